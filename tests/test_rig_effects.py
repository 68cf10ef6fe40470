"""Effects of the rig: never more than their bounds, kept in what is measured with them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from refusals import refused
from simrig.brdf import Lambert, Ward, kurt_material
from simrig.core.effects import Effect, Overrides, Tolerance, parse_tolerance
from simrig.core.errors import SimrigError
from simrig.instruments.instrument import utia
from simrig.plans.along_slices import SlicePlan
from simrig.plans.placement import SlicePlacement
from simrig.rigs.direct.effects import RIG_EFFECT_NAMES, RIG_EFFECTS, plan_directions
from simrig.rigs.direct.gonioreflectometer import Gonioreflectometer
from simrig.rigs.direct.recording import at, averaged, record, within_reach
from simrig.rigs.measurements.measurement import Measurement
from simrig.rigs.tolerances import largest_change, measured_change

TOLERANCES = ("relative=0.01", "dE=0.5", "psnr=45")
UTIA = utia()
PLAN = SlicePlan(SlicePlacement.from_degrees(28.0, 60.0), 1100)
# every effect shows: a spot that reaches the rim, a mirror, few bits and pixels, a large light
HARSH = replace(
    UTIA,
    positioning_deg=0.2,
    light_diameter=90.0,
    aperture_diameter=60.0,
    spot_diameter=28.0,
    sample_diameter=28.5,
    blur_diameter=1.0,
    non_uniformity=0.05,
    mirror_reflectance=0.8,
    mirror_coverage=0.3,
    stray_light=1e-3,
    bits=8,
    saturation=2.0,
    pixels=4,
)


def materials():
    names = ("brushed_aluminium", "yellow_satin", "red_velvet", "fabric112", "wood01")
    narrow = Ward(k_d=(0.01,) * 3, m_x=0.02, m_y=0.02, name="narrow")
    return [*map(kurt_material, names), Lambert((0.5, 0.4, 0.3), name="grey"), narrow]


@pytest.fixture(scope="module")
def measured():
    """Return the directions of an ideal measurement of each material."""
    rig = Gonioreflectometer()
    return [(m, rig.measure(m, PLAN).angles) for m in materials()]


@pytest.fixture(scope="module")
def aluminium(measured):
    return measured[0]


# bounds


@pytest.mark.parametrize("instrument", [UTIA, HARSH], ids=["utia", "harsh"])
def test_no_effect_changes_more_than_its_bound(measured, instrument):
    """At the directions of adaptive measurements, bounds computed at 1024 of them or fewer."""
    broken = []
    for material, angles in measured:
        values = at(material, within_reach(angles))
        changed = {e: record(material, angles, instrument, {e}) for e in RIG_EFFECT_NAMES}
        for text in TOLERANCES:
            tolerance = parse_tolerance(text)
            plan = plan_directions(material, instrument, tolerance, angles)
            for decision in plan.effects:
                change = measured_change(changed[decision.effect], values, angles[:, 0], tolerance)
                if change > decision.bound.value:
                    broken.append((material.name, text, decision.effect, change, decision.bound))
    assert not broken


@pytest.mark.parametrize("text", [*TOLERANCES, "dE=0.1", "relative=0.1"])
def test_a_planned_measurement_is_within_the_tolerance_of_everything(measured, text):
    tolerance = parse_tolerance(text)
    for material, angles in measured:
        plan = plan_directions(material, UTIA, tolerance, angles)
        everything = record(material, angles, UTIA, set(RIG_EFFECT_NAMES))
        planned = record(material, angles, UTIA, set(plan.settings["effects"]))
        change = measured_change(planned, everything, angles[:, 0], tolerance)
        assert change <= tolerance.amount, (material.name, text, change)


def test_bounds_are_no_vacuous_ones(measured):
    """On average they are within a factor of ten of what really changes."""
    tolerance = Tolerance("relative", 0.01)
    ratios = []
    for material, angles in measured:
        values = at(material, angles)
        for decision in plan_directions(material, UTIA, tolerance, angles).effects:
            changed = record(material, angles, UTIA, {decision.effect})
            change = measured_change(changed, values, angles[:, 0], tolerance)
            if change > 1e-9:
                ratios.append(decision.bound.value / change)
    assert len(ratios) > 40
    assert np.exp(np.mean(np.log(ratios))) < 10.0


def test_bounds_at_other_nodes_hold(aluminium):
    """The bound is about the cone, not about the nodes that happen to be simulated."""
    material, angles = aluminium
    tolerance = Tolerance("relative", 0.01)
    values = at(material, angles)
    for effect in RIG_EFFECTS:
        if effect.name in ("light-size", "aperture-size", "spot-size", "fall-off"):
            bound = plan_directions(material, UTIA, tolerance, angles)
            dense = averaged(material, angles[::4], UTIA, {effect.name}, pairs=512)
            change = measured_change(dense, values[::4], angles[::4, 0], tolerance)
            decision = bound.decision(effect.name)
            assert change <= decision.bound.value


def test_effects_have_the_common_interface():
    assert len(set(RIG_EFFECT_NAMES)) == len(RIG_EFFECTS)
    for effect in RIG_EFFECTS:
        assert isinstance(effect, Effect) and effect.description


# the rig


def test_the_default_rig_simulates_nothing(aluminium):
    material, angles = aluminium
    values = Gonioreflectometer().record(material, angles).values
    assert np.array_equal(values, at(material, angles))


def test_everything_at_once_is_finite_and_not_negative(measured):
    for material, angles in measured:
        values = record(material, angles, HARSH, set(RIG_EFFECT_NAMES))
        assert np.all(np.isfinite(values)) and values.min() >= 0.0


def test_an_interrupted_measurement_with_noise_resumes_to_the_same_values(tmp_path):
    material = kurt_material("yellow_satin")
    rig = Gonioreflectometer(instrument=HARSH, effects=RIG_EFFECT_NAMES)
    whole = rig.measure(material, PLAN)

    def interrupt(done: int, total: int) -> None:
        if done > 700:
            raise KeyboardInterrupt

    checkpoint = tmp_path / "checkpoint"
    with pytest.raises(KeyboardInterrupt):
        rig.measure(material, PLAN, checkpoint=checkpoint, progress=interrupt)
    assert checkpoint.exists()
    other = replace(rig, instrument=replace(HARSH, seed=1))
    with pytest.raises(SimrigError, match="unfinished part of another job, with instrument"):
        other.measure(material, PLAN, checkpoint=checkpoint)
    resumed = rig.measure(material, PLAN, checkpoint=checkpoint)
    assert np.array_equal(resumed.values, whole.values)
    assert np.array_equal(resumed.angles, whole.angles)


def test_the_plan_is_kept_in_the_measurement(tmp_path):
    material, rig = kurt_material("brushed_aluminium"), Gonioreflectometer()
    tolerance = Tolerance("dE", 0.5)
    overrides = Overrides(enable=("noise",), disable=("spot-size",))
    planned = rig.planned(material, PLAN, tolerance, overrides)
    plan = planned.effect_plan
    assert plan.on("noise") and not plan.on("spot-size") and plan.on("light-size")
    assert not plan.on("mirror")
    measurement = planned.measure(material, PLAN)
    measurement.save(tmp_path / "m.h5")
    kept = Measurement.load(tmp_path / "m.h5").provenance["effects"]
    assert kept["tolerance"] == "dE=0.5"
    assert [row["effect"] for row in kept["effects"]] == list(RIG_EFFECT_NAMES)
    assert set(kept["effects"][0]) == {"effect", "bound", "on", "why", "cost_s"}
    assert kept["settings"]["effects"] == plan.settings["effects"]


def test_everything_and_unknown_names():
    rig = Gonioreflectometer()
    about = (Lambert(), SlicePlan.for_material(samples=700), Tolerance("relative", 10.0))
    assert rig.planned(*about, Overrides(everything=True)).effects == RIG_EFFECT_NAMES
    assert rig.planned(*about).effects == ()
    refused("did you mean 'noise'", rig.planned, *about, Overrides(enable=("nois",)))
    refused("did you mean 'noise'", Gonioreflectometer, effects=("nois",))


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("light_distance", 0.0, "light_distance must be above 0"),
        ("stray_light", -1.0, "stray_light must be finite"),
        ("positioning_deg", float("nan"), "positioning_deg must be finite"),
        ("spot_diameter", 50.0, "must lie on the sample"),
        ("bits", 0, "at least one bit"),
    ],
)
def test_impossible_instruments_are_refused(field, value, message):
    refused(message, replace, UTIA, **{field: value})


# the units of tolerances


@pytest.mark.parametrize("text", TOLERANCES)
def test_largest_change_is_never_below_what_a_change_amounts_to(text, rng):
    tolerance = parse_tolerance(text)
    values = 10.0 ** rng.uniform(-4.0, 0.5, (300, 3))
    theta_i = rng.uniform(0.0, 1.5, 300)
    for size in (1e-4, 1e-2, 0.5):
        deviation = size * values * rng.uniform(0.0, 1.0, values.shape)
        most = largest_change(values, deviation, theta_i, tolerance)
        for _ in range(20):
            moved = np.maximum(values + deviation * rng.uniform(-1.0, 1.0, values.shape), 0.0)
            assert measured_change(moved, values, theta_i, tolerance) <= most


def test_measured_change_is_delta_e_of_the_displayed_pixels():
    import colour

    values, other = np.array([[0.1, 0.2, 0.05]]), np.array([[0.12, 0.19, 0.07]])
    lab = [
        colour.XYZ_to_Lab(colour.sRGB_to_XYZ(v * np.pi, apply_cctf_decoding=False))
        for v in (values, other)
    ]
    expected = float(np.linalg.norm(lab[0] - lab[1]))
    found = measured_change(values, other, np.zeros(1), Tolerance("dE", 1.0))
    assert found == pytest.approx(expected, rel=2e-3)

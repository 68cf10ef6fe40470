"""Effects of the rig: what they change is what they say, and never more than their bounds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from simrig.directions import to_vector
from simrig.effects import Effect, Overrides, Tolerance, parse_tolerance
from simrig.errors import SimrigError
from simrig.reflectance import Lambert, Ward, kurt_material
from simrig.rigs.chance import normals, uniforms
from simrig.rigs.effects import RIG_EFFECT_NAMES, RIG_EFFECTS, plan_directions
from simrig.rigs.gonioreflectometer import Gonioreflectometer
from simrig.rigs.instrument import UTIA, Instrument
from simrig.rigs.measurement import Measurement
from simrig.rigs.planning import plan_rig, with_plan
from simrig.rigs.recording import (
    at,
    averaged,
    border_share,
    exposure,
    mirror_gain,
    positioning_errors,
    quadrature,
    record,
    within_reach,
)
from simrig.rigs.tolerances import largest_change, measured_change
from simrig.sampling.placement import SlicePlacement

TOLERANCES = ("relative=0.01", "dE=0.5", "psnr=45")
PLACEMENT = SlicePlacement.from_degrees(28.0, 60.0)
SAMPLES = 1100
# every effect shows: a spot that reaches the rim, a mirror, few bits and pixels, a large light
HARSH = Instrument(
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
    return [(m, rig.measure(m, PLACEMENT, SAMPLES).samples.angles) for m in materials()]


@pytest.fixture(scope="module")
def aluminium(measured):
    return measured[0]


def everywhere(count: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    theta = np.arccos(rng.uniform(0.05, 1.0, (count, 2)))
    return np.concatenate([theta, rng.uniform(0.0, 2.0 * np.pi, (count, 2))], axis=1)


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
            (decision,) = (d for d in bound.effects if d.effect == effect.name)
            assert change <= decision.bound.value


def test_effects_have_the_common_interface():
    assert len(set(RIG_EFFECT_NAMES)) == len(RIG_EFFECTS)
    for effect in RIG_EFFECTS:
        assert isinstance(effect, Effect) and effect.description


# what each effect does


def test_quadrature_converges(aluminium):
    material, angles = aluminium
    areas = {"light-size", "aperture-size", "spot-size", "fall-off"}
    dense = averaged(material, angles[::8], UTIA, areas, pairs=2048)
    usual = averaged(material, angles[::8], UTIA, areas)
    assert np.abs(usual - dense).sum() / dense.sum() < 0.004


def test_quadrature_nodes_are_opposite_and_fill_their_discs():
    nodes = quadrature(UTIA, {"light-size", "spot-size"}, pairs=512)
    assert np.array_equal(nodes.light[:512], -nodes.light[512:])
    assert not nodes.lens.any()
    for disc, diameter in ((nodes.light, UTIA.light_diameter), (nodes.spot, UTIA.spot_diameter)):
        radius = np.linalg.norm(disc, axis=1)
        assert radius.max() <= 0.5 * diameter
        # the mean square of a disc's radius is half that of its rim, along any axis a quarter
        assert np.allclose(np.mean(disc**2, axis=0), diameter**2 / 16.0, rtol=0.02)


def test_a_diffuser_does_not_care_about_areas():
    angles = everywhere(200)
    for effect in ("aperture-size", "spot-size", "light-size"):
        values = record(Lambert((0.5, 0.4, 0.3)), angles, UTIA, {effect})
        assert np.allclose(values, np.array([0.5, 0.4, 0.3]) / np.pi, rtol=1e-12)


def test_blunting_of_a_narrow_lobe_follows_its_curvature():
    """Around a maximum, a disc of angular radius r lowers f by r²/8 of each second derivative."""
    material = kurt_material("brushed_aluminium")
    angles = np.array([[0.5, 0.5, 0.0, np.pi]])  # the mirror direction
    small = Instrument(light_diameter=4.0)
    step = 1e-3
    wi = to_vector(angles[:, 0], angles[:, 2])
    up, aside = to_vector(angles[:, 0] - np.pi / 2, angles[:, 2]), np.array([[0.0, 1.0, 0.0]])
    wv = to_vector(angles[:, 1], angles[:, 3])

    def weighted(direction):
        unit = direction / np.linalg.norm(direction, axis=1, keepdims=True)
        return material.eval(unit, wv) * unit[:, 2:]

    curvature = sum(
        (weighted(wi + step * d) - 2.0 * weighted(wi) + weighted(wi - step * d)) / step**2
        for d in (up, aside)
    )
    # less that of the cosine itself, by which the rig divides
    curvature -= -2.0 * material.eval(wi, wv) * wi[:, 2:]
    radius = 0.5 * small.light_diameter / small.light_distance
    expected = at(material, angles) + curvature / wi[:, 2:] * radius**2 / 8.0
    found = averaged(material, angles, small, {"light-size"}, pairs=512)
    lowering = at(material, angles) - found
    assert np.allclose(lowering, at(material, angles) - expected, rtol=0.03)
    assert np.all(lowering > 0.0)


def test_fall_off_of_a_diffuser_follows_the_distance():
    """The mean of (d/d')³ over a spot of radius s: 1 + (3/2)(s/d)²(5/2 sin²θ − 1) + ..."""
    rig = Instrument(non_uniformity=0.0, spot_diameter=60.0, sample_diameter=80.0)
    for theta in (0.0, 0.6, 1.2):
        angles = np.array([[theta, 0.3, 0.0, 1.0]])
        found = averaged(Lambert((1.0,) * 3), angles, rig, {"fall-off"}, pairs=2048)
        ratio = (0.5 * rig.spot_diameter / rig.light_distance) ** 2
        expected = 1.0 + ratio * (15.0 / 8.0 * np.sin(theta) ** 2 - 0.75)
        assert found[0, 0] * np.pi == pytest.approx(expected, abs=2e-6)


def test_non_uniformity_raises_the_mean_by_half():
    rig = Instrument(non_uniformity=0.02, light_distance=1e6)
    found = averaged(Lambert((1.0,) * 3), everywhere(5), rig, {"fall-off"}, pairs=2048)
    assert np.allclose(found * np.pi, 1.01, atol=1e-4)


def test_axes_stop_within_their_accuracy():
    angles = everywhere(500)
    error = np.degrees(positioning_errors(angles, UTIA))
    assert np.abs(error).max() <= 0.03 < 1.05 * np.abs(error).max()
    assert np.abs(error.mean(axis=0)).max() < 0.003
    material = kurt_material("yellow_satin")
    moved = record(material, angles, UTIA, {"positioning"})
    assert np.array_equal(moved, at(material, angles + np.radians(error)))


def test_blur_reaches_the_border_at_a_slant_only():
    rig = Instrument(spot_diameter=29.0, sample_diameter=30.0, blur_diameter=0.5)
    steep, slant = np.array([[0.1, 0.0, 0.0, 0.0]]), np.array([[0.1, 1.4, 0.0, 0.0]])
    assert border_share(steep, rig) == 0.0
    share = border_share(slant, rig)
    assert 0.0 < share < 0.5
    found = record(Lambert((0.9,) * 3), slant, rig, {"lens-blur"})
    border, own = rig.border_reflectance / np.pi, 0.9 / np.pi
    assert np.allclose(found, own + share * (border - own))


def test_a_mirror_adds_what_comes_back():
    """Of a diffuser of albedo a, in a mirror that returns the share s: a²s/π / (1 − a s)."""
    rig = Instrument(mirror_reflectance=0.9, mirror_coverage=0.5)
    added = mirror_gain(Lambert((0.6,) * 3), everywhere(10), rig)
    assert np.allclose(added, 0.36 * 0.45 / np.pi / (1.0 - 0.6 * 0.45), rtol=1e-3)
    assert not mirror_gain(Lambert((0.6,) * 3), everywhere(10), UTIA).any()


def test_stray_light_weighs_more_at_grazing_illumination():
    angles = np.array([[0.0, 0.2, 0.0, 0.0], [1.4, 0.2, 0.0, 0.0]])
    found = record(Lambert((0.0,) * 3), angles, Instrument(stray_light=0.01), {"stray-light"})
    assert np.allclose(found[:, 0], 0.01 / np.pi / np.cos(angles[:, 0]))


# the sensor


def test_exposures_fill_the_sensor_without_saturating():
    angles = everywhere(400)
    values = np.repeat(10.0 ** np.random.default_rng(0).uniform(-3.0, 2.0, (400, 1)), 3, axis=1)
    shot = exposure(values, angles, UTIA)
    steps = values / shot.step
    longest = UTIA.saturation * 2.0**-14.0 / np.cos(angles[:, :1])
    assert np.all(steps <= 2**UTIA.bits)
    assert np.all(steps[values > longest] > 2 ** (UTIA.bits - 1) - 1e-6)


def test_steps_without_noise_and_clipping():
    rig = Instrument(bits=4, saturation=1.0, exposure_range_ev=0.0)
    normal = np.zeros((1, 4))
    for value, expected in ((0.53, 8 / 16), (0.9, 14 / 16), (3.0, 1.0)):
        material = Ward(k_d=(np.pi * value,) * 3, k_s=(0.0,) * 3)
        found = record(material, normal, rig, {"quantisation"})
        assert np.allclose(found, expected, rtol=1e-12)


def test_noise_has_the_deviation_of_its_electrons():
    angles = everywhere(20_000)
    value = 0.3 / np.pi
    found = record(Lambert((0.3,) * 3), angles, UTIA, {"noise"})
    shot = exposure(np.full((len(angles), 3), value), angles, UTIA)
    electrons = value * shot.electrons
    expected = np.sqrt(electrons + UTIA.read_noise**2) / shot.electrons / np.sqrt(UTIA.pixels)
    standard = (found - value) / expected
    assert abs(standard.mean()) < 0.02 and standard.std() == pytest.approx(1.0, rel=0.02)
    assert np.abs(np.corrcoef(standard.T) - np.eye(3)).max() < 0.03


def test_noise_hides_the_steps_of_the_converter():
    """Averaged over pixels whose noise exceeds half a step, rounding no longer shows."""
    angles, rig = everywhere(500), Instrument(bits=12, pixels=10**12)
    value = Lambert((0.3, 0.2, 0.1))
    both = record(value, angles, rig, {"noise", "quantisation"})
    steps = record(value, angles, rig, {"quantisation"})
    exact = at(value, angles)
    assert np.abs(both - exact).max() < 0.05 * np.abs(steps - exact).max()


def test_chance_belongs_to_the_sample():
    angles = everywhere(1000)
    numbers = uniforms(angles, 7, 1, 4)
    order = np.random.default_rng(1).permutation(1000)
    assert np.array_equal(uniforms(angles[order], 7, 1, 4), numbers[order])
    assert np.array_equal(uniforms(angles[:1], 7, 1, 2), numbers[:1, :2])
    for other in (uniforms(angles, 8, 1, 4), uniforms(angles, 7, 2, 4)):
        assert np.abs(np.corrcoef(numbers.ravel(), other.ravel())[0, 1]) < 0.05
    assert numbers.min() > 0.0 and numbers.max() < 1.0
    assert np.allclose(np.histogram(numbers, 8, (0.0, 1.0))[0] / 4000, 0.125, atol=0.02)
    assert normals(angles, 7, 1, 4).std() == pytest.approx(1.0, rel=0.05)
    negative_zero = angles.copy()
    negative_zero[:, 2] = -0.0
    positive_zero = np.abs(negative_zero)
    assert np.array_equal(uniforms(negative_zero, 0, 1, 1), uniforms(positive_zero, 0, 1, 1))


# the rig


def test_the_default_rig_simulates_nothing(aluminium):
    material, angles = aluminium
    values = Gonioreflectometer().measure_directions(material, angles)
    assert np.array_equal(values, at(material, angles))


def test_everything_at_once_is_finite_and_not_negative(measured):
    for material, angles in measured:
        values = record(material, angles, HARSH, set(RIG_EFFECT_NAMES))
        assert np.all(np.isfinite(values)) and values.min() >= 0.0


def test_an_interrupted_measurement_with_noise_resumes_to_the_same_values(tmp_path):
    material = kurt_material("yellow_satin")
    rig = Gonioreflectometer(instrument=HARSH, effects=RIG_EFFECT_NAMES)
    whole = rig.measure(material, PLACEMENT, SAMPLES)

    def interrupt(done: int, total: int) -> None:
        if done > 700:
            raise KeyboardInterrupt

    checkpoint = tmp_path / "checkpoint"
    with pytest.raises(KeyboardInterrupt):
        rig.measure(material, PLACEMENT, SAMPLES, checkpoint=checkpoint, progress=interrupt)
    assert checkpoint.exists()
    other = replace(rig, instrument=replace(HARSH, seed=1))
    with pytest.raises(SimrigError, match="belongs to another measurement"):
        other.measure(material, PLACEMENT, SAMPLES, checkpoint=checkpoint)
    resumed = rig.measure(material, PLACEMENT, SAMPLES, checkpoint=checkpoint)
    assert np.array_equal(resumed.values, whole.values)
    assert np.array_equal(resumed.samples.angles, whole.samples.angles)


def test_the_plan_is_kept_in_the_measurement(tmp_path):
    material, rig = kurt_material("brushed_aluminium"), Gonioreflectometer()
    tolerance = Tolerance("dE", 0.5)
    overrides = Overrides(force=("noise",), without=("spot-size",))
    plan = plan_rig(
        material, rig, tolerance, placement=PLACEMENT, samples=SAMPLES, overrides=overrides
    )
    assert plan.on("noise") and not plan.on("spot-size") and plan.on("light-size")
    assert not plan.on("mirror")
    measurement = with_plan(rig, plan).measure(material, PLACEMENT, SAMPLES)
    measurement.save(tmp_path / "m.h5")
    kept = Measurement.load(tmp_path / "m.h5").provenance["effects"]
    assert kept["tolerance"] == "dE=0.5"
    assert [row["effect"] for row in kept["effects"]] == list(RIG_EFFECT_NAMES)
    assert set(kept["effects"][0]) == {"effect", "bound", "on", "why", "cost_s"}
    assert kept["settings"]["effects"] == plan.settings["effects"]


def test_everything_and_unknown_names():
    material, rig = Lambert(), Gonioreflectometer()
    tolerance = Tolerance("relative", 10.0)
    everything = Overrides(everything=True)
    plan = plan_rig(material, rig, tolerance, samples=700, overrides=everything)
    assert plan.settings["effects"] == list(RIG_EFFECT_NAMES)
    assert plan_rig(material, rig, tolerance, samples=700).settings["effects"] == []
    with pytest.raises(SimrigError, match="did you mean 'noise'"):
        plan_rig(material, rig, tolerance, samples=700, overrides=Overrides(force=("nois",)))
    with pytest.raises(SimrigError, match="did you mean 'noise'"):
        Gonioreflectometer(effects=("nois",))


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
    with pytest.raises(SimrigError, match=message):
        replace(UTIA, **{field: value})


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

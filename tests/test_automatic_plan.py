"""The automatic plan: what the pilot finds, what the plan makes of it, and what it refuses."""

from __future__ import annotations

import json

import numpy as np
import pytest
from odd_materials import HalfAngle, Noisy, OneWay, Rim, Tape, Turned

from command_line import done, refusal, simrig
from simrig.brdf import Lambert, Ward, kurt_material
from simrig.brdf.kriging.displayed import displayed_pairs
from simrig.brdf.kriging.images import mirror_axis
from simrig.brdf.kriging.model import fit_model
from simrig.brdf.kriging.samples import Samples
from simrig.brdf.kriging.symmetry import Symmetry
from simrig.brdf.protocol import Brdf
from simrig.core.errors import SimrigError
from simrig.directions.spherical import to_angles, to_vector
from simrig.front_door.saving import with_hours_saved
from simrig.methods import METHODS
from simrig.plans.auto.batches import travel_order
from simrig.plans.auto.description import describe
from simrig.plans.auto.families import FAMILIES, choose
from simrig.plans.auto.findings import Doubt, findings_of, layout_of
from simrig.plans.auto.pilot import pilot_pairs, pilot_size
from simrig.plans.auto.plan import AutomaticPlan
from simrig.plans.protocol import Recorded
from simrig.reconstruction.kriging import reconstruct_kriging
from simrig.rigs.direct.gonioreflectometer import Gonioreflectometer
from simrig.rigs.measurements.measurement import Measurement

REACH = np.radians(80.0)


def described(brdf: Brdf, samples: int = 6000):
    pilot = pilot_pairs(samples, REACH, REACH)
    return describe(pilot, brdf.eval(pilot.wi, pilot.wv))


def found(measurement: Measurement):
    """Return what the plan of a measurement found."""
    return findings_of(measurement.layout)


def error(brdf: Brdf, made: Brdf) -> float:
    """Return the mean relative error over the 2° grid's angles, in percent."""
    rng = np.random.default_rng(5)
    theta, phi = rng.uniform(0.0, REACH, (2, 3000)), rng.uniform(0.0, 2.0 * np.pi, (2, 3000))
    wi, wv = to_vector(theta[0], phi[0]), to_vector(theta[1], phi[1])
    truth = brdf.eval(wi, wv)
    return float(100.0 * np.mean(np.abs(made.eval(wi, wv) - truth) / truth))


@pytest.mark.parametrize(
    ("samples", "size"), [(16, 8), (30, 15), (100, 50), (300, 60), (2000, 100), (50_000, 300)]
)
def test_a_pilot_is_small(samples, size):
    pilot = pilot_pairs(samples, REACH, REACH)
    assert pilot_size(samples) == len(pilot.wi) == len(pilot.wv) == size
    for v in (pilot.wi, pilot.wv):
        assert np.linalg.norm(v, axis=1) == pytest.approx(1.0)
        assert v[:, 2].min() > np.cos(REACH) - 1e-9


def test_a_pilot_tells_materials_apart():
    lambert, velvet = described(Lambert()), described(kurt_material("purple_satin"))
    assert lambert.symmetry == Symmetry(True, True, True, True)
    assert lambert.width is None
    assert velvet.symmetry == Symmetry(False, True, True, True)
    assert described(OneWay()).symmetry == Symmetry(True, False, True, True)
    turned = described(Turned(kurt_material("purple_satin"), 0.5)).symmetry
    assert turned == Symmetry(False, True, False, True)


def test_a_pilot_tells_what_calls_for_which_family():
    tape, satin = described(Tape()), described(kurt_material("purple_satin"))
    assert [f.name for f in choose(tape).families] == ["isotropic", "retro-reflective"]
    assert [f.name for f in choose(satin).families] == ["anisotropic"]
    assert described(HalfAngle()).bivariate and not described(Rim()).bivariate
    assert described(Rim()).symmetry == Symmetry(True, True, True, True)
    assert not satin.bivariate and not described(OneWay()).bivariate
    for name, family in FAMILIES.items():
        forced = choose(satin, name)
        assert family in forced.families and f"{name} (as you wished)" in forced.why
    assert choose(satin, "retro-reflective").symmetry == satin.symmetry
    assert choose(satin, "retro-reflective").shares.back > choose(satin).shares.back


def test_quantities_of_a_pilot_have_honest_uncertainties():
    bodies, noises = [], []
    for seed in range(12):  # other directions, other noise
        pilot = pilot_pairs(4000, REACH, REACH, seed)
        seen = describe(pilot, Noisy(Lambert((0.3,) * 3), 0.05).eval(pilot.wi, pilot.wv))
        said = {quantity.name: quantity for quantity in seen.quantities()}
        assert said["highlight, half width"].value is None
        body, noise = said["body, median"], said["noise of the rig"]
        bodies.append((body.value - 0.3 / np.pi) / body.uncertainty)
        noises.append((noise.value - 5.0) / noise.uncertainty)
    for scores in np.abs([bodies, noises]):  # of 12, some 8 within one and 11 within two
        assert np.sum(scores < 2.0) >= 9 and np.sum(scores > 0.3) >= 4


def test_noise_is_seen_and_not_taken_for_anisotropy():
    seen = described(Noisy(Lambert(), 0.05))
    assert seen.noise == pytest.approx(0.05, rel=0.6)
    assert seen.symmetry.isotropic
    assert seen.symmetry.reciprocal


@pytest.mark.parametrize("samples", [1000, 6000])
def test_errors_of_the_rig_are_not_taken_for_asymmetry(samples):
    glossy = Ward(m_x=0.03, m_y=0.03)
    pilot = pilot_pairs(samples, REACH, REACH)
    (theta_i, phi_i), (theta_v, phi_v) = to_angles(pilot.wi), to_angles(pilot.wv)
    angles = np.stack([theta_i, theta_v, phi_i, phi_v], axis=1)
    rig = Gonioreflectometer(effects=("positioning", "noise", "quantisation"))
    seen = describe(pilot, rig.record(glossy, angles).values).symmetry
    assert seen == Symmetry(True, True, True, True)


def test_travel_is_shorter_in_order():
    rng = np.random.default_rng(0)
    theta, phi = rng.uniform(0.0, REACH, (2, 300)), rng.uniform(0.0, 2.0 * np.pi, (2, 300))
    wi, wv = to_vector(theta[0], phi[0]), to_vector(theta[1], phi[1])
    order = travel_order(wi, wv)
    assert sorted(order) == list(range(300))

    def way(along):
        turns = np.abs(np.diff(np.concatenate([theta, phi])[:, along], axis=1))
        turns[2:] = np.minimum(turns[2:], 2.0 * np.pi - turns[2:])
        return turns.max(axis=0).sum()

    assert way(order) < 0.5 * way(np.arange(300))


@pytest.mark.parametrize("samples", [16, 30])
def test_small_budgets_are_kept_exactly(samples):
    measured = Gonioreflectometer().measure(kurt_material("wood01"), AutomaticPlan(samples))
    assert len(measured.values) == samples == measured.cost.samples
    made = reconstruct_kriging(measured).brdf
    assert error(kurt_material("wood01"), made) < 60.0


@pytest.mark.slow
def test_anisotropic_materials_are_measured_well(tmp_path):
    satin = kurt_material("purple_satin")
    measured = Gonioreflectometer().measure(satin, AutomaticPlan(600))
    made = reconstruct_kriging(measured)
    assert error(satin, made.brdf) < 3.0
    assert "anisotropic" in made.notes[0]
    measured.save(tmp_path / "m.h5")
    again = Measurement.load(tmp_path / "m.h5")
    assert found(again).symmetry == Symmetry(False, True, True, True)


@pytest.mark.slow
def test_retro_reflection_is_found_and_kept():
    tape = Tape()
    assert described(tape).retro > 100.0
    measured = Gonioreflectometer().measure(tape, AutomaticPlan(500))
    made = reconstruct_kriging(measured).brdf
    theta = np.radians([[20.0, 20.0], [19.0, 21.0], [50.0, 50.0], [30.0, 60.0]])
    wi, wv = to_vector(theta[:, 0], 0.3), to_vector(theta[:, 1], 0.3)
    assert made.eval(wi, wv) == pytest.approx(tape.eval(wi, wv), rel=0.2)


def test_a_pilot_that_was_wrong_is_overruled():
    satin = kurt_material("purple_satin")

    class Deceived(AutomaticPlan):
        """A plan whose pilot sees a diffuse material."""

        def batches(self):
            work = super().batches()
            seen = yield next(work)
            grey = np.full_like(seen.values, seen.values.mean())
            seen = Recorded(grey)
            while True:
                try:
                    seen = yield work.send(seen)
                except StopIteration as end:
                    return end.value

        def within(self, theta_max):
            return self

    findings = found(Gonioreflectometer().measure(satin, Deceived(800)))
    assert findings.symmetries[0][1].isotropic
    assert not findings.symmetry.isotropic
    assert "then anisotropic" in findings.why() and "each left out" in findings.why()


def test_a_wished_family_that_does_not_suit_is_measured_and_doubted():
    satin = kurt_material("purple_satin")
    measured = Gonioreflectometer().measure(satin, AutomaticPlan(150, family="isotropic"))
    told = measured.provenance["found"]
    assert found(measured).symmetry.isotropic and told["families"] == ["isotropic"]
    assert "isotropic (as you wished)" in told["why"]
    (warning,) = told["warnings"]
    assert "better as anisotropic" in warning and warning in told["why"]
    assert told["predicted_delta_e"] > 2.0  # and what it expects is no better than it is
    assert warning in " ".join(reconstruct_kriging(measured).notes)


def test_two_angles_are_measured_where_they_suffice(tmp_path):
    measured = Gonioreflectometer().measure(HalfAngle(), AutomaticPlan(120))
    told = measured.provenance["found"]
    assert told["families"] == ["bivariate"] and "each left out" in told["why"]
    made = reconstruct_kriging(measured).brdf
    assert error(HalfAngle(), made) < 1.0
    measured.save(tmp_path / "m.h5")
    again = Measurement.load(tmp_path / "m.h5")
    assert found(again).symmetry.bivariate and again.provenance["found"] == told
    quantities = {quantity["name"]: quantity for quantity in told["pilot"]}
    assert quantities["highlight, half width"]["uncertainty"] > 0.0
    assert json.loads(json.dumps(told, allow_nan=False)) == told


def test_main_axes_are_found_at_any_azimuth():
    """By left-out samples: the pilot looks for a mirror at azimuth 0 only."""
    turn = np.radians(29.0)
    turned = Turned(kurt_material("yellow_satin"), turn)
    rig, plan = Gonioreflectometer(), AutomaticPlan(400, REACH, REACH)
    symmetry = found(rig.measure(turned, plan)).symmetry
    assert symmetry.mirror
    assert symmetry.half_turn  # so that there is a second plane beside the first
    off = np.mod(symmetry.axis - turn + 0.25 * np.pi, 0.5 * np.pi) - 0.25 * np.pi
    assert abs(off) < np.radians(1.0)


def test_an_axis_is_an_azimuth_and_not_one_from_that_of_the_model():
    turned = Turned(kurt_material("fabric112"), 0.5)
    wi, wv = displayed_pairs(300, REACH, REACH, 4)
    samples = Samples.of(wi, wv, turned.eval(wi, wv), REACH, REACH)
    for axis in (0.0, 1.3):
        symmetry = Symmetry(reciprocal=True, half_turn=True, axis=axis)
        model = fit_model(samples, symmetry)
        assert np.mod(mirror_axis(model), 0.5 * np.pi) == pytest.approx(0.5, abs=0.02)


def test_it_stops_when_it_is_good_enough():
    measured = Gonioreflectometer().measure(kurt_material("wood01"), AutomaticPlan(4000, until=1.0))
    findings = found(measured)
    assert len(measured.values) < 2000
    assert findings.predicted_delta_e <= 1.0
    assert findings.predictions[-1][0] == len(measured.values)


def test_an_interrupted_measurement_goes_on_with_the_same_result(tmp_path):
    checkpoint = tmp_path / "c.h5"
    plan, wood = AutomaticPlan(60), kurt_material("wood01")
    rig = Gonioreflectometer()
    whole = rig.measure(wood, plan)

    def stop(done, total):
        if done > 35:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        rig.measure(wood, plan, checkpoint=checkpoint, progress=stop)
    assert checkpoint.exists()
    resumed = rig.measure(wood, plan, checkpoint=checkpoint)
    assert np.array_equal(resumed.values, whole.values)
    assert np.array_equal(resumed.angles, whole.angles)
    assert not checkpoint.exists()


def test_findings_survive_as_arrays_and_damaged_ones_are_refused():
    taken = [(60, Symmetry(True, False, True, True)), (200, Symmetry(axis=0.3))]
    layout = layout_of(taken, [(60, 3.0), (200, 1.5)])
    again = findings_of(layout)
    assert again.symmetries == tuple(taken)
    before = findings_of({**layout, "symmetries": layout["symmetries"][:, :6]})
    assert before.symmetries == tuple(taken)  # of files that knew no bivariate family
    bivariate = Symmetry(True, True, True, True, bivariate=True)
    doubts = [Doubt(90, bivariate, 0.5)]
    assert findings_of(layout_of([(60, bivariate)], [(60, 3.0)], doubts)).doubts == tuple(doubts)
    with pytest.raises(SimrigError, match="cannot be"):
        findings_of(layout_of(taken, [(60, 3.0)], [Doubt(90, bivariate, 0.0)]))
    assert again.predicted_delta_e == 1.5
    low, high = again.likely_delta_e
    assert low < 1.5 < high
    for name, wrong in (("symmetries", np.zeros((1, 2))), ("predicted_delta_e", np.zeros(3))):
        with pytest.raises(SimrigError, match="does not say"):
            findings_of({**layout, name: wrong})
    with pytest.raises(SimrigError, match="not finite"):
        findings_of({**layout, "predicted_delta_e": np.full((1, 2), np.nan)})


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"samples": 3}, "too few"),
        ({"samples": 10**9}, "at most 50,000"),
        ({"samples": 100, "until": 0.0}, "above 0"),
        ({"samples": 100, "until": float("nan")}, "above 0"),
        ({"samples": 100, "theta_i_max": 2.0}, "between 0 and 90"),
        ({"samples": 100, "family": "isotropc"}, "did you mean 'isotropic'"),
    ],
)
def test_plans_that_cannot_be_are_refused(arguments, message):
    with pytest.raises(SimrigError, match=message):
        AutomaticPlan(**arguments)


@pytest.mark.slow
def test_real_materials_need_fewer_samples_than_slices(shared_data):
    from simrig.files.load import load_material

    truth = load_material(shared_data("rgl/vch_golden_yellow_rgb.bsdf"))
    auto, slices = (METHODS[name].run(truth, 1000) for name in ("auto", "slices"))
    rng = np.random.default_rng(5)
    theta, phi = (
        np.arcsin(np.sqrt(rng.uniform(0, 0.96, (2, 4000)))),
        rng.uniform(0, 6.28, (2, 4000)),
    )
    wi, wv = to_vector(theta[0], phi[0]), to_vector(theta[1], phi[1])
    expected = np.cbrt(truth.eval(wi, wv))
    off = [np.abs(np.cbrt(made.brdf.eval(wi, wv)) - expected).mean() for made in (auto, slices)]
    assert off[0] < 0.2 * off[1]


@pytest.mark.usefixtures("in_empty_folder")
def test_the_command_stops_in_time_and_says_what_that_saved():
    wished = ("measure", "wood01", "--ideal", "-n", "900", "--until", "dE=3")
    data = done(*wished)
    assert data["output"] == "wood01-measurement.h5"
    assert data["plan"] == "auto" and data["cost"]["samples"] < 900
    saved = data["found"]["saved"]
    spent = data["cost"]["hardware_seconds"] / 3600.0
    assert saved["hours"] == pytest.approx(spent)
    assert saved["saved_hours"] == pytest.approx(saved["budget_hours"] - spent) and spent > 0.0
    rival = saved["slices"]
    assert rival["samples"] == 1060 and rival["reached"] and rival["delta_e"] <= 3.0
    assert rival["saved_hours"] == pytest.approx(rival["hours"] - spent)
    assert Measurement.load(data["output"]).provenance["found"] == data["found"]
    text = " ".join(simrig(*wished, "--overwrite").stdout.split())
    for part in ("saved", "against adaptive slices", "family: anisotropic", "noise of the rig"):
        assert part in text
    facts = done("info", data["output"])["facts"]
    assert facts["found, 1"].startswith("family: anisotropic")


@pytest.mark.usefixtures("in_empty_folder")
def test_goals_and_families_that_cannot_be_are_refused():
    measure = ("measure", "wood01", "--output", "m.h5")
    assert "write dE=1, not psnr=40" in refusal(*measure, "--until", "psnr=40")
    assert "is no tolerance" in refusal(*measure, "--until", "nan")
    assert "tolerance" in refusal(*measure, "--until", "dE=-1")
    assert "'isotropic'" in refusal(*measure, "--family", "isotropc")
    assert "slices has no --until, auto has" in " ".join(
        refusal(*measure, "--plan", "slices", "--until", "dE=1").replace("'", "").split()
    )


def test_a_measurement_that_predicts_nothing_or_too_much_saves_nothing():
    rig = Gonioreflectometer()
    far = rig.measure(kurt_material("wood01"), AutomaticPlan(30, until=1e-6))
    told = with_hours_saved(far, rig).provenance["found"]
    assert told["saved"]["reached"] is False and told["saved"]["saved_hours"] == 0.0
    assert any(line.startswith("saved nothing: with 30 of 30 samples") for line in told["lines"])
    plan = METHODS["regular-grid"].plan(None, 60)
    with pytest.raises(SimrigError, match="predicts no error"):
        with_hours_saved(rig.measure(Lambert(), plan), rig)

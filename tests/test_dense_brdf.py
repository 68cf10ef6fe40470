"""The plan of a large flat sample, and the bins that its samples fall into (thesis section 4.3)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from odd_materials import OneWay

from command_line import done, refusal
from refusals import refused
from simrig.brdf import Lambert, kurt_material
from simrig.directions import to_vector
from simrig.evaluation.studies import STUDIES
from simrig.evaluation.studies.dense_brdf import PRESETS
from simrig.methods import METHODS
from simrig.plans.large_sample import LargeSamplePlan
from simrig.plans.listed import Directions
from simrig.reconstruction.scattered.dense_bins import reconstruct_dense_bins
from simrig.reconstruction.scattered.pull_push import fill
from simrig.rigs.direct.recording import at
from simrig.rigs.measurements.measurement import Measurement
from simrig.rigs.registry import make_rig

SMALL = LargeSamplePlan(centres="5", spacing_mm=70.0, oblique_azimuths=8)


def test_the_numbers_of_the_thesis() -> None:
    plan = LargeSamplePlan()
    assert plan.pictures_taken == 8505  # 81 × 81 and 24 × 81
    assert len(plan.points) == 1225 and np.hypot(*plan.points.T).max() <= 277.0
    poses = plan.poses[6561:]
    np.testing.assert_allclose(np.degrees(poses[:, 0]), 85.0)
    assert len(np.unique(np.round(np.degrees(poses[:, 2]), 6))) == 24
    rig = make_rig("utia-large")
    assert rig.seconds(plan, np.empty((10_418_625, 0))) == rig.seconds(  # type: ignore[arg-type]
        Directions(plan.poses), plan.poses
    )


def test_a_rig_of_one_value_for_each_picture_refuses_the_plan() -> None:
    rig = make_rig("imaging", transparent=True)
    refused("reads many in each", rig.measure, Lambert(), SMALL)


def test_fewer_samples_are_fewer_pictures_of_fewer_points() -> None:
    found = [LargeSamplePlan.for_material(samples=n) for n in (841, 8911, 10_418_625)]
    assert [plan.pictures_taken for plan in found] == [841, 841, 8505]
    assert all(p.samples <= n for p, n in zip(found, (841, 8911, 10_418_625), strict=True))
    refused("too few", LargeSamplePlan.for_material, samples=840)
    refused("contradict", LargeSamplePlan.for_material, samples=9000, spacing_mm=20.0)


def test_points_see_light_and_camera_where_they_are() -> None:
    angles = np.concatenate(list(SMALL.batches()))
    assert len(angles) == SMALL.samples
    places, points = SMALL.places(), SMALL.points
    shots = np.array([SMALL.shots(n + 1) - 1 for n in range(0, len(angles), 997)])
    for n, shot in zip(range(0, len(angles), 997), shots, strict=True):
        theta_i, theta_v, phi_i, phi_v = SMALL.poses[shot]
        point = np.append(points[places[n]], 0.0)
        for at_theta, at_phi, distance, own in (
            (theta_i, phi_i, SMALL.light_mm, angles[n, [0, 2]]),
            (theta_v, phi_v, SMALL.camera_mm, angles[n, [1, 3]]),
        ):
            ray = distance * to_vector(at_theta, at_phi) - point
            found = to_vector(own[0], own[1])
            np.testing.assert_allclose(found, ray / np.linalg.norm(ray), atol=1e-12)
    assert SMALL.shots(0) == 0 and SMALL.shots(SMALL.samples) == SMALL.pictures_taken
    assert np.degrees(SMALL.theta_max) <= 87.0


def test_a_table_without_holes_is_left_as_it_is_and_a_plane_is_kept() -> None:
    shape = (12, 12, 8, 8)
    table = np.random.default_rng(0).random((*shape, 3)).astype(np.float32)
    one = np.ones(shape, np.float32)
    assert np.array_equal(fill(table.copy(), one, (False, False, True, True)), table)
    level = np.full((*shape, 3), 0.25, np.float32)
    for share in (0.5, 0.02, 1e-9):  # the last leaves one bin
        known = (np.random.default_rng(1).random(shape) < share).astype(np.float32)
        known[3, 4, 5, 6] = 1.0
        made = fill(level * known[..., None], known, (False, False, True, True))
        np.testing.assert_allclose(made, 0.25, rtol=1e-5)
    ramp = np.broadcast_to(np.arange(12.0)[:, None, None, None, None], level.shape)
    known = (np.random.default_rng(2).random(shape) < 0.3).astype(np.float32)
    made = fill((ramp * known[..., None]).astype(np.float32), known, (False, False, True, True))
    inside = np.abs(made - ramp)[2:-2]
    assert inside.mean() < 0.2 and made.min() >= 0.0 and made.max() <= 11.0


def test_bins_hold_medians_and_are_reciprocal_only_where_the_samples_are() -> None:
    rig = make_rig("utia-large")
    grey = Lambert((0.3, 0.2, 0.1), "grey")
    made = reconstruct_dense_bins(rig.measure(grey, SMALL), 10.0)
    values = made.brdf.values  # type: ignore[attr-defined]
    np.testing.assert_allclose(values - np.array([0.3, 0.2, 0.1]) / np.pi, 0.0, atol=1e-5)
    assert "both orders" in made.notes[1]
    odd = rig.measure(OneWay(), SMALL)
    made = reconstruct_dense_bins(odd, 10.0)
    assert "as measured" in made.notes[1]
    pair = np.radians([[60.0, 20.0, 0.0, 90.0], [20.0, 60.0, 90.0, 0.0]])
    np.testing.assert_allclose(at(made.brdf, pair), at(OneWay(), pair), rtol=0.03)
    # one sample in fifty is wild: medians do not see it
    found = rig.measure(grey, SMALL)
    wild = found.values.copy()
    wild[::50] *= 100.0
    from dataclasses import replace

    made = reconstruct_dense_bins(replace(found, values=wild), 30.0)
    np.testing.assert_allclose(np.median(made.brdf.values / (0.3, 0.2, 0.1)), 1 / np.pi, rtol=1e-2)  # type: ignore[attr-defined]


def test_more_points_of_the_same_pictures_are_worth_more_than_their_centres() -> None:
    material, rig = kurt_material("fabric112"), make_rig("utia-large")
    plan = LargeSamplePlan(centres="12", spacing_mm=60.0, oblique_azimuths=8)
    dense = METHODS["dense-bins"].reconstruct(rig.measure(material, plan), step_deg=6.0)
    sparse = METHODS["rbf-local"].reconstruct(rig.measure(material, Directions(plan.poses)))
    rng = np.random.default_rng(0)
    angles = np.column_stack([rng.uniform(0.1, 1.2, (2000, 2)), rng.uniform(0, 6.28, (2000, 2))])
    truth = at(material, angles)
    error = [np.median(np.abs(at(m.brdf, angles) / truth - 1.0)) for m in (dense, sparse)]
    assert error[0] < 0.6 * error[1]


@pytest.mark.parametrize("value", [0.0, 1e-30, 1e6])
def test_black_and_bright_samples_stay_finite(value: float) -> None:
    found = make_rig("utia-large").measure(Lambert((0.5, 0.5, 0.5), "grey"), SMALL)
    values = np.full_like(found.values, value)
    one = Measurement(found.angles[:1], values[:1], "one", found.cost, Directions(found.angles[:1]))
    for measured in (one, Measurement(found.angles, values, "all", found.cost, found.plan)):
        table = reconstruct_dense_bins(measured, 30.0).brdf.values  # type: ignore[attr-defined]
        assert np.all(np.isfinite(table)) and np.all(table >= 0.0)
        np.testing.assert_allclose(table, value, rtol=1e-3, atol=1e-30)


def test_what_cannot_be_is_refused() -> None:
    for words, options in (
        ("too large beside light", {"radius_mm": 700.0}),
        ("at most 50,000,000", {"spacing_mm": 2.0}),
        ("above 0 mm", {"camera_mm": float("nan")}),
        ("unknown scheme", {"centres": "82x82"}),
    ):
        refused(words, LargeSamplePlan, **options)
    grey = Lambert((0.5, 0.5, 0.5), "grey")
    refused("the sample of", make_rig("utia").measure, grey, SMALL)
    near = LargeSamplePlan(centres="5", spacing_mm=70.0, light_mm=1000.0)
    refused("give --light", make_rig("utia-large").measure, grey, near)
    found = make_rig("utia-large").measure(grey, SMALL)
    refused("must divide 360", reconstruct_dense_bins, found, 7.0)
    refused("no table that can be held", reconstruct_dense_bins, found, 0.5)
    flat = make_rig("utia").measure(grey, Directions(np.radians([[89.0, 0.0, 0.0, 0.0]])))
    refused("measure steeper", reconstruct_dense_bins, flat)


def test_measured_and_reconstructed_on_the_command_line(tmp_path: Path) -> None:
    measured, table = tmp_path / "m.h5", tmp_path / "t.h5"
    small = ("--centres", "5", "--spacing", "140", "--oblique-azimuths", "0")
    done(
        "measure", "lambert", "--rig", "utia-large", "--plan", "large-sample", *small,
        "--ideal", "-o", measured,
    )  # fmt: skip
    done("reconstruct", measured, "--method", "dense-bins", "--step", "15", "-o", table)
    assert "dense" in str(done("info", table))
    assert "the sample of" in refusal("measure", "lambert", "--plan", "large-sample", *small)


@pytest.mark.slow
def test_the_study_compares_ways_of_equal_hours(tmp_path: Path) -> None:
    study = STUDIES["dense-brdf"]
    config = {**PRESETS["quick"], "ways": ["dense bins", "rbf-local"]}
    rows = [{**c, **row} for c in study.cells(config) for row in study.run_cell(config, c)]
    summary = study.summarise(config, rows)
    dense, sparse = summary["rows"]
    assert dense["hours"] == sparse["hours"] and dense["samples"] > 40 * sparse["samples"]
    assert dense["delta_e"] < sparse["delta_e"]
    assert [p.name for p in study.plots(summary, rows, tmp_path)] == [
        "subspaces.png",
        "spheres.png",
    ]

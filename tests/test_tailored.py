"""The plan that is tailored to highlights: where its samples lie, what it refuses."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from simrig.brdf import kurt_material
from simrig.core.errors import SimrigError
from simrig.directions.spherical import to_vector
from simrig.plans.along_slices import SlicePlan
from simrig.plans.registry import make_plan
from simrig.plans.tailored import TailoredPlan
from simrig.rigs.direct.gonioreflectometer import Gonioreflectometer
from simrig.rigs.measurements.store import load_measurement, save_measurement


def test_samples_are_denser_on_the_highlight_and_leave_no_hole() -> None:
    plan = TailoredPlan(1025, (30.0,), (20.0,), np.radians(80.0))
    angles = plan.angles()
    assert angles.shape == (1025, 4) == (plan.samples, 4)
    assert angles[:, :2].max() <= np.radians(80.0)
    assert np.array_equal(angles, plan.angles())

    def on_highlight(pairs: np.ndarray) -> float:
        half = to_vector(pairs[:, 0], pairs[:, 2]) + to_vector(pairs[:, 1], pairs[:, 3])
        away = (np.degrees(np.arctan2(half[:, 1], half[:, 0])) - 30.0 + 90.0) % 180.0 - 90.0
        steep = np.arctan2(np.hypot(half[:, 0], half[:, 1]), half[:, 2])
        return float(np.mean((np.abs(away) < 10.0) & (steep < 0.4)))

    def places(pairs: np.ndarray) -> np.ndarray:
        return np.concatenate([to_vector(pairs[:, k], pairs[:, k + 2]) for k in (0, 1)], axis=1)

    u = np.random.default_rng(3).random((1025, 4))
    thetas = np.arccos(1.0 - u[:, :2] * (1.0 - np.cos(plan.theta_max)))
    chance = np.concatenate([thetas, 2.0 * np.pi * u[:, 2:]], axis=1)
    assert on_highlight(angles) > 1.5 * on_highlight(chance)
    both = np.concatenate([angles, angles[:, [1, 0, 3, 2]]])
    other = np.concatenate([chance, chance[:, [1, 0, 3, 2]]])
    wanted = places(chance[::3] + 1e-3)
    holes = [cKDTree(places(own)).query(wanted, k=3)[0][:, 2].max() for own in (both, other)]
    assert holes[0] < 0.9 * holes[1]


@pytest.mark.parametrize("theta_max_deg", [1e-12, 1e-3, 1.0, 20.0, 89.9])
def test_a_low_end_leaves_samples_of_every_kind(theta_max_deg: float) -> None:
    """Half vectors far below that end would never give a pair."""
    end = np.radians(theta_max_deg)
    angles = TailoredPlan(200, (0.0, 90.0), (20.0, 180.0), end).angles()
    assert angles.shape == (200, 4) and angles[:, :2].max() <= end
    assert angles[:, :2].max() > 0.5 * end
    assert len(np.unique(angles, axis=0)) == 200


def test_stored_and_restored(tmp_path) -> None:
    material = kurt_material("fabric112")
    plan = make_plan("tailored", material, samples=60, axes="0,90", widths="30,60")
    measured = Gonioreflectometer().measure(material, plan)
    save_measurement(tmp_path / "m.h5", measured)
    again = load_measurement(tmp_path / "m.h5")
    assert np.array_equal(again.angles, plan.angles())
    assert again.plan.describe() == plan.describe()


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({}, "needs --axes"),
        ({"axes": "3,x"}, "numbers with commas"),
        ({"axes": "3,4", "widths": "10"}, "width for each"),
        ({"axes": "nan"}, "finite"),
        ({"axes": "3", "widths": "0"}, "between 0 and 180"),
        ({"axes": "3", "samples": 3}, "at least|from 20"),
    ],
)
def test_impossible_plans_are_refused(options: dict, says: str) -> None:
    with pytest.raises(SimrigError, match=says):
        make_plan("tailored", None, **options)


@pytest.mark.parametrize(
    ("samples", "axes", "steps"),
    [(1034, "30", (20, 60)), (3230, "30,120", (20, 36)), (1034, "none", (16, 180))],
)
def test_slices_follow_what_a_picture_shows(samples: int, axes: str, steps: tuple) -> None:
    plan = make_plan("tailored-slices", None, samples=samples, axes=axes)
    assert type(plan) is SlicePlan and plan.samples == samples
    e_s, a_s = np.degrees([plan.placement.theta_step, plan.placement.azimuth_step])
    assert (e_s, a_s) == pytest.approx(steps)
    assert plan.placement.intersections <= samples


@pytest.mark.parametrize(
    ("options", "says"), [({}, "needs --axes"), ({"axes": "x"}, "commas"),
                          ({"axes": "3", "samples": 20}, "too few")],
)  # fmt: skip
def test_impossible_tailored_slices_are_refused(options: dict, says: str) -> None:
    with pytest.raises(SimrigError, match=says):
        make_plan("tailored-slices", None, **options)

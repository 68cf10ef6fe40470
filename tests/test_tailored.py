"""The plan that is tailored to highlights: where its samples lie, what it refuses."""

from __future__ import annotations

import numpy as np
import pytest

from simrig.brdf import kurt_material
from simrig.core.errors import SimrigError
from simrig.directions.spherical import to_vector
from simrig.plans.registry import make_plan
from simrig.plans.tailored import TailoredPlan
from simrig.rigs.direct.gonioreflectometer import Gonioreflectometer
from simrig.rigs.measurements.store import load_measurement, save_measurement


def test_samples_lie_along_the_axis() -> None:
    plan = TailoredPlan(1025, (30.0,), (20.0,), np.radians(80.0))
    angles = plan.angles()
    assert angles.shape == (1025, 4) == (plan.samples, 4)
    assert angles[:, :2].max() <= np.radians(80.0)
    along = angles[-250:]
    half = to_vector(along[:, 0], along[:, 2]) + to_vector(along[:, 1], along[:, 3])
    away = (np.degrees(np.arctan2(half[:, 1], half[:, 0])) - 30.0 + 90.0) % 180.0 - 90.0
    assert np.median(np.abs(away)) == pytest.approx(0.6745 * 20.0 / 2.355, abs=1.0)
    assert np.array_equal(angles, plan.angles())


@pytest.mark.parametrize("theta_max_deg", [1e-12, 1e-3, 1.0, 20.0, 89.9])
def test_a_low_end_leaves_samples_of_every_kind(theta_max_deg: float) -> None:
    """Half vectors far below that end would never give a pair."""
    end = np.radians(theta_max_deg)
    angles = TailoredPlan(200, (0.0, 90.0), (20.0, 180.0), end).angles()
    assert angles.shape == (200, 4) and angles[:, :2].max() <= end
    assert angles[150:, :2].max() > 0.5 * end


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

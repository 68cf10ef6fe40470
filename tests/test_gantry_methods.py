"""The gantry in the registry of methods."""

from __future__ import annotations

import numpy as np
import pytest

from refusals import refused
from simrig.brdf import Lambert, kurt_material
from simrig.core.effects import Tolerance
from simrig.core.errors import SimrigError
from simrig.methods import method
from simrig.plans.along_slices import SlicePlan
from simrig.plans.gantry import GantryPlan
from simrig.rigs.direct.gonioreflectometer import Gonioreflectometer
from simrig.rigs.gantry.rig import Gantry


def test_gantry_method_takes_at_most_the_samples_and_minutes_not_hours():
    result = method("gantry-b").run(kurt_material("wood01"), 170)
    assert result.samples == 168
    assert result.hardware_seconds == pytest.approx(360.0)
    assert result.bytes == result.brdf.values.nbytes
    assert "polar angles 30°, 75°" in result.notes[0] and "'sum'" in result.notes[1]


@pytest.mark.parametrize("name", ["gantry-a", "gantry-b", "gantry-bd"])
def test_fewer_samples_than_the_least_are_refused(name):
    with pytest.raises(SimrigError, match="at least 32"):
        method(name).run(kurt_material("wood01"), method(name).least_samples - 1)


def test_a_gantry_simulates_no_effects_and_takes_no_other_plan():
    refused("no effects", Gantry().measure, Lambert(), tolerance=Tolerance("dE", 0.5))
    with pytest.raises(SimrigError, match="use plan 'gantry' or another rig"):
        Gantry().measure(Lambert(), SlicePlan.for_material(samples=700))


def test_another_rig_takes_the_plan_of_a_gantry_sample_by_sample():
    rig, plan = Gonioreflectometer(), GantryPlan()
    found = rig.measure(kurt_material("wood01"), plan)
    np.testing.assert_array_equal(found.values, Gantry().measure(kurt_material("wood01")).values)
    assert found.cost.hardware_seconds == rig.timing.seconds(168, adaptive=False)
    assert method("gantry-b").reconstruct(found).brdf.theta_max == pytest.approx(plan.theta_max)

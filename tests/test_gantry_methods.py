"""The gantry in the registry of methods."""

from __future__ import annotations

import pytest

from simrig.brdf import kurt_material
from simrig.core.errors import SimrigError
from simrig.methods import method
from simrig.rigs.direct.gonioreflectometer import Gonioreflectometer


def test_gantry_method_takes_at_most_the_samples_and_minutes_not_hours():
    result = method("gantry_b").run(Gonioreflectometer(), kurt_material("wood01"), 170)
    assert result.samples == 168
    assert result.hardware_seconds == pytest.approx(360.0)
    assert result.bytes == result.brdf.values.nbytes
    assert "polar angles 30°, 75°" in result.notes[0] and "'sum'" in result.notes[1]


@pytest.mark.parametrize("name", ["gantry_a", "gantry_b", "gantry_bd"])
def test_fewer_samples_than_the_least_are_refused(name):
    with pytest.raises(SimrigError, match="at least 32"):
        method(name).run(
            Gonioreflectometer(), kurt_material("wood01"), method(name).least_samples - 1
        )


def test_a_rig_with_effects_is_refused():
    rig = Gonioreflectometer(effects=("noise",))
    with pytest.raises(SimrigError, match="no effects"):
        method("gantry_b").run(rig, kurt_material("wood01"), 168)

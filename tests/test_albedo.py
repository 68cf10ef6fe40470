"""The directional albedo, against closed forms and against its own limit."""

from __future__ import annotations

import numpy as np
import pytest

from simrig.brdf import KURT_MATERIALS, Lambert, kurt_material
from simrig.core.errors import SimrigError


def test_lambert_gives_back_its_albedo_from_everywhere() -> None:
    colour = (0.0, 0.25, 1.0)
    for theta_v in np.radians([0.0, 45.0, 89.9]):
        albedo = Lambert(colour).directional_albedo(theta_v, 1.0)
        np.testing.assert_allclose(albedo, colour, rtol=1e-12, atol=0.0)


@pytest.mark.parametrize("name", KURT_MATERIALS)
def test_the_nodes_are_enough_for_every_built_in_material(name: str) -> None:
    material = kurt_material(name)
    theta_v = np.radians(80.0)
    finer = material.directional_albedo(theta_v, 0.3, thetas=512, azimuths=1024)
    np.testing.assert_allclose(material.directional_albedo(theta_v, 0.3), finer, rtol=3e-3)


def test_a_view_below_the_horizon_is_refused() -> None:
    with pytest.raises(SimrigError, match=r"theta_v must lie in \[0, 90\) degrees, got 95"):
        Lambert().directional_albedo(np.radians(95.0))

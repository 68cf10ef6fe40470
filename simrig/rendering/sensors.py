"""The sensors of a loaded scene."""

from __future__ import annotations

from typing import Any

from simrig.core.errors import SimrigError


def sensor_of(scene: Any, number: int) -> Any:
    """Return a sensor of a loaded scene.

    Raises:
        SimrigError: there is none of this number.
    """
    sensors = scene.sensors()
    if not sensors:
        raise SimrigError("the scene has no camera: add a sensor")
    if not 0 <= number < len(sensors):
        raise SimrigError(
            f"the scene has {len(sensors)} sensor{'s' * (len(sensors) > 1)}, numbered from 0: "
            f"there is no sensor {number}"
        )
    return sensors[number]

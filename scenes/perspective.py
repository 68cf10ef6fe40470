"""The camera of the thesis's test scenes: 24 mm sensor height and 45 mm focal length (B.2)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from simrig.scenes.parts import film, sampler, transform

SENSOR_HEIGHT_MM = 24.0
FOCAL_LENGTH_MM = 45.0


def focal_pixels(height: int) -> float:
    """Return the focal length in pixels of a picture ``height`` pixels high."""
    return height * FOCAL_LENGTH_MM / SENSOR_HEIGHT_MM


def pixel_angle_deg(height: int, focal_length_mm: float = FOCAL_LENGTH_MM) -> float:
    """Return the angle of a pixel in the middle of the picture, in degrees."""
    return float(np.degrees(SENSOR_HEIGHT_MM / (height * focal_length_mm)))


def perspective_camera(
    size: tuple[int, int],
    origin: Sequence[float],
    target: Sequence[float],
    focal_length_mm: float = FOCAL_LENGTH_MM,
    pixel_centres: bool = False,
) -> dict[str, Any]:
    """Return a perspective camera with a float32 RGB film and a box filter.

    Args:
        size: width and height of the picture in pixels.
        origin, target: where it stands and what it looks at, in mm; y is up.
        focal_length_mm: behind a sensor that is 24 mm high.
        pixel_centres: one regular sample in the centre of each pixel instead of random ones.

    Raises:
        SimrigError: a size that is not whole and positive, or no variant is set.
    """
    return {
        "type": "perspective",
        "fov": float(np.degrees(2.0 * np.arctan(0.5 * SENSOR_HEIGHT_MM / focal_length_mm))),
        "fov_axis": "y",
        "near_clip": 10.0,
        "far_clip": 2e4,
        "to_world": transform().look_at(
            origin=list(origin), target=list(target), up=[0.0, 1.0, 0.0]
        ),
        "film": film(*size),
        "sampler": sampler(pixel_centres),
    }

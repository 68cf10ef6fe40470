"""Pictures in the coordinates of the sample: every pixel of every view shows the same point.

Source: thesis section 4.2 and appendix C.1. A plane in place of the reference plane gives the
homographies H_2 of appendix C.3; they need not be formed, since every point is projected, with the
distortion of the lens.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from simrig.core.errors import SimrigError
from simrig.core.progress import tracked
from simrig.imaging.alignment import Plane, Views
from simrig.imaging.camera import Camera
from simrig.imaging.checks import finite_array, finite_number
from simrig.imaging.resampling import Spline, inside

_LARGEST_SIDE = 1 << 14


@dataclass(frozen=True)
class Area:
    """A rectangle of the surface around the origin, and its pixels.

    Row 0 is at +y, column 0 at -x.

    Attributes:
        size_mm: width and height.
        pixels: columns and rows.
        margin_mm: along the border, from which points are moved inwards.

    Raises:
        SimrigError: sizes that cannot be.
    """

    size_mm: tuple[float, float]
    pixels: tuple[int, int]
    margin_mm: float = 0.0

    def __post_init__(self) -> None:
        for size in self.size_mm:
            finite_number(size, "the size of an area in mm", above=0.0)
        if not all(1 <= side <= _LARGEST_SIDE for side in self.pixels):
            raise SimrigError(f"an area has 1 to {_LARGEST_SIDE} pixels a side, got {self.pixels}")

    @classmethod
    def of_pitch(cls, size_mm: float, pitch_mm: float) -> Area:
        """Return a square area of some distance between pixels."""
        side = max(1, round(size_mm / finite_number(pitch_mm, "the pitch in mm", above=0.0)))
        return cls((side * pitch_mm, side * pitch_mm), (side, side))

    def divided(self, parts: int, margin_mm: float = 0.0) -> Area:
        """Return the same area with every side of a pixel cut into equal parts."""
        return Area(self.size_mm, (self.pixels[0] * parts, self.pixels[1] * parts), margin_mm)

    def points(self) -> tuple[np.ndarray, np.ndarray]:
        """Return x and y of the pixels' centres in mm, each (rows, columns)."""
        (width, height), (columns, rows) = self.size_mm, self.pixels
        x = ((np.arange(columns) + 0.5) / columns - 0.5) * width
        y = (0.5 - (np.arange(rows) + 0.5) / rows) * height
        inner = [max(0.5 * side - self.margin_mm, 0.0) for side in self.size_mm]
        x, y = (np.clip(v, -most, most) for v, most in zip((x, y), inner, strict=True))
        return np.meshgrid(x, y)


def projected(
    camera: Camera, area: Area, plane: Plane | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return where a camera sees the points of an area, and which of them from the front.

    Args:
        camera: of a view.
        area: of the surface.
        plane: the surface; the reference plane unless given.

    Returns:
        Pixels, (rows, columns, 2), 0 of what is not seen; and what is, (rows, columns).
    """
    surface = plane or Plane()
    x, y = area.points()
    points = np.stack([x, y, surface.height(x, y)], axis=-1)
    pixels = camera.project(points)
    front = (camera.centre_mm - points) @ surface.normal > 0.0
    seen = np.isfinite(pixels).all(axis=-1) & front
    return np.where(seen[..., None], pixels, 0.0), seen


def register(
    picture: Any, camera: Camera, area: Area, plane: Plane | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return what a picture shows of an area.

    Args:
        picture: (height, width) or with channels, linear.
        camera: that took it.
        area: of the surface.
        plane: the surface; the reference plane unless given.

    Returns:
        The area's pixels, (rows, columns) or with channels, and which of them the picture shows;
        the others hold the nearest pixel that it has, or 0 where the camera sees the back.

    Raises:
        SimrigError: values that are no picture.
    """
    values = finite_array(picture, "the picture", (2, 3))
    pixels, seen = projected(camera, area, plane)
    made = Spline(values).at(pixels)
    shown = seen & inside(pixels, values.shape)
    return np.where(seen if made.ndim == 2 else seen[..., None], made, 0.0), shown


def registered_views(
    pictures: Sequence[np.ndarray],
    cameras: Sequence[Camera],
    area: Area,
    progress: Callable[..., None] | None = None,
) -> Views:
    """Return single-channel pictures registered to the reference plane, to find the true one in.

    Args:
        pictures: of every view, (height, width).
        cameras: of every view.
        area: with square pixels.
        progress: called with views done and in total.

    Raises:
        SimrigError: other numbers of cameras, pixels that are not square, or a view that does not
            show the area whole.
    """
    if len(pictures) != len(cameras):
        raise SimrigError(f"{len(pictures)} pictures need as many cameras, got {len(cameras)}")
    pitch = np.array(area.size_mm) / area.pixels
    if abs(pitch[0] - pitch[1]) > 1e-6 * pitch[0]:
        raise SimrigError(f"the area must have square pixels, got {pitch[0]:g} × {pitch[1]:g} mm")
    made = []
    for number, (picture, camera) in enumerate(
        tracked(list(zip(pictures, cameras, strict=True)), progress)
    ):
        shown, seen = register(picture, camera, area)
        if not seen.all():
            raise SimrigError(
                f"view {number} shows {100.0 * seen.mean():.0f} % of the area of "
                f"{area.size_mm[0]:g} × {area.size_mm[1]:g} mm: choose a smaller one"
            )
        made.append(shown)
    return Views(np.array(made), float(pitch[0]), np.array([c.centre_mm for c in cameras]))

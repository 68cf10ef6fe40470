"""Where the receding cylinders stand, and exactly which pixels they cover.

The camera is at the origin and looks along −z; a distance is that of a cylinder's axis along the
optical axis. An upright cylinder is bounded by the two vertical planes through the camera that
touch it, so its outline is two vertical lines whatever the height: with the axis at (x, d) and
radius r the slopes are (x·d ∓ r·sqrt(x² + d² − r²)) / (d² − r²). It looks wider than its diameter
at its distance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from simrig.core.errors import check_known
from simrig.scenes.perspective import focal_pixels
from simrig.scenes.stimuli import CYLINDER_RADIUS


@dataclass(frozen=True)
class CylinderRow:
    """One of the two arrangements of the thesis.

    Attributes:
        experiment: of section 3.3.1 in which it was shown.
        count: number of cylinders.
        first_mm: distance of the first.
        step_mm: between neighbours.
        size: width and height of the published pictures in pixels.
    """

    experiment: str
    count: int
    first_mm: float
    step_mm: float
    size: tuple[int, int]

    @property
    def distances_mm(self) -> np.ndarray:
        """Distances of the axes, nearest first."""
        return self.first_mm + self.step_mm * np.arange(self.count)

    def picture(self, width: int | None = None) -> tuple[int, int]:
        """Return the size of a picture of the published proportions, by default the published."""
        if width is None:
            return self.size
        return width, max(1, round(width * self.size[1] / self.size[0]))


# thesis section 3.3.1: experiment C shows the cylinders of B, rotating
ROWS = {
    "A": CylinderRow("A", 20, 600.0, 200.0, (1920, 1080)),
    "B": CylinderRow("B", 12, 600.0, 350.0, (2160, 1868)),
}


def cylinder_row(experiment: str) -> CylinderRow:
    """Return the arrangement of an experiment, ``"A"`` or ``"B"``.

    Raises:
        SimrigError: another name.
    """
    check_known("experiment", experiment, ROWS)
    return ROWS[experiment]


def outlines(
    x_mm: np.ndarray, distance_mm: np.ndarray, radius_mm: float = CYLINDER_RADIUS
) -> tuple[np.ndarray, np.ndarray]:
    """Return the slopes x/z of the left and the right outline of upright cylinders, exactly.

    Args:
        x_mm: of the axes, to the right.
        distance_mm: of the axes along the optical axis; more than the radius.
        radius_mm: of the cylinders.
    """
    x, d = np.asarray(x_mm, dtype=np.float64), np.asarray(distance_mm, dtype=np.float64)
    half = radius_mm * np.sqrt(x * x + d * d - radius_mm**2)
    below = d * d - radius_mm**2
    return (x * d - half) / below, (x * d + half) / below


def positions_mm(row: CylinderRow) -> np.ndarray:
    """Return x of the axes: side by side from the left, nearest first, with equal gaps.

    No cylinder hides another, and the gaps to the borders of the picture are the same.
    """
    border = 0.5 * row.size[0] / focal_pixels(row.size[1])
    low, high = 0.0, 2.0 * border / row.count
    for _ in range(60):  # halving: the last outline moves to the right with the gap
        gap = 0.5 * (low + high)
        x = _side_by_side(row, -border, gap)
        reached = outlines(x[-1], row.distances_mm[-1])[1] + gap
        low, high = (gap, high) if reached < border else (low, gap)
    return _side_by_side(row, -border, low)


def _side_by_side(row: CylinderRow, left: float, gap: float) -> np.ndarray:
    found = []
    for distance in row.distances_mm.tolist():
        left += gap
        x = left * distance + CYLINDER_RADIUS * np.sqrt(1.0 + left * left)  # touches the left line
        found.append(x)
        left = float(outlines(x, distance)[1])
    return np.array(found)


def columns(row: CylinderRow, width: int | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Return the left and the right outline of every cylinder in pixels from the left border.

    Args:
        width: of the picture in pixels; by default the published one.
    """
    size = row.picture(width)
    left, right = outlines(positions_mm(row), row.distances_mm)
    focal = focal_pixels(size[1])
    return 0.5 * size[0] + focal * left, 0.5 * size[0] + focal * right


def covered(row: CylinderRow, width: int | None = None) -> np.ndarray:
    """Return which cylinder the centre of each pixel column sees, −1 for none; shape (width,)."""
    size = row.picture(width)
    centres = np.arange(size[0]) + 0.5
    seen = np.full(size[0], -1)
    for number, (left, right) in enumerate(zip(*columns(row, width), strict=True)):
        seen[(centres > left) & (centres < right)] = number
    return seen

"""The one-dimensional slices of a placement: straight segments with their intersections.

Source: thesis section 5.1; what coincides under exchange of light and view is listed once.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from simrig.core.errors import check_known

if TYPE_CHECKING:
    from simrig.plans.placement import SlicePlacement

AXIAL, DIAGONAL, CIRCLE, HORIZONTAL = range(4)
SLICE_TYPES = ("all", "axial-diagonal")

# what lies beyond the two ends of a slice
PERIODIC, MIRRORED, OPEN = range(3)


@dataclass(frozen=True)
class Slices:
    """The measured slices of a placement, as flat arrays with one entry per slice.

    Attributes:
        kind: AXIAL, DIAGONAL, CIRCLE (the subspace (0, theta)) or HORIZONTAL.
        origin: (S, 4) angles (theta_i, theta_v, phi_i, phi_v) at position 0, in radians.
        direction: (S, 4) change of these angles per radian of position.
        ends: PERIODIC, MIRRORED (at 0 and ``length``) or OPEN.
        length: period or length in radians.
        first_knot: (S + 1,) where the knots of a slice begin in the arrays below.
        position: (K,) positions of the intersections along their slice, ascending.
        sample: (K,) the distinct sample at that intersection.
        index: per slice, the integers that place it (theta_i, theta_v, α or β, mean azimuth).
    """

    kind: np.ndarray
    origin: np.ndarray
    direction: np.ndarray
    ends: np.ndarray
    length: np.ndarray
    first_knot: np.ndarray
    position: np.ndarray
    sample: np.ndarray
    index: np.ndarray

    def angles(self, slice_index: np.ndarray, position: np.ndarray) -> np.ndarray:
        """Return (theta_i, theta_v, phi_i, phi_v), shape (n, 4), at positions along slices."""
        return self.origin[slice_index] + self.direction[slice_index] * position[:, None]


def build_slices(placement: SlicePlacement, slice_types: str = "all") -> Slices:
    """Return every distinct slice of a placement with its intersections.

    Where theta_i = theta_v, the axial slices α and −α are one, α = 180° has the period 180°, and
    a diagonal slice is mirror symmetric; only the distinct part is listed.

    Args:
        slice_types: ``"all"`` or ``"axial-diagonal"`` (no horizontal slices).

    Raises:
        SimrigError: for unknown slice types.
    """
    check_known("slice types", slice_types, SLICE_TYPES)
    found = _subspace_slices(placement)
    if slice_types == "all":
        found += _horizontal_slices(placement)
    return _assemble(found)


def pair_slices(pair: tuple[int, int], theta: tuple[float, float], corners: np.ndarray) -> Slices:
    """Return the slices of one subspace away from the pole (arguments: ``_pair_slices``)."""
    return _assemble(_pair_slices(pair, theta, corners))


def _assemble(found: list[_Slice]) -> Slices:
    return Slices(
        kind=np.array([s.kind for s in found]),
        origin=np.array([s.origin for s in found], dtype=np.float64),
        direction=np.array([_DIRECTIONS[s.kind] for s in found], dtype=np.float64),
        ends=np.array([s.ends for s in found]),
        length=np.array([s.length for s in found], dtype=np.float64),
        first_knot=np.concatenate([[0], np.cumsum([len(s.positions) for s in found])]),
        position=np.concatenate([s.positions for s in found]),
        sample=np.concatenate([s.samples for s in found]),
        index=np.array([s.indices for s in found]),
    )


class _Slice(NamedTuple):
    """One slice; the fields are those of ``Slices``."""

    kind: int
    ends: int
    length: float
    indices: tuple[int, int, int, int]
    origin: tuple[float, float, float, float]
    positions: np.ndarray
    samples: np.ndarray


# change of theta_i, theta_v, phi_i, phi_v along each kind of slice
_DIRECTIONS = {
    AXIAL: (0, 0, 1, 1),
    DIAGONAL: (0, 0, -1, 1),
    CIRCLE: (0, 0, 0, 1),
    HORIZONTAL: (0, 1, 0, 0),
}


def _subspace_slices(placement: SlicePlacement) -> list[_Slice]:
    """Return the circles of (0, theta) and the axial and diagonal slices."""
    corners, theta = placement.corner_samples(), placement.thetas.tolist()
    e_n, full = placement.theta_count, 2.0 * np.pi
    steps = np.arange(2 * placement.azimuth_count) * (0.5 * placement.azimuth_step)
    found = [
        _Slice(CIRCLE, PERIODIC, full, (0, v, 0, 0), (0, theta[v], 0, 0), steps, corners[0, v, 0])
        for v in range(1, e_n)
    ]
    for i in range(1, e_n):
        for v in range(i, e_n):
            found += _pair_slices((i, v), (theta[i], theta[v]), corners[i, v])
    return found


def _pair_slices(
    pair: tuple[int, int], theta: tuple[float, float], corners: np.ndarray
) -> list[_Slice]:
    """Return the axial and diagonal slices of one subspace away from the pole.

    Args:
        pair: numbers of the two polar angles; equal ones are one polar angle.
        theta: the polar angles in radians.
        corners: (a_n, 2·a_n) which sample lies at every intersection.
    """
    a_n, turn = corners.shape
    half, same = np.pi / a_n, pair[0] == pair[1]
    steps = np.arange(turn) * half
    found = []
    for j in range(a_n // 2 + 1 if same else a_n):
        count = a_n if same and 2 * j == a_n else turn
        origin = (*theta, -j * half, j * half)
        knots = (steps[:count], corners[j, :count])
        found.append(_Slice(AXIAL, PERIODIC, count * half, (*pair, j, 0), origin, *knots))
    for b in range(a_n):
        around = np.concatenate([corners[:, b], corners[:, b + a_n]])
        count = a_n + 1 if same else turn
        ends, length = (MIRRORED, np.pi) if same else (PERIODIC, 2.0 * np.pi)
        origin = (*theta, b * half, b * half)
        knots = (steps[:count], around[:count])
        found.append(_Slice(DIAGONAL, ends, length, (*pair, b, 0), origin, *knots))
    return found


def _horizontal_slices(placement: SlicePlacement) -> list[_Slice]:
    """Return the slices along theta_v; at theta_i = 0 only the azimuth of the view counts."""
    corners, theta = placement.corner_samples(), placement.thetas
    a_n, half = placement.azimuth_count, 0.5 * placement.azimuth_step
    found = []
    for i in range(placement.theta_count):
        for j in range(a_n if i else 1):
            for k in range(2 * a_n):
                origin = (float(theta[i]), 0.0, (k - j) * half, (k + j) * half)
                knots = (theta, corners[i, :, j, k])
                found.append(
                    _Slice(HORIZONTAL, OPEN, placement.theta_max, (i, 0, j, k), origin, *knots)
                )
    return found

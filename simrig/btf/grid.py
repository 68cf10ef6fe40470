"""The grid of direction pairs of a BTF: every illumination with every view."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from simrig.btf.stack import BtfStack
from simrig.core.errors import SimrigError, unknown_name
from simrig.directions.spherical import to_vector
from simrig.directions.triangulation import HemisphereTriangulation

MISSING = ("refuse", "fill")
_DIGITS = 5  # of unit vectors; directions that agree in them are one
_NAMED = 4  # missing pairs that an error lists


@dataclass(frozen=True, eq=False)
class PairGrid:
    """Which image of a stack belongs to which pair.

    Attributes:
        lights, views: unit vectors (n, 3) and (m, 3), in the order in which they appear.
        images: number of the stack's image of each pair, shape (n, m); -1 where there is none.
    """

    lights: np.ndarray
    views: np.ndarray
    images: np.ndarray

    @classmethod
    def of(cls, stack: BtfStack, missing: str = "refuse") -> PairGrid:
        """Return the grid of a stack.

        Args:
            stack: its pairs may stand in any order.
            missing: ``"refuse"`` a stack without all pairs, or let them be ``"fill"``-ed.

        Raises:
            SimrigError: a pair that appears twice; missing pairs, named, where they are refused.
        """
        if missing not in MISSING:
            raise unknown_name("treatment of missing images", missing, MISSING)
        twice = repeated_pair(stack.angles)
        if twice is not None:
            raise SimrigError(
                f"BTF '{stack.name}' has the same pair of directions twice, as images {twice[0]} "
                f"and {twice[1]}: leave one of them out"
            )
        lights, light = _unique(stack.angles[:, 0], stack.angles[:, 2])
        views, view = _unique(stack.angles[:, 1], stack.angles[:, 3])
        images = np.full((len(lights), len(views)), -1)
        images[light, view] = np.arange(len(stack))
        grid = cls(lights, views, images)
        if missing == "refuse" and len(grid.missing):
            raise SimrigError(grid._missing_message(stack.name))
        return grid

    @property
    def missing(self) -> np.ndarray:
        """Pairs (light, view) without an image, shape (k, 2)."""
        return np.argwhere(self.images < 0)

    @property
    def pairs(self) -> int:
        """Number of pairs of the full grid."""
        return self.images.size

    @cached_property
    def light(self) -> HemisphereTriangulation:
        """The triangulated illumination directions."""
        return HemisphereTriangulation(self.lights)

    @cached_property
    def view(self) -> HemisphereTriangulation:
        """The triangulated view directions."""
        same = np.array_equal(self.lights, self.views)
        return self.light if same else HemisphereTriangulation(self.views)

    @property
    def theta_max(self) -> float:
        """Largest polar angle that both directions have, in radians."""
        lowest = max(self.lights[:, 2].min(), self.views[:, 2].min())
        return float(np.arccos(np.clip(lowest, 0.0, 1.0)))

    def sources(self, light: int, view: int) -> list[tuple[int, float]]:
        """Return the images, with weights, that stand for a missing pair.

        They have the same view and the illuminations around the missing one; where the view has
        too few, the same illumination and the views around.

        Raises:
            SimrigError: there are too few images on either side.
        """
        for nodes, images, target in (
            (self.lights, self.images[:, view], self.lights[light]),
            (self.views, self.images[light], self.views[view]),
        ):
            present = np.flatnonzero(images >= 0)
            try:
                place = HemisphereTriangulation(nodes[present]).locate(target[None])
            except SimrigError:
                continue
            chosen = zip(place.nodes, place.weights, strict=True)
            return [(int(images[present[n[0]]]), float(w[0])) for n, w in chosen if w[0] > 0.0]
        raise SimrigError(
            f"the missing image at {self.describe(light, view)} has too few neighbours to be filled"
        )

    def describe(self, light: int, view: int) -> str:
        """Return a pair in degrees."""
        angles = []
        for direction in (self.lights[light], self.views[view]):
            theta = np.degrees(np.arctan2(np.hypot(*direction[:2]), direction[2]))
            angles.append((theta, np.degrees(np.arctan2(direction[1], direction[0])) % 360.0))
        (ti, pi), (tv, pv) = angles
        return f"theta_i {ti:.1f}° phi_i {pi:.1f}° theta_v {tv:.1f}° phi_v {pv:.1f}°"

    def _missing_message(self, name: str) -> str:
        missing = self.missing
        listed = "; ".join(self.describe(*pair) for pair in missing[:_NAMED].tolist())
        more = "; ..." if len(missing) > _NAMED else ""
        return (
            f"BTF '{name}' lacks {len(missing)} of {self.pairs} images ({listed}{more}): supply "
            "them or fill them from their neighbours ('simrig btf fill', missing = fill in a scene)"
        )


def repeated_pair(angles: np.ndarray) -> tuple[int, int] | None:
    """Return the numbers of two rows that are one pair of directions, or None.

    Args:
        angles: theta_i, theta_v, phi_i, phi_v in radians, shape (pairs, 4).
    """
    views, view = _unique(angles[:, 1], angles[:, 3])
    pair = _unique(angles[:, 0], angles[:, 2])[1] * len(views) + view
    order = np.argsort(pair, kind="stable")
    same = np.flatnonzero(np.diff(pair[order]) == 0)
    return (int(order[same[0]]), int(order[same[0] + 1])) if same.size else None


def _unique(theta: np.ndarray, phi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the different directions in the order of their appearance, and each one's number."""
    vectors = to_vector(theta, phi)
    keys = np.round(vectors, _DIGITS) + 0.0  # no -0
    _, first, inverse = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.argsort(order)
    return vectors[first[order]], rank[inverse.reshape(-1)]

"""Where the one-dimensional slices lie in the four-dimensional BRDF space.

A *slice* is a straight segment in the space of angles (theta_i, theta_v, phi_i, phi_v). In the
subspace of two polar angles, axial slices hold φ_v − φ_i = α and run along the mean azimuth
(φ_i + φ_v)/2; diagonal slices hold φ_i + φ_v = β and run along the half difference
(φ_v − φ_i)/2. Both coordinates keep their meaning when light and view change places (the mean
azimuth stays, the half difference changes sign), which is why they, and not φ_v as in thesis
equations 5.1 and 5.2, are the positions here. Horizontal slices run along theta_v; vertical ones
are their reciprocals and are never measured.

Source: thesis sections 5.1 and 5.4.1, appendix D.4.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from simrig.brdf.slices.layout import slice_thetas
from simrig.core.errors import SimrigError
from simrig.directions.schemes import LARGEST_THETA_DEG
from simrig.plans.slices import Slices, build_slices, pair_slices

# thesis Table 5.1: (largest number of samples, polar angle step, azimuth step), in degrees
TABLE_5_1: tuple[tuple[float, float, float], ...] = (
    (667, 28, 180),
    (932, 20, 180),
    (1034, 16, 180),
    (1060, 28, 60),
    (2272, 20, 60),
    (3230, 16, 60),
    (4928, 14, 60),
    (5645, 16, 36),
    (9660, 14, 36),
    (17096, 12, 36),
    (20969, 10, 36),
    (22291, 8, 36),
    (33879, 12, 20),
    (38735, 10, 20),
    (79469, 8, 20),
    (184655, 6, 20),
    (np.inf, 6, 12),
)

_MOST_THETAS, _MOST_INTERSECTIONS = 1000, 20_000_000  # a few gigabytes of index arrays


def _check_azimuth_step(a_s: float, least: int) -> None:
    """Refuse a step in degrees that does not divide the circle into at least so many parts."""
    count = 360.0 / a_s if a_s > 0.0 else 0.0
    if not np.isfinite(count) or round(count) < least or abs(count - round(count)) > 1e-6:
        raise SimrigError(
            f"the azimuth step must divide 360 degrees into at least {least} parts, got {a_s:g}"
        )


@dataclass(frozen=True)
class SlicePlacement:
    """A regular placement of slices by polar angle step, azimuth step and largest polar angle.

    Polar angles are k·e_s and theta_max; axial and diagonal slices lie at multiples of a_s
    (thesis section 5.4.1).

    Args:
        theta_step: e_s in radians, in (0, theta_max].
        azimuth_step: a_s in radians, a whole fraction 360°/a_n with a_n >= 2.
        theta_max: largest polar angle in radians, in (0, 90°).
    """

    theta_step: float
    azimuth_step: float
    theta_max: float

    def __post_init__(self) -> None:
        e_s, a_s, top = np.degrees([self.theta_step, self.azimuth_step, self.theta_max])
        if not 0.0 < top < 90.0:
            raise SimrigError(f"theta_max must lie between 0 and 90 degrees, got {top:g}")
        if not 0.0 < e_s <= top:
            raise SimrigError(
                f"the polar angle step must lie in (0, {top:g}] degrees (theta_max), got {e_s:g}"
            )
        _check_azimuth_step(a_s, least=2)
        if top / e_s > _MOST_THETAS or self.intersections > _MOST_INTERSECTIONS:
            raise SimrigError(
                f"steps of {e_s:g} and {a_s:g} degrees give more than {_MOST_INTERSECTIONS:,} "
                "intersections: use larger steps"
            )

    @classmethod
    def from_degrees(
        cls,
        theta_step_deg: float,
        azimuth_step_deg: float,
        theta_max_deg: float = LARGEST_THETA_DEG,
    ) -> SlicePlacement:
        """Return the placement for steps given in degrees.

        Args:
            theta_step_deg, azimuth_step_deg: between neighbouring slices.
            theta_max_deg: the largest polar angle.

        Raises:
            SimrigError: for steps that do not fit (see the class).
        """
        return cls(*np.radians([theta_step_deg, azimuth_step_deg, theta_max_deg]).tolist())

    @cached_property
    def thetas(self) -> np.ndarray:
        """All measured polar angles in radians, shape (e_n,), from 0 to theta_max."""
        return slice_thetas(self.theta_step, self.theta_max)

    @property
    def theta_count(self) -> int:
        """e_n, the number of polar angles."""
        return len(self.thetas)

    @property
    def azimuth_count(self) -> int:
        """a_n, the number of slices of one kind in a subspace."""
        return round(2.0 * np.pi / self.azimuth_step)

    @property
    def intersections(self) -> int:
        """n_0, the number of distinct physical direction pairs where slices cross.

        Light and view may change places, and at theta = 0 the azimuth does not matter.
        """
        e, a = self.theta_count - 1, self.azimuth_count
        return e * (e - 1) * a * a + e * (a * a + a) + 2 * e * a + 1

    def describe(self) -> str:
        """Return the steps in words, for example ``e_s = 14°, a_s = 36°, theta_max = 80°``."""
        e_s, a_s, top = np.degrees([self.theta_step, self.azimuth_step, self.theta_max])
        return f"e_s = {e_s:g}°, a_s = {a_s:g}°, theta_max = {top:g}°"

    def corner_samples(self) -> np.ndarray:
        """Return which distinct sample lies at every intersection.

        Returns:
            int array (e_n, e_n, a_n, 2·a_n), indexed by theta_i, theta_v, α and half steps of the
            mean azimuth, with values 0..intersections − 1.
        """
        e_n, a_n = self.theta_count, self.azimuth_count
        i, v, j, k = np.indices((e_n, e_n, a_n, 2 * a_n), sparse=False)
        turn = 2 * a_n
        # the same pair with light and view exchanged: α → −α, mean azimuth shifted by 180°
        j_swap = (-j) % a_n
        k_swap = np.where(j == 0, k, (k + a_n) % turn)

        def key(i, v, j, k):  # a unique number for a corner, azimuths at the pole dropped
            on_circle = (i == 0) | (v == 0)
            phi = np.where(i == 0, (k + j) % turn, (k - j) % turn)
            phi = np.where((i == 0) & (v == 0), 0, phi)
            j, k = np.where(on_circle, 0, j), np.where(on_circle, phi, k)
            return ((i * e_n + v) * a_n + j) * turn + k

        keys = np.minimum(key(i, v, j, k), key(v, i, j_swap, k_swap))
        return np.unique(keys, return_inverse=True)[1].reshape(keys.shape)

    def corner_angles(self) -> np.ndarray:
        """Return (theta_i, theta_v, phi_i, phi_v) of every distinct intersection, (n_0, 4)."""
        corners = self.corner_samples()
        first = np.unique(corners, return_index=True)[1]
        i, v, j, k = np.unravel_index(first, corners.shape)
        half = self.azimuth_step / 2.0
        phi = np.where(i == 0, 0.0, (k - j) * half), np.where(v == 0, 0.0, (k + j) * half)
        return np.stack([self.thetas[i], self.thetas[v], *phi], axis=1)

    def slices(self, slice_types: str = "all") -> Slices:
        """Return every distinct slice with its intersections (see ``build_slices``)."""
        return build_slices(self, slice_types)


def optimal_placement(samples: int, theta_max_deg: float = LARGEST_THETA_DEG) -> SlicePlacement:
    """Return the placement that thesis Table 5.1 recommends for a wished number of samples.

    Args:
        theta_max_deg: largest polar angle in degrees.

    Raises:
        SimrigError: when even the sparsest placement has more intersections than ``samples``.
    """
    for largest, e_s, a_s in TABLE_5_1:
        if samples <= largest:
            placement = SlicePlacement.from_degrees(min(e_s, theta_max_deg), a_s, theta_max_deg)
            break
    if placement.intersections > samples:
        raise SimrigError(
            f"{samples} samples are too few: the placement {placement.describe()} has "
            f"{placement.intersections} intersections; ask for at least that many"
        )
    return placement


@dataclass(frozen=True)
class SubspacePlacement:
    """Axial and diagonal slices in one subspace of two polar angles (thesis sections 5.1, 5.3).

    Args:
        theta_i, theta_v: the polar angles in radians, in (0, 90°).
        azimuth_step: a_s in radians, a whole fraction 360°/a_n; 360° is one slice of each kind.
    """

    theta_i: float
    theta_v: float
    azimuth_step: float

    def __post_init__(self) -> None:
        for name, theta in (("theta_i", self.theta_i), ("theta_v", self.theta_v)):
            if not 0.0 < theta < np.pi / 2:
                raise SimrigError(
                    f"{name} of a subspace must lie between 0 and 90 degrees, got "
                    f"{np.degrees(theta):g}"
                )
        _check_azimuth_step(np.degrees(self.azimuth_step), least=1)
        if self.intersections > _MOST_INTERSECTIONS:
            raise SimrigError(f"{self.describe()} has too many intersections: use a larger step")

    @property
    def azimuth_count(self) -> int:
        """a_n, the number of slices of one kind."""
        return round(2.0 * np.pi / self.azimuth_step)

    @property
    def pair(self) -> tuple[int, int]:
        """Numbers of the two polar angles: different unless they are one polar angle."""
        return (1, 1) if self.theta_i == self.theta_v else (1, 2)

    @property
    def theta_max(self) -> float:
        """The larger polar angle in radians."""
        return max(self.theta_i, self.theta_v)

    @property
    def intersections(self) -> int:
        """The number of distinct physical direction pairs where slices cross."""
        a_n = self.azimuth_count
        return a_n * a_n + a_n if self.pair == (1, 1) else 2 * a_n * a_n

    def describe(self) -> str:
        """Return the subspace in words."""
        angles = np.degrees([self.theta_i, self.theta_v, self.azimuth_step])
        return "theta_i = {:g}°, theta_v = {:g}°, a_s = {:g}°".format(*angles)

    def corner_samples(self) -> np.ndarray:
        """Return which distinct sample lies at every intersection, (a_n, 2·a_n)."""
        a_n, turn = self.azimuth_count, 2 * self.azimuth_count
        j, k = np.indices((a_n, turn))
        keys = j * turn + k
        if self.pair == (1, 1):
            keys = np.minimum(keys, (-j) % a_n * turn + np.where(j == 0, k, (k + a_n) % turn))
        return np.unique(keys, return_inverse=True)[1].reshape(keys.shape)

    def corner_angles(self) -> np.ndarray:
        """Return (theta_i, theta_v, phi_i, phi_v) of every distinct intersection, (n_0, 4)."""
        corners = self.corner_samples()
        j, k = np.unravel_index(np.unique(corners, return_index=True)[1], corners.shape)
        half, same = 0.5 * self.azimuth_step, np.ones(len(j))
        phi = (k - j) * half, (k + j) * half
        return np.stack([self.theta_i * same, self.theta_v * same, *phi], axis=1)

    def slices(self, slice_types: str = "axial-diagonal") -> Slices:
        """Return every distinct slice with its intersections.

        Raises:
            SimrigError: for horizontal slices, which leave the subspace.
        """
        if slice_types != "axial-diagonal":
            raise SimrigError("a subspace has only axial and diagonal slices ('axial-diagonal')")
        theta = (self.theta_i, self.theta_v)
        return pair_slices(self.pair, theta, self.corner_samples())

"""Coordinates in which the logarithm of a BRDF varies evenly.

theta_h is stretched where highlights are narrow. Every coordinate is a smooth function of the two
directions, at theta_h = 0, at equal directions and around all azimuths, so that what is
interpolated in them is continuous there. Isotropic: stretched theta_h, theta_d, and one that tells
the sides of the plane of incidence apart; bivariate: the first two. Anisotropic: the stretched half
vector in the plane, theta_d, and the difference vector carried along to the pole. The length of
each is a parameter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from simrig.brdf.kriging.symmetry import Symmetry
from simrig.core.arrays import Array, namespace
from simrig.directions.half_difference import to_half_difference

HALF = 0.5 * np.pi
_LOWEST, _HIGHEST = 0.02, 6.0  # lengths
_BESIDE, _BRIGHTER = 5, 1.5  # samples beside one of equal directions, and how much it outshines
_NARROWEST, _WIDEST = 0.001, 3.0  # widths of highlights, radians


@dataclass(frozen=True)
class Stretch:
    """theta_h on [0, 1]: even in log(1 + theta_h / width), mixed with theta_h itself.

    Attributes:
        width: of the highlight, radians; below it the coordinate is even in theta_h.
        linear: share of theta_h itself.
    """

    width: float
    linear: float

    def __call__(self, theta_h: Array) -> Array:
        xp = namespace(theta_h)
        scale = (1.0 - self.linear) / float(np.log1p(HALF / self.width))
        return scale * xp.log(1.0 + theta_h / self.width) + (self.linear / HALF) * theta_h

    def inverse(self, position: np.ndarray) -> np.ndarray:
        """Return theta_h in radians at positions on [0, 1], to 1e-12 of a radian."""
        low, high = np.zeros_like(position), np.full_like(position, HALF)
        for _ in range(50):
            middle = 0.5 * (low + high)
            below = self(middle) < position
            low, high = np.where(below, middle, low), np.where(below, high, middle)
        return low  # exactly 0 at 0, where azimuths mean nothing


EVEN = Stretch(1.0, 1.0)  # theta itself
BACK = Stretch(float(np.radians(1.0)), 0.5)  # of theta_d, where light goes back to where it is from


@dataclass(frozen=True)
class Coordinates:
    """The coordinates of one material.

    Attributes:
        symmetry: of the material; decides which coordinates there are.
        stretch: of theta_h.
        lengths: of the coordinates: two (bivariate), three (isotropic) or five.
        nugget: variance of noise over that of the signal.
        stretch_d: of theta_d.
    """

    symmetry: Symmetry
    stretch: Stretch
    lengths: tuple[float, ...]
    nugget: float
    stretch_d: Stretch = EVEN

    def __call__(self, angles: np.ndarray) -> np.ndarray:
        """Return the coordinates (n, f) of half-difference angles (n, 4), in radians."""
        theta_h, phi_h, theta_d, phi_d = angles.T
        radius, size = self.stretch(theta_h), np.sin(theta_d)
        apart = self.stretch_d(theta_d)
        near = np.minimum(4.0 * radius, 1.0)  # phi_d alone means nothing at theta_h = 0
        if self.symmetry.bivariate:
            parts = [radius, apart]
            scales = self.lengths
        elif self.symmetry.isotropic:
            parts = [radius, apart, 0.5 * near * size * np.cos(phi_d)]
            if not self.symmetry.mirror:
                parts.append(0.5 * near * size * np.sin(phi_d))
            scales = (*self.lengths, self.lengths[-1])[: len(parts)]
        else:
            carried = phi_h + phi_d
            parts = [
                radius * np.cos(phi_h),
                radius * np.sin(phi_h),
                apart,
                size * np.cos(carried),
                size * np.sin(carried),
                near * size * size * np.cos(2.0 * phi_d),
            ]
            x, y, own, across, twice = self.lengths
            scales = (x, y, own, across, across, twice)
        return np.stack([part / scale for part, scale in zip(parts, scales, strict=True)], axis=1)


@dataclass(frozen=True)
class Prior:
    """Where the logarithms of the parameters are expected, and how far from there.

    Attributes:
        mean, deviation: (p,) of the logarithms of the lengths, of the stretch's width, of the
            logit of its linear share, and of the nugget.
    """

    mean: np.ndarray
    deviation: np.ndarray

    def coordinates(
        self, parameters: np.ndarray, symmetry: Symmetry, stretch_d: Stretch = EVEN
    ) -> Coordinates:
        """Return the coordinates of parameters, each held within what makes sense."""
        *lengths, width, linear, nugget = (float(p) for p in parameters)
        return Coordinates(
            symmetry,
            Stretch(
                float(np.clip(np.exp(width), _NARROWEST, _WIDEST)),
                float(1.0 / (1.0 + np.exp(-np.clip(linear, -4.0, 4.0)))),
            ),
            tuple(float(np.clip(np.exp(length), _LOWEST, _HIGHEST)) for length in lengths),
            float(np.exp(np.clip(nugget, -15.0, -2.0))),
            stretch_d,
        )


ISOTROPIC_PRIOR = Prior(
    np.array([-1.5, -1.0, -0.3, np.log(0.05), -1.0, -9.0]), np.array([1.0, 1.0, 1.0, 1.5, 2.0, 3.0])
)
BIVARIATE_PRIOR = Prior(np.delete(ISOTROPIC_PRIOR.mean, 2), np.delete(ISOTROPIC_PRIOR.deviation, 2))
ANISOTROPIC_PRIOR = Prior(
    np.array([-1.0, -1.0, -0.5, 0.0, 0.0, np.log(0.2), -0.5, -10.0]),
    np.array([1.0, 1.0, 1.0, 1.0, 1.0, 1.5, 2.0, 3.0]),
)


def prior_of(symmetry: Symmetry) -> Prior:
    """Return the prior of the parameters for a symmetry."""
    return {2: BIVARIATE_PRIOR, 3: ISOTROPIC_PRIOR, 4: ANISOTROPIC_PRIOR}[symmetry.dimensions]


def stretch_of_theta_d(angles: np.ndarray, values: np.ndarray) -> Stretch:
    """Return how theta_d is stretched: densely at 0 where light goes back to where it is from.

    A sample of equal directions that is brighter than what lies beside it, at about the same
    theta_h and outside the highlight, tells so.

    Args:
        angles: (n, 4) half-difference angles, radians.
        values: (n, 3) of f_r.
    """
    theta_h, theta_d = np.degrees(angles[:, 0]), np.degrees(angles[:, 2])
    means = values.mean(axis=1)
    beside = np.flatnonzero((theta_d > 6.0) & (theta_d < 25.0) & (theta_h > 10.0))
    for own in np.flatnonzero((theta_d < 1.5) & (theta_h > 10.0)):
        order = np.argsort(np.abs(theta_h[beside] - theta_h[own]), kind="stable")
        nearest = beside[order[:_BESIDE]]
        if len(nearest) and means[own] > _BRIGHTER * np.max(means[nearest]):
            return BACK
    return EVEN


def half_difference_angles(wi: np.ndarray, wv: np.ndarray, axis: float = 0.0) -> np.ndarray:
    """Return theta_h, phi_h from the axis, theta_d, phi_d of direction pairs, (n, 4) radians."""
    at = to_half_difference(wi, wv)
    phi_h = np.mod(at.phi_h - axis, 2.0 * np.pi)
    return np.stack([at.theta_h, phi_h, at.theta_d, at.phi_d], axis=-1)

"""Reflectance measured at scattered directions, and how it becomes a table that renders."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import RBFInterpolator
from scipy.ndimage import map_coordinates

from simrig.brdf.tables.isotropic import IsotropicTable, bin_directions
from simrig.brdf.tables.thin_plate import thin_plate
from simrig.core.colour import FROM_XYZ, TO_XYZ
from simrig.core.errors import SimrigError
from simrig.core.gamut import CLIP, in_gamut
from simrig.directions.half_difference import to_half_difference
from simrig.directions.spherical import to_angles, to_vector
from simrig.directions.triangulation import HemisphereTriangulation

# Polar angle of the half vector below which the interpolation sees no difference, radians: the
# logarithm of theta_h would otherwise stretch the last tenths of a degree without end
_SOFTEST = 0.03
_SMOOTHING = 1e-2
# Values are interpolated as logarithms above this part of their median
_FLOOR = 1e-2
# Nodes per coordinate where the interpolation is evaluated before it is tabulated
_NODES = (36, 26, 26)
# Bins of the table; phi_d over a full turn, for measured data are not quite reciprocal
TABLE_SHAPE = (90, 45, 180)


@dataclass(frozen=True)
class ScatteredSamples:
    """Values of f_r at a list of direction pairs.

    Attributes:
        theta_i, phi_i, theta_v, phi_v: angles in radians, shape (n,).
        values: linear RGB in 1/sr, shape (n, 3); channels of colours outside the gamut may be
            negative.
        isotropic: whether only the difference of the azimuths was recorded.
        gamut: what tables of them do with negative channels (``simrig.core.gamut``).
    """

    theta_i: np.ndarray
    phi_i: np.ndarray
    theta_v: np.ndarray
    phi_v: np.ndarray
    values: np.ndarray
    name: str = "samples"
    isotropic: bool = False
    gamut: str = CLIP

    def __post_init__(self) -> None:
        count = len(self.theta_i)
        angles = (self.theta_i, self.phi_i, self.theta_v, self.phi_v)
        if any(np.shape(angle) != (count,) for angle in angles) or count == 0:
            raise SimrigError(f"'{self.name}' needs as many of each angle, and at least one")
        if np.shape(self.values) != (count, 3):
            raise SimrigError(f"'{self.name}' needs values of shape ({count}, 3)")
        if not all(np.all(np.isfinite(array)) for array in (*angles, self.values)):
            raise SimrigError(f"'{self.name}' has NaN or infinite angles or values")
        low = min(self.theta_i.min(), self.theta_v.min())
        high = max(self.theta_i.max(), self.theta_v.max())
        if low < -1e-6 or high > np.pi / 2 + 1e-6:
            raise SimrigError(
                f"'{self.name}' has polar angles from {np.degrees(low):g}° to "
                f"{np.degrees(high):g}°, outside 0° to 90° (radians are expected)"
            )

    def __len__(self) -> int:
        return len(self.theta_i)

    @property
    def directions(self) -> tuple[np.ndarray, np.ndarray]:
        """Unit vectors of illumination and view, each of shape (n, 3)."""
        return to_vector(self.theta_i, self.phi_i), to_vector(self.theta_v, self.phi_v)


@dataclass(frozen=True)
class FitResidual:
    """Relative errors of an interpolation at measured directions.

    The error of a sample is the sum over channels of |f - f'| over the sum of f, with f clipped
    to the gamut, and the sum taken as at least a hundredth of its median over the samples.
    """

    mean: float
    median: float
    ninety_fifth: float

    def __str__(self) -> str:
        return (
            f"mean {100 * self.mean:.2g} %, median {100 * self.median:.2g} %, "
            f"95th percentile {100 * self.ninety_fifth:.2g} %"
        )


class IsotropicInterpolator:
    """Thin-plate-spline interpolation of isotropic samples.

    Over (log(theta_h + 0.03), √cos theta_i, √cos theta_v): these three determine an isotropic
    pair of directions up to mirror symmetry, so that holds by construction, and the highlight
    depends on the first alone. The logarithms of XYZ values are interpolated, so values of very
    different size weigh alike and none becomes negative. Beyond the samples' largest polar angle
    the value is held; it never leaves the samples' range.

    Reciprocity is not assumed: the measured paints that were tried give 2 to 25 times less with
    the light at 80° than with the view at 79° and the directions swapped, and a symmetric
    spline, though as good at samples left out at random, swings between the measured
    polar angles. The coordinates were chosen by leaving out whole incidences (``cross_validate``),
    among theta_h, theta_d, phi_d and polar angles in several forms.
    """

    def __init__(self, samples: ScatteredSamples):
        self.gamut = samples.gamut
        theta = np.maximum(samples.theta_i, samples.theta_v)
        self.theta_max = float(theta.max())
        # colours outside the gamut, whose RGB has negative channels, have logarithms in XYZ
        xyz = np.maximum(samples.values @ TO_XYZ.T, 0.0)
        self._floor = _FLOOR * np.median(xyz, axis=0) + np.finfo(float).tiny
        logarithms = np.log(xyz + self._floor)
        self._range = logarithms.min(axis=0), logarithms.max(axis=0)
        coordinates = self._coordinates(*samples.directions)
        self._spread = np.maximum(coordinates.std(axis=0), 1e-9)
        try:
            self.spline = RBFInterpolator(
                coordinates / self._spread, logarithms, smoothing=_SMOOTHING, degree=1
            )
        except (ValueError, np.linalg.LinAlgError) as error:
            raise SimrigError(
                f"'{samples.name}' has too few different directions to interpolate"
            ) from error

    @property
    def condition(self) -> float:
        """Condition number (2-norm) of the spline's linear system; infinite where singular.

        Up to about 1e8 rounding does not show; from 1e16 on the system does not determine the
        spline between its samples, and only the range that is never left bounds the result.
        """
        return float(np.linalg.cond(spline_system(self.spline, self.spline.y)))

    def _coordinates(self, wi: np.ndarray, wv: np.ndarray) -> np.ndarray:
        # beyond the data the pair is taken at the largest polar angle, with the half vector there:
        # the spline must not meet coordinates that no pair within the data has
        wi, wv = (limit_theta(direction, self.theta_max) for direction in (wi, wv))
        theta_h = to_half_difference(wi, wv).theta_h
        return np.stack(
            (np.log(theta_h + _SOFTEST), np.sqrt(wi[..., 2]), np.sqrt(wv[..., 2])), axis=-1
        )

    def coordinates(self, wi: np.ndarray, wv: np.ndarray) -> np.ndarray:
        """Return the points, shape (n, 3), where the spline is evaluated for directions (n, 3)."""
        return self._coordinates(wi, wv) / self._spread

    def limited(self, logarithms: np.ndarray) -> np.ndarray:
        """Return logarithms of XYZ values, (..., 3), limited to the range of the samples'."""
        return np.clip(logarithms, *self._range)

    def __call__(self, wi: np.ndarray, wv: np.ndarray) -> np.ndarray:
        """Return linear RGB, shape (n, 3), for directions (n, 3)."""
        return self._colours(self.spline(self.coordinates(wi, wv)))

    def _colours(self, logarithms: np.ndarray) -> np.ndarray:
        xyz = np.exp(self.limited(logarithms)) - self._floor
        return in_gamut(np.maximum(xyz, 0.0) @ FROM_XYZ.T, self.gamut)

    def tabulate(self, shape: tuple[int, int, int]) -> np.ndarray:
        """Return the values in the bins of an isotropic table that is not reciprocal.

        The spline is evaluated on a grid over its own three coordinates, where it is smooth,
        and from there by cubic interpolation.

        Args:
            shape: bins of theta_h, theta_d and phi_d (even, over a full turn).
        """
        first = np.log(np.array([0.0, np.pi / 2]) + _SOFTEST)
        second = np.sqrt([np.cos(self.theta_max), 1.0])
        ends = (first, second, second)
        axes = [np.linspace(end[0], end[1], n) for end, n in zip(ends, _NODES, strict=True)]
        points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        grid = np.asarray(self.spline(points / self._spread)).reshape(*_NODES, 3)
        half = shape[2] // 2  # the other half is mirror symmetric, phi_d and -phi_d
        wi, wv = (d[:, :, :half] for d in bin_directions(shape, reciprocal=False))
        where = self._coordinates(wi, wv)
        indices = [
            (where[..., axis] - end[0]) * ((count - 1) / (end[1] - end[0]))
            for axis, (end, count) in enumerate(zip(ends, _NODES, strict=True))
        ]
        channels = [map_coordinates(grid[..., c], indices, mode="nearest") for c in range(3)]
        values = self._colours(np.stack(channels, axis=-1))
        return np.concatenate((values, values[:, :, ::-1]), axis=2)


def spline_system(spline: RBFInterpolator, nodes: np.ndarray) -> np.ndarray:
    """Return the matrix (n + m, n + m) of a thin-plate spline's n nodes and m monomials.

    Coordinates are shifted and scaled as SciPy does before it solves.

    Args:
        spline: a SciPy interpolator with the kernel ``thin_plate_spline``.
        nodes: its nodes ``spline.y``, (n, k), in the precision that is wanted.
    """
    count, monomials = len(nodes), len(spline.powers)
    matrix = np.zeros((count + monomials,) * 2, dtype=nodes.dtype)
    matrix[:count, :count] = thin_plate(nodes, nodes) + np.diag(spline.smoothing)
    matrix[:count, count:] = spline_monomials(spline, nodes)
    matrix[count:, :count] = matrix[:count, count:].T
    return matrix


def spline_monomials(spline: RBFInterpolator, x: np.ndarray) -> np.ndarray:
    """Return the monomials of a spline at points (a, k), shape (a, m)."""
    low, high = spline.y.min(axis=0), spline.y.max(axis=0)
    width = np.where(high > low, high - low, 2.0)
    scaled = (x - 0.5 * (high + low)) / (0.5 * width)
    return np.prod(scaled[:, None, :] ** spline.powers[None, :, :], axis=-1)


def limit_theta(direction: np.ndarray, theta_max: float) -> np.ndarray:
    """Return directions (..., 3) with the polar angle limited to theta_max, the azimuth kept."""
    theta, phi = to_angles(direction)
    return to_vector(np.minimum(theta, theta_max), phi)


def interpolate_isotropic(
    samples: ScatteredSamples, shape: tuple[int, int, int] = TABLE_SHAPE
) -> IsotropicTable:
    """Interpolate scattered isotropic samples and tabulate the result.

    Args:
        samples: measured values; ``isotropic`` ones, or any that are taken to be.
        shape: bins of theta_h, theta_d, phi_d; the last even, over a full turn.

    Returns:
        A table, not reciprocal, whose theta_max is the largest polar angle measured; further out
        it holds.
    """
    interpolator = IsotropicInterpolator(samples)
    values = interpolator.tabulate(shape).astype(np.float32)
    return IsotropicTable(
        values,
        theta_max=interpolator.theta_max,
        name=samples.name,
        reciprocal=False,
        gamut=samples.gamut,
    )


def residual(samples: ScatteredSamples, predicted: np.ndarray) -> FitResidual:
    """Compare predictions at the samples' directions, shape (n, 3), with their values."""
    truth = in_gamut(samples.values, samples.gamut)
    size = np.abs(truth).sum(axis=1)
    smallest = _FLOOR * np.median(size) + np.finfo(float).tiny
    relative = np.abs(truth - predicted).sum(axis=1) / np.maximum(size, smallest)
    quantiles = np.quantile(relative, (0.5, 0.95))
    return FitResidual(float(relative.mean()), float(quantiles[0]), float(quantiles[1]))


def subset(samples: ScatteredSamples, mask: np.ndarray) -> ScatteredSamples:
    """Return the samples that a mask, or their numbers, choose."""
    names = ("theta_i", "phi_i", "theta_v", "phi_v", "values")
    return replace(samples, **{name: getattr(samples, name)[mask] for name in names})


def barycentric_weights(nodes: np.ndarray, targets: np.ndarray) -> np.ndarray:
    """Return the weights that interpolate values at ``nodes`` to ``targets`` on the sphere.

    Weights are >= 0 with sum 1 and exact where a target is a node; beyond the outermost nodes
    they are held (``simrig.directions.triangulation``).

    Args:
        nodes: unit vectors of the upper hemisphere around the normal, shape (n, 3).
        targets: unit vectors, shape (m, 3).

    Returns:
        Array of shape (m, n).

    Raises:
        SimrigError: when the nodes do not span a triangulation.
    """
    place = HemisphereTriangulation(nodes).locate(targets)
    weights = np.zeros((len(targets), len(nodes)))
    rows = np.arange(len(targets))
    for node, weight in zip(place.nodes, place.weights, strict=True):
        np.add.at(weights, (rows, node), weight)
    return weights

"""Any BRDF as a table, and how far the table is from it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from simrig.brdf.protocol import Brdf, evaluate
from simrig.brdf.tables.dense import DenseTable
from simrig.brdf.tables.isotropic import MERL_SHAPE, IsotropicTable, bin_directions, fill_invalid
from simrig.core.progress import Progress, tracked
from simrig.directions.spherical import to_vector

# A table's nodes at the horizon are evaluated just above it, where f_r has its limit
_HORIZON = float(np.radians(89.9))
# Smallest cosine at which a bin of the half-difference table is evaluated (polar angle 89.4°)
_SMALLEST_COSINE = 0.01
_CHUNK = 1 << 18  # direction pairs evaluated at once, to bound the memory


@dataclass(frozen=True)
class ResamplingError:
    """How far a resampled BRDF is from the original, over random direction pairs.

    Attributes:
        mean_relative: mean of |f - f'| / f over pairs and channels. Where f is below a
            thousandth of its channel's mean, the error is taken relative to that.
        median_relative: median of the same.
        worst_relative: largest of the same.
        weighted_relative: sum of |f - f'| cos(theta_i) cos(theta_v) over the sum of
            f cos(theta_i) cos(theta_v): what a picture shows.
        root_mean_square: root of the mean of (f - f')², in 1/sr.
    """

    mean_relative: float
    median_relative: float
    worst_relative: float
    weighted_relative: float
    root_mean_square: float
    pairs: int

    def __str__(self) -> str:
        return (
            f"mean relative error {100 * self.mean_relative:.3g} % (median "
            f"{100 * self.median_relative:.3g} %, worst {100 * self.worst_relative:.3g} %, "
            f"weighted by the cosines {100 * self.weighted_relative:.3g} %), "
            f"RMSE {self.root_mean_square:.3g} 1/sr over {self.pairs} random pairs"
        )


def resampling_error(original: Brdf, resampled: Brdf, pairs: int = 20_000) -> ResamplingError:
    """Compare two BRDFs over random pairs of directions where both have data.

    Directions are uniform over the solid angle up to the smaller theta_max, at most 89°.
    """
    rng = np.random.default_rng(0)
    lowest = np.cos(min(original.theta_max, resampled.theta_max, np.radians(89.0)))
    wi, wv = (_random_directions(rng, pairs, lowest) for _ in range(2))
    truth, other = evaluate(original, wi, wv), evaluate(resampled, wi, wv)
    smallest = np.maximum(1e-3 * truth.mean(axis=0), np.finfo(float).tiny)
    relative = np.abs(truth - other) / np.maximum(truth, smallest)
    cosines = (wi[:, 2] * wv[:, 2])[:, None]
    total = max(float((truth * cosines).sum()), np.finfo(float).tiny)
    return ResamplingError(
        float(relative.mean()),
        float(np.median(relative)),
        float(relative.max()),
        float((np.abs(truth - other) * cosines).sum() / total),
        float(np.sqrt(np.mean((truth - other) ** 2))),
        pairs,
    )


def _random_directions(rng: np.random.Generator, count: int, lowest: float) -> np.ndarray:
    cosine = rng.uniform(lowest, 1.0, count)
    return to_vector(np.arccos(cosine), rng.uniform(0.0, 2.0 * np.pi, count))


def is_isotropic(brdf: Brdf, tolerance: float = 1e-6) -> bool:
    """Return whether turning both directions about the normal changes nothing (200 pairs)."""
    rng = np.random.default_rng(1)
    wi, wv = (_random_directions(rng, 200, 0.1) for _ in range(2))
    angle = rng.uniform(0.0, 2.0 * np.pi, 200)
    turned = evaluate(brdf, turn(wi, angle), turn(wv, angle))
    return bool(np.allclose(evaluate(brdf, wi, wv), turned, rtol=tolerance, atol=1e-12))


def turn(direction: np.ndarray, angle: np.ndarray | float) -> np.ndarray:
    """Return directions of shape (..., 3) turned about the normal by ``angle`` (radians)."""
    x, y, z = np.moveaxis(direction, -1, 0)
    cosine, sine = np.cos(angle), np.sin(angle)
    parts = np.broadcast_arrays(cosine * x - sine * y, sine * x + cosine * y, z)
    return np.stack(parts, axis=-1)


def resample_dense(
    brdf: Brdf,
    theta_step: float,
    n_phi: int,
    theta_max: float | None = None,
    dtype: type = np.float32,
    float_type: type | None = None,
    progress: Progress | None = None,
) -> DenseTable:
    """Tabulate any BRDF on a regular grid of polar angles and azimuths.

    Of a reciprocal one, each pair of polar angles is evaluated in one order.

    Args:
        theta_step: step of the polar angles, in radians.
        n_phi: azimuths over the full circle, of illumination and of view.
        theta_max: last polar angle, in radians; by default that of the BRDF. Nodes at the
            horizon are evaluated at 89.9°.
        float_type: what to evaluate in (see ``evaluate``); by default NumPy float64.
    """
    theta_max = brdf.theta_max if theta_max is None else theta_max
    n_theta = max(int(np.ceil(theta_max / theta_step - 1e-6)), 1) + 1
    thetas = np.append(np.arange(n_theta - 1) * theta_step, theta_max)
    thetas = np.minimum(thetas, _HORIZON)
    phi = 2.0 * np.pi / n_phi * np.arange(n_phi)
    values: np.ndarray = np.empty((n_theta, n_theta, n_phi, n_phi, 3), dtype=dtype)
    directions = to_vector(thetas[:, None], phi[None, :])  # (n_theta, n_phi, 3)
    rows, columns = np.indices((n_theta, n_theta)).reshape(2, -1)
    if brdf.reciprocal:
        rows, columns = np.triu_indices(n_theta)
    for row, column in tracked(list(zip(rows, columns, strict=True)), progress):
        wi, wv = directions[row][:, None, :], directions[column][None, :, :]
        values[row, column] = evaluate(brdf, wi, wv, float_type)
        if brdf.reciprocal:
            values[column, row] = values[row, column].swapaxes(0, 1)
    reciprocal = True if brdf.reciprocal else None
    return DenseTable(values, theta_step, theta_max, reciprocal=reciprocal, name=brdf.name)


def resample_isotropic(
    brdf: Brdf, shape: tuple[int, int, int] = MERL_SHAPE, rotations: int = 12
) -> IsotropicTable:
    """Tabulate any BRDF in the half-difference parameterisation.

    An anisotropic BRDF is averaged over rotations about the normal, and a BRDF
    that is not reciprocal over both orders of the directions. Bins with a direction at or below
    the horizon take the value of the nearest bin above it.

    Args:
        shape: bins of theta_h, theta_d and phi_d.
        rotations: rotations averaged for an anisotropic BRDF.
    """
    wi, wv = (direction.reshape(-1, 3) for direction in bin_directions(shape))
    valid = np.minimum(wi[:, 2], wv[:, 2]) >= _SMALLEST_COSINE
    angles = [0.0]
    if not is_isotropic(brdf):
        angles = list(2.0 * np.pi * np.arange(rotations) / rotations)
    bounces = [(wi[valid], wv[valid])]
    if not brdf.reciprocal:
        bounces.append((wv[valid], wi[valid]))
    mean = np.zeros((int(valid.sum()), 3))
    for first, second in bounces:
        for angle in angles:
            mean += _evaluate_in_chunks(brdf, turn(first, angle), turn(second, angle))
    values = np.zeros((len(valid), 3))
    values[valid] = mean / (len(bounces) * len(angles))
    filled = fill_invalid(values.reshape(*shape, 3), valid.reshape(shape))
    return IsotropicTable(filled, theta_max=brdf.theta_max, name=brdf.name)


def _evaluate_in_chunks(brdf: Brdf, wi: np.ndarray, wv: np.ndarray) -> np.ndarray:
    out = np.empty((len(wi), 3))
    for start in range(0, len(wi), _CHUNK):
        part = slice(start, start + _CHUNK)
        out[part] = evaluate(brdf, wi[part], wv[part])
    return out

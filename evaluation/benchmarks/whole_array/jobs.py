"""The ways to fill the whole 41 × 41 × 180 × 180 RGB array that are timed beside each other."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np
from scipy.interpolate import LinearNDInterpolator, RBFInterpolator, RegularGridInterpolator

from simrig.brdf import evaluate
from simrig.brdf.protocol import Brdf
from simrig.brdf.tables.barycentric import BarycentricBrdf
from simrig.brdf.tables.dense import DenseTable
from simrig.brdf.tables.grid import dense_grid
from simrig.brdf.tables.rbf import RbfBrdf
from simrig.core import backend
from simrig.directions import to_onion, to_vector
from simrig.reconstruction.scattered.barycentric import reconstruct_barycentric
from simrig.reconstruction.slices.tables import reconstruct
from simrig.rigs.measurements.measurement import Measurement

STEP_DEG = 2.0
PAIRS = (41 * 180) ** 2
RECIPROCAL_PAIRS = (41 * 180) * (41 * 180 + 1) // 2


@dataclass(frozen=True)
class Job:
    """A way to fill the array.

    Attributes:
        run: does it, for ``pairs`` of the ``of`` direction pairs that the array needs.
        pairs, of: equal unless the time has to be extrapolated.
    """

    method: str
    by: str
    run: Callable[[], Any]
    pairs: int = PAIRS
    of: int = PAIRS


def directions(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return random pairs of the 2° grid as unit vectors, each (count, 3)."""
    light, view = np.radians(STEP_DEG) * _indices(count)
    return to_vector(*light), to_vector(*view)


def _indices(count: int) -> np.ndarray:
    """Return polar angles and azimuths of both sides, (2, 2, count)."""
    rng = np.random.default_rng(0)
    theta, phi = rng.integers(0, 41, (2, count)), rng.integers(0, 180, (2, count))
    return np.stack([theta, phi], axis=1)


def slice_jobs(measurement: Measurement, along: Brdf, part: int) -> list[Job]:
    """Return the jobs of slices: ours, the same look-up in NumPy, and along highlights."""
    slices, kind = reconstruct(measurement), backend.types("float32").Float
    (theta_i, phi_i), (theta_v, phi_v) = np.radians(STEP_DEG) * _indices(part)
    wi, wv = directions(part)

    def ours() -> None:
        dr.eval(dense_grid(reconstruct(measurement), STEP_DEG))

    def host() -> Any:
        return slices.eval_angles(theta_i, phi_i, theta_v, phi_v)

    return [
        Job("slices", "simrig, with its tables", ours),
        Job("slices", "NumPy", host, part),
        Job("along-highlights", "simrig, look-ups", lambda: evaluate(along, wi, wv, kind), part),
    ]


def grid_jobs(table: DenseTable, part: int) -> list[Job]:
    """Return the jobs of a regular grid: look-ups, and SciPy's ``RegularGridInterpolator``."""
    kind, (wi, wv) = backend.types("float32").Float, directions(part)
    nodes, padded = _padded(table.values, table.theta_step)
    scipy = RegularGridInterpolator(nodes, padded)
    angles = np.radians(STEP_DEG) * _indices(part)
    points = angles.swapaxes(0, 1).reshape(4, -1).T  # theta_i, theta_v, phi_i, phi_v
    return [
        Job("regular-grid", "simrig, look-ups", lambda: evaluate(table, wi, wv, kind), part),
        Job("regular-grid", "SciPy", lambda: scipy(points), part),
    ]


def _padded(values: np.ndarray, theta_step: float) -> tuple[tuple, np.ndarray]:
    """Return nodes and values with the azimuths closed, as SciPy needs them."""
    wrapped = np.concatenate([values, values[:, :, :1]], axis=2)
    wrapped = np.concatenate([wrapped, wrapped[:, :, :, :1]], axis=3)
    theta = np.arange(len(values)) * theta_step
    theta[-1] = max(theta[-1], np.radians(80.0))  # rounding must not leave the last node out
    phi = np.linspace(0.0, 2.0 * np.pi, values.shape[2] + 1)
    return (theta, theta, phi, phi), wrapped.astype(np.float64)


def barycentric_jobs(measurement: Measurement) -> list[Job]:
    """Return the jobs of barycentric interpolation, ours and SciPy's."""
    brdf = reconstruct_barycentric(measurement)

    def ours() -> np.ndarray:
        return reconstruct_barycentric(measurement).to_dense(STEP_DEG)

    return [
        Job("barycentric", "simrig, with its triangles", ours),
        Job("barycentric", "SciPy", lambda: _scipy_barycentric(brdf), 180 * 41 * 180),
    ]


def _scipy_barycentric(brdf: BarycentricBrdf) -> np.ndarray:
    """Fill one ring of the array with SciPy, one side after the other, in the plane z = -1.

    The stereographic plane has no horizon at infinity; SciPy gives NaN beyond the outermost nodes.
    """

    def plane(direction: np.ndarray) -> np.ndarray:
        return direction[:, :2] / (1.0 + direction[:, 2:])

    theta, phi = np.radians(2.0) * np.arange(41), np.radians(2.0) * np.arange(180)
    every = plane(to_vector(theta[:, None], phi).reshape(-1, 3))
    nodes = plane(to_vector(brdf.theta, brdf.phi))
    by_light = LinearNDInterpolator(nodes, brdf.values)(every[20 * 180 : 21 * 180])
    return LinearNDInterpolator(nodes, by_light.swapaxes(0, 1))(every)


def global_jobs(brdf: RbfBrdf, scipy: RBFInterpolator, part: int) -> list[Job]:
    """Return the jobs of one spline through all samples; a hundredth of the part for the host."""
    kind = backend.types("float32").Float
    wi, wv = directions(part // 10)
    few_i, few_v = wi[: part // 100], wv[: part // 100]
    points = np.stack(to_onion(few_i, few_v), axis=-1)
    few, of = len(few_i), RECIPROCAL_PAIRS

    def ours() -> np.ndarray:
        return evaluate(brdf, wi, wv, kind)

    def host() -> np.ndarray:
        return evaluate(brdf, few_i, few_v)

    return [
        Job("rbf-global", "simrig", ours, len(wi), of),
        Job("rbf-global", "NumPy", host, few, of),
        Job("rbf-global", "SciPy", lambda: scipy(points), few, of),
    ]


def local_jobs(brdf: RbfBrdf, part: int) -> list[Job]:
    """Return the job of local splines, which are SciPy's own."""
    wi, wv = directions(part // 50)

    def host() -> np.ndarray:
        return evaluate(brdf, wi, wv)

    return [Job("rbf-local", "SciPy", host, len(wi), RECIPROCAL_PAIRS)]

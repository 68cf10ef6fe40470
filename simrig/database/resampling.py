"""From rings of directions to the database's regular grid, along highlights (thesis A.4.1, A.4.2).

In a subspace of two polar angles the thesis finds the highlights, interpolates linearly along them,
adds what it got to the samples, and interpolates by radial basis functions. Here one interpolation
does both: the logarithms are the sum of a field that depends on the azimuth difference alone (the
specular highlight, the same all along it), one that depends on the half vector alone (anisotropic
highlights run along it) and a local one, each with a radial basis function of its own. The weights
depend on the directions alone, so a material is a product of matrices.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from simrig.brdf.tables.dense import DenseTable
from simrig.core.errors import SimrigError
from simrig.directions.schemes import HemisphereScheme, hemisphere_81
from simrig.directions.spherical import to_vector

THETAS, AZIMUTHS, STEP_DEG = 6, 48, 15.0  # the grid of UTIA's database
# widths of the three: chord of the azimuth difference, distance of half vectors over the largest,
# chord of both azimuths; chosen on the materials of Table D.1 and two weaves
_SPECULAR, _ANISOTROPIC, _LOCAL = 1.5, 0.35, 1.4
_SHARES = (1.0, 1.0, 0.1)
_NUGGET = 1e-3  # of measured averages
_FLOOR = 1e-3  # under the logarithm, over the mean


def resampled(values: np.ndarray, name: str) -> DenseTable:
    """Return averages at all pairs of the 81 directions on the grid 6 × 48 × 6 × 48.

    Args:
        values: (81, 81, 3) f_r in 1/sr, light first; reciprocity is enforced by the mean of both
            orders.

    Raises:
        SimrigError: another shape, or values that are negative or not finite.
    """
    scheme = hemisphere_81()
    values = np.asarray(values, dtype=np.float64)
    if values.shape != (len(scheme), len(scheme), 3):
        raise SimrigError(f"'{name}' needs values of 81 × 81 directions, got {values.shape}")
    if not np.all(np.isfinite(values)) or values.min() < 0.0:
        raise SimrigError(f"'{name}' has values that are negative or not finite: measure it again")
    floor = max(_FLOOR * float(values.mean()), np.finfo(np.float32).tiny)
    logs = np.log(0.5 * (values + values.swapaxes(0, 1)) + floor)
    rings = _rings(scheme)
    table: np.ndarray = np.empty((THETAS, THETAS, AZIMUTHS, AZIMUTHS, 3), dtype=np.float32)
    for row, light in enumerate(rings):
        for column, view in enumerate(rings[row:], start=row):
            own = logs[light][:, view].reshape(-1, 3)
            mean = own.mean(axis=0)
            made = _weights(row, column) @ (own - mean) + mean
            # no highlight grows beyond what was measured beside it by more than a factor of two
            made = np.minimum(made, own.max(axis=0) + np.log(2.0))
            block = np.maximum(np.exp(made) - floor, 0.0).reshape(AZIMUTHS, AZIMUTHS, 3)
            if row == column:
                block = 0.5 * (block + block.swapaxes(0, 1))
            table[row, column], table[column, row] = block, block.swapaxes(0, 1)
    return DenseTable(table, np.radians(STEP_DEG), reciprocal=True, name=name)


def shift_to(template: np.ndarray, table: np.ndarray) -> int:
    """Return by how many azimuths a table has to be turned to lie as the template (A.4.2).

    The subspace of the largest polar angles is compared, by its brightness over the mean of it, in
    the L1 norm, over half a turn.

    Args:
        template, table: (n_theta, n_theta, n_phi, n_phi, 3) of one grid.
    """
    wanted, own = (_brightness(values[-1, -1]) for values in (template, table))
    turns = range(len(own) // 2)
    return min(turns, key=lambda s: float(np.abs(wanted - np.roll(own, (s, s), (0, 1))).sum()))


def turned(table: DenseTable, shift: int) -> DenseTable:
    """Return a table turned about the normal by ``shift`` azimuths."""
    values = np.roll(table.values, (shift, shift), (2, 3))
    return DenseTable(values, table.theta_step, reciprocal=table.reciprocal, name=table.name)


def _brightness(values: np.ndarray) -> np.ndarray:
    found: np.ndarray = values.astype(np.float64) @ (0.299, 0.587, 0.114)  # Y of YUV
    mean = float(found.mean())
    return found / mean if mean > 0.0 else found


def _rings(scheme: HemisphereScheme) -> list[np.ndarray]:
    """Return the numbers of the directions of each polar angle."""
    which = np.round(np.degrees(scheme.theta) / STEP_DEG).astype(int)
    return [np.flatnonzero(which == ring) for ring in range(THETAS)]


@lru_cache(maxsize=THETAS * THETAS)
def _weights(row: int, column: int) -> np.ndarray:
    """Return the weights (48 · 48, samples) of a subspace, float32."""
    scheme = hemisphere_81()
    rings = _rings(scheme)
    light, view = scheme.phi[rings[row]], scheme.phi[rings[column]]
    grid = 2.0 * np.pi / AZIMUTHS * np.arange(AZIMUTHS)
    thetas = np.radians(STEP_DEG) * np.array([row, column])
    samples = _points(thetas, *(a.ravel() for a in np.meshgrid(light, view, indexing="ij")))
    nodes = _points(thetas, *(a.ravel() for a in np.meshgrid(grid, grid, indexing="ij")))
    system = _kernel(samples, samples)
    system[np.diag_indices_from(system)] += _NUGGET
    found: np.ndarray = np.linalg.solve(system, _kernel(samples, nodes)).T
    return found.astype(np.float32)


def _points(thetas: np.ndarray, phi_i: np.ndarray, phi_v: np.ndarray) -> list[np.ndarray]:
    """Return what the three fields depend on, each (n, dimensions) over its width."""
    across = phi_i - phi_v
    specular = np.column_stack([np.cos(across), np.sin(across)])
    half = to_vector(thetas[0], phi_i) + to_vector(thetas[1], phi_v)
    half = half[:, :2] / max(float(np.sin(thetas).sum()), 1e-9)
    local = np.column_stack([np.cos(phi_i), np.sin(phi_i), np.cos(phi_v), np.sin(phi_v)])
    local *= np.repeat(np.where(thetas > 0.0, 1.0, 0.0), 2)  # the pole has no azimuth
    if thetas.min() == 0.0:  # one circle alone: all depends on its azimuth
        specular = 0.0 * specular
    return [specular / _SPECULAR, half / _ANISOTROPIC, local / _LOCAL]


def _kernel(a: list[np.ndarray], b: list[np.ndarray]) -> np.ndarray:
    total = np.zeros((len(a[0]), len(b[0])))
    for share, left, right in zip(_SHARES, a, b, strict=True):
        apart = np.sqrt(np.maximum(
            (left**2).sum(1)[:, None] + (right**2).sum(1) - 2.0 * left @ right.T, 0.0
        ))  # fmt: skip
        total += share * (1.0 + np.sqrt(3.0) * apart) * np.exp(-np.sqrt(3.0) * apart)
    return total

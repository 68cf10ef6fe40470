"""The method ``basis``: a measurement and a database to a BRDF."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from simrig.core.errors import SimrigError
from simrig.core.progress import Progress
from simrig.database.grid import EPSILON
from simrig.database.known import Known, known
from simrig.database.linear import SOLVERS, over_rotations, solved
from simrig.database.posterior import Posterior
from simrig.directions.half_difference import to_half_difference
from simrig.directions.spherical import to_vector
from simrig.plans.protocol import Measured
from simrig.reconstruction.basis.table import slice_table
from simrig.reconstruction.result import Reconstructed

PROCESS = "process"
_SAME = 1e-4  # radians: rotations, and directions, that are one


class Uncertain(Measured, Protocol):
    """A measurement that says how uncertain its values are."""

    @property
    def uncertainty(self) -> np.ndarray | None: ...


def reconstruct_from_basis(
    measurement: Uncertain,
    *,
    database: str | None = None,
    solver: str = PROCESS,
    progress: Progress | None = None,
) -> Reconstructed:
    """Return the BRDF that samples and a database make.

    Args:
        measurement: samples at any directions; for the thesis's solvers the same directions at
            each rotation.
        database: folders, with commas between; that of the plan unless given.
        solver: ``"process"``, or one of ``SOLVERS``.

    Raises:
        SimrigError: no database, or samples that the solver cannot use.
    """
    own = _database(measurement, database)
    wi = to_vector(measurement.theta_i, measurement.phi_i)
    wv = to_vector(measurement.theta_v, measurement.phi_v)
    values = np.maximum(np.asarray(measurement.values, dtype=np.float64), 0.0)
    notes = [f"database of {len(own.database)} materials"]
    if solver == PROCESS:
        posterior = Posterior.of(own.process, wi, wv, values, measurement.uncertainty)
        logs = posterior.logs(progress)
        notes.append(
            f"predicted error of logarithms {posterior.error():.3g} (left-out samples "
            f"{posterior.calibration:.2g} times as far off as stated)"
        )
    else:
        logs, condition = _by_rotations(own, wi, wv, values, solver)
        notes.append(f"{solver}, condition number {condition:.3g}")
    expected = getattr(measurement.plan, "fingerprint", None)
    if database is None and expected not in (None, own.fingerprint):
        notes.append("the database has changed since the measurement")
    table = slice_table(own.basis.grid, logs, measurement.material)
    return Reconstructed(table, table.stored_bytes, tuple(notes))


def _database(measurement: Measured, database: str | None) -> Known:
    text = database or getattr(measurement.plan, "database", None)
    if not text:
        raise SimrigError(
            "method 'basis' needs --database, a folder of BRDFs: 'simrig database build' makes one"
        )
    return known(text)


def _by_rotations(
    own: Known, wi: np.ndarray, wv: np.ndarray, values: np.ndarray, solver: str
) -> tuple[np.ndarray, float]:
    """Return the logarithms by a solver of the thesis, and the condition number of its rows."""
    basis = own.basis
    directions, phi, order = _arranged(wi, wv, solver)
    weights = basis.grid.rows(*directions.T)
    rows, mean = weights @ basis.principal, weights @ basis.mean
    cosines = np.maximum(wi[:, 2] * wv[:, 2], EPSILON)[:, None]
    logs = np.log(values * cosines + EPSILON)
    data = np.stack([logs[o] - mean[:, None] for o in order], axis=1)
    base = basis.mean[basis.grid.specular.ravel()]
    found = solved(basis, rows, data, phi, solver, mean=base)
    found = over_rotations(found, phi, basis.grid.rotations)
    whole = np.einsum("pk,krc->prc", basis.principal, found) + basis.mean[:, None, None]
    singular = np.linalg.svd(rows, compute_uv=False)
    condition = float(singular[0] / singular[-1]) if singular[-1] > 0.0 else float("inf")
    return whole, condition


def _arranged(
    wi: np.ndarray, wv: np.ndarray, solver: str
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return directions (n, 3), rotations (r,) and the samples (r, n) of a measurement.

    A sample at theta_h = 0 tells phi_h + phi_d alone; it belongs to the rotation at which it is one
    of the directions. One along the normal on both sides is at every rotation the same.
    """
    at = to_half_difference(wi, wv)
    specular = at.theta_h < _SAME
    azimuth = np.where(specular, at.phi_h + at.phi_d, at.phi_d)
    places = np.column_stack([at.theta_h, at.theta_d, azimuth])
    cells = np.round(np.mod(at.phi_h[~specular], 2.0 * np.pi) / _SAME)
    turns = np.unique(cells % round(2.0 * np.pi / _SAME)) * _SAME
    turns = turns if len(turns) else np.zeros(1)
    left, directions, order = list(range(len(places))), [], []
    for n in np.argsort(specular, kind="stable"):
        if n not in left or not (specular[n] or _agree(at.phi_h[n], turns[0], 2.0 * np.pi)):
            continue
        one = places[n] - [0.0, 0.0, turns[0] if specular[n] else 0.0]
        rest, found = left.copy(), []
        for turn in turns:
            number = _match(one, turn, places, at.phi_h, specular, rest)
            if number is None:
                break
            rest.remove(number)
            found.append(number)
        if len(found) == len(turns):
            left = rest
            directions.append(one)
            order.append(found)
    if left:
        raise SimrigError(
            f"solver '{solver}' needs the same directions at each rotation of the material: "
            "measure with --layout regular, or use --solver process"
        )
    return np.array(directions), turns, np.array(order).T


def _match(
    one: np.ndarray,
    turn: float,
    places: np.ndarray,
    phi_h: np.ndarray,
    specular: np.ndarray,
    left: list[int],
) -> int | None:
    """Return the sample among those left that is a direction at a rotation."""
    among = np.array(left, dtype=int)
    mirror = one[0] < _SAME
    wished = one[2] + turn if mirror else one[2]
    fits = np.all(np.abs(places[among, :2] - one[:2]) < _SAME, axis=1)
    turned = _agree(places[among, 2], wished, np.pi) | (one[1] < _SAME)
    fits &= turned & (specular[among] == mirror)
    if not mirror:
        fits &= _agree(phi_h[among], turn, 2.0 * np.pi)
    return int(among[np.argmax(fits)]) if fits.any() else None


def _agree(a: np.ndarray, b: float, period: float) -> np.ndarray:
    """Return which azimuths agree with another."""
    near: np.ndarray = np.abs((a - b + 0.5 * period) % period - 0.5 * period) < 2.0 * _SAME
    return near


ALL_SOLVERS = (PROCESS, *SOLVERS)

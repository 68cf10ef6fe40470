"""From a measurement by grids of visible normals to a BRDF in RGL's form ([DJ18])."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import interp1d
from scipy.ndimage import distance_transform_edt

from simrig.brdf.tables.rgl import RglBrdf
from simrig.core.errors import SimrigError
from simrig.plans.protocol import Measured, plan_of
from simrig.plans.visible_normals import SIZES, Finer, Grids, TableSizes, VisibleNormalsPlan
from simrig.reconstruction.result import Reconstructed

_VIEWS = 16  # polar angles of views in a table of an isotropic material, at least


def reconstruct_visible_normals(measurement: Measured) -> Reconstructed:
    """Return the BRDF whose tables hold what was measured.

    Between views a renderer interpolates what is stored, f_r · cos · 4 σ / D. That is even along
    highlights, and loses light where there is hardly one. So of two ways the one is taken that
    predicts left-out views better: the tables as they were measured, or with more views and nodes,
    f_r interpolated between the views, each with its own cosine.

    Args:
        measurement: by the plan ``visible-normals``.

    Raises:
        SimrigError: a measurement by another plan, or whose arrays do not fit together.
    """
    plan = plan_of(measurement, VisibleNormalsPlan, "grids of visible normals")
    sizes = TableSizes.from_array(measurement.layout[SIZES])
    retro = plan.retro_values(sizes, measurement.values)
    grids = plan.grids(sizes, retro)
    measured, wanted = measurement.values[plan.first(sizes) :], grids.wanted(sizes.half)
    if len(measured) != np.count_nonzero(wanted):
        raise SimrigError(f"the measurement of '{measurement.material}' misses nodes of its grids")
    known = np.zeros((*wanted.shape, 3))
    known[wanted] = measured
    if sizes.half:
        middle = sizes.side // 2
        for array in (known, wanted):
            array[:, :, middle + 1 :] = array[:, :, :middle][:, :, ::-1]
    note = f"{sizes.thetas} × {sizes.phis} views, {sizes.side} × {sizes.side} nodes each"
    if _even_in_reflectance(known, grids):
        grids, rgb = _with_more_nodes(known, grids, plan, sizes, retro)
        note += ", f_r interpolated between views"
    else:
        rgb = known * _to_stored(grids)
    made = RglBrdf(
        grids.phi.tolist(),
        grids.theta.tolist(),
        grids.ndf.astype(np.float32),
        grids.sigma.astype(np.float32),
        grids.vndf.astype(np.float32),
        rgb.astype(np.float32),
        name=measurement.material,
    )
    stored = sum(np.asarray(table).nbytes for table in (rgb, grids.vndf, grids.ndf)) // 2
    kind = "isotropic" if sizes.isotropic else "anisotropic"
    return Reconstructed(made, stored, (kind, note))


def _to_stored(grids: Grids) -> np.ndarray:
    """Return the factor from f_r to what is stored; 0 where the light is below the horizon."""
    return np.asarray((np.maximum(grids.light[..., 2], 0.0) * grids.ratio)[..., None])


def _even_in_reflectance(known: np.ndarray, grids: Grids) -> bool:
    """Return whether views left out are predicted better by f_r than by what is stored.

    The error is that of the displayed cube root of f_r · cos, at the nodes of each inner view.
    """
    factor, cosine = _to_stored(grids), np.maximum(grids.light[..., 2:], 0.0)
    errors = np.zeros(2)
    for own in range(1, len(grids.theta) - 1):
        low, middle, high = grids.theta[own - 1 : own + 2]
        part = (middle - low) / (high - low)
        beside = [
            (1.0 - part) * values[:, own - 1] + part * values[:, own + 1]
            for values in (known, known * factor)
        ]
        beside[1] = beside[1] / np.maximum(factor[:, own], np.finfo(float).tiny)
        truth = np.cbrt(known[:, own] * cosine[:, own])
        there = cosine[:, own, ..., 0] > 0.0
        for number, found in enumerate(beside):
            errors[number] += np.abs(np.cbrt(found * cosine[:, own]) - truth)[there].sum()
    return bool(errors[0] < errors[1])


def _with_more_nodes(
    known: np.ndarray, grids: Grids, plan: VisibleNormalsPlan, sizes: TableSizes, retro: np.ndarray
) -> tuple[Grids, np.ndarray]:
    """Return finer grids and what is stored there: f_r between views, f_r · 4 σ / D in each.

    Nodes below the horizon continue what lies nearest, with the cosine that they have.
    """
    times = max(1, -(-_VIEWS // (sizes.thetas - 1)))
    finer = Finer(times, 4) if sizes.isotropic else Finer(2, 2)
    views = plan.grids(sizes, retro, Finer(finer.views, 1))
    fine = plan.grids(sizes, retro, finer)
    known = _between(_continued(known, grids.wanted(False)), grids, views)
    known = _continued(known * views.ratio[..., None], views.wanted(False))
    return fine, _between(known, views, fine) * fine.light[..., 2:]


def _continued(known: np.ndarray, measured: np.ndarray) -> np.ndarray:
    """Return (phi, theta, row, column, 3) with the nearest measured node where none was."""
    out = known.copy()
    for own, there in zip(
        out.reshape(-1, *out.shape[2:]), measured.reshape(-1, *measured.shape[2:]), strict=True
    ):
        nearest = distance_transform_edt(~there, return_distances=False, return_indices=True)
        own[...] = own[tuple(nearest)]
    return out


def _between(known: np.ndarray, coarse: Grids, fine: Grids) -> np.ndarray:
    """Return values at the nodes of finer grids, linear along each of the four axes."""
    sides = [np.linspace(0.0, 1.0, grids.ratio.shape[2]) for grids in (coarse, fine)]
    axes = ((coarse.phi, fine.phi), (coarse.theta, fine.theta), sides, sides)
    for axis, (nodes, wanted) in enumerate(axes):
        if len(nodes) != len(wanted):
            known = np.asarray(interp1d(nodes, known, axis=axis, assume_sorted=True)(wanted))
    return known

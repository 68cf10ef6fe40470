"""From a measurement by grids of visible normals to a BRDF in RGL's form ([DJ18])."""

from __future__ import annotations

import numpy as np

from simrig.brdf.tables.rgl import RglBrdf
from simrig.core.errors import SimrigError
from simrig.plans.protocol import Measured, plan_of
from simrig.plans.visible_normals import SIZES, TableSizes, VisibleNormalsPlan
from simrig.reconstruction.result import Reconstructed


def reconstruct_visible_normals(measurement: Measured) -> Reconstructed:
    """Return the BRDF whose tables hold what was measured.

    Nodes below the horizon hold 0, as in the database.

    Args:
        measurement: by the plan ``visible-normals``.

    Raises:
        SimrigError: a measurement by another plan, or whose arrays do not fit together.
    """
    plan = plan_of(measurement, VisibleNormalsPlan, "grids of visible normals")
    sizes = TableSizes.from_array(measurement.layout[SIZES])
    grids = plan.grids(sizes, plan.retro_values(sizes, measurement.values))
    measured = measurement.values[plan.first(sizes) :]
    if len(measured) != len(grids.node):
        raise SimrigError(f"the measurement of '{measurement.material}' misses nodes of its grids")
    rgb = np.zeros((grids.factor.size, 3))
    rgb[grids.node] = measured * grids.factor.reshape(-1, 1)[grids.node]
    rgb = rgb.reshape(*grids.factor.shape, 3)
    if sizes.isotropic and sizes.mirror:
        half = sizes.side // 2
        rgb[:, :, half + 1 :] = rgb[:, :, :half][:, :, ::-1]
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
    views = f"{sizes.thetas} × {sizes.phis} views, {sizes.side} × {sizes.side} nodes each"
    kind = "isotropic" if sizes.isotropic else "anisotropic"
    return Reconstructed(made, stored, (kind, views))

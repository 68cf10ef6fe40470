"""What the simulation itself adds to a recording: rounding and samples of areas, no instrument's.

They stand apart from the budget: no laboratory has them.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from simrig.brdf.protocol import evaluate
from simrig.core import backend
from simrig.directions import to_vector
from simrig.evaluation.uncertainty.budget import BLACK, Instruments
from simrig.rigs.direct.recording import at, at_nodes, averaged

_AREAS = ("light-size", "aperture-size", "spot-size")


def renderer_part(instruments: Instruments, angles: np.ndarray, spp: int) -> dict[str, Any]:
    """Return noise and bias of a recording that is rendered, in per cent of f_r.

    Args:
        instruments: whose material and optics are rendered.
        angles: (n, 4) in radians.
        spp: samples per pixel; each has its own point of light, aperture and spot.

    Returns:
        ``spp``; ``noise_percent``: median relative deviation of a value's mean over its pixels;
        ``rounding_percent``: of float32 look-ups against float64, and ``quadrature_percent``: of
        32 pairs of nodes, by which the direct level averages, against 128; None where everything
        is black, or the material does not run in kernels.
    """
    truth = at(instruments.brdf, angles)
    lit = truth > BLACK
    bench = instruments.bench.instrument
    if not np.any(lit):
        none = dict.fromkeys(("noise_percent", "rounding_percent", "quadrature_percent"))
        return {"spp": spp, **none}
    nodes = at_nodes(instruments.brdf, angles, bench, _AREAS)
    noise = nodes.std(axis=1) / np.sqrt(spp * bench.pixels)
    few, many = (averaged(instruments.brdf, angles, bench, _AREAS, n) for n in (32, 128))
    rounding = None
    if instruments.brdf.in_kernels:
        wi, wv = to_vector(angles[:, 0], angles[:, 2]), to_vector(angles[:, 1], angles[:, 3])
        single = backend.types("float32").Float
        rounded = evaluate(instruments.brdf, wi, wv, single, differentiable=False)
        rounding = float(100.0 * np.median(np.abs(rounded - truth)[lit] / truth[lit]))
    return {
        "spp": spp,
        "noise_percent": float(100.0 * np.median(noise[lit] / truth[lit])),
        "rounding_percent": rounding,
        "quadrature_percent": float(100.0 * np.median(np.abs(few - many)[lit] / truth[lit])),
    }

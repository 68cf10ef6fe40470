"""How well an instrument knows what it measures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from simrig.brdf.protocol import Brdf
from simrig.evaluation.uncertainty.budget import TRIALS
from simrig.evaluation.uncertainty.costs import SAMPLES
from simrig.evaluation.uncertainty.result import Budget, make_budget
from simrig.front_door.materials import as_brdf
from simrig.rigs.registry import find_description


def budget(
    material: Brdf | str | Path,
    *,
    instrument: str | Path = "utia",
    thetas_deg: Sequence[float] | None = None,
    pairs: np.ndarray | None = None,
    trials: int = TRIALS,
    seed: int = 0,
    samples: int = SAMPLES,
    exposures: int = 1,
    sources: Sequence[str] | None = None,
    albedo: bool = True,
    spp: int = 64,
    progress: Callable[..., None] | None = None,
) -> Budget:
    """Return the uncertainty budget of an instrument that measures a material.

    Args:
        material: a BRDF, its name or its file.
        instrument: one that comes with simrig, or a file (docs/instruments.md).
        thetas_deg: polar angles of light and view alike, at eight azimuths each.
        pairs: (n, 4) theta_i, theta_v, phi_i, phi_v in radians in their place.
        trials: virtual instruments that are drawn.
        seed: of the draws.
        samples: of the measurement whose hours are stated.
        exposures: of every value.
        sources: that count, see ``simrig.evaluation.uncertainty.sources``; all unless given.
        albedo: also the budget of the albedo.
        spp: samples per pixel of a rendered recording, for the renderer's own part.
        progress: called with steps done and in total.

    Returns:
        ``expanded`` (per cent, k = 2), ``rows()`` by source and polar angle, ``dominant`` with
        what halving it costs, ``curves`` (uncertainty over hours, exposures, price), ``unstated``,
        ``renderer``; ``to_dict()`` gives plain values.

    Raises:
        SimrigError: see ``simrig.evaluation.uncertainty.result.make_budget``.

    Source: JCGM 101:2008.
    """
    return make_budget(
        as_brdf(material),
        find_description(instrument),
        thetas_deg=thetas_deg,
        pairs=None if pairs is None else np.asarray(pairs, dtype=np.float64),
        trials=trials,
        seed=seed,
        samples=samples,
        exposures=exposures,
        sources=sources,
        albedo=albedo,
        spp=spp,
        progress=progress,
    )

"""Which symmetries a material has, by how well left-out samples are predicted under each."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from simrig.brdf.kriging.coordinates import prior_of
from simrig.brdf.kriging.displayed import shown
from simrig.brdf.kriging.model import KrigingModel, Samples, fit_model
from simrig.brdf.kriging.symmetry import Symmetry

# more symmetries are taken when they predict at most this much worse
_TIE = 1.02
# where fits start too: width of the highlight in radians, logit of the linear share
_STARTS = ((0.002, 1.7), (0.3, 1.0))

SYMMETRIES: tuple[Symmetry, ...] = (
    Symmetry(isotropic=True, reciprocal=True, mirror=True, half_turn=True),
    Symmetry(isotropic=True, mirror=True, half_turn=True),
    Symmetry(isotropic=True, half_turn=True),
    Symmetry(reciprocal=True, mirror=True, half_turn=True),
    Symmetry(reciprocal=True, half_turn=True),
    Symmetry(reciprocal=True, mirror=True),
    Symmetry(reciprocal=True),
    Symmetry(mirror=True, half_turn=True),
    Symmetry(half_turn=True),
    Symmetry(),
)


def left_out_error(model: KrigingModel) -> float:
    """Return how wrong the displayed values of left-out samples are, and their logarithms.

    The geometric mean of the two: what is displayed counts, and what is dark is not forgotten.
    """
    misses, _ = model.left_out()
    radiance = model.transform.radiance(model.logs)
    weight = shown(radiance, model.level)
    displayed = np.mean(np.abs(misses) * weight) / max(np.mean(weight), 1e-300)
    return float(np.sqrt(displayed * np.mean(np.abs(misses))) + 1e-12)


def final_model(samples: Samples, symmetry: Symmetry) -> KrigingModel:
    """Return the model of all samples, searched from narrow, usual and wide highlights.

    The criterion of a fit has several valleys; the left-out samples say which is best.
    """
    usual = prior_of(symmetry).mean
    starts = [usual]
    for width, linear in _STARTS:
        start = usual.copy()
        start[-3:-1] = np.log(width), linear
        starts.append(start)
    models = [fit_model(samples, symmetry, start, final=True) for start in starts]
    return min(models, key=left_out_error)


def choose_model(
    samples: Samples,
    candidates: Iterable[Symmetry] = SYMMETRIES,
    axis: float = 0.0,
    final: bool = False,
) -> KrigingModel:
    """Return the model of the symmetry that predicts left-out samples best.

    Args:
        samples: at least two.
        candidates: symmetries, those with more first: these win where it makes no difference.
        axis: azimuth of the main axis, radians.
        final: see ``fit_model``.
    """
    best: KrigingModel | None = None
    least = np.inf
    for symmetry in candidates:
        turned = Symmetry(**{**symmetry.as_dict(), "axis": 0.0 if symmetry.isotropic else axis})
        model = fit_model(samples, turned, evaluations=100)
        error = left_out_error(model)
        if best is None or error * _TIE < least:
            best, least = model, error
    assert best is not None
    return fit_model(samples, best.symmetry, best.parameters, final=True) if final else best

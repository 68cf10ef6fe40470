"""Which symmetries a material has, by how well left-out samples are predicted under each."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from functools import lru_cache

import numpy as np

from simrig.brdf.kriging.coordinates import Stretch, prior_of
from simrig.brdf.kriging.displayed import shown
from simrig.brdf.kriging.model import KrigingModel, fit_model
from simrig.brdf.kriging.outliers import trusted
from simrig.brdf.kriging.profile import fit_profile
from simrig.brdf.kriging.samples import Samples
from simrig.brdf.kriging.symmetry import Symmetry

# more symmetries are taken when they predict at most this much worse
_TIE = 1.02
_BETTER = 0.97  # a profile must predict this much better
_LEAST_LINEAR = 0.4  # share of theta_h itself in the steps of a profile
# where fits start too: width of the highlight in radians, logit of the linear share
_STARTS = ((0.002, 1.7), (0.3, 1.0))

SYMMETRIES: tuple[Symmetry, ...] = (
    Symmetry(isotropic=True, reciprocal=True, mirror=True, half_turn=True, bivariate=True),
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
    misses, _ = model.left_out
    radiance = model.transform.radiance(model.logs)
    weight = shown(radiance, model.level)
    displayed = np.mean(np.abs(misses) * weight) / max(np.mean(weight), 1e-300)
    return float(np.sqrt(displayed * np.mean(np.abs(misses))) + 1e-12)


@dataclass(frozen=True, eq=False)
class _Task:
    """What a final model is made of; equal to another of the same samples."""

    samples: Samples
    symmetry: Symmetry

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, _Task) or other.symmetry != self.symmetry:
            return False
        return all(
            np.array_equal(getattr(self.samples, own.name), getattr(other.samples, own.name))
            for own in fields(Samples)
        )

    def __hash__(self) -> int:
        return hash((self.symmetry, len(self.samples)))


def final_model(samples: Samples, symmetry: Symmetry) -> KrigingModel:
    """Return the model of all samples, searched from narrow, usual and wide highlights.

    The criterion of a fit has several valleys; the left-out samples say which is best. Samples
    that all others contradict are left out for good. The last model is remembered: a plan predicts
    its error, then it is reconstructed.
    """
    return _searched(_Task(samples, symmetry))


@lru_cache(maxsize=1)
def _searched(task: _Task) -> KrigingModel:
    samples, symmetry = task.samples, task.symmetry
    usual = prior_of(symmetry).mean
    starts = [usual]
    for width, linear in _STARTS:
        start = usual.copy()
        start[-3:-1] = np.log(width), linear
        starts.append(start)
    models = [fit_model(samples, symmetry, start) for start in starts]
    best = min(models, key=left_out_error)
    right = trusted(best).samples
    if len(right) < len(samples):
        return _searched(_Task(right, symmetry))
    longer = fit_model(samples, symmetry, best.parameters, final=True)
    return with_profile(min(longer, best, key=left_out_error), final=True)


def with_profile(model: KrigingModel, final: bool = False) -> KrigingModel:
    """Return the model with the curve of theta_h that its samples share, where that helps.

    Args:
        final: see ``fit_model``.
    """
    if not model.symmetry.isotropic:
        return model
    own = model.coordinates.stretch
    steps = Stretch(own.width, max(own.linear, _LEAST_LINEAR))
    theta_h = model.samples_angles[:, 0]
    found = fit_profile(theta_h, model.logs, model.features, model.coordinates.nugget, steps)
    if found is not None and model.profile is not None:
        return replace(model, profile=found)
    if found is None and model.profile is None:
        return model
    other = fit_model(model.samples, model.symmetry, model.parameters, final=final, profile=found)
    return other if left_out_error(other) < _BETTER * left_out_error(model) else model


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
        model = fit_model(samples, turned)
        error = left_out_error(model)
        if best is None or error * _TIE < least:
            best, least = model, error
    assert best is not None
    return fit_model(samples, best.symmetry, best.parameters, final=True) if final else best

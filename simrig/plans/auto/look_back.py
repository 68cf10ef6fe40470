"""A look back at what the pilot said: would another symmetry predict left-out samples better?"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from simrig.brdf.kriging.choice import left_out_error
from simrig.brdf.kriging.images import contradicted, mirror_axis
from simrig.brdf.kriging.model import KrigingModel, fit_model
from simrig.brdf.kriging.symmetry import IMAGES, Symmetry

_OF_ISOTROPIC = "reciprocal", "mirror"  # the symmetries that isotropic materials may lack
_FIRST, _MORE = 2, 4  # steps of a search: to see what is promising, and then
_PROMISING = 1.5  # the error after the first of them over that of the model in use
_CLEARLY = 0.9  # another symmetry must predict this much better,
_SLIGHTLY = 0.98  # another estimate of the axis, or what the pilot saw, this much


@dataclass(frozen=True)
class Look:
    """What a look back found.

    Attributes:
        best: the model in use, or that of a symmetry that predicts left-out samples clearly better.
        same: the same among those that depend on as many angles.
        share: error of ``best`` over that of ``same``.
    """

    best: KrigingModel
    same: KrigingModel
    share: float


def looked_back(model: KrigingModel, bivariate: bool) -> Look:
    """Return which symmetries predict left-out samples clearly better than the one in use.

    Samples lie at all azimuths and in both orders, whatever was assumed, so that they show what a
    pilot missed, and where a mirror plane lies. A symmetry is given up only where samples
    contradict their images besides.

    Args:
        model: that is in use.
        bivariate: whether the pilot allows that phi_d does not matter.
    """
    errors = {model: left_out_error(model)}
    for symmetry in alternatives(model.symmetry, bivariate):
        other = _fitted(model, symmetry, _FIRST)
        errors[other] = left_out_error(other)
        if errors[other] < _PROMISING * errors[model]:
            other = _fitted(model, symmetry, _MORE, other.parameters)
            errors[other] = left_out_error(other)
    free = [m for m in errors if not (m.symmetry.isotropic or m.symmetry.mirror)]
    base = min(free, key=errors.__getitem__)
    turned = replace(base.symmetry, mirror=True, axis=mirror_axis(base))
    mirrored = _fitted(model, turned, _MORE)
    errors[mirrored] = left_out_error(mirrored)
    # no symmetry wins by a search that went better: the one in use goes on from the best parameters
    first = min(errors, key=errors.__getitem__)
    again = _fitted(model, model.symmetry, _MORE, first.parameters)
    errors[model] = min(errors[model], left_out_error(again))
    alike = [m for m in errors if m.symmetry.dimensions == model.symmetry.dimensions]
    best, same = (_clearly_better(model, each, errors) for each in (list(errors), alike))
    return Look(best, same, errors[best] / errors[same])


def back_to(model: KrigingModel, first: Symmetry) -> KrigingModel:
    """Return the model, or that of the symmetry that the pilot saw as soon as it predicts better.

    Few samples can be predicted best by more symmetry than a material has: what differs little is
    worth a dimension only once there are many.
    """
    if model.symmetry == first:
        return model
    other = _fitted(model, first, _MORE)
    return other if left_out_error(other) < _SLIGHTLY * left_out_error(model) else model


def _clearly_better(
    model: KrigingModel, others: list[KrigingModel], errors: Mapping[KrigingModel, float]
) -> KrigingModel:
    own = model.symmetry  # an axis at exactly 0 is what the pilot tried, and no estimate
    for best in sorted(others, key=errors.__getitem__):
        of_axis = own.axis != 0.0 and own == replace(best.symmetry, axis=own.axis)
        wanted = _SLIGHTLY if of_axis else _CLEARLY
        if errors[best] >= wanted * errors[model]:
            break
        given_up = [name for name in IMAGES if getattr(own, name) > getattr(best.symmetry, name)]
        alike = best.symmetry.dimensions == own.dimensions
        if not alike or all(contradicted(best, name) for name in given_up):
            return best
    return model


def alternatives(symmetry: Symmetry, bivariate: bool) -> list[Symmetry]:
    """Return the symmetries that differ in one; mirrors at other azimuths are looked for later.

    One at least is anisotropic without a mirror.

    Args:
        symmetry: that is in use.
        bivariate: whether the pilot allows that phi_d does not matter.
    """
    plain = replace(symmetry, bivariate=False)
    if symmetry.isotropic:
        others = [replace(plain, **{name: not getattr(plain, name)}) for name in _OF_ISOTROPIC]
        turning = replace(plain, isotropic=False, mirror=False)
        others += [turning, replace(turning, half_turn=False)]
        if symmetry.bivariate:
            return [plain, *others]
        if bivariate and symmetry.reciprocal and symmetry.mirror:
            others.append(replace(symmetry, bivariate=True))
        return others
    names = ("reciprocal", "half_turn", *(("mirror",) if symmetry.mirror else ()))
    others = [replace(plain, **{name: not getattr(plain, name)}) for name in names]
    return [*others, replace(plain, isotropic=True, mirror=True, half_turn=True, axis=0.0)]


def _fitted(
    model: KrigingModel, symmetry: Symmetry, steps: int, start: np.ndarray | None = None
) -> KrigingModel:
    """Return the model of the same samples under another symmetry."""
    profile = model.profile if symmetry.isotropic else None
    return fit_model(model.samples, symmetry, start, steps, profile=profile)

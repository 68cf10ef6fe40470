"""Samples that all others about them contradict: a hot pixel, a cosmic ray, a shaken rig.

A sample stands out by its deviation from what the others predict, over that of the samples next to
it where they are predicted without it: one wrong value spoils what its neighbours are compared
with. A narrow highlight of which one sample was seen stands out in the same way, so a plan measures
again what stands out, and only a reconstruction leaves out what nothing confirms.
"""

from __future__ import annotations

import numpy as np

from simrig.brdf.kriging.model import KrigingModel, fit_model

STANDS_OUT = 8.0
WRONG = 50.0  # measured materials have up to 40, one value a hundred times off 300
_SPOILT = 0.6  # error of the others without it, over that with it
_LEAST = float(np.log(2.0))  # what misses by less spoils nothing
_MOST = 64  # looked at
_AROUND, _USUAL = 8, 75.0  # samples about it, and the percentile of their deviations


def outstanding(model: KrigingModel) -> np.ndarray:
    """Return the deviation of each sample over that usual about it, (n,).

    0 where it is small, and where the sample was measured again.
    """
    found = np.zeros(len(model.samples))
    misses, spread = model.left_out
    misses = np.abs(misses).max(axis=1)
    deviations = misses / spread
    suspects = np.flatnonzero((misses > _LEAST) & ~model.samples.again)
    suspects = suspects[np.argsort(-deviations[suspects], kind="stable")][:_MOST]
    if len(suspects) == 0 or len(model.samples) <= 2 * _AROUND:
        return found
    others = model.nearest(suspects, suspects[:, None], _AROUND) % len(found)
    own = others.ravel()
    excluded = np.stack([own, np.repeat(suspects, _AROUND)], axis=1)
    off, off_spread = model.without(own, excluded)
    usual = (np.abs(off).max(axis=1) / off_spread).reshape(others.shape)
    found[suspects] = deviations[suspects] / (np.percentile(usual, _USUAL, axis=1) + 1e-12)
    return found


def trusted(model: KrigingModel) -> KrigingModel:
    """Return the model without samples that all others contradict and nothing confirms.

    Where few are known a wrong one passes for structure finer than it is: those that stand out
    are wrong too if all others are predicted much better by a model that never saw them.
    """
    stands_out = outstanding(model)
    kept = stands_out <= (WRONG if stands_out.max() > WRONG else STANDS_OUT)
    if kept.all():
        return model
    samples = model.samples.only(kept)
    other = fit_model(samples, model.symmetry, model.parameters, profile=model.profile)
    before, after = np.abs(model.left_out[0])[kept].mean(), np.abs(other.left_out[0]).mean()
    return other if stands_out.max() > WRONG or after < _SPOILT * before else model

"""A rehearsal of the picture: a few of its pixels, drawn four times with all of their samples.

How far stratified samples go beyond those of a look, and how often what is rare comes, only as many
samples as the picture has can tell. Pixels are drawn by how much they are expected to be off, and
half of them evenly; the ratio of what they differ by to what was foretold of them
corrects the noise of the whole picture. It counts as far as so few pixels can tell it.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from simrig.core.effects import Decision, Tolerance
from simrig.planning.change import Display
from simrig.planning.costs import USUAL_SPP
from simrig.planning.looks import MOST_SECONDS
from simrig.planning.sampled import SampledSubject
from simrig.planning.view import SEED
from simrig.rendering import multijitter
from simrig.rendering.render import made_integrator

_ROUNDS = 3  # of one picture at most: one may tell that it needs other samples
_ENOUGH = 0.25  # of the noise that is allowed: time that is left over buys no less than that
_SHARE, _SHARE_OF_WIDE = 0.06, 0.1  # of the samples of the picture; behind a wide filter
_LITTLE = 1 << 15  # samples that cost no more than fewer
_FEWEST, _MOST = 6, 128  # pixels
# that each is drawn: stratified samples of a sharp edge take one of two values, so that two
# differ by no more than one is off
_TIMES = 4
_SAMPLES, _FEW = 1 << 21, 32  # in all, of as many pixels at least where there are more of each
_ALIKE = 1.6  # numbers of samples whose rehearsal is the same
_SMALL = 16  # samples: what fewer leave lies between what one and what a group of a look leaves
_CAUTION = 0.5  # standard errors of the ratio: samples are chosen by it
_USUAL = 0.4  # by what what is foretold is usually off, as a logarithm


def samples_rehearsed(
    sampled: SampledSubject,
    decision: Decision,
    noise: Tolerance,
    seconds: float | None,
    integrator: dict[str, Any],
) -> tuple[int, Decision, float]:
    """Return what ``_samples`` does once a rehearsal of the picture confirms it."""
    found = _samples(sampled, decision, noise, seconds)
    for _ in range(_ROUNDS):
        if not _rehearse(sampled, integrator, noise, found[0]):
            break
        found = _samples(sampled, decision, noise, seconds)
    return found


def _rehearse(
    sampled: SampledSubject, integrator: dict[str, Any], tolerance: Tolerance, spp: int
) -> bool:
    """Draw some pixels as the picture will be, and correct what is foretold of its noise.

    Args:
        sampled: the looked-at pixels.
        integrator: of the picture.
        tolerance: in the unit of which noise is foretold.
        spp: of the picture.

    Returns:
        Whether they were drawn; not where a look resolves as many samples, draws no others, or
        follows particles from the lamps.
    """
    view, noise = sampled.subject.view, sampled.noise(tolerance)
    each = min(spp, noise.per_pass)
    told = each <= min(noise.resolved, _SMALL) or each == noise.resolved
    known = told and not noise.tail.heavy
    if sampled.together > 1 or known or not view.stratified or sampled.subject.source.pixel_centres:
        return False
    if any(1.0 / _ALIKE < each / other < _ALIKE for other in noise.rehearsed):
        return False
    around = len(view.neighbours)
    share = _SHARE if around == 1 else _SHARE_OF_WIDE
    count = min(int(max(share * spp * view.pixels, _LITTLE) / (_TIMES * around * each)), _MOST)
    if count < _FEWEST:
        return False
    drawn = multijitter.nearest_grid(min(each, _SAMPLES / _TIMES / around / min(count, _FEW)))
    count = min(count, _SAMPLES // (_TIMES * around * drawn))
    steps, never_met = noise.foretold(drawn)
    pixel, weight = _pixels(steps, count)
    places = np.repeat(view.chosen[pixel], _TIMES, axis=0)
    means = view.as_filmed(places, made_integrator(integrator), drawn, SEED + each)
    means = means.reshape(count, _TIMES, 3)
    noise.take_over(each, _ratio(noise.display, means, weight, steps[pixel], never_met))
    return True


def _pixels(steps: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return which of the pixels that change by (n,) steps are drawn, and what each stands for."""
    chance = 1.0 / len(steps) + steps / max(float(steps.sum()), 1e-300)
    ends = np.cumsum(chance / chance.sum())
    place = (np.arange(count) + np.random.default_rng(SEED).random(count)) / count
    pixel = np.minimum(np.searchsorted(ends, place), len(steps) - 1)
    return pixel, 1.0 / chance[pixel]


def _ratio(
    display: Display,
    means: np.ndarray,
    weight: np.ndarray,
    foretold: np.ndarray,
    never_met: float,
) -> float:
    """Return noise over what was foretold of it, drawn to 1 as far as the pixels cannot tell it.

    Args:
        display: measures changes.
        means: (n, times, 3) radiance of pixels, drawn several times.
        weight: (n,) how many pixels each stands for.
        foretold: (n,) change of each.
        never_met: change of the picture by what no look has met.
    """
    mean, times = means.mean(axis=1), means.shape[1]
    off = np.mean([display.per_pixel(mean, means[:, one]) for one in range(times)], axis=0)
    apart, expected = weight * off, weight * foretold
    seen, told = (display.of_mean(float(x.sum() / weight.sum()), mean) for x in (apart, expected))
    told = math.hypot(told, never_met)
    if seen <= 0.0 or told <= 0.0:
        return 1.0
    # the changes of psnr are squares: they vary by twice as much as their root
    power = 0.5 if display.tolerance.metric == "psnr" else 1.0
    scale = float(expected.sum() / apart.sum())
    error = power * math.sqrt(float(((apart * scale - expected) ** 2).sum())) / expected.sum()
    certain = _USUAL**2 / (_USUAL**2 + error**2)
    ratio = (seen * math.sqrt(times / (times - 1.0)) / told) ** certain
    return float(ratio * math.exp(_CAUTION * math.sqrt(certain) * error))


def _samples(
    sampled: SampledSubject, decision: Decision, allowed: Tolerance, seconds: float | None
) -> tuple[int, Decision, float]:
    """Return the samples per pixel, the decision about them with its settings, and their noise."""
    if decision.bound is None or decision.bound.absent:
        return 1, decision, 0.0
    fills = seconds is not None and math.isfinite(seconds)
    if not decision.on and not fills:
        return 1, decision, sampled.change(allowed, 1)
    spp, change = sampled.needed(allowed, allowed.amount)
    reached = "" if change <= allowed.amount else ", above its share: more samples were not tried"
    most = sampled.samples_within(MOST_SECONDS if seconds is None else seconds)
    if fills:
        most = min(most, sampled.needed(allowed, _ENOUGH * allowed.amount)[0])
    if most < spp or fills:
        reached = "" if fills else f", above its share: more take {MOST_SECONDS:g} s"
        spp, change = most, sampled.change(allowed, most)
    why = f"{decision.why}; {spp} samples per pixel leave {change:.3g}{reached}"
    cost = decision.cost_s * (spp - 1) / (USUAL_SPP - 1)
    cost = cost if math.isfinite(cost) else 0.0
    return spp, replace(decision, on=spp > 1, why=why, cost_s=cost), change

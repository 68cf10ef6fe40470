"""What the orders of reflection change, estimated from paths, with a bound on what that missed.

Sampled, not proved; the bound per pixel of ``evaluation.planning.transport`` is the one that needs
no luck. For the orders from k on, with n paths over N pixels, it adds

- the change of the N pixels when their own estimate of these orders is left out,
- three standard errors of that mean,
- the bias of a concave measure of noisy pixels: by how much the whole estimate exceeds that of its
  halves (the bias falls with 1/n),
- what no path met: an event of probability 3/n, which n samples miss in 5 % of cases, that carries
  twice the largest radiance found, and falls where the picture is the most sensitive.

Where the lobe of a body is so narrow that its highlights may not be found at all, the largest
radiance is that of the lobe's peak under all lights.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from simrig.planning.bounces import radiance_by_bounce
from simrig.planning.change import Display
from simrig.planning.rays import rows, to_rgb
from simrig.planning.view import GROUPS, View
from simrig.rendering.render import timed

BOUNCES = 8  # of indirect light that are told apart; the last holds all beyond
FEW_PATHS = 1 << 14  # of a first look
PATHS = (1 << 16, 1 << 18, 1 << 20)  # of looks that bounds rest on, and of larger ones
_CERTAIN = 3.0  # standard errors
_UNSEEN = 3.0  # events per n samples ("rule of three")
_RANGE_SAFETY = 2.0
_LEVELS = (1e-4, 1e-2, 0.1)  # of displayed values, where the steepest change is searched


@dataclass(frozen=True, eq=False)
class PathProbe:
    """Radiance of N pixels by order, from paths.

    Attributes:
        halves: (BOUNCES + 1, N, 2, 3) means of two halves of each pixel's paths; entry 0 is direct
            light, entry k + 1 what was reflected k + 2 times, the last all beyond.
        largest: (BOUNCES,) largest radiance of one path from indirect order k on.
        paths: how many in all.
        seconds_per_sample: of the kernel, all orders.
        overhead_s: of tracing the program and launching it.
    """

    halves: np.ndarray
    largest: np.ndarray
    paths: int
    seconds_per_sample: float
    overhead_s: float
    _bounces: Sequence[Any]

    def radiance(self, depth: int) -> np.ndarray:
        """Return the samples of each pixel as ``path`` of a depth finds them, (N, k, 3).

        Args:
            depth: Mitsuba's ``max_depth``, at most ``BOUNCES + 1``, or -1 for all orders.
        """
        count = self.halves.shape[1]
        each = self.paths // count
        reflections = len(self._bounces) if depth < 0 else depth - 1
        total = sum(self._bounces[:reflections], mi.Color3f(0.0))
        return rows(total).reshape(count, each, 3)


def probe_paths(
    view: View, delta_lights: bool, hide_emitters: bool, paths: int = PATHS[1]
) -> PathProbe:
    """Trace paths of all orders through the pixels that ``probe.probe`` looks at.

    Args:
        view: of a loaded scene without participating media.
        delta_lights: it has no lights that a ray can meet.
        hide_emitters: the camera does not see lights.
        paths: about how many, a power of two.
    """
    count = len(view.chosen)
    # groups of powers of four: numbers that a stratified sampler draws
    each = GROUPS << (2 * max(int(math.log2(paths / count / GROUPS)) // 2, 0))
    with timed() as clock:
        sampler, ray, weight = view.rays(each)
        spectra = radiance_by_bounce(
            view.scene, sampler, ray, BOUNCES + 1, delta_lights, hide_emitters
        )
        orders = [to_rgb(spectrum * weight, ray) for spectrum in spectra]
        dr.eval(orders)
        dr.sync_thread()
    halves = _block_means(orders, each // 2).reshape(len(orders), 3, count, 2)
    return PathProbe(
        halves.transpose(0, 2, 3, 1),
        _largest(orders[1:]),
        count * each,
        clock.kernel_seconds / (count * each),
        max(clock.run_seconds - clock.kernel_seconds, 0.0),
        orders,
    )


def _largest(orders: Sequence[Any]) -> np.ndarray:
    """Return the largest sum of the orders from each on, in any channel."""
    tails, tail = [], mi.Color3f(0.0)
    for order in reversed(orders):
        tail = tail + order
        tails.append(dr.max(dr.max(tail)))
    dr.eval(tails)
    return np.array([float(tail[0]) for tail in reversed(tails)])


def _block_means(orders: Sequence[Any], block: int) -> np.ndarray:
    sums = [dr.block_sum(channel, block) for order in orders for channel in order]
    dr.eval(sums)
    return np.array(sums, dtype=np.float64) / block


@dataclass(frozen=True)
class SampledChange:
    """What leaving out orders changes, see the module.

    Attributes:
        estimate: from the paths.
        floor: what of the bound comes from how pixels differ; no number of paths is below it.
        bound: at least both.
    """

    estimate: float
    floor: float
    bound: float


def sampled_changes(probe: PathProbe, display: Display, brightest: float) -> list[SampledChange]:
    """Return what leaving out the indirect orders from each on changes, ``BOUNCES`` of them.

    Args:
        look: the paths.
        display: measures changes.
        brightest: radiance that one path may carry at least, for lobes that are not found; 0 else.
    """
    full = probe.halves.sum(axis=0)  # (N, 2, 3)
    lit = (full > 0.0).any(axis=(1, 2))
    if not lit.any():
        return [SampledChange(0.0, 0.0, 0.0)] * BOUNCES
    kept = np.cumsum(probe.halves[:, lit], axis=0)
    direct = kept[0].mean(axis=1)
    weight = _steepest(display, direct) * _UNSEEN / probe.paths * lit.size / int(lit.sum())
    changes = []
    for first in range(BOUNCES):
        mean, error, bias = _mean_change(display, kept[first], full[lit])
        largest = max(_RANGE_SAFETY * float(probe.largest[first]), brightest)
        spread = mean + _CERTAIN * error
        estimate, floor, bound = (
            display.of_mean(one, direct) for one in (mean, spread, spread + bias)
        )
        unseen = display.of_mean(weight * largest, direct)
        changes.append(SampledChange(estimate, floor, bound + unseen))
    return changes


def least_change(probe: PathProbe, display: Display) -> float:
    """Return what leaving out all indirect orders changes at least.

    Noise adds to the mean change, and to that of halves √2 times as much: taken off by that.
    """
    full = probe.halves.sum(axis=0)
    lit = (full > 0.0).any(axis=(1, 2))
    if not lit.any():
        return 0.0
    direct, full = probe.halves[0, lit], full[lit]
    whole = display.per_pixel(direct.mean(axis=1), full.mean(axis=1))
    halves = np.mean([display.per_pixel(direct[:, half], full[:, half]) for half in (0, 1)])
    mean, error = float(whole.mean()), float(whole.std()) / math.sqrt(whole.size)
    noise = max(float(halves) - mean, 0.0) / (math.sqrt(2.0) - 1.0)
    return display.of_mean(max(mean - noise - _CERTAIN * error, 0.0), full.mean(axis=1))


def _mean_change(
    display: Display, before: np.ndarray, after: np.ndarray
) -> tuple[float, float, float]:
    """Return the mean change of pixels, its standard error and its bias, for (N, 2, 3) halves."""
    whole = display.per_pixel(before.mean(axis=1), after.mean(axis=1))
    halves = np.mean([display.per_pixel(before[:, half], after[:, half]) for half in (0, 1)])
    mean, error = float(whole.mean()), float(whole.std()) / math.sqrt(whole.size)
    return mean, error, max(mean - float(halves), 0.0)


def _steepest(display: Display, picture: np.ndarray) -> float:
    """Return the largest change of a pixel over the radiance that is added to it."""
    colours = np.array(list(itertools.product((0.0, 1.0), repeat=3)))[1:]
    ratios = [
        display.per_pixel(picture, picture + level / display.exposure * colour).max()
        * display.exposure
        / level
        for level in _LEVELS
        for colour in colours
    ]
    return float(max(ratios))

"""Accuracy per second in rendering: error over time, by integrator, sampler and samples per pixel.

Every setting renders the scene twice with independent random numbers, which tells its noise from
its bias (what it leaves out, for example orders of inter-reflection): the noise is what the two
differ by, over √2, and falls with the samples; the bias is what both are off by, and does not.
All are compared with one reference: path tracing of all orders, sampled until its own standard
error, again from two halves, is a small part of the tolerance or its share of the time is spent.
Compilation is told from running.

A setting meets the tolerance when the error of one render with it, noise included, is within it.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from simrig.core.cost import stopwatch
from simrig.core.effects import Tolerance
from simrig.core.errors import SimrigError, check_known
from simrig.core.progress import Progress
from simrig.evaluation.convergence.ledger import Ledger
from simrig.evaluation.convergence.results import Convergence, Point, Reference, fit_rate
from simrig.evaluation.metrics.images import foreground_mask, psnr_from_mse
from simrig.evaluation.metrics.replicates import Replicates, converged, distances, replicates
from simrig.planning.integrators import hides_emitters
from simrig.planning.source import scene_source
from simrig.rendering.render import load, render
from simrig.rendering.samplers import SAMPLERS, samples_for

# None is the scene's own; depths count edges from the camera: 2 is direct light
INTEGRATORS: dict[str, dict[str, Any] | None] = {
    "scene": None,
    "direct": {"type": "direct"},  # one sample of the lights and one of the BSDF
    "path-3": {"type": "path", "max_depth": 3},
    "path-5": {"type": "path", "max_depth": 5},
    "path": {"type": "path", "max_depth": -1},
}
REFERENCE = "path"
LEVELS = (1, 4, 16, 64, 256, 1024)

_REFERENCE_SHARE = 0.4  # of the time budget
_REFERENCE_PART = 0.05  # of the tolerance that the reference's standard error may reach
_SIGNIFICANT = 2.0  # standard errors
_TELLS = 0.25  # above this part of the tolerance the reference cannot tell what meets it


def converge(
    scene: Any,
    tolerance: Tolerance,
    *,
    integrators: Sequence[str] = tuple(INTEGRATORS),
    samplers: Sequence[str] = SAMPLERS,
    levels: Sequence[int] = LEVELS,
    budget_seconds: float = 60.0,
    exposure: float = 1.0,
    seed: int = 0,
    progress: Progress | None = None,
    ledger: Ledger | None = None,
) -> Convergence:
    """Render a scene in many settings and say which is the cheapest that is good enough.

    All methods take their turn at a number of samples before the next one, so that an early end
    of the time leaves a fair comparison.

    Participating media are not simulated.

    Args:
        scene: a Mitsuba dictionary, a loaded scene or a file, for the current variant.
        integrators, samplers: names from ``INTEGRATORS`` and ``SAMPLERS``, combined with each
            other; the scene's own integrator is left out when it is that of the reference.
        levels: samples per pixel, powers of 4 in rising order.
        budget_seconds: time for all of it; a setting that would not fit is left out.
        exposure: factor from radiance to the displayed linear value.
        ledger: notes what is finished; what it holds already is not rendered again, and the time
            that took counts.

    Raises:
        SimrigError: unknown names, no time, or a scene that cannot be built.
    """
    methods = _methods(scene, integrators, samplers)
    if not budget_seconds > 0.0:
        raise SimrigError(f"the time budget must be above 0 s, got {budget_seconds:g}")
    loaded = load(scene_source(scene).build())
    ledger = ledger or Ledger()
    elapsed = stopwatch(ledger.seconds)
    total = len(methods) * len(levels) + 1
    report = progress or (lambda *_: None)
    report(0, total, "reference")
    if ledger.reference is None:
        found = _reference(loaded, tolerance, budget_seconds, exposure, seed)
        ledger.note_reference(*found, elapsed())
    picture, reference = ledger.found_reference()
    done, left_out = 1, 0
    for level, (integrator, sampler) in itertools.product(levels, methods):
        report(done, total, f"{integrator}, {sampler}, {level} spp")
        done += 1
        spp = samples_for(sampler, level)
        last = _last(ledger.points, integrator, sampler)
        if last is not None and last.spp >= spp:  # noted, or two levels that are rounded to one
            continue
        expected = 0.0 if last is None else 2.0 * last.run_seconds * spp / last.spp
        if elapsed() + expected > budget_seconds:
            left_out += 1
            continue
        pair = _pair(loaded, integrator, sampler, spp, seed + 1)
        point = _point(integrator, sampler, pair, picture, reference, tolerance, exposure)
        ledger.note(point, elapsed())
    report(total, total)
    return result_so_far(ledger, tolerance, left_out)


def result_so_far(ledger: Ledger, tolerance: Tolerance, left_out: int = 0) -> Convergence:
    """Return what a ledger holds as a result.

    Args:
        left_out: settings for which there was no time.
    """
    _, reference = ledger.found_reference()
    points = tuple(ledger.points)
    methods = dict.fromkeys((point.integrator, point.sampler) for point in points)
    rates = tuple(rate for method in methods if (rate := fit_rate(points, *method)) is not None)
    return Convergence(tolerance, reference, points, rates, left_out)


def _methods(
    scene: Any, integrators: Sequence[str], samplers: Sequence[str]
) -> list[tuple[str, str]]:
    for name in integrators:
        check_known("integrator", name, INTEGRATORS)
    for name in samplers:
        check_known("sampler", name, SAMPLERS)
    own = scene.get("integrator") if isinstance(scene, Mapping) else None
    twice = isinstance(own, Mapping) and REFERENCE in integrators and _traces_all_bounces(own)
    kept = [name for name in dict.fromkeys(integrators) if not (twice and name == "scene")]
    return list(itertools.product(kept, dict.fromkeys(samplers)))


def _traces_all_bounces(integrator: Mapping[str, Any]) -> bool:
    return integrator.get("type") == "path" and integrator.get("max_depth", -1) == -1


def _integrator(scene: Any, name: str) -> dict[str, Any] | None:
    """Return an integrator by name that hides lights from the camera where the scene's own does."""
    integrator = INTEGRATORS[name]
    return integrator and {**integrator, "hide_emitters": hides_emitters(scene)}


def _pair(scene: Any, integrator: str, sampler: str, spp: int, seed: int) -> Replicates:
    made = _integrator(scene, integrator)
    return replicates(
        lambda count, one: render(scene, count, one, made, sampler=sampler), [spp], seed
    )


def _last(points: Iterable[Point], integrator: str, sampler: str) -> Point | None:
    own = [p for p in points if (p.integrator, p.sampler) == (integrator, sampler)]
    return own[-1] if own else None


def _reference(
    scene: Any, tolerance: Tolerance, budget_seconds: float, exposure: float, seed: int
) -> tuple[np.ndarray, Reference]:
    """Render the reference until it is good enough or its share of the time is spent."""
    elapsed = stopwatch()
    enough = _REFERENCE_PART * tolerance.amount
    integrator = _integrator(scene, REFERENCE)
    picture = converged(
        lambda spp, one: render(scene, spp, one, integrator, sampler="independent"),
        lambda so_far: so_far.standard_errors(exposure)[tolerance.metric] <= enough,
        _REFERENCE_SHARE * budget_seconds,
        seed,
    )
    errors = picture.standard_errors(exposure)
    error = errors[tolerance.metric]
    seconds = elapsed()
    stated = Reference(
        spp=picture.spp,
        delta_e=errors["dE"],
        relative_rmse=errors["relative_rms"],
        error=error,
        seconds=seconds,
        suffices=error <= _TELLS * tolerance.amount,
    )
    return picture.image, stated


def _point(
    integrator: str,
    sampler: str,
    pair: Replicates,
    picture: np.ndarray,
    reference: Reference,
    tolerance: Tolerance,
    exposure: float,
) -> Point:
    mask = foreground_mask(picture, *pair.halves)
    both = [distances(picture, half, mask, exposure) for half in pair.halves]
    error = {metric: float(np.mean([one[metric] for one in both])) for metric in both[0]}
    off = (pair.halves[:, mask] - picture[mask]) / float(picture[mask].mean())
    noise = math.sqrt(float(((off[0] - off[1]) ** 2).mean()) / 2.0)
    return Point(
        integrator=integrator,
        sampler=sampler,
        spp=pair.spp // 2,
        delta_e=error["dE"],
        relative_rmse=error["relative_rms"],
        psnr=psnr_from_mse(error["psnr"] ** 2),
        error=error[tolerance.metric],
        noise=noise,
        bias=_bias(off, reference.relative_rmse),
        compile_seconds=pair.compile_seconds,
        run_seconds=pair.fastest_seconds,
    )


def _bias(off: np.ndarray, reference_error: float) -> float:
    """Return the root mean square of what two independent renders are off by in common.

    Their noises are independent, so the product of what they are off by has the squared bias as
    its mean (with the squared error of the reference, which they share). Zero where the spread
    over the pixels does not tell it from zero.

    Args:
        off: (2, pixels, 3).
        reference_error: standard error of the reference, in the same unit.
    """
    products = (off[0] * off[1]).mean(axis=-1)
    certain = _SIGNIFICANT * float(products.std()) / math.sqrt(products.size)
    squared = float(products.mean()) - reference_error**2
    return math.sqrt(squared) if squared > certain else 0.0

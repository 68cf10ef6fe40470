"""Timing side by side: first call and steady state apart, rounds interleaved, medians."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from simrig.core.progress import Progress, tracked
from simrig.rendering.render import timed

MEDIAN = "{median_seconds:.3f} ({fastest_seconds:.3f}–{slowest_seconds:.3f})"  # of ``as_dict``


@dataclass(frozen=True)
class Timing:
    """Seconds of one job.

    Attributes:
        first: the first call, with tracing and compilation (from the kernel cache on disk where
            an earlier process left it there).
        median: median of the later calls.
        rounds: how many later calls.
        kernels: seconds that kernels were at work in each later call. The rest is tracing in
            Python, which does not shrink with the picture; 0 where there are no kernels.
    """

    first: float
    median: float
    fastest: float
    slowest: float
    rounds: int
    kernels: tuple[float, ...] = ()

    def as_dict(self) -> dict[str, float]:
        """Return the seconds as values of a row."""
        names = ("first", "median", "fastest", "slowest")
        return {f"{name}_seconds": getattr(self, name) for name in names}

    @property
    def kernel(self) -> float:
        """Median of ``kernels``."""
        return float(np.median(self.kernels))

    @property
    def tracing(self) -> float:
        """What a later call takes beside its kernels: tracing in Python."""
        return max(self.median - self.kernel, 0.0)


def side_by_side(
    jobs: Mapping[str, Callable[[], Any]], rounds: int = 5, progress: Progress | None = None
) -> dict[str, Timing]:
    """Time jobs in turn, A B C A B C ..., so that a drifting machine slows all alike.

    Args:
        jobs: functions without arguments, by name; Dr.Jit results must be evaluated inside.
        rounds: calls of each after the first one.
    """
    seconds: dict[str, list[float]] = {name: [] for name in jobs}
    kernels: dict[str, list[float]] = {name: [] for name in jobs}
    for name in tracked((rounds + 1) * list(jobs), progress, str):
        dr.sync_thread()
        with timed() as clock:
            start = time.perf_counter()
            jobs[name]()
            dr.sync_thread()
            seconds[name].append(time.perf_counter() - start)
        kernels[name].append(clock.kernel_seconds)
    return {
        name: Timing(
            s[0], float(np.median(s[1:])), min(s[1:]), max(s[1:]), rounds, tuple(kernels[name][1:])
        )
        for name, s in seconds.items()
    }


def one_alive(
    makers: Mapping[str, Callable[[], Callable[[], Any]]],
    rounds: int = 3,
    sweeps: int = 1,
    progress: Progress | None = None,
) -> dict[str, Timing]:
    """Time jobs of which each loads a scene of its own, with one scene alive at a time.

    Dr.Jit traces every BSDF of the process whichever scene is rendered, so scenes that live side
    by side hold up each other. Sweeps go through all of them in turn.

    Args:
        makers: functions that load a scene and return the job, by name.
        rounds: calls in a sweep after the first one.
        sweeps: how often every scene is loaded.
    """
    found: dict[str, list[Timing]] = {name: [] for name in makers}
    for name in tracked(sweeps * list(makers), progress, str):
        found[name].append(side_by_side({name: makers[name]()}, rounds)[name])
        gc.collect()
    return {
        name: Timing(
            timings[0].first,
            float(np.median([timing.median for timing in timings])),
            min(timing.fastest for timing in timings),
            max(timing.slowest for timing in timings),
            rounds * sweeps,
            sum((timing.kernels for timing in timings), ()),
        )
        for name, timings in found.items()
    }


def rendering(
    scene: Any, kept: dict[str, Any], name: str, spp: int, **settings: Any
) -> Callable[[], None]:
    """Return a job that renders a scene.

    Args:
        kept: where the last picture stands under the name.
        settings: of ``mitsuba.render``: an integrator, a sensor.
    """

    def once() -> None:
        # the seed as an array: else every seed is a kernel of its own
        kept[name] = mi.render(scene, spp=spp, seed=mi.UInt32(1), **settings)
        dr.eval(kept[name])

    return once


def pictures_of(kept: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """Return pictures that were rendered as linear RGB, (height, width, 3), none below 0."""
    return {name: np.maximum(np.array(p)[..., :3], 0.0) for name, p in kept.items()}


def stage_of(progress: Progress | None, number: int, count: int, label: str) -> Progress | None:
    """Return what reports the progress of one of several stages.

    Args:
        number: of the stage, from 0.
    """
    if progress is None:
        return None
    return lambda done, total, stage="": progress(number + done / total, count, f"{label}: {stage}")

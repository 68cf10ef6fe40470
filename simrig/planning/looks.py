"""How much looking a picture is worth: looks are sized by how many samples rendering it takes.

A small look comes first. It tells how many samples the picture will have, and a larger one follows
where it costs little beside these, or where the samples of the small one have a heavy tail. Samples
are counted, not seconds, so that plans are reproducible.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from weakref import proxy

from simrig.core.effects import Tolerance
from simrig.planning.indirect import FEW_PATHS, PATHS, least_change
from simrig.planning.integrators import UNLIMITED
from simrig.planning.mesostructure import structured_materials
from simrig.planning.noise import ALONG_PATHS, IN_A_PIXEL
from simrig.planning.sampled import SampledSubject
from simrig.planning.subject import SceneSubject

MOST_SECONDS = 200.0  # that a picture takes when nothing is said of its time
_SHARE = 0.02  # of the samples of the picture, in one look
# The samples of a picture with everything that cost no less than looks and a check, which are a
# tenth of them and a dozen programs, each to be made and compiled.
_WORTH_LOOKS = 1 << 22
_WITH_SHADOWS = 4  # times as many where bodies may hide lights from each other, which is looked at
COSTS_MORE = "nothing was looked for that could be left out: that costs more than the whole picture"
COMES_WITH_PATHS = (
    "nothing was looked for that could be left out: inter-reflection is called for, and paths "
    "bring the rest with them"
)
_SHARE_OF_FEW = 0.25  # of few samples, or of those that have a heavy tail, in a look at them
MORE_SAMPLES = (64, 256, 1024)  # of each looked-at pixel, where orders are not told apart


def size_looks(subject: SceneSubject, noise: Tolerance) -> None:
    """Look at a scene along as many paths as its picture is worth.

    Args:
        subject: the scene.
        noise: that the samples of the picture may leave.
    """
    if not subject.tells_orders:
        return
    if subject.path_count < PATHS[0] and subject.looks_pay:
        subject.look_along_paths(PATHS[0])
    while True:
        sampled = everything_sampled(subject)
        samples = _samples(sampled, noise)
        few = not subject.looks_pay and samples <= _WORTH_LOOKS
        subject.affordable_paths = int((_SHARE_OF_FEW if few else _SHARE) * samples)
        most = subject.affordable_paths
        if sampled.heavy_tailed(noise):
            most = max(most, min(PATHS[1], int(_SHARE_OF_FEW * samples)))
        larger = next((n for n in PATHS if n > subject.path_count), math.inf)
        if larger > most:
            return
        subject.look_along_paths(int(larger))  # which may tell that the picture is worth less


def unlooked_because(subject: SceneSubject, allowed: Tolerance, noise: Tolerance) -> str:
    """Return why nothing has to be looked for that may be left out; empty where it may pay.

    It does not where the picture with everything takes few samples, and where paths are needed
    that bring all the rest with them; unless few of the samples carry much, or structure gives a
    reason to doubt them.

    Args:
        subject: the scene.
        allowed: what all that is left out may change.
        noise: that the samples of the picture may leave.
    """
    if subject.tells_orders and not subject.path_count:
        subject.look_along_paths(FEW_PATHS)
    sampled = everything_sampled(subject)
    if sampled.heavy_tailed(noise) or subject.doubts(noise):
        return ""
    if needs_paths(subject, allowed):
        return COMES_WITH_PATHS
    needed, _ = sampled.needed(noise, noise.amount)
    worth = _WORTH_LOOKS * (_WITH_SHADOWS if subject.shadows_possible else 1)
    return COSTS_MORE if needed * subject.pixels <= worth else ""


def needs_paths(subject: SceneSubject, allowed: Tolerance) -> bool:
    """Return whether leaving out inter-reflection surely changes too much, and BTFs are none."""
    if not subject.tells_orders or structured_materials(subject.scene):
        return False
    return least_change(subject.paths, subject.display(allowed)) > allowed.amount


def looked_closer(
    sampled: SampledSubject, noise: Tolerance, look: Callable[[int], SampledSubject]
) -> SampledSubject:
    """Return pixels with as many samples of each as their picture is worth.

    Where nothing but the place within a pixel is left to chance a look is as cheap as its picture:
    it may have as many samples, as long as it has fewer of a pixel than that. What it does not
    resolve, such as a bright rim, it cannot foretell.

    Args:
        sampled: from a first look.
        noise: that the samples of the picture may leave.
        look: looks again, with some samples of each pixel.
    """
    for more in MORE_SAMPLES:
        pixels, looked = sampled.radiance.shape[:2]
        if more <= looked:
            continue
        samples = _samples(sampled, noise)
        cheap = sampled.dimensions == IN_A_PIXEL and looked * sampled.subject.pixels <= samples
        if more * pixels <= (1.0 if cheap else _SHARE) * samples:
            sampled = look(more)
    return sampled


def everything_sampled(subject: SceneSubject) -> SampledSubject:
    """Return the looked-at pixels with light of all orders; the same ones until more are known."""
    if subject.sampled is None:
        subject.sampled = _everything_sampled(proxy(subject))  # no circle keeps scenes alive
    return subject.sampled


def _everything_sampled(subject: SceneSubject) -> SampledSubject:
    if subject.tells_orders:
        paths = subject.paths
        return SampledSubject(subject, paths.radiance(UNLIMITED), paths.seconds_per_sample)
    media = subject.survey.needs_volpath
    seen = subject.all_orders if media else subject.probe
    exact = subject.survey.only_delta_lights and not media
    dimensions = IN_A_PIXEL if exact else ALONG_PATHS
    return SampledSubject(subject, seen.radiance, seen.seconds_per_sample, dimensions=dimensions)


def _samples(sampled: SampledSubject, noise: Tolerance) -> int:
    """Return the samples that a picture will have."""
    seconds = sampled.subject.budget_seconds
    if seconds is None:
        needed, _ = sampled.needed(noise, noise.amount)
        spp = min(needed, sampled.samples_within(MOST_SECONDS))
    else:
        spp = sampled.samples_within(seconds)
    return spp * sampled.subject.pixels

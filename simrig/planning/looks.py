"""How much looking a picture is worth: looks are sized by how many samples rendering it takes.

A small look comes first. It tells how many samples the picture will have, and a larger one follows
where it costs little beside these, or where the samples of the small one have a heavy tail. Samples
are counted, not seconds, so that plans are reproducible.
"""

from __future__ import annotations

from simrig.core.effects import Tolerance
from simrig.planning.indirect import PATHS
from simrig.planning.integrators import UNLIMITED
from simrig.planning.sampled import SampledSubject
from simrig.planning.subject import SceneSubject

MOST_SECONDS = 200.0  # that a picture takes when nothing is said of its time
_SHARE = 0.025  # of the samples of the picture, in one look
MORE_SAMPLES = (256, 1024)  # of each looked-at pixel, where orders are not told apart


def size_looks(subject: SceneSubject, noise: Tolerance) -> None:
    """Look at a scene along as many paths as its picture is worth.

    Args:
        subject: the scene.
        noise: that the samples of the picture may leave.
    """
    if not subject.tells_orders:
        return
    if not subject.path_count:
        subject.look_along_paths(PATHS[0])
    while True:
        paths = subject.paths
        sampled = SampledSubject(subject, paths.radiance(UNLIMITED), paths.seconds_per_sample)
        subject.affordable_paths = _worth(sampled, noise)
        least = PATHS[1] if sampled.heavy_tailed(noise) else PATHS[0]
        wanted = max(n for n in PATHS if n <= max(subject.affordable_paths, least))
        if wanted <= subject.path_count:
            return
        subject.look_along_paths(wanted)  # which may tell that the picture is worth more


def samples_worth(sampled: SampledSubject, noise: Tolerance) -> int:
    """Return the samples of each looked-at pixel that a picture is worth; 0 for those that are."""
    pixels, looked = sampled.radiance.shape[:2]
    most = _worth(sampled, noise) / pixels
    return max((n for n in MORE_SAMPLES if looked < n <= most), default=0)


def _worth(sampled: SampledSubject, noise: Tolerance) -> int:
    """Return the samples of a look that a picture is worth."""
    seconds = sampled.subject.budget_seconds
    if seconds is None:
        needed, _ = sampled.needed(noise, noise.amount)
        spp = min(needed, sampled.samples_within(MOST_SECONDS))
    else:
        spp = sampled.samples_within(seconds)
    return int(_SHARE * spp * sampled.subject.pixels)

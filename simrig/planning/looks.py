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
    paths = subject.paths
    sampled = SampledSubject(subject, paths.radiance(UNLIMITED), paths.seconds_per_sample)
    if subject.budget_seconds is None:
        spp, _ = sampled.needed(noise, noise.amount)
    else:
        spp = sampled.samples_within(subject.budget_seconds)
    subject.affordable_paths = int(_SHARE * spp * subject.pixels)
    larger = [n for n in PATHS if n > subject.path_count]
    enough = subject.affordable_paths
    if larger and (larger[0] <= enough or sampled.heavy_tailed(noise)):
        subject.look_along_paths(larger[0])

"""The bounds of inter-reflection: from paths, and where these are not enough, from every pixel.

A plan asks only whether a bound fits into a tolerance. Paths that already show a larger change
settle that; so does their bound when it is smaller. In between the bound per pixel of
``planning.transport`` may be smaller.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from simrig.core.effects import Tolerance
from simrig.planning.indirect import PathProbe, SampledChange, sampled_changes
from simrig.planning.transport import narrow_highlights

if TYPE_CHECKING:
    from simrig.planning.subject import SceneSubject


@dataclass(frozen=True)
class IndirectBounds:
    """The most that leaving out orders of reflection changes.

    Attributes:
        values: entry k for all light that was reflected k + 2 times or more often.
        why: one line, where the first one comes from.
    """

    values: tuple[float, ...]
    why: str

    def bounces_needed(self, allowed: float) -> int | None:
        """Return after how many indirect orders the rest may change no more than is allowed.

        None where even the last that are told apart may.
        """
        return next((k for k, value in enumerate(self.values) if value <= allowed), None)


def indirect_bounds(subject: SceneSubject, tolerance: Tolerance) -> IndirectBounds:
    """Return the bounds of a scene without what its survey calls ``unknown``.

    Args:
        subject: the scene.
        tolerance: that may be used; bounds need to be no tighter than to tell what fits into it.
    """
    paths = subject.paths
    found = _sampled(subject, tolerance, paths)
    if not _undecided(found, tolerance):
        return _from_paths(found, paths)
    proved = proved_change(subject, tolerance)
    if proved <= tolerance.amount:
        why = "albedo and solid angle of the other bodies times the radiance that they send"
        return IndirectBounds((proved, *(change.bound for change in found[1:])), why)
    return _from_paths(found, paths)


def _undecided(found: list[SampledChange], tolerance: Tolerance) -> bool:
    return found[0].estimate <= tolerance.amount < found[0].bound


def _sampled(subject: SceneSubject, tolerance: Tolerance, paths: PathProbe) -> list[SampledChange]:
    hidden = 0.0
    if subject.survey.delta_lights:
        hidden = float(narrow_highlights(subject.survey, subject.surfaces).max(initial=0.0))
    return sampled_changes(paths, subject.display(tolerance), hidden)


def _from_paths(found: list[SampledChange], paths: PathProbe) -> IndirectBounds:
    why = (
        f"{paths.paths:,} paths change {found[0].estimate:.3g}; three standard errors and what "
        "they may have missed are added"
    )
    return IndirectBounds(tuple(change.bound for change in found), why)


def proved_change(subject: SceneSubject, tolerance: Tolerance) -> float:
    """Return the bound of all indirect light that holds for each pixel, whatever paths find."""
    picture, display = subject.probe.picture, subject.display(tolerance)
    return display.total(display.worst(picture, subject.proved_indirect.sum(axis=0)), picture)

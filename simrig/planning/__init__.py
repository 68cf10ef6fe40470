"""The planner of scenes: which effects a picture calls for, and the settings that follow.

See ``docs/effects.md``.
"""

from simrig.planning.budget import plan_budget
from simrig.planning.effects import EFFECT_NAMES
from simrig.planning.loading import planned_subject
from simrig.planning.overrides import checked_overrides
from simrig.planning.planned import as_planned, planned_integrator, planned_render
from simrig.planning.planner import plan_scene
from simrig.planning.source import scene_source
from simrig.planning.verification import verified_render

__all__ = [
    "EFFECT_NAMES",
    "as_planned",
    "checked_overrides",
    "plan_budget",
    "plan_scene",
    "planned_integrator",
    "planned_render",
    "planned_subject",
    "scene_source",
    "verified_render",
]

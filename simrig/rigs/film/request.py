"""A film as a user asks for it: the material's name, the instrument, and a tolerance."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from simrig.core.effects import EffectPlan, Overrides, parse_tolerance
from simrig.instruments.description import Description
from simrig.plans.gantry import GantryPlan
from simrig.rigs.film.effects import film_effects
from simrig.rigs.film.recorder import Film, filming_plan
from simrig.rigs.film.setup import Setup
from simrig.rigs.imaging.effects import plan_pictures
from simrig.rigs.imaging.request import material_of


def film_of(
    material: str,
    description: Description,
    plan: GantryPlan,
    tolerance: str | None,
    overrides: Overrides | None,
    **wishes: Any,
) -> tuple[Film, EffectPlan | None]:
    """Return a film with the effects that a tolerance calls for, and how they were decided.

    Args:
        material: a name or a file.
        description: of the instrument.
        plan: of its slices; it is filmed every 15° and beside highlights (``filming_plan``).
        tolerance: ΔE 0.5 unless given.
        overrides: what the user decided; None simulates no effect.
        wishes: ``sample_mm``, ``spp``, ``seed`` of the film.

    Raises:
        SimrigError: an instrument that does not film, an unknown material or effect.
    """
    plan = filming_plan(plan)
    seed = int(wishes.get("seed", 0))
    setup = Setup.of(description, wishes.get("sample_mm"), seed)
    film = Film(material_of(material, seed), description, plan, (), **wishes)
    if overrides is None:
        return film, None
    effects = film_effects(description)  # type: ignore[arg-type]
    angles = np.asarray(plan.angles())
    allowed = parse_tolerance(tolerance or "dE=0.5")
    chosen = plan_pictures(film.material, setup.optics, angles, allowed, overrides, effects=effects)
    return replace(film, effects=tuple(chosen.settings["effects"])), chosen

"""How far structure has to be seen: BTFs within a distance of their own, their average beyond it.

The looked-at pixels are seen twice along the same rays, with the texels and with the average of
the tile. What leaving the texels out changes is known then for every place, and with it where each
material may do without them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from simrig.core.effects import Bound, Decision, Overrides, Tolerance, replaced
from simrig.planning.change import Display
from simrig.planning.costs import USUAL_SPP
from simrig.planning.places import DRAWN, PLACES, measured_change
from simrig.planning.subject import SceneSubject

MESOSTRUCTURE = "mesostructure"
_HALVINGS = 24  # of the price at which structure is given up
_WORTH = 0.1  # of the places with structure: fewer beyond a distance save nothing


def structured_materials(scene: Any) -> dict[str, Any]:
    """Return the BTFs of a loaded scene by their paths in it; those of one texel are BRDFs."""
    return {name: bsdf for name, (bsdf, _) in _with_carriers(scene).items()}


@contextmanager
def structure_within(scene: Any, distances_mm: Mapping[str, float] | None) -> Iterator[None]:
    """See each BTF of a scene up to a distance only, as long as the context lasts.

    Args:
        scene: loaded.
        distances_mm: by ``structured_materials``; those not named are seen everywhere.
    """
    if not distances_mm:
        yield
        return
    found = structured_materials(scene)
    within = {bsdf: distances_mm[name] for name, bsdf in found.items() if name in distances_mm}
    before = {bsdf: bsdf.within_mm for bsdf in within}
    try:
        for bsdf, distance in within.items():
            bsdf.show_structure_within(distance)
        yield
    finally:
        for bsdf, distance in before.items():
            bsdf.show_structure_within(distance)


def decide_mesostructure(
    subject: SceneSubject,
    decisions: tuple[Decision, ...],
    integrator: dict[str, Any],
    allowed: Tolerance,
    room: float,
    overrides: Overrides,
) -> tuple[tuple[Decision, ...], dict[str, float], float]:
    """Decide how far the structure of each material is seen, once everything else is decided.

    Args:
        subject: the scene.
        decisions: about all its effects.
        integrator: that will render it.
        allowed: whose unit changes are in.
        room: what leaving structure out may change.
        overrides: what the user decided.

    Returns:
        The decisions; the distances in mm, by material, within which structure is seen, without
        those that have it everywhere; and, where some of it is seen, the most that the averages
        beyond these distances change.
    """
    if not structured_materials(subject.scene) or not subject.looks_pay:
        return decisions, {}, 0.0
    asked = overrides.of(MESOSTRUCTURE)
    probed = _StructureProbe(subject, integrator, allowed)
    if asked is not None and asked[0]:
        distances = probed.everywhere
    elif asked is not None:
        distances = probed.nowhere
    else:
        distances = probed.distances(room)
    change = probed.change(distances)
    if asked is None and change > room:  # light that was reflected more than once changed as well
        distances, change = probed.everywhere, 0.0
    on = any(distance > 0.0 for distance in distances.values())
    share = probed.beyond(distances).sum() / max(probed.structured.sum(), 1)
    full = probed.change(probed.nowhere)
    saved = max(probed.seconds - probed.average_seconds, 0.0) * subject.pixels * USUAL_SPP
    explained = Bound(full, allowed.unit, "the average of the tile in the place of its texels")
    why = asked[1] if asked else _why(on, float(share), full, change, room)
    cost = saved * (1.0 - share * on)
    decisions = replaced(decisions, MESOSTRUCTURE, on=on, why=why, bound=explained, cost_s=cost)
    finite = {name: float(d) for name, d in distances.items() if np.isfinite(d)}
    return decisions, finite, change if on else 0.0


def _why(on: bool, share: float, full: float, change: float, room: float) -> str:
    if not on:
        return f"{full:.3g} is within its share {room:.3g}: averages of tiles are seen"
    if share == 0.0:
        return f"{full:.3g} is above its share {room:.3g}, and nearer averages are as well"
    return (
        f"{full:.3g} is above its share {room:.3g}; averages where {share:.0%} of the structure "
        f"is seen, from a distance on, change {change:.3g}"
    )


@dataclass(frozen=True, eq=False)
class _StructureProbe:
    """The looked-at pixels of a scene with the structure of its materials and without."""

    subject: SceneSubject
    integrator: dict[str, Any]
    tolerance: Tolerance

    @property
    def everywhere(self) -> dict[str, float]:
        return dict.fromkeys(structured_materials(self.subject.scene), np.inf)

    @property
    def nowhere(self) -> dict[str, float]:
        return dict.fromkeys(self.everywhere, 0.0)

    @cached_property
    def _display(self) -> Display:
        return self.subject.display(self.tolerance)

    @cached_property
    def _with(self) -> tuple[np.ndarray, float]:
        return self._seen(self.everywhere)

    @cached_property
    def _without(self) -> tuple[np.ndarray, float]:
        return self._seen(self.nowhere)

    def _seen(self, distances: Mapping[str, float]) -> tuple[np.ndarray, float]:
        """Return (n, places, 3) radiance and the seconds of a sample."""
        exact = self.integrator["type"] == "simrig_all_lights" or (
            self.integrator["type"] == "direct" and self.subject.survey.only_delta_lights
        )
        with structure_within(self.subject.scene, distances):
            return self.subject.places.probe(self.integrator, 1 if exact else DRAWN)

    @property
    def seconds(self) -> float:
        """Of a sample with structure, kernels only."""
        return self._with[1]

    @property
    def average_seconds(self) -> float:
        """Likewise without structure."""
        return self._without[1]

    @cached_property
    def _hits(self) -> tuple[np.ndarray, np.ndarray]:
        """Distance in mm to what is seen at each place, and which material that is, or -1."""
        si = self.subject.places.hits()
        shape = (-1, PLACES)
        distance = np.full(dr.width(si.t), np.inf)
        material = np.full(distance.shape, -1)
        distance_of_hit, carrier = np.array(si.t), si.bsdf()
        for number, (bsdf, outer) in enumerate(_with_carriers(self.subject.scene).values()):
            met = np.array((carrier == mi.BSDFPtr(outer)) & si.is_valid())
            material[met] = number
            distance[met] = bsdf.cone.unit_mm * distance_of_hit[met]
        return distance.reshape(shape), material.reshape(shape)

    @property
    def structured(self) -> np.ndarray:
        """(n, places): where a material with structure is seen directly."""
        return self._hits[1] >= 0

    def beyond(self, distances: Mapping[str, float]) -> np.ndarray:
        """Return (n, places): where structure is seen, but farther than the distances."""
        seen_from, material = self._hits
        limits = np.array([*distances.values(), np.inf])
        return self.structured & (seen_from >= limits[material])

    def change(self, distances: Mapping[str, float]) -> float:
        """Return the most that averages beyond distances change."""
        if distances == self.everywhere:
            return 0.0
        seen = self._without if distances == self.nowhere else self._seen(distances)
        return self._change_to(seen[0])

    def _change_to(self, seen: np.ndarray) -> float:
        """Return the most that (n, places, 3) radiance differs from that with structure.

        What may have been missed is added: at most 3 in as many places as were looked at (95 %),
        which change as much as the one that changes most.
        """
        share = self._missed_share
        missed = share * float(self._steps(seen).max())
        if self.tolerance.metric == "psnr":
            missed = float(np.sqrt(share)) * float(self._steps(seen).max())
        elif self.tolerance.metric == "relative":
            missed /= float(self._with[0].mean())
        return measured_change(self._display, self._with[0], seen) + missed

    @property
    def _missed_share(self) -> float:
        """The share of lit places that may differ and of which none was looked at (95 %)."""
        lit = int((self._with[0] > 0.0).any(axis=-1).sum())
        return 3.0 / max(lit, 3)

    def _steps(self, seen: np.ndarray) -> np.ndarray:
        """Return by how much each place differs from what it is with structure."""
        before, after = (self._display.coordinates(probe) for probe in (self._with[0], seen))
        return np.linalg.norm(before - after, axis=-1)

    def distances(self, room: float) -> dict[str, float]:
        """Return distances whose averages change no more than ``room``, at as many places as can.

        Every material gives structure up beyond the distance where a place costs more than a
        price, which is the same for all; the highest price that fits is found by halving.
        """
        if self.change(self.nowhere) <= room:
            return self.nowhere
        steps = self._steps(self._without[0])
        low, high = 0.0, float(steps.max())
        chosen = self.everywhere
        for _ in range(_HALVINGS):
            price = 0.5 * (low + high)
            tried = self._at_price(steps, price)
            mixed = np.where(self.beyond(tried)[..., None], self._without[0], self._with[0])
            if self._change_to(mixed) <= room:
                low, chosen = price, tried
            else:
                high = price
        worth = self.beyond(chosen).sum() >= _WORTH * self.structured.sum()
        return chosen if worth else self.everywhere

    def _at_price(self, steps: np.ndarray, price: float) -> dict[str, float]:
        seen_from, material = self._hits
        found = {}
        for number, name in enumerate(self.everywhere):
            own = material == number
            order = np.argsort(-seen_from[own], kind="stable")
            far_first = seen_from[own][order]
            # what the farthest k places change, less what they are worth
            spent = np.cumsum(steps[own][order] - price)
            best = int(np.argmin(np.concatenate([[0.0], spent])))
            found[name] = np.inf if best == 0 else float(far_first[best - 1])
        return found


def _with_carriers(scene: Any) -> dict[str, tuple[Any, Any]]:
    """Return the BTFs of a scene by their paths, each with the BSDF of a shape that holds it."""
    parents = {node: parent for node, (parent, _) in mi.traverse(scene).hierarchy.items()}
    found: dict[str, tuple[Any, Any]] = {}
    for node in parents:
        if type(node).__name__ != "simrig_btf" or len(node.brdf.mipmap.shapes) == 1:
            continue
        path, carrier = [node], node
        while parents[path[-1]] is not None:
            path.append(parents[path[-1]])
            if isinstance(path[-1], mi.BSDF):
                carrier = path[-1]
        name = ".".join(part.id() or type(part).__name__ for part in reversed(path[:-1]))
        found[name if name not in found else f"{name} {len(found)}"] = (node, carrier)
    return found

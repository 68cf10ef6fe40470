"""Materials that change: wet spots that dry, tarnish that spreads, dust that settles.

A change acts on the colours and the gloss of a tile's parts, from 0 (begins) to 1 (has ended); the
geometry stays. Where it is sharp, a part is cut in two along its triangles.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from simrig.core.errors import SimrigError, check_known
from simrig.mesostructure.tile import Part, Tile

_SPOT = 0.38  # radius of a spot at the beginning, of the tile's shorter side
_WAVES = 6  # of a spot's rim, and of a field

Change = Callable[[Tile, float, np.random.Generator], tuple[Part, ...]]


def changed_tile(tile: Tile, change: str, time: float, seed: int = 0) -> Tile:
    """Return a tile while it changes.

    Args:
        tile: before.
        change: of ``CHANGES``.
        time: 0 (begins) to 1 (has ended).
        seed: of what is random.

    Raises:
        SimrigError: an unknown change, or another time.
    """
    check_known("change", change, CHANGES)
    if not 0.0 <= time <= 1.0:
        raise SimrigError(f"a change goes from 0 to 1, got {time:g}")
    parts = CHANGES[change](tile, float(time), np.random.default_rng([seed, *change.encode()]))
    origin = {**tile.origin, "change": change, "time": float(time)}
    return replace(tile, name=f"{tile.name}+{change}@{time:g}", parts=parts, origin=origin)


def _drying(tile: Tile, time: float, rng: np.random.Generator) -> tuple[Part, ...]:
    """A wet spot that shrinks: dark and glossy where it is wet.

    Source: Lekner and Dorf, Why some things are darker when wet, 1988 (light that is reflected
    back into the water is absorbed again); thesis Figure E.2 for the course.
    """
    amount, phase = rng.uniform(0.0, 0.06, _WAVES), rng.uniform(0.0, 2.0 * np.pi, _WAVES)
    middle, side = 0.5 * np.array(tile.size_mm), min(tile.size_mm)
    radius = _SPOT * side * np.sqrt(1.0 - time)  # the area shrinks evenly

    def wet(at: np.ndarray) -> np.ndarray:
        away = at[:, :2] - middle
        turn = np.arctan2(away[:, 1], away[:, 0])
        rim = 1.0 + np.sin(np.arange(2, 2 + _WAVES) * turn[:, None] + phase) @ amount
        return np.asarray(np.hypot(*away.T) < radius * rim)

    made: list[Part] = []
    for part in tile.parts:
        inside = wet(part.vertices[part.faces].mean(axis=1))
        soaked = None if part.colours is None else part.colours / (3.0 - 2.0 * part.colours)
        gloss = {"roughness": lambda r: 0.45 * r, "specular": lambda s: 0.5 * s + 0.25}
        looks = ((~inside, part.colours, part.bsdf), (inside, soaked, _altered(part.bsdf, gloss)))
        made += [
            replace(part, faces=part.faces[mine], colours=colours, bsdf=bsdf)
            for mine, colours, bsdf in looks
            if mine.any()
        ]
    return tuple(made)


def _tarnish(tile: Tile, time: float, rng: np.random.Generator) -> tuple[Part, ...]:
    """A brown film that begins in places and spreads over all; the gloss goes with it."""
    field = _field(tile, rng)

    def colours(part: Part) -> np.ndarray | None:
        if part.colours is None:
            return None
        how_far = np.clip((1.4 * time - field(part.vertices)) / 0.4, 0.0, 1.0)[:, None]
        brown = part.colours * np.array([0.5, 0.32, 0.2]) + 0.01
        return np.asarray((1.0 - how_far) * part.colours + how_far * brown)

    duller = {"roughness": lambda r: r + time * (0.8 - r) * (r < 0.8)}
    return tuple(
        replace(part, colours=colours(part), bsdf=_altered(part.bsdf, duller))
        for part in tile.parts
    )


def _dust(tile: Tile, time: float, rng: np.random.Generator) -> tuple[Part, ...]:
    """Grey dust that settles on what looks up, more in some places."""
    field = _field(tile, rng)

    def colours(part: Part) -> np.ndarray | None:
        if part.colours is None:
            return None
        up = np.ones(len(part.vertices))
        if part.normals is not None:
            up = np.maximum(part.normals[:, 2], 0.0)
        covered = 1.0 - np.exp(-3.0 * time * up * (0.5 + field(part.vertices)))
        dust = np.array([0.42, 0.39, 0.34])
        return np.asarray(part.colours + covered[:, None] * (dust - part.colours))

    matt = {
        "roughness": lambda r: r + time * (0.95 - r) * (r < 0.95),
        "specular": lambda s: s * (1.0 - 0.8 * time),
        "clearcoat": lambda c: c * (1.0 - time),
    }
    return tuple(
        replace(part, colours=colours(part), bsdf=_altered(part.bsdf, matt)) for part in tile.parts
    )


def _altered(bsdf: dict[str, Any], how: dict[str, Callable[[Any], Any]]) -> dict[str, Any]:
    """Return a BSDF with some of the numbers that it has changed."""
    return bsdf | {name: float(how[name](bsdf[name])) for name in how.keys() & bsdf.keys()}


def _field(tile: Tile, rng: np.random.Generator) -> Callable[[np.ndarray], np.ndarray]:
    """Return a smooth function of places that repeats with the tile, within 0 and 1."""
    waves = rng.integers(-2, 3, (_WAVES, 2)) + np.eye(2, dtype=int)[rng.integers(0, 2, _WAVES)]
    phase = rng.uniform(0.0, 2.0 * np.pi, _WAVES)

    def field(at: np.ndarray) -> np.ndarray:
        turn = 2.0 * np.pi * (at[:, :2] / np.array(tile.size_mm)) @ waves.T + phase
        return np.asarray(0.5 + 0.5 * np.sin(turn).mean(axis=1))

    return field


CHANGES: dict[str, Change] = {"drying": _drying, "tarnish": _tarnish, "dust": _dust}

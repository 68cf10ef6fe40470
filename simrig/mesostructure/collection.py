"""The recipes of the virtual database: as many of each category as thesis Table A.2 counts.

A recipe is drawn from its own seed, so that the first of a small collection are those of the whole.
"""

from __future__ import annotations

import colorsys
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from simrig.core.errors import SimrigError
from simrig.mesostructure.bsdfs import fibre
from simrig.mesostructure.fibres import Nonwoven
from simrig.mesostructure.knit import Knit
from simrig.mesostructure.leather import Leather
from simrig.mesostructure.pile import Carpet, Pile
from simrig.mesostructure.preset import Preset, Structure
from simrig.mesostructure.sheet import CubeCorners, Sheet
from simrig.mesostructure.tile import Tile
from simrig.mesostructure.weave import Weave
from simrig.mesostructure.wood import Spindles, Wood
from simrig.mesostructure.yarn import Yarn

RGB = tuple[float, float, float]
# category: materials, of them strongly and weakly anisotropic, with two highlights, of two colours
TABLE_A2: dict[str, tuple[int, int, int, int, int]] = {
    "fabric": (96, 21, 51, 31, 6),
    "wood": (16, 16, 0, 0, 0),
    "leather": (16, 0, 2, 0, 0),
    "carpet": (6, 0, 2, 0, 0),
    "plastic": (6, 0, 1, 0, 0),
    "paper": (2, 0, 0, 0, 0),
    "wallpaper": (2, 0, 0, 0, 0),
    "plaster": (2, 0, 0, 0, 0),
    "others": (4, 0, 1, 0, 0),
}
WHOLE = sum(row[0] for row in TABLE_A2.values())
_GROUP = {"wood": "wood meso", "leather": "leather meso"}
_STEPS = 96  # along the longer side of a tile: averages need no fine triangles


@dataclass(frozen=True)
class Recipe:
    """One material of the collection.

    Attributes:
        name: category and number, such as ``fabric007``.
        category: of Table A.2.
        generator: what makes it, such as ``satin_8`` or ``jersey``: materials alike.
        bounces: reflections that its average needs.
    """

    name: str
    category: str
    generator: str
    structure: Structure
    seed: int
    bounces: int = 2

    def tile(self) -> Tile:
        """Return the tile."""
        group = _GROUP.get(self.category, "fabric meso" if self.category == "fabric" else "other")
        made = Preset(self.name, group, self.generator, self.structure, _STEPS)(seed=self.seed)
        return replace(made, origin={"collection": self.name, "tile_seed": self.seed})


def collection(count: int = WHOLE, seed: int = 0) -> tuple[Recipe, ...]:
    """Return the recipes.

    Args:
        count: of them; fewer than 150 take each category's share, at least one of as many
            categories as there are.

    Raises:
        SimrigError: fewer than one, more than 150, or a seed below 0.
    """
    if count != int(count) or not 1 <= count <= WHOLE or seed != int(seed) or seed < 0:
        raise SimrigError(
            f"a collection has 1 to {WHOLE} materials and a whole seed >= 0, "
            f"got {count} and seed {seed}"
        )
    found = []
    for category, share in _shares(int(count)).items():
        for number in range(share):
            rng = np.random.default_rng([int(seed), *category.encode(), number])
            kind, structure = _MAKERS[category](number, rng)
            bounces = 4 if kind == "cube-corners" else 2
            name = f"{category}{number + 1:03d}"
            drawn = int(rng.integers(1 << 30))
            found.append(Recipe(name, category, kind, structure, drawn, bounces))
    return tuple(found)


def _shares(count: int) -> dict[str, int]:
    """Return how many of each category: one each while they last, then by largest remainder."""
    names = list(TABLE_A2)
    shares = dict.fromkeys(names[:count], 1)
    while sum(shares.values()) < count:
        behind = {n: TABLE_A2[n][0] * count / WHOLE - shares[n] for n in names}
        free = [n for n in names if shares[n] < TABLE_A2[n][0]]
        shares[max(free, key=lambda n: behind[n])] += 1
    return shares


def _colour(rng: np.random.Generator, darkest: float = 0.03, lightest: float = 0.8) -> RGB:
    value = float(np.exp(rng.uniform(np.log(darkest), np.log(lightest))))
    r, g, b = colorsys.hsv_to_rgb(rng.random(), float(rng.beta(1.2, 1.6)), value)
    return r, g, b


def _shining(rng: np.random.Generator) -> dict[str, object]:
    look = fibre(
        float(rng.uniform(0.22, 0.36)),
        float(rng.uniform(0.7, 0.92)),
        sheen=0.0,
        tint=float(rng.uniform(0.0, 0.7)),
    )
    return look | {"metallic": max(0.0, float(rng.uniform(-0.5, 0.8)))}  # lamé, or plain filament


def _dull(rng: np.random.Generator, low: float = 0.45) -> dict[str, object]:
    return fibre(
        float(rng.uniform(low, 0.8)),
        float(rng.uniform(0.3, 0.7)),
        sheen=float(rng.uniform(0.0, 0.6)),
        tint=float(rng.uniform(0.0, 0.5)),
    )


def _yarn(rng: np.random.Generator, spacing: float, colour: RGB, shining: bool) -> Yarn:
    width = spacing * rng.uniform(0.82, 1.0)
    flat = rng.uniform(0.35, 0.75) if shining else rng.uniform(0.5, 0.8)
    return Yarn(
        colour,
        float(width),
        float(width * flat),
        strands=int(rng.integers(2, 5)) if shining else int(rng.integers(3, 7)),
        twist=0.0 if shining else float(rng.uniform(0.4, 2.5)),
        look=_shining(rng) if shining else _dull(rng),
        mottle=float(rng.uniform(0.02, 0.12)),
    )


_ONE_SIDED = ("satin_8", "satin_5", "twill_3_1")
_TWO_SIDED = ("plain", "twill_2_2", "basket", "twill_2_1")
_YARNS = {"satin_8": 16, "satin_5": 10, "twill_3_1": 12, "twill_2_1": 12, "herringbone": 16}


def _weave(rng: np.random.Generator, pattern: str, shining: bool, colours: int) -> Weave:
    spacing = float(rng.uniform(0.2, 0.7))
    first = _colour(rng, 0.03, 0.45 if shining else 0.8)
    second = _colour(rng, 0.1, 0.6) if colours == 2 else first
    across = spacing * float(rng.uniform(0.85, 1.2))
    yarns = _YARNS.get(pattern, 8)
    return Weave(
        pattern,
        _yarn(rng, spacing, first, shining),
        _yarn(rng, across, second, shining),
        (spacing, across),
        yarns,
        yarns,
        crimp=float(rng.uniform(0.25, 0.8)),
    )


def _fabric(number: int, rng: np.random.Generator) -> tuple[str, Structure]:
    """Return every kind in turn, so that a small collection has several."""
    turn = number % 16
    if turn in (0, 4, 9):  # strong: one side of shining threads shows
        pattern = _ONE_SIDED[int(rng.integers(len(_ONE_SIDED)))]
        return f"{pattern}-filament", _weave(rng, pattern, True, 1)
    if turn in (1, 5, 8, 11, 13):  # two highlights: threads of both directions shine
        pattern = _TWO_SIDED[int(rng.integers(len(_TWO_SIDED)))]
        colours = 2 if turn == 5 else 1
        return f"{pattern}-filament", _weave(rng, pattern, True, colours)
    if turn in (2, 6, 10, 14):
        pattern = (*_ONE_SIDED, *_TWO_SIDED, "herringbone")[int(rng.integers(8))]
        return f"{pattern}-staple", _weave(rng, pattern, False, 1)
    if turn in (3, 12):
        wale = float(rng.uniform(1.0, 2.2))
        width = wale * float(rng.uniform(0.3, 0.36))
        yarn = Yarn(
            _colour(rng), width, 0.9 * width, 4, float(rng.uniform(0.3, 1.4)), _dull(rng, 0.35)
        )
        return "knit", Knit(yarn, wale, 0.72 * wale, 4, 4, bool(rng.integers(2)))
    if turn == 7:
        ribs = 2.5 if rng.random() < 0.5 else None
        return "pile", Pile(
            _colour(rng), (7.5, 7.5), float(rng.uniform(0.6, 1.2)), ribs, 40.0, 0.045,
            float(rng.uniform(0.1, 0.5)), fibre(float(rng.uniform(0.35, 0.6)), 0.6, 0.5),
        )  # fmt: skip
    colour = _colour(rng)
    pale = (min(1.2 * colour[0], 0.9), min(1.2 * colour[1], 0.9), min(1.2 * colour[2], 0.9))
    return "nonwoven", Nonwoven(
        (colour, pale), (6.0, 6.0), 0.03, 5.0, 2.0, 0.3, float(rng.uniform(0.3, 1.6)), 1.2,
        look=_dull(rng),
    )  # fmt: skip


def _wood(number: int, rng: np.random.Generator) -> tuple[str, Structure]:
    base = float(np.exp(rng.uniform(np.log(0.06), np.log(0.62))))
    red = float(rng.uniform(0.45, 0.75))
    light = (base, base * red, base * red * float(rng.uniform(0.35, 0.65)))
    shade = float(rng.uniform(0.4, 0.85))
    dark, mark = ((c * light[0], c * light[1], c * light[2]) for c in (shade, 0.5 * shade))
    length = float(rng.uniform(1.0, 6.0))
    marks = Spindles(length, 0.1, float(rng.uniform(0.5, 2.5)), mark, float(rng.uniform(0.0, 0.1)))
    rays = Spindles(0.5 * length, 0.2, 0.4, mark)
    return "wood", Wood(
        light, dark, (20.0, 20.0), int(rng.integers(3, 9)), 0.3, marks, rays,
        fibre_relief=float(rng.uniform(0.004, 0.02)), roughness=float(rng.uniform(0.25, 0.5)),
        specular=float(rng.uniform(0.2, 0.6)),
    )  # fmt: skip


def _leather(number: int, rng: np.random.Generator) -> tuple[str, Structure]:
    pebble = float(rng.uniform(0.8, 2.2))
    stretch = float(rng.uniform(1.6, 2.4)) if number % 8 == 3 else float(rng.uniform(1.0, 1.2))
    return "leather", Leather(
        _colour(rng, 0.02, 0.45), (8.0 * pebble, 8.0 * pebble), pebble,
        pebble * float(rng.uniform(0.05, 0.17)), stretch=stretch,
        regularity=int(rng.integers(0, 5)), pores=float(rng.uniform(0.0, 1.5)),
        wrinkle=float(rng.uniform(0.002, 0.01)), roughness=float(rng.uniform(0.3, 0.55)),
    )  # fmt: skip


def _carpet(number: int, rng: np.random.Generator) -> tuple[str, Structure]:
    width = float(rng.uniform(2.6, 4.0))
    cut = bool(number % 2)
    twist = 0.03 if cut else 0.25
    yarn = Yarn(_colour(rng, 0.04, 0.5), width, width, 6, twist, _dull(rng), mottle=0.12)
    gauge = (width, width * float(rng.uniform(1.0, 1.4)))
    return "carpet", Carpet(yarn, gauge, float(rng.uniform(3.0, 6.0)), (3, 3), cut, 60)


def _sheet(
    kind: str,
    relief: tuple[float, float],
    grain: tuple[float, float],
    rough: tuple[float, float],
    specular: float = 0.5,
    brushed: int = -1,
) -> Callable[[int, np.random.Generator], tuple[str, Structure]]:
    def make(number: int, rng: np.random.Generator) -> tuple[str, Structure]:
        size = float(rng.uniform(*grain))
        lines = number == brushed
        return kind, Sheet(
            _colour(rng, 0.05 if kind == "plastic" else 0.35, 0.85),
            (24.0 * size, 24.0 * size),
            size * float(rng.uniform(*relief)),
            (size, 6.0 * size if lines else size),
            float(rng.uniform(*rough)),
            specular,
            clearcoat=float(rng.uniform(0.0, 0.4)) if kind == "plastic" else 0.0,
            anisotropic=0.7 if lines else 0.0,
        )

    return make


def _others(number: int, rng: np.random.Generator) -> tuple[str, Structure]:
    if number == 0:
        return "cube-corners", CubeCorners(1.0, float(rng.uniform(0.2, 0.3)))
    if number == 1:
        return _sheet("foil", (0.03, 0.06), (0.3, 0.6), (0.28, 0.35), 1.0, brushed=1)(number, rng)
    return _sheet("coating", (0.02, 0.1), (0.4, 1.0), (0.3, 0.7), 0.7)(number, rng)


_MAKERS: dict[str, Callable[[int, np.random.Generator], tuple[str, Structure]]] = {
    "fabric": _fabric,
    "wood": _wood,
    "leather": _leather,
    "carpet": _carpet,
    "plastic": _sheet("plastic", (0.01, 0.06), (0.4, 1.0), (0.25, 0.45), brushed=2),
    "paper": _sheet("paper", (0.03, 0.08), (0.15, 0.3), (0.55, 0.8), 0.3),
    "wallpaper": _sheet("wallpaper", (0.05, 0.1), (0.5, 1.2), (0.5, 0.7), 0.4),
    "plaster": _sheet("plaster", (0.1, 0.2), (0.4, 1.0), (0.75, 0.95), 0.2),
    "others": _others,
}

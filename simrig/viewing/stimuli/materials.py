"""Materials of the test scenes: one stack of images as a BTF, as its BRDF, and as a chessboard."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from simrig.btf.full import FullBtf
from simrig.btf.grid import PairGrid
from simrig.btf.stack import BtfStack
from simrig.btf.synthetic import bumps, chessboard
from simrig.core.errors import SimrigError, unknown_name
from simrig.core.progress import Progress
from simrig.directions.schemes import HemisphereScheme, scheme
from simrig.files.btf.hdf5 import read_btf
from simrig.mesostructure import PRESETS, build_tile
from simrig.plugins import make_btf
from simrig.rigs.btf.kept import kept_btf
from simrig.rigs.btf.rig import AUTO, btf_angles

BUMPS, CHESSBOARD = "bumps", "chessboard-MM"
_CHESSBOARD = re.compile(r"chessboard-(\d+(?:\.\d+)?)$")


@dataclass(frozen=True)
class StimulusMaterial:
    """A material with structure, as a BTF and as the BRDF that is its spatial average.

    Both are looked up in the same way among the same directions, so from afar they are the same.

    Raises:
        SimrigError: pairs of directions without an image, or with two.
    """

    stack: BtfStack

    def __post_init__(self) -> None:
        PairGrid.of(self.stack)

    @cached_property
    def near(self) -> FullBtf:
        """The BTF."""
        return FullBtf.from_stack(self.stack)

    @cached_property
    def far(self) -> FullBtf:
        """The BRDF: the mean of every image, as a BTF of one texel.

        It is looked up as the BTF is, beyond the last measured polar angle too.
        """
        mean = self.stack.mean()
        values = mean.values.astype(np.float32).reshape(-1, 1, 1, 3)
        return FullBtf.from_stack(
            BtfStack(values, self.stack.angles, self.stack.size_mm, mean.name)
        )

    def btf(self, **options: Any) -> Any:
        """Return the BTF as a BSDF; for the options see ``simrig.plugins.make_btf``."""
        return make_btf(self.near, **options)

    def brdf(self, rotation_deg: float = 0.0) -> Any:
        """Return the BRDF as a BSDF."""
        return make_btf(self.far, scale=1.0, rotation=rotation_deg)

    def switched(self, distance_mm: float, **options: Any) -> dict[str, Any]:
        """Return the BTF within a distance and the BRDF beyond it (``simrig_lod``)."""
        return {
            "type": "simrig_lod",
            "distance": distance_mm,
            "near": self.btf(**options),
            "far": self.brdf(options.get("rotation", 0.0)),
        }


def stimulus_stack(
    name: str,
    texels: int = 64,
    directions: str | HemisphereScheme = "hemisphere_81",
    spp: int = 16,
    tile_steps: int | None = None,
    bounces: int | str = AUTO,
    variant: str = "auto",
    folder: Path | None = None,
    progress: Progress | None = None,
) -> BtfStack:
    """Return the images of a material by its name, or of a file.

    Args:
        name: a file that ``simrig btf measure`` wrote; a material with structure, which is
            measured now; ``bumps``; or ``chessboard-2`` for squares of 2 mm.
        texels: along x, for what is made here.
        directions: the scheme of both directions, likewise.
        tile_steps: of the structure that is measured (``build_tile``).
        bounces: how often light is reflected at most in a measurement (``measure_btf``).
        folder: for what is measured now, which is read from there the next time (``kept_btf``).
        progress: of a measurement: called with views done and in total.

    Raises:
        SimrigError: an unknown name, a file that is none, or a folder with another measurement.
    """
    squares = _CHESSBOARD.match(name)
    if squares:
        return chessboard(float(squares[1]))
    rings = scheme(directions) if isinstance(directions, str) else directions
    if name == BUMPS:
        return bumps((texels, texels), directions=rings)
    if name in PRESETS:
        tile, angles = build_tile(name, resolution=tile_steps), btf_angles(rings)
        path = folder and folder / f"{name}.h5"
        how: dict[str, Any] = {"bounces": bounces, "variant": variant, "progress": progress}
        return kept_btf(path, tile, angles, texels, spp, **how)
    if Path(name).is_file():
        return read_btf(Path(name))
    if Path(name).suffix:
        raise SimrigError(f"there is no file '{name}'")
    raise unknown_name("material with structure", name, (*PRESETS, BUMPS, CHESSBOARD))

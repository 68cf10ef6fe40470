"""BTFs that are measured once: into a file, and from it the next time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from simrig.btf.stack import BtfStack
from simrig.core.errors import SimrigError
from simrig.files.btf.hdf5 import read_btf
from simrig.mesostructure.tile import Tile
from simrig.rigs.btf.rig import AUTO, btf_angles, by_view, measure_btf, resolution_of


def kept_btf(
    path: str | Path | None,
    tile: Tile,
    angles: np.ndarray | None = None,
    resolution: int | tuple[int, int] = 128,
    spp: int = 16,
    *,
    bounces: int | str = AUTO,
    seed: int = 0,
    **how: Any,
) -> BtfStack:
    """Return a measured BTF, from its file where it has been measured before.

    Args:
        path: an HDF5 file, whose folder is made; None measures in memory.
        tile, angles, resolution, spp, bounces, seed, how: of ``measure_btf``.

    Raises:
        SimrigError: what ``measure_btf`` refuses, or a file that holds another measurement.
    """
    angles = btf_angles() if angles is None else angles
    if path is not None and Path(path).is_file():
        wanted = {
            "tile": [tile.name, tile.triangles, *tile.height_mm],
            "texels": list(resolution_of(tile, resolution)),
            "samples per texel": spp,
            "seed": seed,
        }
        if bounces != AUTO:  # those that a plan found are not planned again
            wanted["bounces"] = bounces
        stack = read_btf(path)
        _check_same(path, stack, wanted, by_view(angles))
        return stack
    if path is not None:
        try:
            Path(path).parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise SimrigError(f"cannot write '{path}': {error.strerror}") from error
    how |= {"path": path, "bounces": bounces, "seed": seed}
    return measure_btf(tile, angles, resolution, spp, **how)


def _check_same(
    path: str | Path, stack: BtfStack, wanted: dict[str, Any], angles: np.ndarray
) -> None:
    held = stack.provenance
    tile = held.get("tile", {})
    found = {
        "tile": [tile.get("name"), tile.get("triangles"), *tile.get("height_mm", ())],
        "texels": list(stack.resolution),
        "samples per texel": held.get("spp"),
        "seed": held.get("seed"),
        "bounces": held.get("bounces"),
    }
    other = [name for name, value in wanted.items() if found[name] != value]
    if not np.array_equal(stack.angles, angles):
        other.append("directions")
    if other:
        raise SimrigError(
            f"'{path}' holds another measurement, with other {' and '.join(other)}: remove it or "
            "choose another folder"
        )

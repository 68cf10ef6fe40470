"""Tiles that repeat, cut out of a BTF of a surface that does not."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from simrig.core.errors import SimrigError
from simrig.core.progress import Progress
from simrig.files.btf.hdf5 import read_btf
from simrig.files.btf.recording import BtfWriter
from simrig.imaging.tiling import Tiling, find_tiling

_MOST = 24  # images that the cut is chosen by


def write_tiled(
    path: str | Path,
    source: str | Path,
    height: int,
    width: int,
    progress: Progress | None = None,
) -> Tiling:
    """Write a BTF whose images repeat, all cut along the same path.

    Args:
        path: the file; an interrupted one continues.
        source: a BTF file of registered images.
        height, width: of the tile in texels.
        progress: called with images done and in total.

    Returns:
        How it was cut.

    Raises:
        SimrigError: a file that is none, or images smaller than the tile and its overlap.
    """
    if Path(path).absolute() == Path(source).absolute():
        raise SimrigError(f"'{path}' is what is to be cut: choose another output")
    stack = read_btf(source)
    chosen = np.unique(np.linspace(0, len(stack) - 1, min(_MOST, len(stack))).astype(int))
    tiling = find_tiling(stack.images(chosen).mean(axis=-1), height, width)
    rows, columns = stack.resolution
    size = (stack.size_mm[0] * width / columns, stack.size_mm[1] * height / rows)
    cut = {"row": tiling.row, "column": tiling.column, "overlap": tiling.overlap}
    with BtfWriter(
        path,
        stack.angles,
        (height, width),
        size,
        name=stack.name,
        provenance={**stack.provenance, "tile": {**cut, "seam": round(tiling.seam, 4)}},
        dtype=stack.values.dtype.type,
    ) as writer:
        for part, block in stack.blocks():
            if part.start in writer.missing:
                writer.write(part.start, np.stack([tiling.cut(image) for image in block]))
            if progress is not None:
                progress(part.stop, len(stack))
    return tiling

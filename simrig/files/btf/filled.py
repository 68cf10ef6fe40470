"""A BTF whose missing images are blended from their neighbours."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from simrig.btf.grid import PairGrid
from simrig.btf.stack import BtfStack
from simrig.core.errors import SimrigError
from simrig.core.progress import Progress, tracked
from simrig.directions.spherical import to_angles
from simrig.files.btf.recording import BtfWriter

FILLED = "filled"  # in the provenance: how many images are no measurements


def write_filled(path: str | Path, stack: BtfStack, progress: Progress | None = None) -> list[str]:
    """Write a stack with an image for every illumination and view that it has.

    Images that are there come first and as they are. A missing one is the blend of those of the
    same view around it, else of the same illumination, as a renderer blends them (``PairGrid``).

    Args:
        path: the file (``BtfWriter``); an interrupted one continues.
        stack: what lacks images. Its type is kept.

    Returns:
        The pairs that were filled, in degrees.

    Raises:
        SimrigError: nothing is missing, or a missing image has too few neighbours.
    """
    grid = PairGrid.of(stack, "fill")
    missing = grid.missing.tolist()
    if not missing:
        raise SimrigError(f"BTF '{stack.name}' lacks no images: there is nothing to fill")
    sources = [grid.sources(light, view) for light, view in missing]
    theta_i, phi_i = to_angles(grid.lights[grid.missing[:, 0]])
    theta_v, phi_v = to_angles(grid.views[grid.missing[:, 1]])
    angles = np.concatenate([stack.angles, np.stack([theta_i, theta_v, phi_i, phi_v], axis=-1)])
    provenance = {**stack.provenance, FILLED: len(missing)}
    with BtfWriter(
        path,
        angles,
        stack.resolution,
        stack.size_mm,
        name=stack.name,
        provenance=provenance,
        dtype=stack.values.dtype.type,
    ) as writer:
        for part, block in stack.blocks():
            writer.write(part.start, block)
        for number, blended in enumerate(tracked(sources, progress)):
            image = sum(w * np.asarray(stack.values[k], dtype=np.float64) for k, w in blended)
            writer.write(len(stack) + number, np.asarray(image))
    return [grid.describe(light, view) for light, view in missing]

"""From which distance on the structure of a material cannot be seen."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from simrig.btf.stack import BtfStack
from simrig.core import backend
from simrig.core.errors import SimrigError, check_known
from simrig.files.pictures import names_picture, read_image
from simrig.front_door.materials import load
from simrig.mesostructure import PRESETS, Tile, build_tile
from simrig.viewing.structure.cylinder import cylinder_stimulus, measured_upright
from simrig.viewing.structure.probe import (
    Stimulus,
    StructureProbe,
    btf_stimulus,
    element_of_preset,
    image_stimulus,
    probe,
    tile_stimulus,
)

FLAT, CYLINDER = STIMULI = ("flat", "cylinder")


def critical_distance(
    material: Tile | BtfStack | np.ndarray | str | Path,
    *,
    size_mm: float | None = None,
    structure_mm: float | None = None,
    stimulus: str = FLAT,
    texels: int = 64,
    spp: int | None = None,
    seed: int = 0,
) -> StructureProbe:
    """Predict the critical viewing distance of a material with structure (thesis section 3.3).

    From there on its BRDF looks like its BTF.

    Args:
        material: a built-in material with structure or its name, a BTF or its file (``.h5``), or a
            picture of a material (linear RGB, or a file).
        size_mm: width of what a picture shows; required there.
        structure_mm: size of the largest element; that of the built-in material, or what is found
            in the spectrum, else.
        stimulus: ``flat`` (a flat piece from 0.6 m under two lights), or ``cylinder`` (its BTF
            beside its BRDF, as in thesis section B.2).
        texels: along x, of the BTF of a built-in material for the cylinder.
        spp: of a built-in material: samples per pixel (256), or per texel of its BTF (16).
        seed: of the tile of a built-in material named by its name.

    Returns:
        ``distances_m`` by each feature with published constants, the features, the sizes and the
        cost.

    Raises:
        SimrigError: an unknown name, a picture without its width, a size that is not positive.
    """
    shown, size, _ = stimulus_of(
        material,
        size_mm=size_mm,
        structure_mm=structure_mm,
        stimulus=stimulus,
        texels=texels,
        spp=spp,
        seed=seed,
    )
    return probe(shown, size)


def stimulus_of(
    material: Any,
    *,
    size_mm: float | None = None,
    structure_mm: float | None = None,
    stimulus: str = FLAT,
    texels: int = 64,
    spp: int | None = None,
    seed: int = 0,
) -> tuple[Stimulus, float | None, str]:
    """Return what is looked at, the size of its structure, and where that is from.

    Args, Raises: as ``critical_distance``.
    """
    check_known("stimulus", stimulus, STIMULI)
    for name, count in (("spp", spp), ("texels", texels)):
        if count is not None and not (isinstance(count, int) and count >= 1):
            raise SimrigError(f"{name} must be a whole number >= 1, got {count!r}")
    picture = isinstance(material, np.ndarray) or (
        isinstance(material, str | Path) and names_picture(material)
    )
    if not picture:
        material = _structured(material, seed)
    name = "the picture" if isinstance(material, np.ndarray) else f"'{_name(material)}'"
    if picture and stimulus == CYLINDER:
        raise SimrigError(f"{name}: a cylinder needs a BTF, look at a picture with flat")
    if picture and size_mm is None:
        raise SimrigError(f"{name} is a picture: say with size_mm (--size-mm) how wide it is")
    if not picture and size_mm is not None:
        raise SimrigError(
            f"{name}: size_mm (--size-mm) says how wide a picture is, and only a picture needs it"
        )
    show = _cylinder if stimulus == CYLINDER else _flat
    shown, own = show(material, size_mm, texels, spp)
    if structure_mm is not None:
        return shown, structure_mm, "given"
    return shown, own, "of the preset" if own else "found in the spectrum"


def _structured(material: Any, seed: int) -> Tile | BtfStack:
    """Return a material with structure from its name, its file or itself."""
    if isinstance(material, str | Path):
        if str(material) in PRESETS and not Path(material).exists():
            return build_tile(str(material), seed=seed)
        material = load(material)
    if not isinstance(material, Tile | BtfStack):
        raise SimrigError(
            f"'{_name(material)}' has no structure to see: give a built-in material with "
            "structure, a BTF or a picture"
        )
    return material


def _name(material: Any) -> str:
    return str(getattr(material, "name", material))


def _flat(
    material: Any, size_mm: float | None, _texels: int, spp: int | None
) -> tuple[Stimulus, float | None]:
    if isinstance(material, BtfStack):
        return btf_stimulus(material), element_of_preset(material.name)
    if isinstance(material, Tile):
        backend.current()
        return tile_stimulus(material, spp=256 if spp is None else spp), material.element_mm
    if size_mm is None:
        raise SimrigError("a picture needs its width")
    if isinstance(material, np.ndarray):
        return image_stimulus(material, size_mm), None
    return image_stimulus(read_image(material), size_mm, Path(material).name), None


def _cylinder(
    material: Any, _size_mm: float | None, texels: int, spp: int | None
) -> tuple[Stimulus, float | None]:
    backend.current()
    if isinstance(material, BtfStack):
        return cylinder_stimulus(material), element_of_preset(material.name)
    stack = measured_upright(material, texels, 16 if spp is None else spp)
    return cylinder_stimulus(stack), material.element_mm

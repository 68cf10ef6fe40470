"""Materials and measurements by name, file or object: load, save, list, average."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from simrig.brdf import KURT_MATERIALS, RESCALED_MATERIALS
from simrig.brdf.protocol import Brdf
from simrig.btf.stack import BtfStack
from simrig.core.errors import SimrigError, unknown_name
from simrig.files import hdf5
from simrig.files.btf.hdf5 import CONTENT as BTF
from simrig.files.btf.hdf5 import read_btf, write_btf
from simrig.files.load import MATERIALS, load_material, save_material
from simrig.mesostructure import PRESETS, Tile, build_tile

if TYPE_CHECKING:
    from simrig.rendering.render import RenderResult
    from simrig.rigs.measurements.measurement import Measurement


def materials() -> dict[str, str]:
    """Return the built-in materials: name to a line that says what it is.

    The first are BRDFs; those with structure (cloth, leather, wood, ...) are tiles of real
    geometry, which ``load`` builds. Any file that ``load`` reads is a material as well.
    """
    about = dict.fromkeys(MATERIALS, "model with its default parameters")
    about |= dict.fromkeys(KURT_MATERIALS, "thesis Table D.1, as printed")
    about |= dict.fromkeys(RESCALED_MATERIALS, "thesis Table D.1, second lobe rescaled (inferred)")
    return about | {name: preset.description for name, preset in PRESETS.items()}


def load(source: str | Path, *, clamp_negative: bool = False, **stated: Any) -> Brdf | Any:
    """Return a material or a measurement.

    Args:
        source: a name of ``materials()``, or a file. What a file is, is told by its content:
            simrig's own (HDF5: BRDF, BTF, measurement), MERL, UTIA, RGL, Cornell, UBO2014, ...
        clamp_negative: set negative values of measurement noise to 0 instead of refusing them.
        stated: what a file of a material cannot say: ``factor``, ``layout``, ``encoding``,
            ``colour``, ``axes``, ``side``, ... (``simrig.files.formats.ReadOptions``).

    Returns:
        A ``Brdf``, a ``Btf`` (images by pairs of directions), a ``Measurement``, or of a built-in
        material with structure its tile. (Type checkers take it for any of these.)

    Raises:
        SimrigError: no such name or file, with the nearest known name; a file that holds neither a
            material nor a measurement, with what it holds; a damaged file.
    """
    if not isinstance(source, str | Path):
        raise SimrigError(f"a name or a file is needed, got {_kind(source)}")
    name, path = str(source), Path(source)
    asked = [option for option, value in stated.items() if value is not None]
    asked += ["clamp_negative"] if clamp_negative else []
    if name in PRESETS and not path.exists():
        _refuse_stated(f"'{name}' is built in", asked)
        return build_tile(name)
    if name not in MATERIALS and not path.exists() and path.name == name and not path.suffix:
        raise unknown_name("material", name, (*MATERIALS, *PRESETS))
    content = hdf5.content_of(path) if _is_hdf5(path) else ""
    if "measurement" in content or content == BTF:
        _refuse_stated(f"'{source}' is no material file", asked)
    if "measurement" in content:
        return load_measurement(path)
    if content == BTF:
        return read_btf(path)
    return load_material(source, clamp_negative, **stated)


def _refuse_stated(why: str, asked: list[str]) -> None:
    if asked:
        raise SimrigError(f"{why}: leave out {', '.join(asked)}")


def _is_hdf5(path: Path) -> bool:
    if not path.is_file():
        return False
    with open(path, "rb") as file:
        return file.read(len(hdf5.MAGIC)) == hdf5.MAGIC


def load_measurement(path: Path) -> Measurement:
    """Read a measurement along slices or of listed directions.

    Raises:
        SimrigError: not a measurement, or a damaged one.
    """
    from simrig.rigs.measurements.measurement import Measurement

    return Measurement.load(path)


def save(
    item: Brdf | BtfStack | Measurement | RenderResult | np.ndarray,
    path: str | Path,
    *,
    format: str | None = None,
    overwrite: bool = False,
) -> Path:
    """Write a material, a measurement or a picture.

    Args:
        item: what ``load``, ``measure``, ``reconstruct`` or ``render`` returned, or a picture as
            linear RGB, shape (height, width, 3).
        path: the file. A BRDF's format follows from its ending (``.h5``, ``.binary``, ``.bin``,
            ``.bsdf``); measurements and BTFs are ``.h5``; pictures ``.exr`` (linear) or ``.png``
            (sRGB, 8 bit).
        format: of a BRDF, in place of the ending: see ``simrig convert``.
        overwrite: replace a file that exists.

    Returns:
        The path.

    Raises:
        SimrigError: the file exists, cannot be written, or cannot hold the item.
    """
    path = Path(path)
    if path.exists() and not overwrite:
        raise SimrigError(f"'{path}' exists: choose another name, or say overwrite=True")
    if isinstance(item, Brdf):
        save_material(path, item, format)
        return path
    if format is not None:
        raise SimrigError("only a BRDF has a choice of formats: leave out format")
    if isinstance(item, BtfStack):
        write_btf(path, item)
    elif hasattr(item, "save"):
        item.save(path)
    else:
        _save_picture(getattr(item, "image", item), path)
    return path


def _save_picture(image: Any, path: Path) -> None:
    from simrig.files.images import as_image, write_exr, write_png

    if not isinstance(image, np.ndarray):
        raise SimrigError(
            "what can be saved is a BRDF, a BTF, a measurement or a picture, "
            f"got {type(image).__name__}"
        )
    if path.suffix.lower() == ".exr":
        write_exr(path, as_image(image))
    elif path.suffix.lower() == ".png":
        write_png(path, image)
    else:
        raise SimrigError(f"a picture ends in .exr or .png, not '{path.suffix}'")


def average(btf: BtfStack | str | Path) -> Brdf:
    """Return the BRDF of a BTF: the mean over all of its texels (thesis section 1.1.1).

    Args:
        btf: images of all pairs of n directions, the same for light and view; or the file.

    Raises:
        SimrigError: no BTF, or one that lacks pairs.
    """
    from simrig.btf.average import average_brdf

    stack = btf if isinstance(btf, BtfStack) else load(btf)
    if not isinstance(stack, BtfStack):
        raise SimrigError(f"only a BTF has texels to average, got {_kind(stack)}")
    return average_brdf(stack)


def as_brdf(material: Any) -> Brdf:
    """Return a BRDF from itself, its name or its file.

    Raises:
        SimrigError: what ``load`` refuses, or a material that is none, with what to do.
    """
    if isinstance(material, str | Path):
        tile = str(material) in PRESETS and not Path(material).exists()
        material = load(material) if tile else load_material(material)
    if isinstance(material, Brdf):
        return material
    advice = {
        BtfStack: "average it (simrig.average)",
        Tile: "measure its BTF (rig 'btf'), whose values are means of images",
    }
    cure = next((text for kind, text in advice.items() if isinstance(material, kind)), None)
    if cure is None and hasattr(material, "plan"):
        cure = "reconstruct it first (simrig.reconstruct)"
    raise SimrigError(
        f"a BRDF is needed, got {_kind(material)}: {cure or 'give a name, a file or a BRDF'}"
    )


def _kind(item: Any) -> str:
    """Return what something is, for a message."""
    words = {BtfStack: "the BTF", Tile: "the material with structure", Brdf: "the BRDF"}
    word = next((word for kind, word in words.items() if isinstance(item, kind)), None)
    return type(item).__name__ if word is None else f"{word} '{item.name}'"

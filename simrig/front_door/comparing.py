"""How far two materials, or two pictures, are apart."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from simrig.btf.stack import BtfStack
from simrig.core.errors import SimrigError
from simrig.directions.schemes import LARGEST_THETA_DEG
from simrig.evaluation.metrics.btfs import BtfComparison, compare_btfs
from simrig.evaluation.metrics.comparison import (
    BrdfComparison,
    Comparison,
    compare_brdfs,
    compare_images,
)
from simrig.evaluation.metrics.images import foreground_mask
from simrig.files.atomic import existing_file
from simrig.files.btf.hdf5 import CONTENT as BTF
from simrig.files.btf.hdf5 import read_btf
from simrig.files.hdf5 import content_of
from simrig.files.pictures import Picture, as_image, names_picture, picture_format, read_picture
from simrig.files.utia import states_layout
from simrig.front_door.materials import as_brdf

if TYPE_CHECKING:
    from simrig.brdf.protocol import Brdf
    from simrig.rendering.render import RenderResult

    AnyPicture = np.ndarray | RenderResult | Picture

_PICTURE, _MATERIAL = "picture", "material"
_OF_MATERIALS = {"step_deg": 2.0, "theta_max_deg": None}
_OF_PICTURES = {"exposure": None, "foreground": False, "difference_scale": 10.0}


@overload
def compare(
    reference: Brdf,
    other: Brdf | str | Path,
    *,
    step_deg: float | None = None,
    theta_max_deg: float | None = None,
) -> BrdfComparison: ...
@overload
def compare(
    reference: AnyPicture,
    other: AnyPicture | str | Path,
    *,
    exposure: float | None = None,
    foreground: bool | None = None,
    difference_scale: float | None = None,
) -> Comparison: ...
@overload  # names: what they name is not known to a type checker
def compare(
    reference: str | Path,
    other: Brdf | AnyPicture | str | Path,
    *,
    step_deg: float | None = None,
    theta_max_deg: float | None = None,
    exposure: float | None = None,
    foreground: bool | None = None,
    difference_scale: float | None = None,
) -> Comparison | Any: ...
def compare(
    reference: Brdf | AnyPicture | str | Path,
    other: Brdf | AnyPicture | str | Path,
    *,
    step_deg: float | None = None,
    theta_max_deg: float | None = None,
    exposure: float | None = None,
    foreground: bool | None = None,
    difference_scale: float | None = None,
) -> Comparison | BrdfComparison | BtfComparison:
    """Compare two materials, two BTFs, or two pictures, by every metric.

    Args:
        reference: the truth: a BRDF, its name or its file; or a picture: what ``render`` returned,
            linear RGB of shape (height, width, 3), or a file (EXR, HDR, PNG, JPEG, PFM). What a
            file is, is told by its content; an OpenEXR file that may be a table of UTIA's layout
            is a picture beside a picture, and a material beside a material. BTFs are compared
            image by image, and have no options.
        other: what is compared with it, of the same kind.
        step_deg: of materials: degrees between directions of the grid (2).
        theta_max_deg: of materials: the largest polar angle of the grid, in degrees; the last
            step up to 80 unless given.
        exposure: of pictures: factor to the linear values before they are shown; unless given,
            the one that the reference's plan was made for where its OpenEXR file says so, else 1.
        foreground: of pictures: count only pixels that are not black in both (false).
        difference_scale: of pictures: s of the difference image ``255 − s·|I1 − I2|`` (10).

    Returns:
        ``delta_e``, ``log_error`` (%), ``median_relative_error`` (%), ``mre`` (%), ``rmse``
        (1/sr) and ``log_psnr`` (dB) of materials; ``delta_e``, ``psnr``,
        ``ssim``, ``flip`` and more of pictures, with maps. Prints itself, shows itself in a
        notebook, and ``to_dict()`` gives plain numbers.

    Raises:
        SimrigError: one of each kind, pictures of different sizes, values that are not finite, or
            options of the other kind.

    Source: thesis section 5.4 for the metrics of BRDFs; ``simrig.evaluation.metrics.comparison``
    says how each is taken.
    """
    given = {
        "step_deg": step_deg,
        "theta_max_deg": theta_max_deg,
        "exposure": exposure,
        "foreground": foreground,
        "difference_scale": difference_scale,
    }
    if are_btfs(reference, other):
        _options(given, {}, "BTFs")
        return compare_btfs(_stack(reference), _stack(other))
    if are_pictures(reference, other):
        options = _options(given, _OF_PICTURES, "pictures")
        return _pictures(_named(reference, "the reference"), _named(other, "the other"), **options)
    options = _options(given, _OF_MATERIALS, "materials")
    if options["theta_max_deg"] is None:
        options["theta_max_deg"] = _last_step(options["step_deg"])
    return compare_brdfs(as_brdf(reference), as_brdf(other), **options)


def are_btfs(reference: Any, other: Any) -> bool:
    """Return whether both are BTFs, or files of BTFs.

    Raises:
        SimrigError: a file (.h5) that does not exist.
    """
    return all(_is_btf(item) for item in (reference, other))


def _is_btf(item: Any) -> bool:
    if isinstance(item, str | Path):
        return Path(item).suffix == ".h5" and content_of(existing_file(item)) == BTF
    return isinstance(item, BtfStack)


def _stack(item: Any) -> BtfStack:
    return item if isinstance(item, BtfStack) else read_btf(item)


def are_pictures(reference: Any, other: Any) -> bool:
    """Return whether both are pictures, or else both materials.

    Raises:
        SimrigError: one of each.
    """
    kinds = [_kinds(item) for item in (reference, other)]
    if _PICTURE in kinds[0] and _PICTURE in kinds[1]:
        return True
    if _MATERIAL in kinds[0] and _MATERIAL in kinds[1]:
        return False
    raise SimrigError("compare two pictures or two materials, not one of each")


def _options(given: dict[str, Any], known: dict[str, Any], kind: str) -> dict[str, Any]:
    """Return the options of a kind with their defaults; refuse those of the other."""
    stray = [name for name, value in given.items() if value is not None and name not in known]
    if stray:
        raise SimrigError(f"comparing {kind} has no {stray[0]}: leave it out")
    return {
        name: default if given[name] is None else given[name] for name, default in known.items()
    }


def _last_step(step_deg: float) -> float:
    """Return the largest polar angle of a grid: the last step up to 80 degrees."""
    if not 0.0 < step_deg <= LARGEST_THETA_DEG:
        return LARGEST_THETA_DEG
    steps = math.floor(LARGEST_THETA_DEG / step_deg + 1e-9)
    return step_deg * steps if steps > 1 else LARGEST_THETA_DEG


def _kinds(item: Any) -> set[str]:
    """Return what something can be; an OpenEXR file is a picture or a table of UTIA's layout."""
    if not isinstance(item, str | Path):
        picture = isinstance(item, np.ndarray | Picture) or hasattr(item, "image")
        return {_PICTURE if picture else _MATERIAL}
    path = Path(item)
    if not path.is_file():
        return {_PICTURE if names_picture(path) else _MATERIAL}
    format = picture_format(path)
    if format == "OpenEXR":
        return {_MATERIAL} if states_layout(path) else {_PICTURE, _MATERIAL}
    return {_MATERIAL if format is None else _PICTURE}


def _named(item: Any, otherwise: str) -> tuple[str, Picture]:
    """Return a picture with the name by which messages call it."""
    if isinstance(item, str | Path):
        return str(item), read_picture(item)
    if isinstance(item, Picture):
        return otherwise, item
    return otherwise, Picture(as_image(np.asarray(item), otherwise), "array")


def _pictures(
    reference: tuple[str, Picture],
    other: tuple[str, Picture],
    exposure: float | None,
    foreground: bool,
    difference_scale: float,
) -> Comparison:
    """Compare two pictures; where both say an exposure, and not the same, both are undone."""
    named = (reference, other)
    if reference[1].pixels.shape != other[1].pixels.shape:
        sizes = " and ".join(f"'{name}' has {picture.size}" for name, picture in named)
        raise SimrigError(f"the pictures differ in size: {sizes}")
    notes = {name: list(picture.made) for name, picture in named}
    if exposure is None:
        exposure = _planned_exposure(reference[1])
        if exposure is not None:
            notes[reference[0]].append(f"shown at the exposure {exposure:.4g} of its plan")
        else:
            exposure = 1.0
    first, second = (picture.pixels for _, picture in named)
    shown_at = [picture.shown_exposure or 1.0 for _, picture in named]
    if shown_at[0] != shown_at[1]:
        first, second = first / shown_at[0], second / shown_at[1]
        for (name, _), at in zip(named, shown_at, strict=True):
            if at != 1.0:
                notes[name].append(f"divided by the exposure {at:g} that it was made with")
    mask = foreground_mask(first, second) if foreground else None
    made = {name: tuple(lines) for name, lines in notes.items() if lines}
    return replace(compare_images(first, second, mask, exposure, difference_scale), made=made)


def _planned_exposure(picture: Picture) -> float | None:
    """Return the exposure for which a picture of simrig was planned, None where it says none."""
    try:
        value = float(picture.says.get("exposure", "")) if picture.format == "OpenEXR" else math.nan
    except ValueError:
        return None
    return value if 0.0 < value < math.inf else None

"""How far two materials, or two pictures, are apart."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from simrig.core.errors import SimrigError
from simrig.evaluation.comparison import (
    BrdfComparison,
    Comparison,
    compare_brdfs,
    compare_images,
)
from simrig.files.pictures import names_picture, read_image
from simrig.front_door.materials import as_brdf

if TYPE_CHECKING:
    from simrig.brdf.protocol import Brdf
    from simrig.rendering.render import RenderResult

    Picture = np.ndarray | RenderResult
    Material = Brdf

_OF_MATERIALS = {"step_deg": 2.0, "theta_max_deg": 80.0}
_OF_PICTURES = {"exposure": 1.0, "foreground": False, "difference_scale": 10.0}


def compare(
    reference: Material | Picture | str | Path,
    other: Material | Picture | str | Path,
    *,
    step_deg: float | None = None,
    theta_max_deg: float | None = None,
    exposure: float | None = None,
    foreground: bool | None = None,
    difference_scale: float | None = None,
) -> Comparison | BrdfComparison:
    """Compare two materials, or two pictures, by every metric.

    Args:
        reference: the truth: a BRDF, its name or its file; or a picture: what ``render`` returned,
            linear RGB of shape (height, width, 3), or a file (``.exr``, ``.hdr``, ``.png``).
        other: what is compared with it, of the same kind.
        step_deg: of materials: degrees between directions of the grid (2).
        theta_max_deg: of materials: the largest polar angle of the grid, in degrees (80).
        exposure: of pictures: factor to the linear values before they are shown (1).
        foreground: of pictures: count only pixels that are not black in both (false).
        difference_scale: of pictures: s of the difference image 255 − s·|I1 − I2| (10).

    Returns:
        ``mre`` (%), ``rmse`` (1/sr) and ``log_psnr`` (dB) of materials; ``delta_e``, ``psnr``,
        ``ssim``, ``flip`` and more of pictures, with maps. Prints itself, shows itself in a
        notebook, and ``to_dict()`` gives plain numbers.

    Raises:
        SimrigError: one of each kind, pictures of different sizes, values that are not finite, or
            options of the other kind.

    Source: thesis section 5.4 for the metrics of BRDFs; ``simrig.evaluation.comparison`` says how
    each is taken.
    """
    given = {
        "step_deg": step_deg,
        "theta_max_deg": theta_max_deg,
        "exposure": exposure,
        "foreground": foreground,
        "difference_scale": difference_scale,
    }
    kinds = [_is_picture(item) for item in (reference, other)]
    if any(kinds) != all(kinds):
        raise SimrigError("compare two pictures or two materials, not one of each")
    if all(kinds):
        return _pictures(reference, other, **_options(given, _OF_PICTURES, "pictures"))
    options = _options(given, _OF_MATERIALS, "materials")
    return compare_brdfs(as_brdf(reference), as_brdf(other), **options)


def _options(given: dict[str, Any], known: dict[str, Any], kind: str) -> dict[str, Any]:
    """Return the options of a kind with their defaults; refuse those of the other."""
    stray = [name for name, value in given.items() if value is not None and name not in known]
    if stray:
        raise SimrigError(f"comparing {kind} has no {stray[0]}: leave it out")
    return {
        name: default if given[name] is None else given[name] for name, default in known.items()
    }


def _is_picture(item: Any) -> bool:
    if isinstance(item, str | Path):
        return names_picture(item)
    return isinstance(item, np.ndarray) or hasattr(item, "image")


def _pictures(
    reference: Any, other: Any, exposure: float, foreground: bool, difference_scale: float
) -> Comparison:
    from simrig.evaluation.metrics.images import foreground_mask

    first, second = _pixels(reference), _pixels(other)
    mask = foreground_mask(first, second) if foreground else None
    return compare_images(first, second, mask, exposure, difference_scale)


def _pixels(picture: Any) -> np.ndarray:
    return read_image(picture) if isinstance(picture, str | Path) else np.asarray(picture)

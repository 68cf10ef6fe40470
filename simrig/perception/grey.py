"""The images that all features look at: grey, as a display shows them."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from simrig.core.errors import SimrigError

_ROUNDING = 1e-6  # float32 encodings of white may lie this far above 1


def grey_image(values: ArrayLike, what: str = "the image", least: int = 1) -> np.ndarray:
    """Return a displayed grey image as float64, shape (height, width).

    Args:
        values: shape (height, width), in [0, 1].
        what: its name in errors.
        least: pixels that each side must have at least.

    Raises:
        SimrigError: another shape, too few pixels, NaN, infinity, or values outside [0, 1].
    """
    image = np.asarray(values, dtype=np.float64)
    if image.ndim != 2 or image.size == 0:
        raise SimrigError(f"{what} must be grey, of shape (height, width), got {image.shape}")
    if min(image.shape) < least:
        raise SimrigError(
            f"{what} has {image.shape[1]} × {image.shape[0]} pixels, at least {least} × {least} "
            "are needed: repeat the tile, or take a larger picture"
        )
    if not np.isfinite(image).all():
        count = int((~np.isfinite(image)).sum())
        raise SimrigError(f"{what} has {count} values that are NaN or infinite")
    if image.min() < -_ROUNDING or image.max() > 1.0 + _ROUNDING:
        raise SimrigError(
            f"{what} must be displayed values from 0 to 1, got {image.min():g} to {image.max():g}"
        )
    return np.clip(image, 0.0, 1.0)


def grey_pair(
    plain: ArrayLike, textured: ArrayLike, least: int = 1
) -> tuple[np.ndarray, np.ndarray]:
    """Return the image without structure (BRDF) and the one with it (BTF), of one shape.

    Raises:
        SimrigError: as ``grey_image``, or shapes that differ.
    """
    first = grey_image(plain, "the image without structure", least)
    second = grey_image(textured, "the image with structure", least)
    if first.shape != second.shape:
        raise SimrigError(
            f"the images differ in size: {first.shape[1]} × {first.shape[0]} "
            f"and {second.shape[1]} × {second.shape[0]} pixels"
        )
    return first, second

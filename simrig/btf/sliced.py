"""A BTF from a few images: every texel's values at all pairs from those that were measured.

A gantry measures slices of 168 images in place of 6,561 (thesis section 6.3.5). Which method makes
the others is not decided here (``simrig.reconstruction.gantry.btf`` has those of the gantry). The
result is a stack like any other: it renders, is factorised and is stored.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from simrig.btf.stack import LARGEST_HALF, BtfStack
from simrig.core.errors import SimrigError
from simrig.core.progress import Progress

_AT_ONCE = 1 << 26  # bytes of the float64 values of some texels at all pairs


def sliced_stack(
    measured: BtfStack,
    numbers: np.ndarray,
    method: Callable[[np.ndarray], np.ndarray],
    angles: np.ndarray,
    progress: Progress | None = None,
) -> BtfStack:
    """Return the stack of all pairs that a few measured images make, in memory.

    Args:
        numbers: of the images that the method takes, in its order, (s,).
        method: takes values (s, texels, 3) as float64, returns (pairs, texels, 3); what falls
            below zero is black.
        angles: theta_i, theta_v, phi_i, phi_v of the pairs in radians, shape (pairs, 4).

    Returns:
        A stack of the type of the measured one; of float32 where float16 does not hold what the
        method made.

    Raises:
        SimrigError: a method that returns another shape, or values that are not finite.
    """
    height, width = measured.resolution
    known = np.stack([np.asarray(measured.values[k], dtype=np.float64) for k in numbers.tolist()])
    known = known.reshape(len(numbers), -1, 3)
    texels, dtype = height * width, np.dtype(measured.values.dtype)
    values = np.empty((len(angles), texels, 3), dtype=dtype)
    step = max(1, _AT_ONCE // (24 * len(angles)))
    for start in range(0, texels, step):
        part = slice(start, min(start + step, texels))
        found = method(known[:, part])
        if found.shape != values[:, part].shape or not np.all(np.isfinite(found)):
            raise SimrigError(
                f"the method made values of shape {found.shape} for BTF '{measured.name}', finite "
                f"ones of shape {values[:, part].shape} are needed"
            )
        if dtype == np.float16 and found.max() > LARGEST_HALF:  # a method may overshoot
            dtype = np.dtype(np.float32)
            values = values.astype(dtype)
        values[:, part] = np.maximum(found, 0.0)
        if progress is not None:
            progress(part.stop, texels)
    return BtfStack(
        values.reshape(len(angles), height, width, 3),
        angles,
        measured.size_mm,
        f"{measured.name}, from {len(numbers)} images",
        {**measured.provenance, "images": len(numbers)},
    )

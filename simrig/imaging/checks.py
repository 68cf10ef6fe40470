"""What the stages of processing share: refusing arrays that cannot be pictures."""

from __future__ import annotations

from typing import Any

import numpy as np

from simrig.core.errors import SimrigError


def finite_array(values: Any, what: str, dimensions: tuple[int, ...]) -> np.ndarray:
    """Return values as a float array of one of some numbers of dimensions.

    float32 stays as it is; everything else that is a real number becomes float64.

    Raises:
        SimrigError: no numbers, other dimensions, nothing in it, NaN or infinity.
    """
    try:
        array = np.asarray(values)
    except ValueError as error:
        raise SimrigError(f"{what} must be an array of numbers: {error}") from error
    if array.dtype.kind not in "buif":
        raise SimrigError(f"{what} must be an array of real numbers, got {array.dtype}")
    if array.ndim not in dimensions or array.size == 0:
        wanted = " or ".join(str(number) for number in dimensions)
        raise SimrigError(f"{what} must have {wanted} dimensions and no empty one: {array.shape}")
    array = array if array.dtype == np.float32 else array.astype(np.float64, copy=False)
    bad = ~np.isfinite(array)
    if bad.any():
        place = ", ".join(str(int(number)) for number in np.argwhere(bad)[0])
        raise SimrigError(
            f"{what} has {int(bad.sum()):,} values that are NaN or infinite, the first at ({place})"
        )
    return array


def finite_number(value: Any, what: str, least: float = -np.inf, above: float = -np.inf) -> float:
    """Return a value as a finite number.

    Args:
        value: what was given.
        what: it is, for the message.
        least: it may be, inclusive.
        above: what it must be, exclusive.

    Raises:
        SimrigError: no number, not finite, or too small.
    """
    try:
        number = float(value)
    except (TypeError, ValueError) as error:
        raise SimrigError(f"{what} must be a number, got {value!r}") from error
    if not np.isfinite(number) or number < least or number <= above:
        limit = f" above {above:g}" if above > -np.inf else ""
        limit = f" of at least {least:g}" if least > -np.inf else limit
        raise SimrigError(f"{what} must be a finite number{limit}, got {value!r}")
    return number

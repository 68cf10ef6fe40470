"""How far one value of a BRDF is from the truth: relative and logarithmic differences.

The relative difference |f − f'| / f has no bound where the truth is almost black, and does not
exist where it is zero. The logarithmic one, |ln((f' + ε) / (f + ε))| with ε = ``LOG_ERROR_FLOOR``,
exists everywhere, is the relative one where both are small and f is well above ε, and grows by
2.3 for each factor of ten, however wrong a value is.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np

from simrig.core.errors import SimrigError

LOG_ERROR_FLOOR = 1e-3  # ε in 1/sr: a reflectance of 0.3 %, as black as black velvet
_PER_OCTAVE, _SMALLEST, _LARGEST = 64, -30, 34  # bins of relative differences, powers of two
BINS = _PER_OCTAVE * (_LARGEST - _SMALLEST)


def relative_differences(f: np.ndarray, g: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return |f − g| / f, zero where f is, and whether f > 0 as 1 or 0.

    Raises:
        SimrigError: for values that are not finite.
    """
    if not (np.isfinite(f).all() and np.isfinite(g).all()):
        raise SimrigError("the BRDFs cannot be compared: some values are NaN or infinite")
    lit = f > 0.0
    return np.where(lit, np.abs(f - g) / np.where(lit, f, 1.0), 0.0), lit.astype(np.float64)


def log_differences(f: np.ndarray, g: np.ndarray) -> np.ndarray:
    """Return |ln((g + ε) / (f + ε))|; negative values count as zero."""
    first, second = (np.log(np.maximum(v, 0.0) + LOG_ERROR_FLOOR) for v in (f, g))
    return np.asarray(np.abs(second - first))


def log_difference(f: Any, g: Any) -> Any:
    """Return ``log_differences`` of Dr.Jit arrays; NaN stays NaN."""
    ratio = (dr.maximum(g, 0.0) + LOG_ERROR_FLOOR) / (dr.maximum(f, 0.0) + LOG_ERROR_FLOOR)
    return dr.abs(dr.log(ratio))


def bin_of(relative: Any) -> Any:
    """Return the bin of relative differences (Dr.Jit), for ``median_of_bins``; NaN in the last."""
    place = (dr.log2(relative) - _SMALLEST) * _PER_OCTAVE
    return dr.uint32_array_t(type(relative))(
        dr.clip(dr.select(place < BINS, place, BINS), 0, BINS - 1)
    )


def median_of_bins(counts: np.ndarray) -> float:
    """Return the median of relative differences from their counts (BINS,), to 0.5 %.

    What falls below the first bin (1e-9) counts as no difference; NaN where nothing was counted.
    """
    total = counts.sum()
    if not total > 0:
        return float("nan")
    number = int(np.searchsorted(np.cumsum(counts), 0.5 * total))
    return 0.0 if number == 0 else float(2.0 ** ((number + 0.5) / _PER_OCTAVE + _SMALLEST))


def weighted_median(values: np.ndarray, weights: np.ndarray) -> float:
    """Return the value below which half the weight lies; NaN where there is no weight."""
    if not weights.sum() > 0.0:
        return float("nan")
    order = np.argsort(values, kind="stable")
    reached = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(reached, 0.5 * reached[-1])])

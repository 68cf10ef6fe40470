"""Random numbers that belong to a sample, not to the order in which samples are taken.

A resumed measurement, or one that is cut into other portions, gets the same numbers: they are
computed from the directions of the sample, the seed and the number of the draw alone.
"""

from __future__ import annotations

import numpy as np
from scipy.special import ndtri

_GOLDEN, _FIRST, _SECOND = (
    np.uint64(constant) for constant in (0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB)
)


def uniforms(angles: np.ndarray, seed: int, stream: int, count: int) -> np.ndarray:
    """Return uniform numbers in (0, 1) for samples.

    Args:
        angles: (n, 4) directions as they were asked for, in radians; their bits are the counter.
        seed: of the measurement, >= 0.
        stream: what the numbers are for; streams are independent.
        count: numbers per sample.

    Returns:
        float64 (n, count). Source of the mixing function: Steele, Lea and Flood, "Fast splittable
        pseudorandom number generators", 2014 (SplitMix64).
    """
    with np.errstate(over="ignore"):  # arithmetic modulo 2^64 is meant
        state = np.full(len(angles), seed, dtype=np.uint64) * _GOLDEN + np.uint64(stream)
        for column in np.ascontiguousarray(angles.T + 0.0, dtype=np.float64):  # no negative zero
            state = _mix(state ^ column.view(np.uint64))
        numbers = _mix(state[:, None] + _GOLDEN * np.arange(1, count + 1, dtype=np.uint64))
    return ((numbers >> np.uint64(11)).astype(np.float64) + 0.5) * 2.0**-53


def normals(angles: np.ndarray, seed: int, stream: int, count: int) -> np.ndarray:
    """Return standard normal numbers for samples, (n, count); see ``uniforms``."""
    return ndtri(uniforms(angles, seed, stream, count))


def hashed(counter: tuple[int, ...], count: int) -> np.ndarray:
    """Return the hash of each of ``count`` items of something that whole numbers name.

    Args:
        counter: whole numbers >= 0, for example a seed, a picture and a stream.
        count: items, for example pixels; the first ones are the same for any count.

    Returns:
        uint64 (count,), all 64 bits of which are random.
    """
    with np.errstate(over="ignore"):
        state = np.zeros(1, dtype=np.uint64)
        for number in counter:
            state = _mix(state ^ np.uint64(number))
        return _mix(state + _GOLDEN * np.arange(count, dtype=np.uint64))


def _mix(state: np.ndarray) -> np.ndarray:
    state = state + _GOLDEN
    state = (state ^ (state >> np.uint64(30))) * _FIRST
    state = (state ^ (state >> np.uint64(27))) * _SECOND
    return state ^ (state >> np.uint64(31))

"""Eight floats in sixteen bytes: the fast layout of factors that are only read.

Each number keeps the upper 16 bits of its float32: sign, 8 exponent bits and 7 mantissa bits. The
full range of float32 stays, zero stays zero, and a number is off by at most 2⁻⁸ (0.4 %) of itself.
A group of eight is read at once; its words hold numbers 0 to 3 above and 4 to 7 below. The packed
table carries no derivatives.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np

from simrig.core.arrays import Array, array_type, is_numpy

EIGHT = 8
RELATIVE_ERROR = 2.0**-8
_WORDS = EIGHT // 2
_UPPER, _SIGN, _SIZE = 0xFFFF0000, 0x80000000, 0x7FFFFFFF
_HALF = 1 << 15
_LARGEST = 0x7F800000 - 1 - _HALF  # rounding up from here would reach infinity


def pack_bfloat16(values: Array) -> Array:
    """Pack a flat Dr.Jit float32 table, a multiple of eight long and finite, into 32-bit words."""
    uint: Any = dr.uint32_array_t(type(values))
    word: Any = dr.reinterpret_array(uint, dr.detach(values))
    rounded = (word & _SIGN) | (dr.minimum(word & _SIZE, _LARGEST) + _HALF)
    place = dr.arange(uint, dr.width(values) // 2)
    first = place // _WORDS * EIGHT + place % _WORDS
    upper, lower = (dr.gather(uint, rounded, first + shift) for shift in (0, _WORDS))
    return (upper & _UPPER) | (lower >> 16)


def gather_eight(source: Array, index: Array, active: Array = True) -> Array:
    """Read group number ``index`` of eight numbers.

    Args:
        source: a flat table of floats, or Dr.Jit words of ``pack_bfloat16``.
        index: in range (Dr.Jit does not check).
        active: mask of Dr.Jit look-ups.

    Returns:
        NumPy array of shape (..., 8) or a Dr.Jit array of eight numbers, as the index is.
    """
    if is_numpy(index):
        return source.reshape(-1, EIGHT)[index]
    if isinstance(index, int):
        import drjit.scalar

        first = EIGHT * index
        return drjit.scalar.ArrayXf64([float(x) for x in source[first : first + EIGHT]])
    kind = type(source)
    if dr.is_float_v(kind):
        four: Any = array_type(kind, _WORDS)
        halves: Any = [dr.gather(four, source, 2 * index + part, active) for part in (0, 1)]
        return array_type(kind, EIGHT)([*halves[0], *halves[1]])
    single: Any = dr.float32_array_t(kind)
    words: Any = dr.gather(_four_words(kind), source, index, active)
    numbers = [word & _UPPER for word in words] + [word << 16 for word in words]
    return array_type(single, EIGHT)([dr.reinterpret_array(single, n) for n in numbers])


def joined(eights: list[Array]) -> Array:
    """Return groups of ``gather_eight`` as one array of numbers per look-up."""
    if is_numpy(eights[0]):
        return np.concatenate(eights, axis=-1)
    return type(eights[0])([number for eight in eights for number in eight])


def eight_of(numbers: Array, group: int) -> Array:
    """Return one group of what ``joined`` returned."""
    part = slice(EIGHT * group, EIGHT * (group + 1))
    return numbers[..., part] if is_numpy(numbers) else list(numbers)[part]


def inner(a: Array, b: Array) -> Array:
    """Return the inner product of two groups."""
    if is_numpy(a):
        return np.sum(a * b, axis=-1)
    total = a[0] * b[0]
    for k in range(1, EIGHT):
        total = dr.fma(a[k], b[k], total)
    return total


def _four_words(kind: type) -> type:
    import importlib

    return importlib.import_module(kind.__module__).Array4u

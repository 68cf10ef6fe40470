"""Eight floats in sixteen bytes: the fast layout of factors that are only read.

Each number keeps the upper 16 bits of its float32: sign, 8 exponent bits and 7 mantissa bits. The
full range of float32 stays, zero stays zero, and a number is off by at most 2⁻⁸ (0.4 %) of itself.
A group of eight is read at once; its words hold numbers 0 to 3 above and 4 to 7 below. The packed
table carries no derivatives.
"""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np

from simrig.core.arrays import Array, array_type, is_numpy, is_single

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


@dataclass(frozen=True)
class PlainEights:
    """Groups of eight numbers as they are: differentiable, of any float type.

    Attributes:
        values: flat Dr.Jit array, or a NumPy array of shape (..., 8·k) or flat.
    """

    values: Array

    def read(self, index: Array) -> Array:
        """Return group number ``index`` (in range): NumPy (..., 8) or eight Dr.Jit numbers."""
        if is_numpy(self.values):
            return self.values.reshape(-1, EIGHT)[index]
        kind = type(self.values)
        four: Any = array_type(kind, _WORDS)
        halves: Any = [dr.gather(four, self.values, 2 * index + part) for part in (0, 1)]
        return array_type(kind, EIGHT)([*halves[0], *halves[1]])


@dataclass(frozen=True)
class Bfloat16Eights:
    """Groups of eight bfloat16 numbers, read in float32 and without derivatives.

    Attributes:
        words: what ``pack_bfloat16`` returned.
    """

    words: Array

    def read(self, index: Array) -> Array:
        """Return group number ``index``, in range, as eight Dr.Jit numbers."""
        kind = type(self.words)
        single: Any = dr.float32_array_t(kind)
        words: Any = dr.gather(_four_words(kind), self.words, index)
        numbers = [word & _UPPER for word in words] + [word << 16 for word in words]
        return array_type(single, EIGHT)([dr.reinterpret_array(single, n) for n in numbers])


Eights = PlainEights | Bfloat16Eights


def eights(values: Array, differentiable: bool) -> Eights:
    """Return a table of groups of eight in the layout that is best to read."""
    if differentiable or not is_single(type(values)):
        return PlainEights(values)
    return Bfloat16Eights(pack_bfloat16(values))


def joined(eights: list[Array]) -> Array:
    """Return groups that were read as one array of numbers per look-up."""
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
    return importlib.import_module(kind.__module__).Array4u

"""Three floats in 64 bits: the fast layout of a table that is only read.

Red and green keep the upper 21 bits of their float32 (sign, 8 exponent bits, 12 mantissa bits),
blue 22. The full range of float32 stays, and a value is off by at most 2⁻¹³ (1.2e-4) of itself. One
64-bit gather then reads a whole colour, where float triples need three. The packed table carries no
derivatives.

The three stand one after the other. Red and green are read with the bits of their neighbour below
their own, which saves the masks: packing chooses their own bits so that the whole word is nearest.
A zero comes out as zero or as a subnormal number, which Dr.Jit's kernels take for zero.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np

from simrig.core.arrays import Array, gather_colour, is_numpy, is_single, namespace, vector_type

_DROPPED, _DROPPED_BLUE = 11, 10  # mantissa bits of float32 that are not kept
_HALF = 1 << (_DROPPED - 1)
_LARGEST = 0x7F800000 - 1 - _HALF  # rounding up from here would reach infinity
_SIGN, _SIZE, _SMALLEST = 0x80000000, 0x7FFFFFFF, 0x00800000
RELATIVE_ERROR = 2.0**-13


def pack_colours(values: Array) -> Array:
    """Pack linear RGB into one 64-bit integer per colour.

    Args:
        values: NumPy array of shape (..., 3), or a flat Dr.Jit float32 array of triples; all
            values finite.

    Returns:
        NumPy uint64 of shape (prod(...),), or a Dr.Jit UInt64 array.
    """
    if is_numpy(values):
        words = np.ascontiguousarray(values, dtype=np.float32).reshape(-1, 3).view(np.uint32)
        return _join(*(part.astype(np.uint64) for part in _kept(*words.T)))
    uint: Any = dr.uint32_array_t(type(values))
    wide: Any = dr.uint64_array_t(type(values))
    triple = 3 * dr.arange(uint, dr.width(values) // 3)
    channels = [dr.gather(type(values), dr.detach(values), triple + c) for c in range(3)]
    kept = _kept(*(dr.reinterpret_array(uint, channel) for channel in channels))
    return _join(*(wide(part) for part in kept))


def _kept(red: Array, green: Array, blue: Array) -> tuple[Array, Array, Array]:
    """Return the kept bits of three words of float32."""
    xp = namespace(red)

    def nearest(word: Array, below: Array, dropped: int) -> Array:
        rounded = xp.minimum(word & _SIZE, _LARGEST) + (1 << (dropped - 1))
        return ((word & _SIGN) | (xp.maximum(rounded, below) - below)) >> dropped

    blue = nearest(blue, 0, _DROPPED_BLUE)
    green = nearest(green, blue >> (32 - _DROPPED_BLUE - _DROPPED), _DROPPED)
    return nearest(red, green >> (32 - 2 * _DROPPED), _DROPPED), green, blue


def _join(red: Array, green: Array, blue: Array) -> Array:
    """Return the 64-bit words of three channels of 21, 21 and 22 bits."""

    def shift(bits: int) -> Any:  # NumPy keeps uint64 only among uint64
        return np.uint64(bits) if is_numpy(red) else bits

    return (red << shift(43)) | (green << shift(22)) | blue


@dataclass(frozen=True)
class PlainColours:
    """A table of colours as it is: differentiable, of any float type.

    Attributes:
        values: flat Dr.Jit array of triples, or a NumPy array of shape (..., 3) or flat.
    """

    values: Array

    def read(self, index: Array) -> Array:
        """Return colour number ``index``; it must be in range (Dr.Jit does not check)."""
        return gather_colour(self.values, index)


@dataclass(frozen=True)
class PackedColours:
    """A table of packed colours, read in float32 and without derivatives.

    Attributes:
        words: what ``pack_colours`` returned.
    """

    words: Array

    def read(self, index: Array) -> Array:
        """Return colour number ``index``; it must be in range (Dr.Jit does not check)."""
        if is_numpy(self.words):
            return unpack_colours(self.words[index])
        single: Any = dr.float32_array_t(type(self.words))
        packed = dr.gather(type(self.words), self.words, index)
        uint: Any = dr.uint32_array_t(type(self.words))
        high, low = uint(packed >> 32), uint(packed)
        words = high, (high << (32 - _DROPPED)) | (low >> _DROPPED), low << _DROPPED_BLUE
        return vector_type(single)(*(dr.reinterpret_array(single, word) for word in words))


Colours = PlainColours | PackedColours


def colour_table(values: Array, differentiable: bool) -> Colours:
    """Return a colour table in the layout that is best to read.

    That is the packed one where no derivatives are wanted and the table is a Dr.Jit float32
    array, and the table itself otherwise.
    """
    if differentiable or not is_single(type(values)):
        return PlainColours(values)
    return PackedColours(pack_colours(values))


def unpack_colours(packed: np.ndarray) -> np.ndarray:
    """Return the colours of packed words: float32 of shape (..., 3)."""
    red, green = (packed >> np.uint64(bits) for bits in (32, _DROPPED))
    words = np.stack([red, green, packed << np.uint64(_DROPPED_BLUE)], axis=-1).astype(np.uint32)
    words[words & np.uint32(_SIZE) < _SMALLEST] = 0  # as kernels take them
    return words.view(np.float32)

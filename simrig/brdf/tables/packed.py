"""Three floats in 64 bits: the fast layout of a table that is only read.

Each colour channel keeps the upper 21 bits of its float32: sign, 8 exponent bits and 12 mantissa
bits. The full range of float32 stays, zero stays zero, and a value is off by at most 2⁻¹³
(1.2e-4) of itself. One 64-bit gather then reads a whole colour, where float triples need three.
The packed table carries no derivatives.

Red and green stand in place in the two 32-bit words, so that one mask each unpacks them; blue
fills the 11 and 10 bits that are left. Without the masks, with kept bits chosen so that the whole
word is nearest, a table takes 5 % fewer instructions, but grey is not grey then,
and what 12 bits hold is not exact.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np

from simrig.core.arrays import Array, gather_colour, is_numpy, is_single, vector_type

_DROPPED = 11  # mantissa bits of float32 that are not kept
_HALF = 1 << (_DROPPED - 1)
_LARGEST = 0x7F800000 - 1 - _HALF  # rounding up from here would reach infinity
_KEPT, _SIGN, _SIZE = 0xFFFFF800, 0x80000000, 0x7FFFFFFF
_LOW_BLUE = 10  # bits of blue in the word of green
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
        size = np.minimum(words & np.uint32(_SIZE), np.uint32(_LARGEST))
        rounded = (words & np.uint32(_SIGN)) | (size + np.uint32(_HALF))
        return _join(*(rounded >> np.uint32(_DROPPED)).astype(np.uint64).T)
    uint: Any = dr.uint32_array_t(type(values))
    wide: Any = dr.uint64_array_t(type(values))
    triple = 3 * dr.arange(uint, dr.width(values) // 3)
    channels = []
    for channel in range(3):
        value = dr.gather(type(values), dr.detach(values), triple + channel)
        word: Any = dr.reinterpret_array(uint, value)
        rounded = (word & _SIGN) | (dr.minimum(word & _SIZE, _LARGEST) + _HALF)
        channels.append(wide(rounded >> _DROPPED))
    return _join(*channels)


def _join(red: Array, green: Array, blue: Array) -> Array:
    """Return the 64-bit words of three channels of 21 bits."""

    def shift(bits: int) -> Any:  # NumPy keeps uint64 only among uint64
        return np.uint64(bits) if is_numpy(red) else bits

    high = (red << shift(_DROPPED)) | (blue >> shift(_LOW_BLUE))
    low = (green << shift(_DROPPED)) | (blue & shift((1 << _LOW_BLUE) - 1))
    return (high << shift(32)) | low


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
        blue = (high << (32 - _DROPPED)) | ((low & ((1 << _LOW_BLUE) - 1)) << _DROPPED)
        return vector_type(single)(
            *(dr.reinterpret_array(single, word) for word in (high & _KEPT, low & _KEPT, blue))
        )


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
    high = (packed >> np.uint64(32)).astype(np.uint32)
    low = packed.astype(np.uint32)  # keeps the lower half
    blue = (high << np.uint32(32 - _DROPPED)) | (
        (low & np.uint32((1 << _LOW_BLUE) - 1)) << np.uint32(_DROPPED)
    )
    kept = np.uint32(_KEPT)
    return np.stack([high & kept, low & kept, blue], axis=-1).view(np.float32)

"""Three floats in 64 bits: the fast layout of a table that is only read.

Each colour channel keeps the upper 21 bits of its float32: sign, 8 exponent bits and 12 mantissa
bits. The full range of float32 stays, zero stays zero, and a value is off by at most 2⁻¹³
(1.2e-4) of itself. One 64-bit gather then reads a whole colour, where float triples need three.
The packed table carries no derivatives.

Red and green stand in place in the two 32-bit words, so that one mask each unpacks them; blue
fills the 11 and 10 bits that are left.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import drjit as dr
import numpy as np

from simrig.core.arrays import Array, float_type, gather_colour, is_numpy, vector_type

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


def gather_packed(source: Array, index: Array, float_type: type, active: Array = True) -> Any:
    """Read and unpack colour number ``index`` of a packed Dr.Jit table.

    Args:
        source: UInt64 array as made by ``pack_colours``.
        index: 32-bit indices in range (Dr.Jit does not check).
        float_type: the float type of the result's components.
    """
    single: Any = dr.float32_array_t(float_type)
    packed = dr.gather(type(source), source, index, active)
    uint = type(index)
    high, low = uint(packed >> 32), uint(packed)
    blue = (high << (32 - _DROPPED)) | ((low & ((1 << _LOW_BLUE) - 1)) << _DROPPED)
    return vector_type(float_type)(
        *(dr.reinterpret_array(single, word) for word in (high & _KEPT, low & _KEPT, blue))
    )


def unpack_colours(packed: np.ndarray) -> np.ndarray:
    """Return the colours of packed words: float32 of shape (..., 3)."""
    high = (packed >> np.uint64(32)).astype(np.uint32)
    low = packed.astype(np.uint32)  # keeps the lower half
    blue = (high << np.uint32(32 - _DROPPED)) | (
        (low & np.uint32((1 << _LOW_BLUE) - 1)) << np.uint32(_DROPPED)
    )
    kept = np.uint32(_KEPT)
    return np.stack([high & kept, low & kept, blue], axis=-1).view(np.float32)


def read_packed(source: Array, index: Array, like: Array, active: Array = True) -> Array:
    """Read packed colour number ``index``, as a colour of the kind of ``like``.

    Args:
        source: NumPy uint64 for NumPy and plain indices, a UInt64 array for Dr.Jit ones.
        index: in range (Dr.Jit does not check).
        like: a vector of the type that is wanted.
        active: mask of Dr.Jit look-ups.
    """
    if is_numpy(index):
        return unpack_colours(source[index])
    if isinstance(index, int):
        return type(like)(*unpack_colours(source[index : index + 1])[0].tolist())
    return gather_packed(source, index, float_type(like), active)


def prepare_table(data: Mapping[str, Array], differentiable: bool) -> Mapping[str, Array]:
    """Return the data of a colour table ``values`` in the layout that ``read_colour`` reads.

    That is the packed one where no derivatives are wanted and the table is a Dr.Jit float32
    array, and the table itself otherwise.
    """
    values = data["values"]
    single = dr.is_jit_v(values) and dr.type_v(values) == dr.VarType.Float32
    if differentiable or not single:
        return data
    return {"packed": pack_colours(values)}


def read_colour(data: Mapping[str, Array], index: Array, like: Array, active: Array) -> Array:
    """Read colour number ``index`` of prepared data, as a colour of the type of ``like``."""
    if "packed" in data:
        return gather_packed(data["packed"], index, float_type(like), active)
    return gather_colour(data["values"], index, like, active)

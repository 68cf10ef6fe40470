"""Three floats in 64 bits: the fast layout of a table that is only read.

Each colour channel keeps its 8 exponent bits and the upper 13 mantissa bits, so the full range
of float32 stays and a value is off by at most 2⁻¹⁴ (6.1e-5) of itself. Signed tables give one
mantissa bit to the sign (2⁻¹³). One 64-bit gather then reads a whole colour, where float triples
need three. The packed table carries no derivatives.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import drjit as dr
import numpy as np

from simrig.arrays import Array, float_type, gather_colour, is_numpy, vector_type

_DROPPED = 10  # mantissa bits of float32 that are not kept; one more in signed tables
_MASK = (1 << 21) - 1
RELATIVE_ERROR = 2.0**-14


def pack_colours(values: Array, signed: bool = False) -> Array:
    """Pack linear RGB into one 64-bit integer per colour.

    Args:
        values: NumPy array of shape (..., 3), or a flat Dr.Jit float32 array of triples; all
            values finite and, unless signed, >= 0.
        signed: whether values may be negative.

    Returns:
        NumPy uint64 of shape (prod(...),), or a Dr.Jit UInt64 array.
    """
    dropped = _DROPPED + signed
    half = 1 << (dropped - 1)
    largest = 0x7F800000 - 1 - half  # rounding up from here would reach infinity
    if is_numpy(values):
        bits = np.ascontiguousarray(values, dtype=np.float32).reshape(-1, 3).view(np.uint32)
        sign = bits & np.uint32(0x80000000 if signed else 0)
        bits = bits & np.uint32(0x7FFFFFFF)
        bits = sign | (np.minimum(bits, np.uint32(largest)) + np.uint32(half))
        bits = (bits >> np.uint32(dropped)).astype(np.uint64)
        return (bits[:, 0] << np.uint64(42)) | (bits[:, 1] << np.uint64(21)) | bits[:, 2]
    uint: Any = dr.uint32_array_t(type(values))
    wide: Any = dr.uint64_array_t(type(values))
    triple = 3 * dr.arange(uint, dr.width(values) // 3)
    packed = wide(0)
    for channel in range(3):
        value = dr.gather(type(values), dr.detach(values), triple + channel)
        word: Any = dr.reinterpret_array(uint, value)
        word = (word & (0x80000000 if signed else 0)) | (
            dr.minimum(word & 0x7FFFFFFF, largest) + half
        )
        packed = (packed << 21) | wide(word >> dropped)
    return packed


def gather_packed(
    source: Array, index: Array, float_type: type, active: Array = True, signed: bool = False
) -> Any:
    """Read and unpack colour number ``index`` of a packed Dr.Jit table.

    Args:
        source: UInt64 array as made by ``pack_colours``.
        index: 32-bit indices in range (Dr.Jit does not check).
        float_type: the float32 type of the result's components.
        signed: as in ``pack_colours``.
    """
    packed = dr.gather(type(source), source, index, active)
    uint = type(index)
    channels = (uint(packed >> 42), uint(packed >> 21) & _MASK, uint(packed) & _MASK)
    return vector_type(float_type)(
        *(dr.reinterpret_array(float_type, bits << (_DROPPED + signed)) for bits in channels)
    )


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

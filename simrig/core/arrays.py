"""One set of array operations for NumPy and Dr.Jit arrays.

Everything that looks a BRDF up is written once over this module, so that the same lines run on
NumPy float64 arrays (host) and on Dr.Jit float32 and float64 arrays (``llvm``, ``cuda``;
differentiable with ``ad``). Plain numbers count as NumPy's.

Conventions: a *vector* is a Dr.Jit 3-vector or a NumPy array of shape (..., 3); a *colour* is
whatever has the vector's type and holds linear RGB.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass, replace
from types import SimpleNamespace
from typing import Any

import drjit as dr
import numpy as np

Array = Any  # a NumPy array, a Dr.Jit array or a plain number; a Dr.Jit stub cannot say this

_NUMPY = SimpleNamespace(
    sin=np.sin,
    cos=np.cos,
    tan=np.tan,
    asin=np.arcsin,
    acos=np.arccos,
    atan2=np.arctan2,
    sqrt=np.sqrt,
    exp=np.exp,
    log=np.log,
    abs=np.abs,
    floor=np.floor,
    round=np.round,
    minimum=np.minimum,
    maximum=np.maximum,
    clip=np.clip,
    select=np.where,
    power=np.power,
    isfinite=np.isfinite,
)


def is_numpy(x: Array) -> bool:
    """Return whether ``x`` is a NumPy array, a NumPy scalar or a plain number."""
    return isinstance(x, np.ndarray | np.generic | float | int)


def namespace(x: Array) -> Any:
    """Return the functions (sin, atan2, select, ...) that fit ``x``: NumPy's or Dr.Jit's."""
    return _NUMPY if is_numpy(x) else dr


def components(v: Array) -> tuple[Array, Array, Array]:
    """Split a vector into x, y, z (each of shape (...) for NumPy)."""
    if is_numpy(v):
        return v[..., 0], v[..., 1], v[..., 2]
    return v[0], v[1], v[2]


def vector(x: Array, y: Array, z: Array, like: Array = None) -> Array:
    """Join three components into a vector of the type of ``like``.

    Without ``like``: NumPy components give an array of shape (..., 3), Dr.Jit components the
    plain Dr.Jit 3-vector of their type.
    """
    if dr.is_array_v(like):
        return type(like)(x, y, z)
    device = next((c for c in (x, y, z) if dr.is_array_v(c)), None)
    if device is None:
        return np.stack(np.broadcast_arrays(x, y, z), axis=-1)
    return vector_type(type(device))(x, y, z)


def vector_type(float_type: type) -> type:
    """Return the 3-vector type of a Dr.Jit float type."""
    return array_type(float_type, 3)


def array_type(float_type: type, size: int) -> type:
    """Return the array of ``size`` numbers of a Dr.Jit float type; above four that of any size."""
    module = importlib.import_module(float_type.__module__)
    double = dr.type_v(float_type) == dr.VarType.Float64
    return getattr(module, f"Array{size if size <= 4 else 'X'}{'f64' if double else 'f'}")


def float_type(v: Array) -> type:
    """Return the float type behind a vector or number: ``np.ndarray`` or a Dr.Jit type."""
    if is_numpy(v):
        return np.ndarray
    t = type(v)
    return dr.value_t(t) if dr.size_v(t) == 3 else t


def is_single(float_type: type) -> bool:
    """Return whether a float type is Dr.Jit's float32."""
    return dr.is_jit_v(float_type) and dr.type_v(float_type) == dr.VarType.Float32


def scale(colour: Array, factor: Array) -> Array:
    """Multiply a colour by a number per direction."""
    if is_numpy(colour):
        return colour * np.asarray(factor)[..., None]
    return colour * factor


def multiply_add(colour: Array, factor: Array, total: Array = None) -> Array:
    """Return colour · factor + total (or without a total), with a number per direction."""
    if total is None:
        return scale(colour, factor)
    if is_numpy(colour):
        return total + scale(colour, factor)
    return dr.fma(colour, factor, total)


def lerp(a: Array, b: Array, t: Array) -> Array:
    """Return the colour a + t·(b − a), with one t per direction."""
    return multiply_add(b - a, t, a)


def to_index(x: Array) -> Array:
    """Turn a non-negative float into an integer index (rounds towards zero)."""
    if is_numpy(x):
        return np.asarray(x).astype(np.int64)
    return dr.uint32_array_t(type(x))(x)


def to_number(index: Array, like: Array) -> Array:
    """Turn an index into a float of the type of the number ``like``."""
    return np.asarray(index, dtype=np.float64) if is_numpy(index) else type(like)(index)


def cell(position: Array, count: int) -> tuple[Array, Array]:
    """Return the cell of a position in [0, count], and where in the cell it lies, in [0, 1]."""
    index = namespace(position).minimum(to_index(position), count - 1)
    return index, position - to_number(index, position)


def gather(source: Array, index: Array, active: Array = True) -> Array:
    """Read ``source[index]``; the index must be in range (Dr.Jit does not check)."""
    return source[index] if is_numpy(source) else dr.gather(type(source), source, index, active)


def gather_colour(source: Array, index: Array) -> Array:
    """Read RGB triple number ``index`` of an array of triples, as a colour."""
    if is_numpy(source):
        return source.reshape(-1, 3)[index]
    return dr.gather(vector_type(type(source)), source, index)


def gather_four(source: Array, index: Array) -> tuple[Array, ...]:
    """Read group number ``index`` of four numbers of an array, at once; each of shape (...)."""
    if is_numpy(source):
        return tuple(np.moveaxis(source.reshape(-1, 4)[index], -1, 0))
    return tuple(dr.gather(array_type(type(source), 4), source, index))


def where_colour(mask: Array, colour: Array, other: Array = 0.0) -> Array:
    """Return the colour where ``mask`` is true and another one, by default black, elsewhere."""
    if is_numpy(colour):
        return np.where(np.asarray(mask)[..., None], colour, other)
    return dr.select(mask, colour, other)


def aligned(value: np.ndarray) -> np.ndarray:
    """Return a copy whose memory starts at a multiple of 64 bytes.

    Dr.Jit's LLVM backend reads NumPy memory in place and writes into the kernel whether it is
    aligned, so the same operation on another allocation could be compiled again.
    """
    buffer = np.empty(value.nbytes + 64, dtype=np.uint8)
    start = -buffer.ctypes.data % 64
    copy = buffer[start : start + value.nbytes].view(value.dtype).reshape(value.shape)
    copy[...] = value
    return copy


def read_only(value: Any, dtype: Any = None) -> np.ndarray:
    """Return values that nobody can change any more, in C order.

    What the caller may still change is copied; an array that is read-only all the way down to
    the memory it owns is taken as it is.
    """
    array = np.ascontiguousarray(value, dtype=dtype)
    array = array.reshape(np.shape(value))  # ascontiguousarray makes () to (1,)
    owner: Any = array
    while isinstance(owner, np.ndarray) and not owner.flags.writeable:
        owner = owner.base
    if owner is not None:
        array = array.copy()
        array.flags.writeable = False
    return array


def to_device(value: np.ndarray, float_type: type) -> Array:
    """Copy a master array to the arrays that ``float_type`` computes with.

    On the host that is the array itself in float64. On a device, shape () becomes one opaque
    number (not baked into kernels), shape (3,) a colour of opaque numbers, anything else a flat
    table.
    """
    if float_type is np.ndarray:
        return np.asarray(value, dtype=np.float64)
    if value.ndim == 0:
        return dr.opaque(float_type, float(value))
    if value.shape == (3,):
        return vector_type(float_type)(*(dr.opaque(float_type, float(c)) for c in value))
    precision = np.float32 if is_single(float_type) else np.float64
    return float_type(np.ascontiguousarray(value, dtype=precision).reshape(-1))


def map_arrays(function: Callable[[Array], Array], tables: Any) -> Any:
    """Return prepared data (nested dataclasses, mappings, tuples) with each array replaced.

    Args:
        function: of an array; called in the order of the fields.
    """
    if is_dataclass(tables) and not isinstance(tables, type):
        names = [field.name for field in fields(tables)]
        return replace(tables, **{n: map_arrays(function, getattr(tables, n)) for n in names})
    if isinstance(tables, Mapping):
        return {name: map_arrays(function, value) for name, value in tables.items()}
    if isinstance(tables, tuple):
        return tuple(map_arrays(function, value) for value in tables)
    return tables if tables is None else function(tables)


def table_bytes(tables: Any) -> int:
    """Return the bytes of all arrays of prepared data on a device."""
    sizes: list[int] = []

    def count(array: Array) -> Array:
        numbers = np.array(array)
        sizes.append(numbers.nbytes)
        return array

    map_arrays(count, tables)
    return sum(sizes)


def epsilon(x: Array) -> float:
    """Return the spacing of floats just above 1 in the precision of ``x``."""
    if is_numpy(x):
        return float(np.finfo(np.asarray(x).dtype).eps)
    return float(np.finfo(np.float32 if is_single(type(x)) else np.float64).eps)

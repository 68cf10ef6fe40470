"""One set of array operations for NumPy arrays, Dr.Jit arrays and plain floats.

Everything that looks BRDF up is written once over this module, so that the same lines run
on NumPy float64 arrays (host), on Dr.Jit float32 and float64 arrays (``llvm``, ``cuda``;
differentiable with ``ad``) and on the plain floats of Mitsuba's scalar variants.

Conventions: a *vector* is a Dr.Jit 3-vector or a NumPy array of shape (..., 3); a *colour* is
whatever has the vector's type and holds linear RGB.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import drjit as dr
import numpy as np

Array = Any  # a NumPy array, a Dr.Jit array or a plain float; a Dr.Jit stub cannot say this

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


def namespace(x: Array) -> Any:
    """Return the functions (sin, atan2, select, ...) that fit ``x``: NumPy's or Dr.Jit's.

    Dr.Jit's own functions also take plain Python floats.
    """
    return _NUMPY if isinstance(x, np.ndarray | np.generic) else dr


def is_numpy(x: Array) -> bool:
    """Return whether ``x`` is a NumPy array or NumPy scalar."""
    return isinstance(x, np.ndarray | np.generic)


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
    if is_numpy(x) or is_numpy(y) or is_numpy(z) or is_numpy(like):
        return np.stack(np.broadcast_arrays(x, y, z), axis=-1)
    if like is not None:
        return type(like)(x, y, z)
    return vector_type(type(x))(x, y, z)


def vector_type(float_type: type) -> type:
    """Return the 3-vector type of a Dr.Jit float type (or of ``float``)."""
    if float_type is float:
        import drjit.scalar

        return drjit.scalar.Array3f64
    return array_type(float_type, 3)


def array_type(float_type: type, size: int) -> type:
    """Return the array of ``size`` numbers of a Dr.Jit float type; above four that of any size."""
    import importlib

    module = importlib.import_module(float_type.__module__)
    double = dr.type_v(float_type) == dr.VarType.Float64
    return getattr(module, f"Array{size if size <= 4 else 'X'}{'f64' if double else 'f'}")


def float_type(v: Array) -> type:
    """Return the float type behind a vector or number: np.ndarray, float or a Dr.Jit type."""
    if is_numpy(v):
        return np.ndarray
    t = type(v)
    if t in (float, int):
        return float
    return dr.value_t(t) if dr.size_v(t) == 3 else t


def scale(colour: Array, factor: Array) -> Array:
    """Multiply a colour by a number per direction."""
    if is_numpy(colour) or is_numpy(factor):
        return np.asarray(colour) * np.asarray(factor)[..., None]
    return colour * factor


def lerp(a: Array, b: Array, t: Array) -> Array:
    """Return the colour a + t·(b − a), with one t per direction."""
    return a + scale(b - a, t)


def to_index(x: Array) -> Array:
    """Turn a non-negative float into an integer index (rounds towards zero)."""
    if is_numpy(x):
        return x.astype(np.int64)
    if isinstance(x, float | int):
        return int(x)
    return dr.uint32_array_t(type(x))(x)


def gather(source: Array, index: Array, active: Array = True) -> Array:
    """Read ``source[index]``; the index must be in range (Dr.Jit does not check)."""
    if is_numpy(index) or isinstance(index, int):
        value = source[index]
        return value if is_numpy(index) else float(value)
    return dr.gather(type(source), source, index, active)


def gather_colour(source: Array, index: Array, like: Array, active: Array = True) -> Array:
    """Read RGB triple number ``index`` of a flat array of triples, as a colour like ``like``."""
    if is_numpy(index):
        return source.reshape(-1, 3)[index]
    if isinstance(index, int):
        return type(like)(*(float(source[3 * index + c]) for c in range(3)))
    return dr.gather(vector_type(type(source)), source, index, active)


def gather_four(source: Array, index: Array, active: Array = True) -> tuple[Array, ...]:
    """Read group number ``index`` of four numbers of a flat array, at once; each of shape (...)."""
    if is_numpy(index):
        four = source.reshape(-1, 4)[index]
        return tuple(four[..., k] for k in range(4))
    if isinstance(index, int):
        return tuple(float(source[4 * index + k]) for k in range(4))
    return tuple(dr.gather(array_type(type(source), 4), source, index, active))


def where_colour(mask: Array, colour: Array) -> Array:
    """Return the colour where ``mask`` is true and black elsewhere."""
    if is_numpy(colour):
        return np.where(np.asarray(mask)[..., None], colour, 0.0)
    return dr.select(mask, colour, type(colour)(0.0))


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


def to_device(value: np.ndarray, float_type: type, colour_type: type | None = None) -> Array:
    """Copy a master array to the arrays that ``float_type`` computes with.

    Shape () becomes one opaque number (not baked into kernels), shape (3,) a colour of opaque
    numbers, anything else a flat table.
    """
    value = np.asarray(value)
    if float_type is np.ndarray:
        return value.astype(np.float64)
    if float_type is float:
        if value.ndim == 0:
            return float(value)
        if value.shape == (3,):
            return (colour_type or vector_type(float))(*value.tolist())
        return np.ascontiguousarray(value).reshape(-1)
    if value.ndim == 0:
        return dr.opaque(float_type, float(value))
    if value.shape == (3,):
        make = colour_type or vector_type(float_type)
        return make(*(dr.opaque(float_type, float(c)) for c in value))
    precision = np.float64 if dr.type_v(float_type) == dr.VarType.Float64 else np.float32
    return float_type(np.ascontiguousarray(value, dtype=precision).reshape(-1))


def epsilon(x: Array) -> float:
    """Return the spacing of floats just above 1 in the precision of ``x``."""
    if is_numpy(x):
        return float(np.finfo(x.dtype).eps)
    single = not isinstance(x, float | int) and dr.type_v(type(x)) == dr.VarType.Float32
    return float(np.finfo(np.float32 if single else np.float64).eps)

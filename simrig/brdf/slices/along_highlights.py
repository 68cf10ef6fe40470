"""Interpolation between slices along the lines of constant φ_h (thesis section 5.7, taken further).

In the subspace of two polar angles let m be the mean azimuth and d half the azimuth difference.
The half vector then has the azimuth

    φ_h = m + ψ(d),   ψ(d) = atan2((sin θ_v − sin θ_i) sin d, (sin θ_v + sin θ_i) cos d),

so an axial slice (constant d) meets every φ_h once, and a highlight of constant φ_h crosses the
subspace slanted. Section 5.3 interpolates between two axial slices at constant m; here they are
read at constant φ_h, which follows the highlight. What this predicts wrongly on the two
neighbouring diagonal slices is known there, and is interpolated between them:

    g = p + (q − c),

p between the axial slices, q on the diagonal ones, c the prediction p there. Without the shift
ψ this is section 5.3 to the letter; where the axial slices are constant (isotropic materials) the
shift changes nothing. Section 5.7 instead weighs one value of each slice by their distances: it
needs exactly one slice of each kind and loses isotropic materials.

The sums are taken of g = log(1 + f / offset): differences of values far above the offset become
ratios, so that a highlight is scaled and not shifted, and values below it are added as in 5.3.
"""

from __future__ import annotations

from collections.abc import Callable

import drjit as dr
import numpy as np

from simrig.brdf.slices.cells import diagonal_row, half_step
from simrig.core.arrays import Array, cell, components, is_numpy, lerp, namespace, vector
from simrig.directions import wrap_angle

FULL_SHIFT = float(np.radians(2.0))  # polar angles this far apart follow φ_h completely
_OFFSET = 2.0  # times the median; 1 to 3 are equally good on the materials of Table D.1
Slice = Callable[[Array, Array], Array]  # colour of a row at a position in radians


def offsets(*tables: np.ndarray) -> np.ndarray:
    """Return the offset of each channel, (3,) and > 0: twice the median of all values.

    Where most values are 0 it is a thousandth of the mean, and 1 where all are.

    Args:
        tables: values along slices, (..., 3).
    """
    values = np.concatenate([table.reshape(-1, 3) for table in tables]).astype(np.float64)
    found = np.maximum(_OFFSET * np.median(values, axis=0), 1e-3 * values.mean(axis=0))
    return np.where(found > 1e-30, found, 1.0)


def compressed(value: Array, offset: np.ndarray) -> Array:
    """Return log(1 + f / offset) of a colour f >= 0."""
    return _channels(value, offset, lambda f, e: _log1p(f * (1.0 / e)))


def expanded(value: Array, offset: np.ndarray) -> Array:
    """Return the colour f >= 0 that ``compressed`` turned into ``value``; 0 below 0."""
    return _channels(value, offset, lambda g, e: _expm1(namespace(g).maximum(g, 0.0)) * e)


def half_vector_turn(d: Array, sin_i: Array, sin_v: Array) -> Array:
    """Return ψ = φ_h − m in radians for half azimuth differences d in [0, π].

    It runs from 0 to ±π, is continuous in d where the polar angles differ, and a step at π/2 where
    they are equal.
    """
    xp = namespace(d)
    # sin π is just below 0 in single precision
    across = xp.abs(sin_v - sin_i) * xp.maximum(xp.sin(d), 0.0)
    turn = xp.atan2(across, xp.maximum(sin_v + sin_i, 1e-9) * xp.cos(d))
    return xp.select(sin_v < sin_i, -turn, turn)


def shift_strength(theta_i: Array, theta_v: Array) -> Array:
    """Return how far to follow φ_h in a subspace, from 0 at θ_i = θ_v to 1.

    Where both polar angles are equal, φ_h jumps by half a turn at the mirror direction; there the
    rule of section 5.3, which is good for equal polar angles, takes over continuously. At the pole
    the strength is 1.
    """
    xp = namespace(theta_i)
    largest = xp.maximum(theta_i, theta_v)
    apart = xp.abs(theta_v - theta_i) / xp.clip(largest, 1e-6, FULL_SHIFT)
    t = xp.minimum(apart, 1.0)
    return t * t * (3.0 - 2.0 * t)


def swept_along_highlights(
    axial: Slice,
    diagonal: Slice,
    mean: Array,
    half_difference: Array,
    a_n: int,
    shift: Callable[[Array], Array],
) -> Array:
    """Return the value between the slices of one subspace.

    Args:
        axial, diagonal: colours of row 0..a_n at a position in radians.
        mean: mean azimuth in radians, any.
        half_difference: half the azimuth difference in radians, in [0, π].
        a_n: slices of one kind.
        shift: ψ of half azimuth differences, times its strength.

    Returns:
        The colour, not below the smallest of the four slice values around it (section 5.3).
    """
    half, xp = np.pi / a_n, namespace(mean)
    row, row_weight = cell(half_difference / half, a_n)
    column, column_weight = half_step(wrap_angle(mean), a_n)
    own_diagonal, second = diagonal_row(column, a_n)
    here, first_row = shift(half_difference), half_difference - row_weight * half
    to_rows = [here - shift(xp.clip(first_row + step * half, 0.0, np.pi)) for step in (0, 1)]
    along_diagonal = xp.select(second, half_difference + np.pi, half_difference)

    def between_axial(azimuth: Array) -> tuple[Array, Array]:
        """Return the colours of the two axial slices where they meet the φ_h of an azimuth."""
        below, above = (axial(row + step, azimuth + to_rows[step]) for step in (0, 1))
        return below, above

    p_0, p_1 = between_axial(mean)
    value = lerp(p_0, p_1, row_weight)
    xp = namespace(value)
    lowest = xp.minimum(p_0, p_1)
    missed: list[Array] = []
    for side in (0, 1):
        c_0, c_1 = between_axial(mean + (side - column_weight) * half)
        q = diagonal(own_diagonal + side, along_diagonal)
        lowest = xp.minimum(lowest, q)
        missed.append(q - lerp(c_0, c_1, row_weight))
    return xp.maximum(value + lerp(missed[0], missed[1], column_weight), lowest)


def _channels(value: Array, offset: np.ndarray, change: Callable[[Array, Array], Array]) -> Array:
    if is_numpy(value):
        return change(value, offset)
    x, y, z = (change(c, float(e)) for c, e in zip(components(value), offset, strict=True))
    return vector(x, y, z, value)


def _log1p(x: Array) -> Array:
    """Return log(1 + x) for x >= 0, accurate for small x (Kahan's correction)."""
    if is_numpy(x):
        return np.log1p(x)
    total = 1.0 + x
    return dr.select(total == 1.0, x, dr.log(total) * (x / dr.maximum(total - 1.0, 1e-30)))


def _expm1(x: Array) -> Array:
    """Return exp(x) − 1 for x >= 0, accurate for small x (Kahan's correction)."""
    if is_numpy(x):
        return np.expm1(x)
    total = dr.exp(x)
    quotient = (total - 1.0) * (x / dr.maximum(dr.log(total), 1e-30))
    return dr.select(total == 1.0, x, quotient)

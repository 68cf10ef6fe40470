"""Interpolation along all slices at once: cubic spline, PCHIP or linear.

Every slice becomes a piecewise cubic in Hermite form. The splines of thousands of slices of
different lengths are one block-diagonal banded system, solved by SciPy in a single call; the
periodic blocks are closed by the Sherman-Morrison formula. The result equals SciPy's
``CubicSpline`` (``not-a-knot`` or ``periodic``) slice by slice, hundreds of times faster.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve_banded

from simrig.core.errors import check_known
from simrig.plans.adaptive import Knots
from simrig.plans.slices import MIRRORED, OPEN, PERIODIC

INTERPOLATIONS = ("cubic", "pchip", "linear")

# positions closer than this, in radians, are one: no arm can tell them apart, and a spline through
# two values there would have a slope without meaning
_SAME_POSITION = 1e-9


class SliceInterpolator:
    """Piecewise interpolants along all slices of a plan.

    Args:
        values: (n, C) values of all samples.
        interpolation: ``"cubic"`` (not-a-knot at open ends, periodic elsewhere), ``"pchip"``
            (never overshoots) or ``"linear"``.

    Raises:
        SimrigError: for an unknown interpolation.
    """

    def __init__(self, knots: Knots, values: np.ndarray, interpolation: str = "cubic"):
        check_known("interpolation", interpolation, INTERPOLATIONS)
        full = _unfold(knots)
        full, self._values = _without_duplicates(full, values[full.sample].astype(np.float64))
        self._first, self._position = full.first, full.position
        self._periodic, self._period = full.ends != OPEN, full.length
        count = np.diff(full.first)
        self._last = full.first[1:] - 1
        gap, after = _gaps(full, self._periodic)
        slope = np.divide(
            self._values[after] - self._values,
            gap[:, None],
            out=np.zeros_like(self._values),
            where=gap[:, None] > 0.0,
        )
        self._gap, self._after = gap, after
        if interpolation == "linear":
            self._tangents = None
            self._slope = slope
        elif interpolation == "pchip":
            self._tangents = _pchip_tangents(full, self._periodic, gap, slope)
        else:
            self._tangents = _spline_tangents(full, self._periodic, gap, slope, count)

    def __call__(self, slice_index: np.ndarray, position: np.ndarray) -> np.ndarray:
        """Return values at positions along slices.

        Args:
            slice_index: (R,) which slice each row reads.
            position: (R, M) positions in radians; wrapped on periodic slices, clamped on open ones.

        Returns:
            (R, M, C) interpolated values.
        """
        start = self._position[self._first[:-1]][slice_index, None]
        period = self._period[slice_index, None]
        wrapped = start + np.mod(position - start, period)
        end = self._position[self._last][slice_index, None]
        position = np.where(
            self._periodic[slice_index, None], wrapped, np.clip(position, start, end)
        )
        # one sorted search over all slices: each slice has its own range of keys
        stride = 4.0 * np.pi
        owner = np.repeat(np.arange(len(self._last)), np.diff(self._first))
        keys = self._position + stride * owner
        query = position + stride * slice_index[:, None]
        low = np.searchsorted(keys, query, side="right") - 1
        low = np.clip(low, self._first[slice_index, None], self._last[slice_index, None])
        high = self._after[low]
        gap = self._gap[low]
        t = np.divide(position - self._position[low], gap, out=np.zeros_like(gap), where=gap > 0.0)
        t = np.clip(t, 0.0, 1.0)[..., None]
        y_0, y_1 = self._values[low], self._values[high]
        if self._tangents is None:
            return y_0 + t * (y_1 - y_0)
        gap = gap[..., None]
        d_0, d_1 = gap * self._tangents[low], gap * self._tangents[high]
        rise = y_1 - y_0
        return y_0 + t * (d_0 + t * (3.0 * rise - 2.0 * d_0 - d_1 + t * (d_0 + d_1 - 2.0 * rise)))


def _unfold(knots: Knots) -> Knots:
    """Return the knots with mirrored slices [0, π] continued to their full period 2π."""
    if not np.any(knots.ends == MIRRORED):
        return knots
    position, sample, count = [], [], []
    for s, end in enumerate(knots.ends):
        p = knots.position[knots.first[s] : knots.first[s + 1]]
        q = knots.sample[knots.first[s] : knots.first[s + 1]]
        if end == MIRRORED:
            inner = (p > 0.0) & (p < knots.length[s])
            p = np.concatenate([p, 2.0 * knots.length[s] - p[inner][::-1]])
            q = np.concatenate([q, q[inner][::-1]])
        position.append(p)
        sample.append(q)
        count.append(len(p))
    mirrored = knots.ends == MIRRORED
    return Knots(
        first=np.concatenate([[0], np.cumsum(count)]),
        ends=np.where(mirrored, PERIODIC, knots.ends),
        length=np.where(mirrored, 2.0 * knots.length, knots.length),
        position=np.concatenate(position),
        sample=np.concatenate(sample),
    )


def _without_duplicates(knots: Knots, values: np.ndarray) -> tuple[Knots, np.ndarray]:
    """Return the knots with those at one position merged, and their mean values, (K', C)."""
    starts = np.ones(len(knots.position), dtype=bool)
    starts[1:] = np.diff(knots.position) > _SAME_POSITION
    starts[knots.first[:-1]] = True
    if starts.all():
        return knots, values
    group = np.cumsum(starts) - 1
    first = np.append(group[knots.first[:-1]], group[-1] + 1)
    size = np.bincount(group)
    position = np.bincount(group, knots.position) / size
    means = [np.bincount(group, channel) / size for channel in values.T]
    merged = Knots(first, knots.ends, knots.length, position, np.arange(len(size)))
    return merged, np.stack(means, axis=1)


def _gaps(knots: Knots, periodic: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the distance to the next knot of the slice (0 where there is none) and its index."""
    count = len(knots.position)
    first, last = knots.first[:-1], knots.first[1:] - 1
    after = np.minimum(np.arange(count) + 1, count - 1)
    after[last] = np.where(periodic, first, last)
    gap = knots.position[after] - knots.position
    gap[last] = np.where(periodic, gap[last] + knots.length, 0.0)
    return gap, after


def _before(knots: Knots, periodic: np.ndarray) -> np.ndarray:
    first, last = knots.first[:-1], knots.first[1:] - 1
    before = np.arange(len(knots.position)) - 1
    before[first] = np.where(periodic, last, first)
    return before


def _spline_tangents(
    knots: Knots, periodic: np.ndarray, gap: np.ndarray, slope: np.ndarray, count: np.ndarray
) -> np.ndarray:
    """Return the derivatives of the C² cubic splines at all knots, (K, C)."""
    first, last = knots.first[:-1], knots.first[1:] - 1
    before = _before(knots, periodic)
    gap_before, slope_before = gap[before], slope[before]
    diagonal = 2.0 * (gap_before + gap)
    lower, upper = gap.copy(), gap_before.copy()  # factors of the tangents before and after
    right = 3.0 * (gap[:, None] * slope_before + gap_before[:, None] * slope)

    _open_ends(first, last, periodic, count, gap, slope, diagonal, lower, upper, right)
    # close the periodic blocks: A = T + u vᵀ with corners in u and v (Sherman-Morrison)
    p_first, p_last = first[periodic], last[periodic]
    gamma = -diagonal[p_first]
    corner_top, corner_bottom = lower[p_first], upper[p_last]
    u = np.zeros(len(gap))
    np.add.at(u, p_first, gamma)
    np.add.at(u, p_last, corner_bottom)
    np.subtract.at(diagonal, p_first, gamma)
    np.subtract.at(diagonal, p_last, corner_top * corner_bottom / gamma)
    lower[first], upper[last] = 0.0, 0.0

    band = np.zeros((3, len(gap)))
    band[0, 1:], band[1], band[2, :-1] = upper[:-1], diagonal, lower[1:]
    solution = solve_banded((1, 1), band, np.column_stack([right, u]), check_finite=False)
    y, q = solution[:, :-1], solution[:, -1]
    factor = np.zeros((len(first), y.shape[1]))
    ratio = corner_top / gamma
    factor[periodic] = (y[p_first] + ratio[:, None] * y[p_last]) / (
        1.0 + q[p_first] + ratio * q[p_last]
    )[:, None]
    return y - q[:, None] * np.repeat(factor, np.diff(knots.first), axis=0)


def _open_ends(first, last, periodic, count, gap, slope, diagonal, lower, upper, right) -> None:
    """Write the not-a-knot rows of open slices; short ones become a parabola or a line."""
    long = ~periodic & (count >= 4)
    a, b = first[long], last[long]
    d = gap[a] + gap[a + 1]
    diagonal[a], upper[a] = gap[a + 1], d
    right[a] = (
        ((gap[a] + 2.0 * d) * gap[a + 1])[:, None] * slope[a]
        + (gap[a] ** 2)[:, None] * slope[a + 1]
    ) / d[:, None]
    d = gap[b - 1] + gap[b - 2]
    diagonal[b], lower[b] = gap[b - 2], d
    right[b] = (
        (gap[b - 1] ** 2)[:, None] * slope[b - 2]
        + ((2.0 * d + gap[b - 1]) * gap[b - 2])[:, None] * slope[b - 1]
    ) / d[:, None]
    for s in np.flatnonzero(~periodic & (count < 4)):
        a, b = first[s], last[s]
        diagonal[a : b + 1], lower[a : b + 1], upper[a : b + 1] = 1.0, 0.0, 0.0
        if count[s] == 3:
            curve = (slope[a + 1] - slope[a]) / (gap[a] + gap[a + 1])
            right[a] = slope[a] - curve * gap[a]
            right[a + 1] = slope[a] + curve * gap[a]
            right[b] = slope[a + 1] + curve * gap[a + 1]
        else:
            right[a : b + 1] = slope[a] if count[s] == 2 else 0.0


def _pchip_tangents(
    knots: Knots, periodic: np.ndarray, gap: np.ndarray, slope: np.ndarray
) -> np.ndarray:
    """Return monotone tangents (Fritsch and Butland 1984, the weights of SciPy's PCHIP)."""
    before = _before(knots, periodic)
    h_0, h_1 = gap[before][:, None], gap[:, None]
    s_0, s_1 = slope[before], slope
    w_1, w_2 = 2.0 * h_1 + h_0, h_1 + 2.0 * h_0
    same = np.sign(s_0) * np.sign(s_1) > 0.0  # the product of the slopes could underflow
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        inner = (w_1 + w_2) * s_0 / (w_1 + w_2 * (s_0 / s_1))  # no quotient of a denormal slope
    tangents = np.where(same, inner, 0.0)
    first, last = knots.first[:-1], knots.first[1:] - 1
    count = np.diff(knots.first)
    for end, step in ((first, 1), (last, -1)):
        chosen = ~periodic & (count >= 2)
        e = end[chosen]
        near = e if step == 1 else e - 1  # the interval that touches the end
        far = np.where(count[chosen] >= 3, near + step, near)
        tangents[e] = _pchip_end(gap[near][:, None], gap[far][:, None], slope[near], slope[far])
        tangents[end[~periodic & (count < 2)]] = 0.0
    return tangents


def _pchip_end(h_0: np.ndarray, h_1: np.ndarray, s_0: np.ndarray, s_1: np.ndarray) -> np.ndarray:
    """Return the one-sided three-point estimate, limited to keep the shape."""
    tangent = ((2.0 * h_0 + h_1) * s_0 - h_0 * s_1) / (h_0 + h_1)
    tangent = np.where(np.sign(tangent) != np.sign(s_0), 0.0, tangent)
    too_steep = (np.sign(s_0) != np.sign(s_1)) & (np.abs(tangent) > 3.0 * np.abs(s_0))
    return np.where(too_steep, 3.0 * s_0, tangent)

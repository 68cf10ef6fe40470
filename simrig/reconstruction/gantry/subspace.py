"""One azimuthal subspace from the slices of a gantry (thesis sections 5.3 and 6.1.2).

A point (φ_i, φ_v) lies between two neighbouring axial slices, with which a diagonal line connects
it, and between two diagonal slices, along an axial line. P is the linear blend of the two axial
slices where that line meets them, Q that of the diagonal ones. A single slice is its own
neighbour, one turn further: all this is periodic, for any number of slices.

``sum`` (6.1.2): P + Q, mapped linearly to the range of the slices' values, channel by channel.
The thesis turns the coordinates by 45°, which is two-valued on the periodic subspace unless the
slices repeat after 180°; P and Q are the same sum there and single-valued always. P + Q goes from
the sum of the smallest to the sum of the largest slice values, which become m and M.
``corners`` (5.3): P + Q − C with C blended from the values where slices cross, and not below the
smallest of the four slice values.
``turning``: the value depends on φ_v − φ_i alone (isotropic materials), the mean over all
diagonal slices where they pass that difference.
"""

from __future__ import annotations

import numpy as np

from simrig.core.errors import SimrigError, check_known
from simrig.directions.spherical import TWO_PI
from simrig.plans.gantry import GantryPlan
from simrig.plans.slices import AXIAL, DIAGONAL
from simrig.reconstruction.slices.along_slices import SliceInterpolator

COMBINATIONS = ("sum", "corners", "turning")


def default_combination(plan: GantryPlan) -> str:
    """Return how the slices of a plan are combined: by the method of 6.1.2 where it applies."""
    if plan.axial == 0:
        return "turning"
    return "sum" if plan.axial == plan.diagonal == 1 else "corners"


def subspaces(
    plan: GantryPlan,
    values: np.ndarray,
    azimuths: int | np.ndarray,
    combination: str | None = None,
    interpolation: str = "pchip",
) -> np.ndarray:
    """Return f_r at all azimuths for every pair of measured polar angles.

    Args:
        values: (n, channels) measured at ``plan.angles()``: three, or those of many texels.
        azimuths: of illumination and view: so many over the full circle, from 0, or a list of
            them in radians.
        combination: of ``COMBINATIONS``; by default see ``default_combination``.
        interpolation: along the slices: ``"pchip"`` (never overshoots), ``"cubic"`` or
            ``"linear"``.

    Returns:
        (polar angles, polar angles, azimuths, azimuths, channels), theta_i, theta_v, φ_i, φ_v; >=
        0.

    Raises:
        SimrigError: unknown names, or a combination that the plan has no slices for.
    """
    combination = combination or default_combination(plan)
    _check(plan, values, combination)
    interpolate = SliceInterpolator(plan.knots(), values, interpolation)
    count = len(plan.thetas)
    if isinstance(azimuths, int | np.integer):
        phi = np.arange(azimuths) * (TWO_PI / azimuths)
    else:
        phi = np.asarray(azimuths)
    phi_i, phi_v = (grid.ravel() for grid in np.meshgrid(phi, phi, indexing="ij"))
    shape = (len(phi), len(phi), np.shape(values)[1])
    out = np.empty((count, count, *shape))
    for pair in plan.pairs:
        view = _Subspace(plan, values, interpolate, pair)
        found = getattr(view, combination)(phi_i, phi_v)
        out[pair] = np.maximum(found, 0.0).reshape(shape)
    return out


def _check(plan: GantryPlan, values: np.ndarray, combination: str) -> None:
    check_known("combination of slices", combination, COMBINATIONS)
    if np.ndim(values) != 2 or len(values) != plan.samples:
        raise SimrigError(
            f"the plan has {plan.samples} samples of some channels, got {np.shape(values)}"
        )
    if combination != "turning" and plan.axial == 0:
        raise SimrigError(f"'{combination}' needs axial slices: use 'turning', or measure some")
    if combination == "sum" and not plan.axial == plan.diagonal == 1:
        raise SimrigError("'sum' takes one axial and one diagonal slice: use 'corners'")


class _Subspace:
    """The slices of one pair of polar angles."""

    def __init__(
        self,
        plan: GantryPlan,
        values: np.ndarray,
        interpolate: SliceInterpolator,
        pair: tuple[int, int],
    ):
        self._interpolate = interpolate
        self._alpha, self._beta = plan.offsets
        number = {
            kind: [k for k, s in enumerate(plan.slices) if s.pair == pair and s.kind == kind]
            for kind in (AXIAL, DIAGONAL)
        }
        self._axial, self._diagonal = (np.array(number[k], dtype=int) for k in (AXIAL, DIAGONAL))
        first = plan.knots().first
        self._samples = {
            kind: [values[first[k] : first[k + 1]] for k in own] for kind, own in number.items()
        }

    def sum(self, phi_i: np.ndarray, phi_v: np.ndarray) -> np.ndarray:
        (_, p, _), (_, q, _) = self._between(phi_i, phi_v)
        low, high = (
            np.array([extreme(self._samples[k][0], axis=0) for k in (AXIAL, DIAGONAL)])
            for extreme in (np.min, np.max)
        )
        spread = (high - low).sum(axis=0)
        v = np.divide(p + q - low.sum(axis=0), spread, out=np.zeros_like(p), where=spread > 0.0)
        m, top = low.min(axis=0), high.max(axis=0)
        return np.clip(v, 0.0, 1.0) * (top - m) + m

    def corners(self, phi_i: np.ndarray, phi_v: np.ndarray) -> np.ndarray:
        (axial, p, at_axial), (diagonal, q, at_diagonal) = self._between(phi_i, phi_v)
        corner = 0.0
        for a, shift_a, weight_a in axial:
            for d, shift_d, weight_d in diagonal:
                position = phi_v + shift_a + shift_d
                crossing = 0.5 * (self._at(a, position) + self._at(d, position))
                corner = corner + (weight_a * weight_d)[:, None] * crossing
        return np.maximum(p + q - corner, np.minimum(at_axial, at_diagonal))

    def turning(self, phi_i: np.ndarray, phi_v: np.ndarray) -> np.ndarray:
        difference = phi_v - phi_i
        passes = [
            self._at(np.full(len(phi_i), slice_number), 0.5 * (difference + beta) + half_turn)
            for slice_number, beta in zip(self._diagonal, self._beta, strict=True)
            for half_turn in (0.0, np.pi)
        ]
        return np.mean(passes, axis=0)

    def _between(self, phi_i: np.ndarray, phi_v: np.ndarray) -> tuple:
        """Return per kind: the two neighbours, their blend, and their smaller value."""
        found = []
        for number, offsets, along in (
            (self._axial, self._alpha, phi_v - phi_i),
            (self._diagonal, self._beta, phi_i + phi_v),
        ):
            step = TWO_PI / len(number)
            place = np.mod(along - offsets[0], TWO_PI) / step
            below = np.floor(place)
            upper = place - below
            low = below.astype(int) % len(number)
            near = [
                (number[low], -0.5 * step * upper, 1.0 - upper),
                (number[(low + 1) % len(number)], 0.5 * step * (1.0 - upper), upper),
            ]
            values = [self._at(s, phi_v + shift) for s, shift, _ in near]
            blend = values[0] + upper[:, None] * (values[1] - values[0])
            found.append((near, blend, np.minimum(*values)))
        return tuple(found)

    def _at(self, slice_number: np.ndarray, position: np.ndarray) -> np.ndarray:
        return self._interpolate(slice_number, position[:, None])[:, 0]

"""From samples along slices to a BRDF (thesis sections 5.2, 5.3 and D.4)."""

from __future__ import annotations

import numpy as np

from simrig.brdf.slices.layout import SliceLayout
from simrig.brdf.slices.slices import SliceBrdf
from simrig.core.errors import SimrigError
from simrig.plans.adaptive import AdaptiveSamples
from simrig.plans.along_slices import slice_plan, slice_samples
from simrig.plans.placement import SlicePlacement
from simrig.plans.protocol import Measured
from simrig.plans.slices import AXIAL, CIRCLE, DIAGONAL, HORIZONTAL, Slices, build_slices
from simrig.reconstruction.slices.along_slices import SliceInterpolator


def slice_layout(
    placement: SlicePlacement,
    azimuth_samples: int = 360,
    largest_node_step_deg: float = 2.0,
    one_pole: bool = True,
) -> SliceLayout:
    """Return the table structure for a placement.

    The polar angle grid has the largest step, at most ``largest_node_step_deg``, that meets all
    measured polar angles exactly (in whole twelfths of a degree, and not below 0.25°); where there
    is none, every interval between measured polar angles has its own step.

    Args:
        azimuth_samples: of the tables along a whole turn.
        largest_node_step_deg: see above.
        one_pole: one value at theta_i = theta_v = 0, whatever the azimuths are.
    """
    ticks = np.degrees([placement.theta_max, placement.theta_step]) * 12.0
    common = np.gcd(*np.round(ticks).astype(int)) / 12.0
    intervals = placement.theta_count - 1
    if np.abs(ticks - np.round(ticks)).max() < 1e-5 and common >= 0.25:
        node_step = common / np.ceil(common / largest_node_step_deg - 1e-9)
        count = round(ticks[0] / 12.0 / node_step)
    else:
        count = intervals * int(np.ceil(ticks[1] / 12.0 / largest_node_step_deg - 1e-9))
    return SliceLayout(
        placement.theta_step,
        placement.azimuth_step,
        placement.theta_max,
        azimuth_samples,
        count + 1,
        one_pole,
    )


def reconstruct(
    measurement: Measured,
    interpolation: str = "cubic",
    *,
    azimuth_samples: int = 360,
    largest_node_step_deg: float = 2.0,
    one_pole: bool = True,
) -> SliceBrdf:
    """Return the BRDF that a measurement along slices gives.

    Args:
        measurement: what a rig recorded by a ``SlicePlan`` over all directions.
        interpolation: along the slices: ``"cubic"``, ``"pchip"`` or ``"linear"``.
        azimuth_samples, largest_node_step_deg: resolution of the tables.
        one_pole: one value at theta = 0 whatever azimuth is named; False takes D.1 to the letter.

    Raises:
        SimrigError: for an unknown interpolation, too coarse tables, or another plan.
    """
    placement, slice_types = full_slices(measurement)
    return reconstruct_slices(
        slice_samples(measurement),
        placement,
        slice_types=slice_types,
        interpolation=interpolation,
        azimuth_samples=azimuth_samples,
        largest_node_step_deg=largest_node_step_deg,
        one_pole=one_pole,
        name=f"{measurement.material} from {len(measurement.values)} samples",
    )


def full_slices(measurement: Measured) -> tuple[SlicePlacement, str]:
    """Return where the slices of a measurement lie, and which were measured.

    Raises:
        SimrigError: it was measured by another plan, or in one subspace alone.
    """
    plan = slice_plan(measurement)
    if not isinstance(plan.placement, SlicePlacement):
        raise SimrigError(
            f"'{measurement.material}' was measured in one subspace alone: use reconstruct_subspace"
        )
    return plan.placement, plan.slice_types


def reconstruct_slices(
    samples: AdaptiveSamples,
    placement: SlicePlacement,
    *,
    slice_types: str = "all",
    interpolation: str = "cubic",
    azimuth_samples: int = 360,
    largest_node_step_deg: float = 2.0,
    one_pole: bool = True,
    name: str = "slices",
) -> SliceBrdf:
    """Pre-interpolate all slices into the tables of a ``SliceBrdf``.

    Args:
        samples: what was measured along the slices of ``placement``.
        slice_types: the types that were measured, ``"all"`` or ``"axial-diagonal"``.
        interpolation: along the slices: ``"cubic"``, ``"pchip"`` or ``"linear"``.
        azimuth_samples: samples over 360° along axial and diagonal slices.
        largest_node_step_deg: largest step of the polar angle grid, in degrees.
        one_pole: see ``reconstruct``.

    Splines can dip below zero beside a highlight; pre-interpolated values are kept at or above 0.
    """
    slices = build_slices(placement, slice_types)
    layout = slice_layout(placement, azimuth_samples, largest_node_step_deg, one_pole)
    interpolate = SliceInterpolator(samples.knots, samples.values, interpolation)
    number = slice_numbers(slices)
    azimuth = np.arange(azimuth_samples) * (2.0 * np.pi / azimuth_samples)
    shapes = layout.shapes()
    axial = fill_rows(interpolate, _rows(layout, number, AXIAL), azimuth, shapes["axial"])
    diagonal = fill_rows(interpolate, _rows(layout, number, DIAGONAL), azimuth, shapes["diagonal"])
    intersections = samples.values[_intersection_table(placement)]
    axial[0], diagonal[0] = samples.values[0], samples.values[0]  # both directions at the pole
    horizontal = None
    if slice_types == "all":
        rows = _horizontal_rows(layout, number)
        horizontal = fill_rows(interpolate, rows, layout.nodes, shapes["horizontal"])
    return SliceBrdf(layout, intersections, axial, diagonal, horizontal, name)


def slice_numbers(slices: Slices) -> dict[tuple[int, ...], int]:
    """Return the number of every slice by its kind and indices."""
    return {
        (int(kind), *map(int, index)): s
        for s, (kind, index) in enumerate(zip(slices.kind, slices.index, strict=True))
    }


def fill_rows(
    interpolate: SliceInterpolator,
    rows: tuple[np.ndarray, np.ndarray],
    position: np.ndarray,
    shape: tuple[int, ...],
) -> np.ndarray:
    """Return slices at regular positions, float32 of the given shape, kept at or above 0.

    Args:
        rows: which slice fills each row, and the shift of its position in radians.
        position: (M,) positions in radians.
        shape: shape of the result.
    """
    slice_index, shift = rows
    values = interpolate(slice_index, position + shift[:, None])
    return np.maximum(values, 0.0).astype(np.float32).reshape(shape)


def _pairs(layout: SliceLayout) -> list[tuple[int, int]]:
    return [(i, v) for v in range(layout.theta_count) for i in range(v + 1)]


def _rows(layout: SliceLayout, number: dict, kind: int) -> tuple[np.ndarray, np.ndarray]:
    """Return which slice fills every axial or diagonal row, and the shift of its position."""
    pairs = [pair_rows(pair, layout.azimuth_count, number, kind) for pair in _pairs(layout)]
    slice_index, shifts = zip(*pairs, strict=True)
    return np.concatenate(slice_index), np.concatenate(shifts)


def pair_rows(
    pair: tuple[int, int], a_n: int, number: dict, kind: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return which slice fills every row of one subspace, and the shift of its position.

    Args:
        pair: numbers of the two polar angles.
        a_n: slices of one kind.
        number: slices by kind and indices.
        kind: AXIAL or DIAGONAL.
    """
    (i, v), half, rows = pair, np.pi / a_n, []
    for row in range(a_n + 1):
        own, shift = (0, np.pi) if row == a_n else (row, 0.0)
        if i == 0:  # a circle; that of (0, 0) is filled by the caller
            rows.append((number.get((CIRCLE, 0, v, 0, 0), 0), row * half))
        elif kind == AXIAL and i == v and 2 * own > a_n:  # α and −α are one, half a turn apart
            rows.append((number[AXIAL, i, v, a_n - own, 0], shift + np.pi))
        else:
            rows.append((number[kind, i, v, own, 0], shift))
    slice_index, shifts = zip(*rows, strict=True)
    return np.array(slice_index), np.array(shifts)


def _horizontal_rows(layout: SliceLayout, number: dict) -> tuple[np.ndarray, np.ndarray]:
    a_n, turn = layout.azimuth_count, 2 * layout.azimuth_count
    rows = [
        number[HORIZONTAL, i, 0, j if i else 0, (k if i else k + j) % turn]
        for i in range(layout.theta_count)
        for j in range(a_n)
        for k in range(turn + 1)
    ]
    return np.array(rows), np.zeros(len(rows))


def _intersection_table(placement: SlicePlacement) -> np.ndarray:
    """Return the sample at every stored intersection, (pairs, a_n + 1, 2·a_n + 1)."""
    found = placement.corner_samples()
    pairs = [(i, v) for v in range(placement.theta_count) for i in range(v + 1)]
    return np.stack([padded_intersections(found[i, v]) for i, v in pairs])


def padded_intersections(found: np.ndarray) -> np.ndarray:
    """Return the intersections of a subspace with the first row and column repeated at the end.

    Beyond the last axial slice the first one continues, half a turn on.
    """
    a_n, turn = found.shape
    j, k = np.indices((a_n + 1, turn + 1))
    return found[np.where(j == a_n, 0, j), np.where(j == a_n, k + a_n, k) % turn]

"""A table from samples of f_r, by how they lie: on a grid, on all pairs of directions, scattered.

Nothing is fitted where the samples lie on a grid: the table holds them. All pairs of illuminations
and views are interpolated by barycentric coordinates, isotropic samples on a grid of the three
angles along each of them, and other isotropic samples by a thin-plate spline.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from simrig.brdf.protocol import Brdf
from simrig.brdf.tables.barycentric import BarycentricBrdf
from simrig.brdf.tables.dense import DenseTable
from simrig.brdf.tables.isotropic import MERL_SHAPE, IsotropicTable, fill_invalid
from simrig.brdf.tables.scattered import (
    IsotropicInterpolator,
    ScatteredSamples,
    barycentric_weights,
    interpolate_isotropic,
    residual,
    subset,
)
from simrig.core.errors import SimrigError
from simrig.core.gamut import CLIP, in_gamut, outside
from simrig.directions.half_difference import from_half_difference
from simrig.directions.spherical import to_vector

FEWEST_INCIDENCES = 5  # of scattered samples, between which a spline may interpolate
_FEWEST_SAMPLES = 100
_MOST_FOR_A_SPLINE = 1500  # its linear system takes their cube in time; more are thinned out
_CLEARLY_ABOVE = 0.1  # cosine from which on a grid of half-difference angles must be complete
_LARGEST_TABLE = 1 << 27  # values of a table
_GRAZING = np.radians(89.5)  # the spline has no horizon
_SAME_ANGLE = 2e-4  # radians; files have four to six digits
_STEP = np.radians(7.5)  # of tables that are interpolated


@dataclass(frozen=True)
class Assembled:
    """A BRDF from samples.

    Attributes:
        how: what was done, for people.
    """

    brdf: Brdf
    how: str


def assemble(samples: ScatteredSamples, what: str = "samples") -> Assembled:
    """Return the table that samples make.

    Args:
        samples: values may be negative; ``samples.gamut`` says what becomes of them.
        what: they are, for the message.

    Raises:
        SimrigError: samples that are too few or too sparse, with what is missing.
    """
    found = _assembled(samples, what)
    found.brdf.outside = outside(samples.values)
    return found


def _assembled(samples: ScatteredSamples, what: str) -> Assembled:
    angles = _tidy(samples)
    isotropic = samples.isotropic or len(np.unique(_key(angles[:, 1]))) == 1
    if isotropic:
        relative = angles.copy()
        relative[:, 3] = np.mod(angles[:, 3] - angles[:, 1], 2.0 * np.pi)
        found = _isotropic_grid(relative, samples)
        if found is not None:
            return found
    else:
        found = _all_pairs(angles, samples)
        if found is not None:
            return found
    return _scattered(samples, isotropic, what)


def _tidy(samples: ScatteredSamples) -> np.ndarray:
    """Return theta_i, phi_i, theta_v, phi_v with azimuths in [0, 2π), 0 at the pole."""
    angles = np.stack([samples.theta_i, samples.phi_i, samples.theta_v, samples.phi_v], axis=1)
    for theta, phi in ((0, 1), (2, 3)):
        angles[:, phi] = np.mod(angles[:, phi], 2.0 * np.pi)
        angles[np.abs(angles[:, phi] - 2.0 * np.pi) < _SAME_ANGLE, phi] = 0.0
        angles[np.abs(angles[:, theta]) < _SAME_ANGLE, theta] = 0.0
        angles[angles[:, theta] == 0.0, phi] = 0.0
    return angles


def _key(angle: np.ndarray) -> np.ndarray:
    return np.round(angle / _SAME_ANGLE).astype(np.int64)


def _grouped(columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the different rows, sorted, and the number of each row's group.

    Angles that differ by less than ``_SAME_ANGLE`` are one, also across a boundary of rounding.
    """
    levels = np.empty(columns.shape, dtype=np.int64)
    centres = []
    for column in range(columns.shape[1]):
        order = np.argsort(columns[:, column], kind="stable")
        ordered = columns[order, column]
        group = np.concatenate([[0], np.cumsum(np.diff(ordered) > _SAME_ANGLE)])
        levels[order, column] = group
        centres.append(np.bincount(group, ordered) / np.bincount(group))
    rows, inverse = np.unique(levels, axis=0, return_inverse=True)
    values = np.stack([centre[rows[:, k]] for k, centre in enumerate(centres)], axis=1)
    return values, inverse.ravel()


def _axes(columns: np.ndarray) -> tuple[list[np.ndarray], tuple[np.ndarray, ...]]:
    """Return the different values of each column, sorted, and which of them each row has."""
    found = [_grouped(column[:, None]) for column in columns.T]
    return [levels[:, 0] for levels, _ in found], tuple(group for _, group in found)


def _means(group: np.ndarray, count: int, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the mean of the values of each group, (count, 3), and how many there are."""
    number = np.bincount(group, minlength=count)
    total = np.stack([np.bincount(group, column, count) for column in values.T], axis=1)
    return total / np.maximum(number, 1)[:, None], number


def _all_pairs(angles: np.ndarray, samples: ScatteredSamples) -> Assembled | None:
    """Return the table of a set of illuminations times a set of views, None without them."""
    lights, light = _grouped(angles[:, :2])
    views, view = _grouped(angles[:, 2:])
    pairs = len(lights) * len(views)
    if pairs > len(samples) or 3 * pairs > _LARGEST_TABLE:
        return None
    values, number = _means(light * len(views) + view, pairs, samples.values)
    if np.any(number == 0):
        return None
    values = in_gamut(values, samples.gamut).reshape(len(lights), len(views), 3)
    text = f"{len(lights)} illuminations × {len(views)} views"
    table = _regular(lights, views, values, samples)
    if table is not None:
        return Assembled(table, f"{text} on a regular grid, held as they are")
    if min(len(lights), len(views)) < 4:
        return None
    same = lights.shape == views.shape and np.allclose(lights, views, atol=_SAME_ANGLE)
    if same:
        brdf = BarycentricBrdf(
            lights[:, 0], lights[:, 1], values, name=samples.name, gamut=samples.gamut
        )
        return Assembled(brdf, f"{text}, interpolated between neighbours")
    theta_max = float(max(lights[:, 0].max(), views[:, 0].max()))
    sides = to_vector(*lights.T), to_vector(*views.T)
    table = tabulated_pairs(*sides, values, theta_max, samples.name, samples.gamut)
    return Assembled(table, f"{text}, interpolated to every {np.degrees(_STEP):g}°")


def tabulated_pairs(
    lights: np.ndarray,
    views: np.ndarray,
    values: np.ndarray,
    theta_max: float,
    name: str,
    gamut: str = CLIP,
) -> DenseTable:
    """Return the table every 7.5° of a set of illuminations times a set of views.

    Both are interpolated by barycentric coordinates on the triangulated hemisphere, so the table
    is exact wherever a node is a measured direction.

    Args:
        lights, views: unit vectors, (n, 3) and (m, 3).
        values: (n, m, 3) f_r.
        theta_max: polar angle of the last nodes.
        gamut: of the values (``simrig.core.gamut``).
    """
    n_theta, n_phi = int(np.ceil(theta_max / _STEP - 1e-4)) + 1, round(2.0 * np.pi / _STEP)
    theta = np.append(np.arange(n_theta - 1) * _STEP, theta_max)
    nodes = to_vector(theta[:, None], _STEP * np.arange(n_phi)).reshape(-1, 3)
    left, right = (barycentric_weights(side, nodes) for side in (lights, views))
    # one side after the other: (nodes, n) by (n, m, 3), then the same from the right
    full = np.einsum("vn,inc->ivc", right, np.tensordot(left, values, (1, 0)), optimize=True)
    full = full.reshape(n_theta, n_phi, n_theta, n_phi, 3).transpose(0, 2, 1, 3, 4)
    values = np.ascontiguousarray(full, dtype=np.float32)
    return DenseTable(values, _STEP, theta_max, name=name, gamut=gamut)


def _regular(
    lights: np.ndarray, views: np.ndarray, values: np.ndarray, samples: ScatteredSamples
) -> DenseTable | None:
    """Return a dense table where both sets are grids of the same polar angles, None elsewhere."""
    from_lights, from_views = _grid_of(lights), _grid_of(views)
    if from_lights is None or from_views is None:
        return None
    (theta, rows_i), (theta_v, rows_v) = from_lights, from_views
    if theta.shape != theta_v.shape or not np.allclose(theta, theta_v, atol=_SAME_ANGLE):
        return None
    table = values[rows_i][:, :, rows_v]  # theta_i, phi_i, theta_v, phi_v, 3
    table = np.ascontiguousarray(table.transpose(0, 2, 1, 3, 4))
    step = float(theta[1])
    return DenseTable(table, step, float(theta[-1]), name=samples.name, gamut=samples.gamut)


def _grid_of(directions: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the polar angles of a regular grid, and the row of each node (n_theta, n_phi)."""
    theta = np.sort(directions[:, 0])
    theta = theta[np.concatenate([[True], np.diff(theta) > _SAME_ANGLE])]
    if len(theta) < 2 or theta[0] > _SAME_ANGLE:
        return None
    steps = np.diff(theta)
    regular = np.allclose(steps[:-1], steps[0], atol=2 * _SAME_ANGLE)
    if not regular or steps[-1] > steps[0] + 2 * _SAME_ANGLE:
        return None
    rings = [np.flatnonzero(np.abs(directions[:, 0] - t) <= _SAME_ANGLE) for t in theta]
    count = len(rings[1])
    phi = 2.0 * np.pi / count * np.arange(count)
    rows = np.empty((len(theta), count), dtype=np.int64)
    rows[0] = rings[0][0]
    if len(rings[0]) != 1:
        return None
    for number, ring in enumerate(rings[1:], start=1):
        ring = ring[np.argsort(directions[ring, 1])]
        if len(ring) != count or not np.allclose(directions[ring, 1], phi, atol=2 * _SAME_ANGLE):
            return None
        rows[number] = ring
    return np.array(theta), rows


def _isotropic_grid(angles: np.ndarray, samples: ScatteredSamples) -> Assembled | None:
    """Return the table of isotropic samples on a grid of theta_i, theta_v and the azimuth between.

    An azimuth of 0° to 180° stands for both sides: an isotropic surface is its own mirror image.
    """
    axes, where = _axes(angles[:, [0, 2, 3]])
    shape = tuple(len(axis) for axis in axes)
    size = int(np.prod(shape, dtype=object))
    pole = (angles[:, 0] == 0.0) | (angles[:, 2] == 0.0)
    if min(shape) < 3 or size > 4 * len(samples) + 1000:
        return None
    values, number = _means(np.ravel_multi_index(where, shape), size, samples.values)
    values, number = values.reshape(*shape, 3), number.reshape(shape)
    if pole.any():  # a direction at the pole has one value whatever the azimuth
        for axis in (0, 1):
            at: tuple[int | slice, ...] = (0,) if axis == 0 else (slice(None), 0)
            if axes[axis][0] == 0.0:
                part, counted = values[at], number[at]
                total = counted.sum(axis=-1, keepdims=True)
                mean = (part * counted[..., None]).sum(axis=-2, keepdims=True)
                values[at] = mean / np.maximum(total, 1)[..., None]
                number[at] = total
    if np.any(number == 0):
        return None
    theta_i, theta_v, phi, values = _whole_circle(
        axes[0], axes[1], axes[2], in_gamut(values, samples.gamut)
    )
    if phi is None:
        return None
    theta_max = float(min(theta_i[-1], theta_v[-1]))
    step = _even_step(theta_i, theta_v, theta_max)
    n_theta = int(np.ceil(theta_max / step - 1e-4)) + 1
    n_phi = len(phi) - 1
    nodes = np.append(np.arange(n_theta - 1) * step, theta_max)
    even = 2.0 * np.pi / n_phi * np.arange(n_phi)
    look_up = RegularGridInterpolator(
        (theta_i, theta_v, phi), values, bounds_error=False, fill_value=None
    )
    held = [np.clip(nodes, axis[0], axis[-1]) for axis in (theta_i, theta_v)]
    grid = np.stack(np.meshgrid(*held, even, indexing="ij"), axis=-1)
    relative = in_gamut(look_up(grid), samples.gamut)  # theta_i, theta_v, azimuth between, 3
    turned = (np.arange(n_phi)[None, :] - np.arange(n_phi)[:, None]) % n_phi
    table = np.ascontiguousarray(relative[:, :, turned], dtype=np.float32)
    exact = all(np.allclose(axis, nodes, atol=_SAME_ANGLE) for axis in (theta_i, theta_v))
    how = (
        f"isotropic, {shape[0]} × {shape[1]} polar angles and {shape[2]} azimuths between on a "
        "grid, "
        + ("held as they are" if exact else f"interpolated to every {np.degrees(step):.3g}°")
    )
    dense = DenseTable(table, step, theta_max, name=samples.name, gamut=samples.gamut)
    return Assembled(dense, how)


def _even_step(theta_i: np.ndarray, theta_v: np.ndarray, theta_max: float) -> float:
    """Return the step of a table that holds both axes: their smallest, at least 1°."""
    steps = np.concatenate([np.diff(theta_i), np.diff(theta_v)])
    return float(min(max(steps.min(), np.radians(1.0)), theta_max))


def _whole_circle(
    theta_i: np.ndarray, theta_v: np.ndarray, phi: np.ndarray, values: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray | None, np.ndarray]:
    """Return azimuths from 0 to 2π with both ends, by mirroring half of them where needed."""
    gap = float(np.diff(phi).max())
    closes = 2.0 * np.pi - (phi[-1] - phi[0])
    if closes <= 1.5 * gap + _SAME_ANGLE:
        first, wrapped = phi[0], values
        phi = np.append(phi - first, 2.0 * np.pi)
        wrapped = np.concatenate([values, values[:, :, :1]], axis=2)
        if first > _SAME_ANGLE:  # start at zero, between the last node and the first
            even = np.linspace(0.0, 2.0 * np.pi, len(phi))
            look_up = RegularGridInterpolator((theta_i, theta_v, phi), wrapped)
            at = np.mod(even - first, 2.0 * np.pi)
            grid = np.stack(np.meshgrid(theta_i, theta_v, at, indexing="ij"), axis=-1)
            return theta_i, theta_v, even, look_up(grid)
        return theta_i, theta_v, phi, wrapped
    if abs(phi[0]) < _SAME_ANGLE and abs(phi[-1] - np.pi) <= gap + _SAME_ANGLE:
        if abs(phi[-1] - np.pi) > _SAME_ANGLE:  # 0 to 170°: the value there is held
            phi, values = np.append(phi, np.pi), np.concatenate([values, values[:, :, -1:]], axis=2)
        mirrored = np.concatenate([values, values[:, :, -2::-1]], axis=2)
        return theta_i, theta_v, np.concatenate([phi, 2.0 * np.pi - phi[-2::-1]]), mirrored
    return theta_i, theta_v, None, values


def half_difference_table(
    angles: np.ndarray, samples: np.ndarray, name: str, gamut: str = CLIP
) -> IsotropicTable | None:
    """Return the table of a whole grid of theta_h, theta_d and phi_d, None where it has gaps.

    Where a pair would lie below the horizon the grid may have gaps; they take the nearest value.
    phi_d over half a turn makes the table reciprocal.

    Args:
        angles: the three in radians, shape (n, 3).
        samples: f_r at them, (n, 3).
        gamut: of negative values, see ``simrig.core.gamut``.
    """
    x = np.array(angles, dtype=np.float64)
    turn = 2.0 * np.pi if np.ptp(x[:, 2]) > np.pi + _SAME_ANGLE else np.pi
    x[:, 2] = np.mod(x[:, 2], turn)
    x[np.abs(x[:, 2] - turn) < _SAME_ANGLE, 2] = 0.0
    axes, where = _axes(x)
    shape = tuple(len(axis) for axis in axes)
    if min(shape) < 2 or np.prod(shape, dtype=object) > 8 * len(x):
        return None
    means, number = _means(np.ravel_multi_index(where, shape), int(np.prod(shape)), samples)
    values = in_gamut(means, gamut).reshape(*shape, 3)
    held = (number > 0).reshape(shape)
    grid = np.meshgrid(*axes, indexing="ij")
    wi, wv = from_half_difference(grid[0], 0.0 * grid[0], grid[1], grid[2])
    if np.any(~held & (np.minimum(wi[..., 2], wv[..., 2]) > _CLEARLY_ABOVE)):
        return None
    filled = values if held.all() else fill_invalid(values, held)
    phi = np.concatenate([axes[2], [axes[2][0] + turn]])
    filled = np.concatenate([filled, filled[:, :, :1]], axis=2)
    look_up = RegularGridInterpolator((axes[0], axes[1], phi), filled)
    n_h, n_d, n_p = MERL_SHAPE[0], MERL_SHAPE[1], round(MERL_SHAPE[2] * turn / np.pi)
    theta_h = ((np.arange(n_h) + 0.5) / n_h) ** 2 * (np.pi / 2)
    theta_d = (np.arange(n_d) + 0.5) / n_d * (np.pi / 2)
    phi_d = (np.arange(n_p) + 0.5) / n_p * turn
    nodes = [
        np.clip(theta_h, axes[0][0], axes[0][-1]),
        np.clip(theta_d, axes[1][0], axes[1][-1]),
        axes[2][0] + np.mod(phi_d - axes[2][0], turn),
    ]
    table = look_up(np.stack(np.meshgrid(*nodes, indexing="ij"), axis=-1))
    return IsotropicTable(
        in_gamut(table, gamut).astype(np.float32), name=name, reciprocal=turn < 4.0, gamut=gamut
    )


def _scattered(samples: ScatteredSamples, isotropic: bool, what: str) -> Assembled:
    incidences = len(np.unique(_key(samples.theta_i)))
    count = f"{len(samples):,}".replace(",", "") + f" {what} at {incidences} incidences"
    if not isotropic:
        raise SimrigError(
            f"{count}: too sparse to render; anisotropic samples need every view for every "
            "illumination, on a grid or on directions around the normal"
        )
    if incidences < FEWEST_INCIDENCES or len(samples) < _FEWEST_SAMPLES:
        raise SimrigError(
            f"{count}: too sparse to render; a table needs a whole grid of the angles, or at "
            f"least {FEWEST_INCIDENCES} incidences and {_FEWEST_SAMPLES} samples"
        )
    low = np.minimum(samples.theta_i, _GRAZING), np.minimum(samples.theta_v, _GRAZING)
    samples = replace(samples, theta_i=low[0], theta_v=low[1], isotropic=True)
    used, note = samples, ""
    if len(samples) > _MOST_FOR_A_SPLINE:
        keep = np.random.default_rng(0).permutation(len(samples))[:_MOST_FOR_A_SPLINE]
        used = subset(samples, np.sort(keep))
        note = f" {_MOST_FOR_A_SPLINE} of them drawn at random"
    brdf = interpolate_isotropic(used)
    wi, wv = samples.directions
    error = residual(samples, IsotropicInterpolator(used)(wi, wv)) if note else None
    shown = f"; error at all samples: {error}" if error else ""
    return Assembled(brdf, f"isotropic samples at {incidences} incidences, spline{note}{shown}")

"""Reflectance in plain arrays, with axes that the file or the caller names.

Values are f_r in 1/sr, linear RGB, XYZ, spectra with a ``wavelength`` array, or grey where the
array has no axis for colours. Nodes come from arrays named as the axes, from ranges that are
stated, or are assumed where only one is usual, which is said. What simrig writes names its axes.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from simrig.brdf.checks import CLAMP
from simrig.brdf.protocol import Brdf
from simrig.brdf.tables.dense import DenseTable
from simrig.brdf.tables.from_samples import assemble, half_difference_table
from simrig.brdf.tables.isotropic import MERL_SHAPE, IsotropicTable
from simrig.brdf.tables.resample import resample_dense
from simrig.brdf.tables.scattered import ScatteredSamples
from simrig.core.colour import FROM_XYZ
from simrig.core.errors import SimrigError
from simrig.core.gamut import CLIP, in_gamut, outside
from simrig.files.arrays import axes as axis_names
from simrig.files.arrays.axes import COLOURS, HELP, Axis
from simrig.files.arrays.containers import is_npy, read_arrays
from simrig.files.atomic import atomic_write
from simrig.files.wavelengths import to_rgb

_SAME = 1e-3  # degrees
_MOST_SAMPLES = 1 << 23  # of an array that is not on a regular grid
_STEP_DEG, _AZIMUTHS = 5.0, 72  # of tables that are written of other materials


def load_arrays(
    path: str | Path,
    clamp_negative: bool = False,
    axes: str | None = None,
    variable: str | None = None,
    wavelength: float | None = None,
    gamut: str = CLIP,
) -> tuple[Brdf, list[str]]:
    """Read a table of reflectance from a ``.npz``, ``.npy`` or ``.mat`` file.

    Args:
        clamp_negative: set negative values to 0 instead of refusing them.
        axes: what the axes of the array are, see ``axes.parse``; needed unless the file says it.
        variable: name of the array, where several could be it.
        wavelength: in nm, to take one of several as grey.
        gamut: of colours outside sRGB, see ``simrig.core.gamut``.

    Returns:
        The table, and what was done and assumed.

    Raises:
        SimrigError: damaged files, arrays that do not fit the axes, values that cannot be.
    """
    path = Path(path)
    if axes is None and is_npy(path):
        raise SimrigError(f"'{path}' is a single NumPy array: {HELP}")
    arrays = read_arrays(path)
    stated = axes or _own_axes(arrays)
    if stated is None:
        shapes = ", ".join(f"{n} {a.shape}" for n, a in list(arrays.items())[:8])
        raise SimrigError(f"'{path}' holds arrays ({shapes}): {HELP}")
    wanted = axis_names.parse(stated)
    name, values = _variable(path, arrays, wanted, variable)
    notes = [f"array '{name}' {values.shape} over {', '.join(a.name for a in wanted)}"]
    values = np.asarray(values, dtype=np.float64)
    if not np.all(np.isfinite(values)):
        count = int((~np.isfinite(values)).sum())
        raise SimrigError(f"'{name}' of '{path}' has {count} NaN or infinite values")
    negative = int((values < 0.0).sum())
    if negative and not clamp_negative:
        raise SimrigError(f"'{path}' has {negative} negative of {values.size} values{CLAMP}")
    angles, colours, note = _colours(path, arrays, wanted, np.maximum(values, 0.0), wavelength)
    stored = {
        axis.name: found
        for axis in angles
        if (found := _stored(arrays, axis.name, name)) is not None
    }
    stored, unit = axis_names.in_degrees(stored)
    nodes = []
    for axis, count in zip(angles, colours.shape, strict=False):
        found, assumed = (
            axis_names.nodes(axis, count, stored.get(axis.name))
            if (axis.name not in ("theta_h", "theta_d", "phi_d") or _has_nodes(axis, stored))
            else (np.zeros(0), "")
        )
        nodes.append(found)
        notes += [assumed] if assumed else []
    brdf, how = _table(path, angles, nodes, in_gamut(colours, gamut), gamut)
    brdf.outside = outside(colours)
    return brdf, [*notes, *([unit] if unit else []), note, how]


def write_npz(path: str | Path, brdf: Brdf) -> None:
    """Write a BRDF as a compressed ``.npz``; a dense table as it is, others every 5°."""
    content = _content(brdf)
    with atomic_write(path) as temporary, open(temporary, "wb") as file:
        np.savez_compressed(file, allow_pickle=False, **content)


def write_mat(path: str | Path, brdf: Brdf) -> None:
    """Write a BRDF as a MATLAB file (version 5, compressed), otherwise as ``write_npz``."""
    from scipy.io import savemat

    content = _content(brdf)
    with atomic_write(path) as temporary:
        savemat(str(temporary), content, appendmat=False, do_compression=True)


def _content(brdf: Brdf) -> dict[str, np.ndarray]:
    table = brdf
    if not isinstance(table, DenseTable):
        top = min(brdf.theta_max, np.radians(85.0))
        table = resample_dense(brdf, np.radians(_STEP_DEG), _AZIMUTHS, top)
    phi_i, phi_v = table.azimuths
    theta = np.degrees(table.thetas)
    return {
        "brdf": table.values,
        "theta_i": theta,
        "theta_v": theta,
        "phi_i": np.degrees(phi_i),
        "phi_v": np.degrees(phi_v),
        "axes": np.array("theta_i,theta_v,phi_i,phi_v,rgb"),
        "units": np.array("f_r in 1/sr, linear RGB with sRGB primaries; angles in degrees"),
    }


def _own_axes(arrays: dict[str, np.ndarray]) -> str | None:
    stated = arrays.get("axes")
    return (
        str(stated)
        if stated is not None and stated.dtype.kind == "U" and stated.ndim == 0
        else None
    )


def _variable(
    path: Path, arrays: dict[str, np.ndarray], wanted: list[Axis], name: str | None
) -> tuple[str, np.ndarray]:
    """Return the array that has the axes, with one for colours behind where it has one more."""
    count = len(wanted)
    has_colours = any(axis.name in COLOURS for axis in wanted)

    def fits(array: np.ndarray) -> bool:
        extra = array.ndim == count + 1 and not has_colours and array.shape[-1] in (1, 3)
        return array.dtype.kind in "fiu" and (array.ndim == count or extra)

    shapes = ", ".join(f"{n} {a.shape}" for n, a in list(arrays.items())[:8])
    if name is not None:
        if name not in arrays or not fits(arrays[name]):
            raise SimrigError(f"'{path}' has no array '{name}' of {count} axes, only: {shapes}")
        return name, arrays[name]
    found = {n: a for n, a in arrays.items() if fits(a)}
    if not found:
        raise SimrigError(f"'{path}' has no array of {count} axes, only: {shapes}")
    if len(found) > 1:
        raise SimrigError(f"'{path}' has several arrays that fit ({', '.join(found)}): --variable")
    return next(iter(found.items()))


def _colours(
    path: Path,
    arrays: dict[str, np.ndarray],
    wanted: list[Axis],
    values: np.ndarray,
    wavelength: float | None,
) -> tuple[list[Axis], np.ndarray, str]:
    """Return the axes of angles, values (..., 3), and what the colours are."""
    names = [axis.name for axis in wanted]
    angles = [axis for axis in wanted if axis.name not in COLOURS]
    kind = next((name for name in names if name in COLOURS), None)
    if kind is not None:
        values = np.moveaxis(values, names.index(kind), -1)
    elif values.ndim > len(wanted):
        kind = "rgb" if values.shape[-1] == 3 else None
    else:
        values = values[..., None]
    if kind == "wavelength":
        waves = _stored(arrays, "wavelength", "")
        if waves is None or len(waves) != values.shape[-1]:
            raise SimrigError(f"'{path}' has no 'wavelength' array of {values.shape[-1]} nm")
        flat, note = to_rgb(values.reshape(-1, len(waves)), waves, f"'{path}'", wavelength)
        return angles, flat.reshape(*values.shape[:-1], 3), note
    if kind is None:
        return angles, np.repeat(values[..., :1], 3, axis=-1), "grey: no axis of colours"
    if values.shape[-1] != 3:
        raise SimrigError(f"the axis {kind} of '{path}' has {values.shape[-1]} channels, not 3")
    if kind == "xyz":
        return angles, values @ FROM_XYZ.T, "CIE XYZ to RGB"
    return angles, values, "RGB"


def _stored(arrays: dict[str, np.ndarray], name: str, but: str) -> np.ndarray | None:
    """Return the nodes that a file holds under a usual name of an axis."""
    lower = {key.lower(): array for key, array in arrays.items() if key != but}
    for alias in axis_names.NAMES[name]:
        array = lower.get(alias)
        if (
            array is not None
            and array.dtype.kind in "fiu"
            and array.size == max(array.shape, default=0)
        ):
            nodes = np.asarray(array, dtype=np.float64).ravel()
            if np.all(np.isfinite(nodes)) and np.all(np.diff(nodes) > 0.0):
                return nodes
    return None


def _has_nodes(axis: Axis, stored: dict[str, np.ndarray]) -> bool:
    return axis.name in stored or axis.first_deg is not None


def _table(
    path: Path, angles: list[Axis], nodes: list[np.ndarray], values: np.ndarray, gamut: str
) -> tuple[Brdf, str]:
    names = [axis.name for axis in angles]
    if "theta_h" in names:
        return _half_difference(path, names, nodes, values, gamut)
    order = [n for n in ("theta_i", "theta_v", "phi_i", "phi_v", "dphi") if n in names]
    values = np.moveaxis(values, [names.index(n) for n in order], range(len(order)))
    held = [np.asarray(nodes[names.index(n)]) for n in order]
    for name, axis in zip(order, held, strict=True):
        top = 90.0 if name.startswith("theta") else 360.0
        if axis.min() < -_SAME or axis.max() > top + _SAME:
            raise SimrigError(
                f"{name} of '{path}' runs from {axis.min():g}° to {axis.max():g}°, not within "
                f"0° to {top:g}°"
            )
    if len(order) == 4:
        for number in (2, 3):  # 0° and 360° are one
            if len(held[number]) > 1 and held[number][-1] - held[number][0] > 360.0 - _SAME:
                held[number] = held[number][:-1]
                values = np.delete(values, -1, axis=number)
        table = _regular(path, held, values, gamut)
        if table is not None:
            return table, "a regular grid, held as it is"
    if values.size // 3 > _MOST_SAMPLES:
        raise SimrigError(
            f"the array of '{path}' is on no regular grid and too large to interpolate: resample "
            "it to even steps from 0°"
        )
    if len(order) == 4:
        held, values = _even(path, held, values)
        table = _regular(path, held, values, gamut)
        if table is not None:
            return table, f"interpolated to every {held[0][1]:.3g}°"
    grid = [np.radians(g).ravel() for g in np.meshgrid(*held, indexing="ij")]
    flat = np.ascontiguousarray(values).reshape(-1, 3)
    samples = ScatteredSamples(
        grid[0], 0.0 * grid[0], grid[1], grid[2], flat, path.stem, isotropic=True, gamut=gamut
    )
    found = assemble(samples, "values")
    return found.brdf, found.how


def _regular(
    path: Path, nodes: list[np.ndarray], values: np.ndarray, gamut: str
) -> DenseTable | None:
    theta_i, theta_v, phi_i, phi_v = nodes
    if len(theta_i) < 2 or theta_i.shape != theta_v.shape:
        return None
    even = np.arange(len(theta_i)) * theta_i[1]
    even[-1] = min(theta_i[-1], even[-1])
    around = [360.0 / len(p) * np.arange(len(p)) for p in (phi_i, phi_v)]
    pairs = ((theta_i, even), (theta_v, even), (phi_i, around[0]), (phi_v, around[1]))
    if not all(np.allclose(a, b, atol=_SAME) for a, b in pairs):
        return None
    table = np.ascontiguousarray(values)
    step, top = np.radians(theta_i[[1, -1]])
    return DenseTable(table, step, top, name=path.stem, gamut=gamut)


def _even(
    path: Path, nodes: list[np.ndarray], values: np.ndarray
) -> tuple[list[np.ndarray], np.ndarray]:
    """Return the array interpolated to even steps of polar angles from 0° and around the circle."""
    for name, axis in zip(("phi_i", "phi_v"), nodes[2:], strict=True):
        gaps = np.diff(np.append(axis, axis[0] + 360.0))
        if len(axis) < 2 or gaps[-1] > 2.0 * gaps[:-1].max() + _SAME:
            raise SimrigError(
                f"{name} of '{path}' covers {axis[0]:g}° to {axis[-1]:g}°, not the whole circle"
            )
    steps = np.concatenate([np.diff(nodes[0]), np.diff(nodes[1])])
    if len(steps) == 0:
        raise SimrigError(f"'{path}' has a single polar angle: two at least make a table")
    top = float(min(nodes[0][-1], nodes[1][-1]))
    count = max(round(top / max(float(steps.min()), 1.0)), 1)
    theta = np.linspace(0.0, top, count + 1)
    around = [360.0 / len(p) * np.arange(len(p)) for p in nodes[2:]]
    closed = [*nodes[:2], *(np.append(p, p[0] + 360.0) for p in nodes[2:])]
    values = np.concatenate([values, values[:, :, :1]], axis=2)
    values = np.concatenate([values, values[:, :, :, :1]], axis=3)
    look_up = RegularGridInterpolator(tuple(closed), values)
    at = [np.clip(theta, axis[0], axis[-1]) for axis in nodes[:2]]
    at += [np.mod(a - p[0], 360.0) + p[0] for a, p in zip(around, nodes[2:], strict=True)]
    return [theta, theta, *around], look_up(np.stack(np.meshgrid(*at, indexing="ij"), axis=-1))


def _half_difference(
    path: Path, names: list[str], nodes: list[np.ndarray], values: np.ndarray, gamut: str
) -> tuple[IsotropicTable, str]:
    order = [names.index(n) for n in ("theta_h", "theta_d", "phi_d")]
    values = np.moveaxis(values, order, range(3))
    held = [nodes[number] for number in order]
    if all(len(axis) == 0 for axis in held):
        full = values.shape[2] == 2 * MERL_SHAPE[2]
        table = IsotropicTable(
            np.ascontiguousarray(values), name=path.stem, reciprocal=not full, gamut=gamut
        )
        turn = "a whole turn" if full else "half a turn"
        return table, f"bins assumed as in MERL, theta_h by its square root, phi_d over {turn}"
    for name, axis in zip(("theta_h", "theta_d", "phi_d"), held, strict=True):
        if len(axis) == 0:
            raise SimrigError(f"the nodes of {name} are not in '{path}': state {name}=FIRST:LAST")
    if values.size // 3 > _MOST_SAMPLES:
        raise SimrigError(f"the array of '{path}' is too large to interpolate")
    grid = np.meshgrid(*(np.radians(axis) for axis in held), indexing="ij")
    points = np.stack([g.ravel() for g in grid], axis=-1)
    found = half_difference_table(points, values.reshape(-1, 3), path.stem, gamut)
    if found is None:
        raise SimrigError(f"'{path}' has too few nodes of theta_h, theta_d or phi_d")
    return found, "interpolated to MERL's bins"

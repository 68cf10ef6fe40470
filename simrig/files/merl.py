"""MERL ``.binary`` files: isotropic BRDF in the half-difference parameterisation.

Layout (Matusik et al. 2003): three little-endian int32 (90, 90, 180), then float64 in planes of
red, green, blue, each over theta_h, theta_d, phi_d with phi_d running fastest. Stored values are
f_r divided by 1/1500, 1.15/1500 and 1.66/1500. Negative values mark bins that were not measured.
Other counts of bins are read as the same parameterisation: theta_h by its square root, phi_d over
half a turn.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from simrig.brdf.tables.isotropic import MERL_SHAPE, IsotropicTable, fill_invalid
from simrig.core.errors import SimrigError
from simrig.files.atomic import atomic_write, existing_file

SCALE = np.array([1.0, 1.15, 1.66]) / 1500.0
_LARGEST = 1e35  # what single precision holds, with room for the scales
_HEADER = 12
SIZE = _HEADER + 24 * int(np.prod(MERL_SHAPE))


def read_merl(path: str | Path) -> IsotropicTable:
    """Read a MERL file.

    A bin in which any channel is negative was not measured: it gets the value of the nearest
    measured bin (phi_d periodic).

    Returns:
        A table whose attribute ``invalid_bins`` says how many bins were not measured.

    Raises:
        SimrigError: other dimensions, a truncated or too long file, NaN or infinite values.
    """
    path = existing_file(path)
    shape = _checked_shape(path)
    planes = np.fromfile(path, dtype="<f8", offset=_HEADER).reshape(3, *shape)
    values = np.moveaxis(planes, 0, -1)
    usable = np.abs(values) < _LARGEST  # false for NaN
    if not np.all(usable):
        raise SimrigError(
            f"'{path}' has {int((~usable).sum())} NaN or infinite values, or ones beyond "
            f"{_LARGEST:g}: the data are damaged"
        )
    valid = np.all(values >= 0.0, axis=-1)
    missing = int(valid.size - valid.sum())
    values = values * SCALE
    if missing == valid.size:
        raise SimrigError(f"'{path}' has no measured bin: every value is negative")
    filled = np.abs(fill_invalid(values, valid))
    table = IsotropicTable(filled.astype(np.float32), name=path.stem)
    table.invalid_bins = missing
    return table


def write_merl(path: str | Path, table: IsotropicTable) -> None:
    """Write a table with MERL's bins as a MERL file (see ``resample_isotropic`` for others).

    Raises:
        SimrigError: when the table has other bins, or is not reciprocal.
    """
    if table.values.shape != (*MERL_SHAPE, 3) or not table.reciprocal:
        raise SimrigError(
            f"a MERL file is reciprocal with {MERL_SHAPE} bins, the table "
            f"{'is' if table.reciprocal else 'is not'} and has {table.values.shape[:3]}: "
            "resample it with resample_isotropic"
        )
    planes = np.moveaxis(table.values.astype("<f8") / SCALE, -1, 0)
    with atomic_write(path) as temporary, open(temporary, "wb") as file:
        file.write(np.asarray(MERL_SHAPE, dtype="<i4").tobytes())
        file.write(np.ascontiguousarray(planes).tobytes())


def is_merl(start: bytes, size: int) -> bool:
    """Return whether a file with these first bytes and size looks like a MERL file.

    True as well for one whose dimensions or length are wrong, so that its reader can say so:
    three dimensions of at most four digits that multiply to about the size of the file.
    """
    if len(start) < _HEADER:
        return False
    dimensions = np.frombuffer(start[:_HEADER], dtype="<i4").astype(np.int64)
    if tuple(dimensions) == MERL_SHAPE:
        return True
    return bool(np.all(dimensions > 0)) and size == _HEADER + 24 * int(
        np.prod(dimensions, dtype=object)
    )


def _checked_shape(path: Path) -> tuple[int, int, int]:
    """Return the counts of bins, after checking that the file has that size."""
    size = path.stat().st_size
    with open(path, "rb") as file:
        header = file.read(_HEADER)
    if len(header) < _HEADER:
        raise SimrigError(f"'{path}' is not a MERL file: it has only {size} bytes")
    first, second, third = (int(n) for n in np.frombuffer(header, dtype="<i4"))
    shape = (first, second, third)
    expected = _HEADER + 24 * first * second * third
    if shape != MERL_SHAPE and (min(shape) < 2 or size != expected):
        raise SimrigError(
            f"'{path}' is not a MERL file: its dimensions are {shape}, not {MERL_SHAPE}, and its "
            f"{size} bytes do not fit them"
        )
    if size != expected:
        what = "is truncated" if size < expected else "has trailing bytes"
        raise SimrigError(f"MERL file '{path}' {what}: {size} bytes instead of {expected}")
    return shape

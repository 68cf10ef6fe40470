"""Mean BRDF of a UBO2014 material as ``.npz``: all pairs of 151 directions.

Arrays ``theta`` and ``phi`` (n, radians) and ``f_view_light_rgb`` (n, n, 3): linear RGB, view
first, illumination second. The values are f_r up to one common scale per material, which the
data do not hold: they are left as they are. Nothing is ever unpickled.
"""

from __future__ import annotations

import zipfile
import zlib
from pathlib import Path

import numpy as np

from simrig.brdf.checks import CLAMP, check_values, without_negative
from simrig.brdf.tables.dense import DenseTable
from simrig.brdf.tables.from_samples import tabulated_pairs
from simrig.core.errors import SimrigError
from simrig.directions.spherical import to_vector
from simrig.files.atomic import existing_file

_FIELDS = ("theta", "phi", "f_view_light_rgb")
_MOST_DIRECTIONS = 4096
_MOST_BYTES = 3 * 8 * _MOST_DIRECTIONS**2 + (1 << 20)


def read_ubo(path: str | Path, clamp_negative: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Read directions and values.

    Returns:
        Unit vectors (n, 3), and f_r of shape (n, n, 3) with illumination first.

    Raises:
        SimrigError: not this format, sizes that do not fit, or values that cannot be.
    """
    path = existing_file(path)
    fields = _read_fields(path)
    theta, phi, values = (np.asarray(fields[name], dtype=np.float64) for name in _FIELDS)
    count = len(theta) if theta.ndim == 1 else 0
    if count < 4 or phi.shape != (count,) or values.shape != (count, count, 3):
        raise SimrigError(
            f"the arrays of '{path}' do not fit together: theta {theta.shape}, phi {phi.shape}, "
            f"f_view_light_rgb {values.shape}"
        )
    if not np.all(np.isfinite(theta)) or not np.all(np.isfinite(phi)):
        raise SimrigError(f"'{path}' has NaN or infinite directions")
    if theta.min() < 0.0 or theta.max() >= np.pi / 2:
        raise SimrigError(f"'{path}' has polar angles outside 0° to 90° (radians are expected)")
    values = without_negative(values, clamp_negative)
    check_values(values, f"'{path}'", CLAMP)
    return to_vector(theta, phi), values.transpose(1, 0, 2)


def load_ubo(path: str | Path, clamp_negative: bool = False) -> DenseTable:
    """Read a material and tabulate it (see ``tabulated_pairs``); it is not made reciprocal.

    theta_max is the largest polar angle measured.
    """
    directions, values = read_ubo(path, clamp_negative)
    theta_max = float(np.arccos(directions[:, 2].min()))
    return tabulated_pairs(directions, directions, values, theta_max, Path(path).stem)


def _read_fields(path: Path) -> dict[str, np.ndarray]:
    """Return the arrays after checking what the archive's directory claims."""
    try:
        with zipfile.ZipFile(path) as archive:
            sizes = {entry.filename: entry.file_size for entry in archive.infolist()}
    except zipfile.BadZipFile as error:
        raise SimrigError(f"'{path}' is damaged or truncated: it is no zip archive") from error
    missing = [name for name in _FIELDS if f"{name}.npy" not in sizes]
    if missing:
        raise SimrigError(f"'{path}' is not a UBO2014 material: it lacks {', '.join(missing)}")
    if sum(sizes[f"{name}.npy"] for name in _FIELDS) > _MOST_BYTES:
        raise SimrigError(f"'{path}' claims {sum(sizes.values())} bytes, too many for a material")
    try:
        return {name: _read_array(path, name, sizes[f"{name}.npy"]) for name in _FIELDS}
    except (ValueError, EOFError, OSError, zipfile.BadZipFile, zlib.error) as error:
        raise SimrigError(f"'{path}' is damaged: {' '.join(str(error).split())}") from error


def _read_array(path: Path, name: str, size: int) -> np.ndarray:
    """Read one array whose header agrees with its size; objects are refused by NumPy."""
    with zipfile.ZipFile(path) as archive, archive.open(f"{name}.npy") as member:
        version = np.lib.format.read_magic(member)
        read = np.lib.format.read_array_header_1_0
        if version != (1, 0):
            read = np.lib.format.read_array_header_2_0
        shape, _, dtype = read(member)
        if dtype.kind not in "fiu" or int(np.prod(shape, dtype=object)) * dtype.itemsize > size:
            raise SimrigError(f"array '{name}' of '{path}' claims more than the file holds")
    with np.load(path, allow_pickle=False) as archive:
        return archive[name]

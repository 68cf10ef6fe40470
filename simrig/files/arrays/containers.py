"""Named arrays of ``.npz``, ``.npy`` and ``.mat`` files; nothing is ever unpickled or executed.

MATLAB files of version 4, 5 and 7 are read by SciPy; 7.3 is HDF5, whose axes MATLAB writes in the
opposite order. What an array claims is checked against the file before it is read.
"""

from __future__ import annotations

import io
import warnings
import zipfile
from math import prod
from pathlib import Path

import h5py
import numpy as np

from simrig.core.errors import SimrigError
from simrig.files.atomic import existing_file

NPY_MAGIC = b"\x93NUMPY"
MAT_TEXT = b"MATLAB"  # both versions begin with it, 7.3 before its HDF5
_RATIO = 1100  # of deflate
_HEADROOM = 1 << 16
_MOST_BYTES = 1 << 33
_MOST_ARRAYS = 1024


def read_arrays(path: str | Path) -> dict[str, np.ndarray]:
    """Return the arrays of numbers or text in a file by name; others are left out.

    Raises:
        SimrigError: another file, a damaged one, or arrays larger than it can hold.
    """
    path = existing_file(path)
    with path.open("rb") as file:
        start = file.read(512)
    try:
        if start.startswith(b"PK"):
            arrays = _npz(path)
        elif start.startswith(NPY_MAGIC):
            arrays = {"array": _npy(path, path.read_bytes())}
        elif h5py.is_hdf5(path):
            arrays = _mat73(path)
        else:
            arrays = _mat(path)
    except SimrigError:
        raise
    except MemoryError as error:
        raise SimrigError(f"'{path}' needs more memory than there is") from error
    except Exception as error:  # the libraries raise many kinds for damaged files
        reason = (str(error).strip().splitlines() or [type(error).__name__])[0]
        raise SimrigError(f"'{path}' is damaged or truncated: {reason}") from error
    return {name: a for name, a in arrays.items() if a.dtype.kind in "fiubUS" and a.size}


def is_npy(path: Path) -> bool:
    """Return whether a file is a single NumPy array."""
    with existing_file(path).open("rb") as file:
        return file.read(len(NPY_MAGIC)) == NPY_MAGIC


def _check(path: Path, name: str, claimed: int, available: int) -> None:
    if claimed > _MOST_BYTES or claimed > _RATIO * available + _HEADROOM:
        raise SimrigError(
            f"'{name}' of '{path}' claims {claimed / 1e6:,.1f} MB, more than the file can hold"
        )


def _npz(path: Path) -> dict[str, np.ndarray]:
    arrays = {}
    with zipfile.ZipFile(path) as archive:
        entries = [e for e in archive.infolist() if e.filename.endswith(".npy")]
        if len(entries) > _MOST_ARRAYS:
            raise SimrigError(f"'{path}' claims {len(entries)} arrays")
        for entry in entries:
            name = entry.filename.removesuffix(".npy")
            available = min(entry.compress_size, path.stat().st_size)
            _check(path, name, entry.file_size, available)
            with archive.open(entry) as file:
                content = file.read(entry.file_size)
            arrays[name] = _npy(path, content)
    return arrays


def _npy(path: Path, content: bytes) -> np.ndarray:
    """Return an array of plain numbers; its header is checked against its bytes."""
    file = io.BytesIO(content)
    version = np.lib.format.read_magic(file)
    read = (
        np.lib.format.read_array_header_1_0
        if version == (1, 0)
        else np.lib.format.read_array_header_2_0
    )
    shape, _, dtype = read(file)
    if dtype.hasobject:
        return np.zeros(0)
    if prod(shape) * dtype.itemsize > len(content):
        raise SimrigError(f"'{path}' is truncated: an array claims the shape {shape}")
    file.seek(0)
    return np.asarray(np.lib.format.read_array(file, allow_pickle=False))


def _mat(path: Path) -> dict[str, np.ndarray]:
    from scipy.io import loadmat, whosmat

    size = path.stat().st_size
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of variables that are there twice and the like
        found = whosmat(str(path))
        wanted = []
        for name, shape, kind in found[:_MOST_ARRAYS]:
            if kind not in ("cell", "struct", "object", "function", "opaque", "unknown"):
                _check(path, name, prod(int(n) for n in shape), size)
                wanted.append(name)
        content = loadmat(str(path), variable_names=wanted) if wanted else {}
    arrays = {name: np.asarray(content[name]) for name in wanted if name in content}
    # one line of text is an array of characters
    return {
        name: np.array(a.item()) if a.dtype.kind == "U" and a.size == 1 else a
        for name, a in arrays.items()
    }


def _mat73(path: Path) -> dict[str, np.ndarray]:
    arrays: dict[str, np.ndarray] = {}
    size = path.stat().st_size
    with path.open("rb") as start:
        matlab = start.read(len(MAT_TEXT)) == MAT_TEXT
    with h5py.File(path, "r") as file:
        for name in list(file)[:_MOST_ARRAYS]:
            item = file.get(name, getlink=False) if _is_hard(file, name) else None
            if not isinstance(item, h5py.Dataset) or item.dtype.kind not in "fiub":
                continue
            _check(path, name, item.nbytes, min(item.id.get_storage_size(), size))
            values = np.asarray(item[()])
            kind = item.attrs.get("MATLAB_class", b"")
            if (kind.decode() if isinstance(kind, bytes) else str(kind)) == "char":
                codes = values.T.ravel()[:4096].astype(int)
                arrays[name] = np.array("".join(chr(c) for c in codes if 0 < c < 0x110000))
            else:
                arrays[name] = values.T if matlab or kind else values
    return arrays


def _is_hard(file: h5py.File, name: str) -> bool:
    """Return whether a name is in the file itself and no link out of it."""
    return isinstance(file.get(name, getlink=True), h5py.HardLink)

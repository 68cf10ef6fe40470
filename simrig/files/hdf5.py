"""simrig's own HDF5 files: self-describing, versioned, checked before anything is read.

Every file carries as attributes ``format`` ("simrig"), ``format_version``, ``content`` (what it
holds), ``simrig_version``, ``conventions`` and ``provenance`` (JSON). A BRDF is one group
``structure`` (plain values as attributes) and one group ``data`` (arrays with ``units``).
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any

import h5py
import numpy as np

import simrig
from simrig.brdf.protocol import Brdf
from simrig.core.errors import SimrigError, check_known
from simrig.core.kept import keep, kept
from simrig.files.atomic import atomic_write, existing_file
from simrig.files.full_disk import FileOnFullDisk
from simrig.files.heaps import check_heaps

MAGIC = b"\x89HDF\r\n\x1a\n"
FORMAT_VERSION = 1
CONVENTIONS = (
    "local frame right-handed, z is the surface normal; directions point away from the surface; "
    "theta from +z, phi from +x towards +y, radians; i illumination, v view; values are f_r in "
    "1/sr without the cosine, linear RGB with sRGB primaries"
)
LARGEST_ARRAY = 1 << 32  # bytes; a file that claims more is refused before it is read
_DEFLATE_LIMIT = 1100  # deflate cannot shrink anything by more than 1032
_HEADROOM = 1 << 16
_ORIGIN = "origin"

# what h5py raises for damaged files, and what reading their content may come to
_DAMAGE = (OSError, LookupError, RuntimeError, TypeError, ValueError, AttributeError, MemoryError)

# What files of version 0.1 call things: (now, then)
_NAMES_OF_0_1 = {
    "anisotropy": "probes",
    "brdf": "reflectance",
    "intersections": "corners",
    "minnaert": "lafortune",
    "theta_step": "elevation_step",
    "thetas": "elevations",
}
_NAMES_NOW = {then: now for now, then in _NAMES_OF_0_1.items()}

# Where the class of each kind of BRDF lives; imported when a file needs it
KINDS: dict[str, tuple[str, str]] = {
    "barycentric": ("simrig.brdf.tables.barycentric", "BarycentricBrdf"),
    "btf_factored": ("simrig.btf.factored", "FactoredBtf"),
    "dense": ("simrig.brdf.tables.dense", "DenseTable"),
    "half_difference": ("simrig.brdf.tables.half_difference", "HalfDifferenceTable"),
    "highlight_slices": ("simrig.brdf.slices.highlight_slices", "HighlightSlices"),
    "isotropic": ("simrig.brdf.tables.isotropic", "IsotropicTable"),
    "kurt": ("simrig.brdf.analytic", "Kurt"),
    "minnaert": ("simrig.brdf.minnaert", "Minnaert"),
    "multiaxial": ("simrig.brdf.multiaxial", "Multiaxial"),
    "lambert": ("simrig.brdf.analytic", "Lambert"),
    "rbf": ("simrig.brdf.tables.rbf", "RbfBrdf"),
    "rgl": ("simrig.brdf.tables.rgl", "RglBrdf"),
    "simplex": ("simrig.brdf.tables.simplex", "SimplexTable"),
    "slices": ("simrig.brdf.slices.slices", "SliceBrdf"),
    "ward": ("simrig.brdf.analytic", "Ward"),
}


@contextmanager
def create(
    path: str | Path, content: str, provenance: Mapping[str, Any] | None = None
) -> Iterator[h5py.File]:
    """Give a new file with simrig's attributes; it takes its name only when all went well.

    Args:
        content: what it holds, for example ``"brdf"``.
        provenance: how it came about, anything JSON can hold.
    """
    with (
        atomic_write(path) as temporary,
        FileOnFullDisk(temporary) as stream,
        h5py.File(stream, "w", track_order=True) as file,
    ):
        file.attrs["format"] = "simrig"
        file.attrs["format_version"] = FORMAT_VERSION
        file.attrs["content"] = content
        file.attrs["simrig_version"] = simrig.__version__
        file.attrs["conventions"] = CONVENTIONS
        file.attrs["provenance"] = json.dumps(dict(provenance or {}), sort_keys=True, default=str)
        yield file


@contextmanager
def open_checked(path: str | Path, content: str) -> Iterator[h5py.File]:
    """Open a simrig file for reading after checking what it is.

    Raises:
        SimrigError: not HDF5, not ours, a later version, other content, or damaged inside.
    """
    path = existing_file(path)
    with open(path, "rb") as start:
        if start.read(len(MAGIC)) != MAGIC:
            raise SimrigError(f"'{path}' is not an HDF5 file")
    check_heaps(path)
    try:
        file = h5py.File(path, "r")
    except _DAMAGE as error:
        raise SimrigError(f"HDF5 file '{path}' is damaged or truncated") from error
    with file:
        try:
            _check_attributes(path, file, content)
            yield file
        except SimrigError:
            raise
        except _DAMAGE as error:
            raise SimrigError(f"HDF5 file '{path}' is damaged: {_one_line(error)}") from error


def content_of(path: str | Path) -> str:
    """Return what a simrig file says that it holds; an empty text for any other HDF5 file."""
    try:
        check_heaps(existing_file(path))
        with h5py.File(path, "r") as file:
            ours = _text(file.attrs.get("format")) == "simrig"
            return name_now(_text(file.attrs.get("content"))) if ours else ""
    except _DAMAGE:
        return ""


def name_now(name: str) -> str:
    """Return today's name of what a file of version 0.1 may call otherwise."""
    return _NAMES_NOW.get(name, name)


def names_now(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return attributes or settings of a file by today's names (see ``name_now``)."""
    return {name_now(name): value for name, value in values.items()}


def provenance_of(file: h5py.File) -> dict[str, Any]:
    """Return how a file came about, as given to ``create``."""
    try:
        provenance = json.loads(_text(file.attrs.get("provenance")) or "{}")
    except json.JSONDecodeError as error:
        raise SimrigError(f"the provenance in '{file.filename}' is not JSON") from error
    return provenance if isinstance(provenance, dict) else {}


def write_array(group: h5py.Group, name: str, value: np.ndarray, units: str = "") -> None:
    """Write an array; large ones are compressed (shuffle and deflate, both in every HDF5)."""
    value = np.asarray(value)
    options = {"compression": "gzip", "compression_opts": 1, "shuffle": True}
    dataset = group.create_dataset(name, data=value, **(options if value.nbytes > 4096 else {}))
    if units:
        dataset.attrs["units"] = units


def read_array(group: h5py.Group, name: str, shape: tuple[int | None, ...] | None = None) -> Any:
    """Read a numeric array after checking its size against the file.

    Args:
        shape: what it must be; ``None`` entries match any length.

    Raises:
        SimrigError: missing, not numeric, another shape, or a claimed size that the file cannot
            hold.
    """
    where = f"'{name}' in '{group.file.filename}'"
    dataset = group.get(name)
    if not isinstance(dataset, h5py.Dataset):
        raise SimrigError(f"{where} is missing")
    if dataset.dtype.kind not in "fiub" or dataset.external or dataset.is_virtual:
        raise SimrigError(f"{where} is not a plain numeric array")
    check_claim(dataset, LARGEST_ARRAY)
    if shape is not None and not _matches(dataset.shape, shape):
        raise SimrigError(f"{where} has shape {dataset.shape}, expected {shape}")
    return dataset[()]


def check_claim(dataset: h5py.Dataset, most: int | None = None) -> None:
    """Refuse an array that claims more than is stored of it, or than may be read.

    Args:
        most: bytes that may be read at once.

    Raises:
        SimrigError: its size cannot be that of what the file holds.
    """
    claimed = math.prod(dataset.shape) * dataset.dtype.itemsize
    size = Path(dataset.file.filename).stat().st_size
    stored = min(dataset.id.get_storage_size(), size)  # chunks that were never written take none
    if claimed > _DEFLATE_LIMIT * stored + _HEADROOM or (most is not None and claimed > most):
        raise SimrigError(
            f"'{dataset.name.lstrip('/')}' in '{dataset.file.filename}' claims {claimed:,} bytes, "
            "which its file cannot hold"
        )


def write_brdf(path: str | Path, brdf: Brdf, provenance: Mapping[str, Any] | None = None) -> None:
    """Write a BRDF of a storable kind (see ``KINDS``).

    Raises:
        SimrigError: for a kind that has no stored form.
    """
    kind = brdf.kind
    if kind not in KINDS:
        raise SimrigError(
            f"a BRDF of type {type(brdf).__name__} has no stored form: resample it "
            f"first (storable: {', '.join(sorted(KINDS))})"
        )
    with create(path, "brdf", provenance) as file:
        file.attrs["kind"] = kind
        file.attrs["name"] = brdf.name
        file.attrs["theta_max_deg"] = float(np.degrees(brdf.theta_max))
        structure = file.create_group("structure")
        for key, value in brdf.structure().items():
            structure.attrs[key] = value
        data = file.create_group("data")
        for key, array in brdf.data().items():
            write_array(data, key, array, "1/sr" if np.ndim(array) > 1 else "")


def read_brdf(path: str | Path) -> Brdf:
    """Read a BRDF that ``write_brdf`` wrote.

    Raises:
        SimrigError: as ``open_checked`` and ``read_array``; an unknown kind; parts that do not
            fit together.
    """
    with open_checked(path, "brdf") as file:
        kind = name_now(_text(file.attrs.get("kind")))
        check_known("kind of stored reflectance", kind, KINDS)
        module, class_name = KINDS[kind]
        attributes = file["structure"].attrs.items()
        structure = names_now({key: _plain(value) for key, value in attributes})
        data = {key: np.asarray(read_array(file["data"], key)) for key in file["data"]}
        for array in data.values():
            array.flags.writeable = False  # nobody else has it: no copy is needed
        build: type[Brdf] = getattr(import_module(module), class_name)
        try:
            name = _text(file.attrs.get("name")) or Path(path).stem
            brdf = build.from_parts(structure, names_now(data), name)
            keep(brdf, _ORIGIN, provenance_of(file))
            return brdf
        except SimrigError as error:
            raise SimrigError(f"'{path}': {error}") from error
        except (KeyError, ValueError, TypeError, IndexError) as error:
            raise SimrigError(
                f"the parts of '{path}' do not make a '{kind}' BRDF: {_one_line(error)}"
            ) from error


def origin(brdf: Brdf) -> dict[str, Any]:
    """Return how a BRDF that ``read_brdf`` returned came about; nothing of any other."""
    known: dict[str, Any] = kept(brdf, _ORIGIN, dict)
    return known


def _check_attributes(path: Path, file: h5py.File, content: str) -> None:
    if _text(file.attrs.get("format")) != "simrig":
        raise SimrigError(f"HDF5 file '{path}' was not written by simrig")
    version = file.attrs.get("format_version", 0)
    if not isinstance(version, int | np.integer) or version < 1:
        raise SimrigError(f"'{path}' has no valid format version")
    if version > FORMAT_VERSION:
        raise SimrigError(
            f"'{path}' has format version {version}, this simrig reads up to {FORMAT_VERSION}: "
            "install a later simrig"
        )
    found = name_now(_text(file.attrs.get("content")))
    if found != content:
        raise SimrigError(f"'{path}' holds a {found or 'nothing known'}, expected a {content}")


def _matches(found: tuple[int, ...], expected: tuple[int | None, ...]) -> bool:
    return len(found) == len(expected) and all(
        wanted is None or wanted == length for length, wanted in zip(found, expected, strict=True)
    )


def _text(value: Any) -> str:
    if isinstance(value, bytes | np.bytes_):
        return value.decode("utf-8", errors="replace")
    return value if isinstance(value, str) else ""


def _plain(value: Any) -> Any:
    """Return an attribute as a plain Python value."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    return _text(value) if isinstance(value, bytes) else value


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())[:200]

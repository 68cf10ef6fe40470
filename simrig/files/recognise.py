"""What a file is, by its content: a format of materials, or something else that has a name."""

from __future__ import annotations

import re
import zipfile
from pathlib import Path

from simrig.core.errors import SimrigError
from simrig.files import alta, astm, bird, cornell, hdf5, merl, utia, zemax
from simrig.files.arrays.containers import MAT_TEXT, NPY_MAGIC
from simrig.files.atomic import existing_file
from simrig.files.formats import FORMATS
from simrig.files.pictures.reader import NOT_READ, PICTURES
from simrig.files.rgl import tensor_file
from simrig.files.window.xml import is_window_xml

_START = 4096  # bytes that are looked at to find out what a file is
_XML_START = 1 << 16  # the structure of a BSDF stands behind the description of its material
_UBO_FIELD = "f_view_light_rgb.npy"
_INSTEAD = "not read: convert it to ASTM E2387 text, BiRD JSON, Klems XML or a NumPy array"

_MAGIC = {
    tensor_file.MAGIC: "rgl",
    b"\x76\x2f\x31\x01": "utia-exr",
    MAT_TEXT: "mat",
    NPY_MAGIC: "npz",
    hdf5.MAGIC: "hdf5",
}
_BONN = (
    "a factored BTF of the University of Bonn (UBO2014, ATRIUM), not read: unpack its pictures "
    "with Bonn's btflib or btf_extractor, then 'simrig btf convert'"
)
_OTHER = {
    b"#?": "a Radiance HDR picture (an environment map?)",
    b"\x89PNG": "a PNG picture",
    b"\xff\xd8\xff": "a JPEG picture",
    **NOT_READ,
    b"!DFMF": _BONN,
    b"!FMF": _BONN,
    b"!B6b": _BONN,
    b"\x80\x02": "a Python pickle, which is never opened",
    b"\x80\x03": "a Python pickle, which is never opened",
    b"\x80\x04": "a Python pickle, which is never opened",
    b"\x80\x05": "a Python pickle, which is never opened",
    b"%PDF": "a PDF document",
    b"\x1f\x8b": "a gzip archive: unpack it first",
    b"7z\xbc\xaf\x27\x1c": "a 7-Zip archive: unpack it first",
    b"Rar!": "a RAR archive: unpack it first",
}
_ENDINGS = {
    ".btf": _BONN,
    ".axf": f"an X-Rite AxF file, {_INSTEAD}",
    ".u3m": f"a U3M material, {_INSTEAD}",
    ".serialized": "a Mitsuba mesh",
}
# Text formats that people of this trade bring, by what stands in their headers
_TEXTS: tuple[tuple[str, str], ...] = (
    (r"^\s*ScatterRadial\b", f"a LightTools BSDF file, {_INSTEAD}"),
    (r"^\s*TypeSym\b", f"an Integra diffuse or specular distribution, {_INSTEAD}"),
    (r"^OPTIS\b", f"a surface file of Ansys Speos, {_INSTEAD}"),
    (r"^#\s*(Measurement by|data written using) ?pab|^#intheta\b", f"a pab-opto file, {_INSTEAD}"),
    (r"^\s*VERSION.*\bSSDD\b|^\s*ssdd_version\b", f"a surface scattering distribution, {_INSTEAD}"),
    (r"^IESNA", "an IES light distribution"),
    (r"^\s*<scene\b", "a Mitsuba scene"),
    (r"^\s*newmtl\b", "a Wavefront material library"),
)


def file_format(path: str | Path) -> str:
    """Return the name in ``FORMATS`` of what a file holds, by its content.

    Raises:
        SimrigError: when it is no material, saying what it is where that is known.
    """
    path = existing_file(path)
    size = path.stat().st_size
    with open(path, "rb") as file:
        start = file.read(_START)
    if not start:
        raise SimrigError(f"'{path}' is empty")
    if start.startswith(b"PK"):
        return _archive(path)
    for magic, name in _MAGIC.items():
        if start.startswith(magic):
            return name
    for magic, what in _OTHER.items():
        if start.startswith(magic):
            raise _other(path, what)
    text = _as_text(start)
    if text is not None:
        return _text_format(path, text)
    if start.startswith(b"#") and b"#PARAM_IN" in start:
        raise _other(path, "a binary ALTA file, not read: data2data writes it as text")
    if path.suffix.lower() in _ENDINGS:
        raise _other(path, _ENDINGS[path.suffix.lower()])
    if merl.is_merl(start, size) or path.suffix == ".binary":
        return "merl"
    if size == utia.DATABASE.bytes or path.suffix == ".bin":
        return "utia"
    if path.suffix == ".mat":  # of version 4, which begins with nothing of its own
        return "mat"
    raise SimrigError(
        f"'{path}' is of no format that is known (known: {', '.join(sorted(FORMATS))})"
    )


def _other(path: Path, what: str) -> SimrigError:
    """Return the error for a file that has a name and is no material that is read."""
    return SimrigError(f"'{path}' is {what}" + ("" if ", not read" in what else ", not a material"))


def _archive(path: Path) -> str:
    """Return the format of a zip archive."""
    try:
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
    except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError):
        raise SimrigError(f"'{path}' is damaged or truncated: it is no zip archive") from None
    if _UBO_FIELD in names:
        return "ubo"
    if any(name.endswith(".npy") for name in names):
        return "npz"
    endings = {suffix for kind in PICTURES.values() for suffix in kind.suffixes}
    pictures = sum(Path(name).suffix.lower() in endings for name in names)
    if pictures:
        raise SimrigError(
            f"'{path}' is a zip archive of {pictures} pictures (a BTF? 'simrig btf convert'), not "
            "a material"
        )
    raise SimrigError(f"'{path}' is a zip archive, not a material: unpack it first")


def _text_format(path: Path, text: str) -> str:
    if text.lstrip("\ufeff").lstrip().startswith("<"):
        return _xml_format(path)
    if alta.is_alta(text):
        return "alta"
    if cornell.is_cornell(text):
        return "cornell"
    if astm.is_astm(text):
        return "astm"
    if bird.is_bird(text):
        return "bird"
    if zemax.is_zemax(text):
        return "zemax"
    for pattern, what in _TEXTS:
        if re.search(pattern, text, re.MULTILINE):
            raise _other(path, what)
    if text.lstrip().startswith("{"):
        raise SimrigError(
            f"'{path}' is JSON, but no BRDF of the BiRD format (no 'metadata'): not a material"
        )
    rows = [line.split() for line in text.splitlines()[:-1] if line.strip() and line[0] != "#"]
    numeric = rows and all(_is_number(word) for row in rows for word in row)
    if numeric and all(len(row) == 2 for row in rows):
        raise SimrigError(
            f"'{path}' is a table of two columns (a spectrum: wavelength and value), not a material"
        )
    what = f"a table of {len(rows[0])} numeric columns" if numeric else "a text file"
    raise SimrigError(
        f"'{path}' is {what}, not a material of a known text format (alta, astm, bird, cornell)"
    )


def _xml_format(path: Path) -> str:
    with open(path, "rb") as file:
        text = file.read(_XML_START).decode("utf-8", errors="replace")
    if is_window_xml(text):
        return "tensor-tree" if "TensorTree" in text else "klems"
    what = "a Mitsuba scene" if re.search(r"<scene\b", text) else "an XML file (a scene?)"
    raise _other(path, what)


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _as_text(start: bytes) -> str | None:
    """Return the start of a file as text, or None when it is binary."""
    if b"\0" in start:
        return None
    try:
        return start.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        # a character may be cut at the end of what was read
        return start[: error.start].decode("utf-8-sig") if error.start > len(start) - 4 else None

"""ICC colour profiles of matrix and curve type (ICC.1:2022), as pictures carry them.

Curves to linear light, then the matrix to XYZ under D50, adapted to D65 by Bradford, to linear
sRGB. Profiles of look-up tables (printers, some scanners) are refused by their name.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from simrig.core.errors import SimrigError
from simrig.files.pictures import primaries

_MOST_TAGS = 256
_MOST_ENTRIES = 1 << 16
_TABLES = ("A2B0", "A2B1", "D2B0")  # that a profile may hold beside its matrix
# transfer characteristics of ITU-T H.273 whose values are no share of a display's white
HDR = {16: "perceptual quantizer, SMPTE ST 2084", 18: "hybrid log-gamma, ARIB STD-B67"}

Curve = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Profile:
    """A profile that can be applied.

    Attributes:
        decode: encoded values in [0, 1], (height, width, channels), to linear ones.
        matrix: linear device RGB to linear sRGB; None for grey.
    """

    name: str
    decode: Curve
    matrix: np.ndarray | None


def read_profile(content: bytes, what: str, grey: bool = False) -> Profile:
    """Read a profile.

    Args:
        what: the picture, for messages.
        grey: the picture has one channel.

    Raises:
        SimrigError: a damaged profile, or one that is not of matrix and curves.
    """
    try:
        tags = _tags(content)
        name = _description(tags.get("desc", b"")) or "unnamed"
        space = content[16:20].decode("latin-1").strip()
        if (transfer := tags.get("cicp", bytes(12))[9]) in HDR:
            raise SimrigError(
                f"{what} has the HDR profile '{name}' ({HDR[transfer]}), which is not read: "
                "convert it to sRGB, or to OpenEXR"
            )
        if space == "GRAY" and "kTRC" in tags:
            return Profile(name, _each([_curve(tags["kTRC"])]), None)
        if space != "RGB" or not {"rXYZ", "gXYZ", "bXYZ", "rTRC", "gTRC", "bTRC"} <= set(tags):
            raise SimrigError(
                f"{what} has the {space} profile '{name}' of look-up tables, which is not read: "
                "convert it to sRGB first"
            )
        if grey:
            return Profile(name, _each([_curve(tags["gTRC"])]), None)
        if tables := [tag for tag in _TABLES if tag in tags]:
            name += f" (its matrix and curves; its look-up table {tables[0]} is not used)"
        columns = np.stack([_xyz(tags[f"{c}XYZ"]) for c in "rgb"], axis=-1)
        curves = [_curve(tags[f"{c}TRC"]) for c in "rgb"]
    except (struct.error, ValueError, IndexError, KeyError) as error:
        if isinstance(error, SimrigError):
            raise
        raise SimrigError(f"{what} is damaged: its colour profile is broken") from error
    to_d65 = primaries.adaptation(primaries.D50, primaries.D65)
    from_xyz = np.linalg.inv(primaries.rgb_to_xyz(primaries.SRGB, "sRGB"))
    matrix = from_xyz @ to_d65 @ columns
    if not np.all(np.isfinite(matrix)) or abs(np.linalg.det(columns)) < 1e-8:
        raise SimrigError(f"{what} is damaged: its colour profile '{name}' has no usable primaries")
    same = np.allclose(matrix, np.eye(3), atol=2e-3)
    return Profile(name, _each(curves), None if same else matrix)


def _tags(content: bytes) -> dict[str, bytes]:
    if content[36:40] != b"acsp":
        raise ValueError("no profile")
    (count,) = struct.unpack(">I", content[128:132])
    tags = {}
    for number in range(min(count, _MOST_TAGS)):
        start = 132 + 12 * number
        name, offset, size = struct.unpack(">4sII", content[start : start + 12])
        tags[name.decode("latin-1")] = content[offset : offset + size]
    return tags


def _description(tag: bytes) -> str:
    if tag[:4] == b"desc":
        (length,) = struct.unpack(">I", tag[8:12])
        return tag[12 : 12 + min(length, 200)].split(b"\0")[0].decode("latin-1")
    if tag[:4] == b"mluc":
        length, offset = struct.unpack(">II", tag[20:28])
        return tag[offset : offset + min(length, 400)].decode("utf-16-be", "replace")
    return ""


def _xyz(tag: bytes) -> np.ndarray:
    if tag[:4] != b"XYZ ":
        raise ValueError("no XYZ")
    return np.array(struct.unpack(">3i", tag[8:20])) / 65536.0


def _curve(tag: bytes) -> Curve:
    kind = tag[:4]
    if kind == b"curv":
        (count,) = struct.unpack(">I", tag[8:12])
        if count == 0:
            return lambda x: x
        if count == 1:
            return _power(struct.unpack(">H", tag[12:14])[0] / 256.0)
        if count > _MOST_ENTRIES:
            raise ValueError("curve")
        table = np.frombuffer(tag, ">u2", count, 12).astype(np.float64) / 65535.0
        nodes = np.linspace(0.0, 1.0, count)
        return lambda x: np.interp(x, nodes, table)
    if kind == b"para":
        (form,) = struct.unpack(">H", tag[8:10])
        count = (1, 3, 4, 5, 7)[form]
        values = np.array(struct.unpack(f">{count}i", tag[12 : 12 + 4 * count])) / 65536.0
        return _parametric(form, values)
    raise ValueError("curve")


def _power(exponent: float) -> Curve:
    if not 0.01 <= exponent <= 100.0:
        raise ValueError("gamma")
    return lambda x: x**exponent


def _parametric(form: int, values: np.ndarray) -> Curve:
    """Return a curve of type 0 to 4 (ICC.1 section 10.18)."""
    if form == 0:
        return _power(float(values[0]))
    g, a, b = values[:3]
    c = d = e = f = 0.0
    if form == 1:
        d = -b / a if a else 0.0
    elif form == 2:
        d, e, f = (-b / a if a else 0.0), values[3], values[3]
    elif form >= 3:
        c, d = values[3:5]
    if form == 4:
        e, f = values[5:7]
    if not 0.01 <= g <= 100.0:
        raise ValueError("gamma")
    return lambda x: np.where(x >= d, np.maximum(a * x + b, 0.0) ** g + e, c * x + f)


def _each(curves: list[Curve]) -> Curve:
    def decode(values: np.ndarray) -> np.ndarray:
        out = np.empty(values.shape, dtype=np.float32)
        for number in range(values.shape[-1]):
            out[..., number] = curves[min(number, len(curves) - 1)](values[..., number])
        return out

    return decode

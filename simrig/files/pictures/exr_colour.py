"""The colour space that an OpenEXR header states: three attributes, which must agree."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from simrig.core.colour import FROM_XYZ
from simrig.core.errors import SimrigError
from simrig.files.pictures import primaries

# Names that OpenImageIO, Blender and others write where values are linear and nothing more is said
_LINEAR = {"linear", "scene_linear", "scene-linear", "lin", "rendering", "default", ""}
_NOT_COLOUR = {"raw", "data", "non-color", "noncolor", "unknown", "ncd"}
_SPACES = {
    "rec709": primaries.SRGB,
    "srgb": primaries.SRGB,
    "ap0": primaries.ACES,
    "ap1": (0.713, 0.293, 0.165, 0.83, 0.128, 0.044, 0.32168, 0.33767),
    "rec2020": (0.708, 0.292, 0.17, 0.797, 0.131, 0.046, 0.3127, 0.329),
    "p3d65": (0.68, 0.32, 0.265, 0.69, 0.15, 0.06, 0.3127, 0.329),
    "adobergb": primaries.ADOBE_RGB,
    "ciexyzd65": (1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0 / 3.0, 1.0 / 3.0),
}
_ALIASES = {
    "acescg": "lin_ap1",
    "aces2065-1": "lin_ap0",
    "lin_srgb": "lin_rec709",
    "linear rec.709": "lin_rec709",
    "linear rec.709 (srgb)": "lin_rec709",
    "linear bt.709": "lin_rec709",
    "scene-linear rec.709-srgb": "lin_rec709",
    "utility - linear - srgb": "lin_rec709",
    "linear srgb": "lin_rec709",
    "linear rec.2020": "lin_rec2020",
    "linear p3-d65": "lin_p3d65",
    "linear cie-xyz d65": "lin_ciexyzd65",
    "srgb": "srgb_rec709",
    "adobergb": "g22_adobergb",
}


@dataclass(frozen=True)
class ColourSpace:
    """How stored colours become linear sRGB.

    Attributes:
        matrix: applied to linear colours, None for the identity.
        decode: applied before, None where values are linear.
        chromaticities: the primaries that the file states, None without.
        made: what that means, for people.
    """

    matrix: np.ndarray | None = None
    decode: Callable[[np.ndarray], np.ndarray] | None = None
    chromaticities: tuple[float, ...] | None = None
    made: list[str] = field(default_factory=list)


def colour_space(header: dict[str, Any], what: str, xyz: bool) -> ColourSpace:
    """Return the colour space of a part.

    Args:
        what: the file, for messages.
        xyz: its channels are named X, Y, Z.

    Raises:
        SimrigError: attributes that contradict each other, or name what is not read.
    """
    stated = _chromaticities(header, what)
    said, decode, made = None, None, []
    for key in ("colorInteropID", "oiio:ColorSpace"):
        if key in header:
            other, curve = _interop(str(header[key]), f"{what} says {key} '{header[key]}'")
            decode = curve or decode
            if curve is not None:
                made.append(f"decoded: {header[key]}")
            if other is not None and said is not None and not _same(other, said):
                raise SimrigError(f"{what} states two colour spaces: it contradicts itself")
            said = other or said
    if stated is not None and said is not None and not _same(stated, said):
        raise SimrigError(
            f"{what} contradicts itself: its chromaticities are {primaries.named(stated)}, its "
            f"colour space is '{header.get('colorInteropID', header.get('oiio:ColorSpace'))}'"
        )
    chromaticities = stated or said
    if xyz:
        return ColourSpace(FROM_XYZ, decode, chromaticities, [*made, "CIE XYZ to RGB"])
    if chromaticities is None:
        return ColourSpace(None, decode, None, made)
    matrix = primaries.to_srgb(chromaticities, what)
    if matrix is not None:
        to = (
            "CIE XYZ to RGB" if primaries.is_xyz(chromaticities) else "from its primaries to sRGB's"
        )
        made.append(f"{to}: {primaries.named(chromaticities)}")
    return ColourSpace(matrix, decode, chromaticities, made)


def _chromaticities(header: dict[str, Any], what: str) -> tuple[float, ...] | None:
    if "chromaticities" not in header:
        # an ACES container says so by its flag alone (SMPTE ST 2065-4)
        return primaries.ACES if header.get("acesImageContainerFlag") == 1 else None
    try:
        values = tuple(float(v) for v in np.ravel(header["chromaticities"]))
    except (TypeError, ValueError) as error:
        raise SimrigError(f"{what} states chromaticities that cannot be read") from error
    if len(values) != 8:
        raise SimrigError(f"{what} states {len(values)} chromaticities instead of 8")
    return values


def _interop(
    name: str, what: str
) -> tuple[tuple[float, ...] | None, Callable[[np.ndarray], np.ndarray] | None]:
    """Return primaries and decoding of a colour interop ID or another common name."""
    text = name.strip().lower()
    if text in _LINEAR or text in _NOT_COLOUR:
        return None, None
    text = _ALIASES.get(text, text)
    words = text.removesuffix("_scene").removesuffix("_display").split("_")
    if len(words) != 2 or words[1] not in _SPACES or words[0] not in _CURVES:
        raise SimrigError(f"{what}, which is not read: convert it to linear RGB first")
    return _SPACES[words[1]], _CURVES[words[0]]


def _same(a: tuple[float, ...], b: tuple[float, ...]) -> bool:
    return bool(np.allclose(a, b, atol=2e-3, rtol=0.0))


def _power(exponent: float) -> Callable[[np.ndarray], np.ndarray]:
    def decode(values: np.ndarray) -> np.ndarray:
        return np.asarray(np.sign(values) * np.abs(values) ** np.float32(exponent), np.float32)

    return decode


def _srgb(values: np.ndarray) -> np.ndarray:
    size = np.abs(values)
    linear = np.where(size <= 0.04045, size / 12.92, ((size + 0.055) / 1.055) ** 2.4)
    return np.asarray(np.sign(values) * linear, np.float32)


_CURVES: dict[str, Callable[[np.ndarray], np.ndarray] | None] = {
    "lin": None,
    "srgb": _srgb,
    "g18": _power(1.8),
    "g22": _power(2.2),
    "g24": _power(2.4),
}

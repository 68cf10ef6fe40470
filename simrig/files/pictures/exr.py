"""OpenEXR pictures: parts, layers, windows, primaries, XYZ and luminance-chroma, tiles and levels.

Channels R, G, B are colour, X, Y, Z without a layer's name CIE XYZ (as Mitsuba writes them), Y with
RY and BY luminance and chroma (Rec. 709 or the primaries that the file states), Y alone grey. Of
several layers the unnamed one is the picture, or the one whose name says so; otherwise it is asked
for. Colours are premultiplied by alpha, so they stand as on black. The result is the whole display
window, black where the data window holds nothing; what lies outside of it is cut off.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from simrig.core.errors import SimrigError, unknown_name
from simrig.files.pictures import luminance_chroma, primaries
from simrig.files.pictures.exr_colour import colour_space
from simrig.files.pictures.exr_library import watched
from simrig.files.pictures.picture import Box, Decoded, check_claim, check_size

MAGIC = b"\x76\x2f\x31\x01"
_MOST_BYTES = 1 << 32  # of all channels of all parts together, for the library reads them all
_SMALL = 1 << 20  # pixels of a display window that may be empty
_MOST_EMPTY = 64  # times its data window that a larger display window may be
_SMALLEST, _LARGEST = 2.0, 4.0  # bytes of a channel; a header read alone does not say which
# Most bytes that a byte unpacks to; constant pictures reach a quarter of it with the others
_RATIO = {"NO": 1.0, "RLE": 64.0, "ZIP": 1400.0, "ZIPS": 1400.0, "PXR24": 1900.0, "B44": 16.0}
_OTHER_RATIO = float(1 << 17)
_COLOURS = {"R": "R", "G": "G", "B": "B", "RED": "R", "GREEN": "G", "BLUE": "B"}
_MAIN = ("", "rgba", "rgb", "xyz", "xyza", "beauty", "combined", "image", "color", "colour")


@dataclass(frozen=True)
class _Layer:
    """Channels of one part that make a picture.

    Attributes:
        name: what people would call it: the part's name, then the layer's.
        kind: ``"rgb"``, ``"xyz"``, ``"chroma"`` or ``"grey"``.
        channels: full names, in the order of ``kind``.
        alpha: full name of its alpha, if any.
    """

    part: int
    name: str
    kind: str
    channels: tuple[str, ...]
    alpha: str | None


def read(path: Path, layer: str | None = None) -> Decoded:
    """Read one layer of an OpenEXR file.

    Args:
        layer: its name, where a file has several.

    Raises:
        SimrigError: a damaged file, deep data, no colours, several layers and none named, values
            that are encoded in a way that is not read.
    """
    headers = _headers(path)
    _check(path, headers)
    layers = [found for number, header in enumerate(headers) for found in _layers(number, header)]
    chosen = _choose(path, layers, layer, headers)
    header = headers[chosen.part]
    space = colour_space(header, f"'{path}'", chosen.kind == "xyz")
    planes = _planes(path, chosen)
    made = []
    if len(layers) > 1:
        others = ", ".join(repr(other.name or "main") for other in layers if other is not chosen)
        made.append(f"layer '{chosen.name or 'main'}' taken; others with colours: {others}")
    if chosen.kind == "chroma":
        stated = space.chromaticities or primaries.SRGB
        weights = primaries.rgb_to_xyz(stated, f"'{path}'")[1]
        pixels = luminance_chroma.to_rgb(planes[0], planes[1], planes[2], weights / weights.sum())
        made.append("luminance and chroma to RGB")
    else:
        pixels = np.stack([_full(path, plane, planes[0].shape) for plane in planes], axis=-1)
    if space.decode is not None:
        pixels = space.decode(pixels)
    if chosen.kind != "grey":
        pixels = primaries.apply(space.matrix, pixels)
    made += space.made if chosen.kind != "grey" else [m for m in space.made if "decoded" in m]
    pixels, window, placed = _placed(path, header, pixels)
    says = _says(header, chosen, headers)
    return Decoded(pixels, says, (*made, *placed), window)


def read_header(path: Path) -> dict[str, Any]:
    """Return the attributes of the first part; empty where the header is broken."""
    try:
        return _headers(path)[0]
    except SimrigError:
        return {}


def _headers(path: Path) -> list[dict[str, Any]]:
    import OpenEXR

    try:
        with watched() as said, OpenEXR.File(str(path), header_only=True) as file:
            headers = [dict(part.header) for part in file.parts]
    except Exception as error:  # the binding raises bare exceptions of several types
        raise SimrigError(f"'{path}' is a damaged OpenEXR file: its header is broken") from error
    if said.getvalue() or not headers:
        raise SimrigError(f"'{path}' is a damaged OpenEXR file: its header is broken")
    return headers


def _box(header: dict[str, Any], key: str) -> Box:
    low, high = (np.asarray(corner, dtype=np.int64) for corner in header[key])
    return int(low[0]), int(low[1]), int(high[0]) + 1, int(high[1]) + 1


def _check(path: Path, headers: list[dict[str, Any]]) -> None:
    """Refuse sizes that cannot be, before a pixel is read."""
    available, total = path.stat().st_size, 0.0
    for header in headers:
        try:
            boxes = [_box(header, key) for key in ("dataWindow", "displayWindow")]
            channels = _channels_of_a_pixel(header)
        except (KeyError, ValueError, TypeError, OverflowError) as error:
            raise SimrigError(
                f"'{path}' is a damaged OpenEXR file: its header is broken"
            ) from error
        if str(header.get("type", "")).rsplit(".", 1)[-1].startswith("deep"):
            raise SimrigError(f"'{path}' holds deep pixels (several depths each): flatten it first")
        for name, (left, top, right, bottom) in zip(("data", "display"), boxes, strict=True):
            check_size(path, right - left, bottom - top, f"its {name} window")
        left, top, right, bottom = boxes[0]
        claimed = (right - left) * (bottom - top) * channels
        name = str(header.get("compression", "")).rsplit(".", 1)[-1].removesuffix("_COMPRESSION")
        ratio = _RATIO.get(name, _OTHER_RATIO)
        check_claim(path, "OpenEXR", _SMALLEST * claimed, available, ratio)
        total += _LARGEST * claimed
    if total > _MOST_BYTES:
        raise SimrigError(
            f"the parts and layers of '{path}' hold {total / 1e9:.1f} GB together: write the "
            "colours alone to a file"
        )


def _channels_of_a_pixel(header: dict[str, Any]) -> float:
    """Return how many values a pixel has, subsampled ones counted by their share."""
    total = 0.0
    for channel in header["channels"]:
        if channel.xSampling < 1 or channel.ySampling < 1:
            raise ValueError("sampling")
        total += 1.0 / (channel.xSampling * channel.ySampling)
    return total


def _layers(part: int, header: dict[str, Any]) -> list[_Layer]:
    """Return what can be a picture among the channels of a part."""
    groups: dict[str, dict[str, str]] = {}
    for channel in header["channels"]:
        layer, _, base = channel.name.rpartition(".")
        groups.setdefault(layer, {})[base.upper()] = channel.name
    label = str(header.get("name", "") or "")
    found = []
    for layer, bases in groups.items():
        for long, short in _COLOURS.items():
            if long in bases:
                bases.setdefault(short, bases[long])
        name = ".".join(text for text in (label, layer) if text)
        alpha = bases.get("A", bases.get("ALPHA"))
        for kind, wanted in (("rgb", "RGB"), ("xyz", "XYZ")):
            # in a named layer X, Y, Z are a normal, a position or a motion
            if set(wanted) <= set(bases) and (kind == "rgb" or not layer):
                channels = tuple(bases[letter] for letter in wanted)
                found.append(_Layer(part, name, kind, channels, alpha))
                break
        else:
            if "Y" in bases and not {"X", "Z"} & set(bases):
                chroma = {"RY", "BY"} <= set(bases)
                wanted_names = ("Y", "RY", "BY") if chroma else ("Y",)
                channels = tuple(bases[letter] for letter in wanted_names)
                kind = "chroma" if chroma else "grey"
                found.append(_Layer(part, name, kind, channels, alpha))
    return found


def _choose(
    path: Path, layers: list[_Layer], wanted: str | None, headers: list[dict[str, Any]]
) -> _Layer:
    if not layers:
        names = [channel.name for header in headers for channel in header["channels"]]
        shown = ", ".join(names[:12]) + (", ..." if len(names) > 12 else "")
        raise SimrigError(f"'{path}' has no channels R, G, B or Y, only: {shown}")
    if wanted is not None:
        for layer in layers:
            if layer.name.lower() == wanted.lower() or (wanted == "main" and not layer.name):
                return layer
        raise unknown_name(f"layer of '{path}'", wanted, [la.name or "main" for la in layers])
    coloured = [layer for layer in layers if layer.kind != "grey"] or layers
    if len(coloured) == 1:
        return coloured[0]
    for name in _MAIN:
        matching = [la for la in coloured if la.name.rpartition(".")[2].lower() == name]
        if len(matching) == 1:
            return matching[0]
    # Mitsuba's and Nuke's own: the channels without a layer of a single part
    unnamed = [la for la in coloured if "." not in la.channels[0]]
    if len(headers) == 1 and len(unnamed) == 1:
        return unnamed[0]
    listed = ", ".join(la.name or "main" for la in layers[:12])
    raise SimrigError(
        f"'{path}' has several layers with colours ({listed}): name one, --layer NAME"
    )


def _planes(path: Path, layer: _Layer) -> list[np.ndarray]:
    """Return the channels as float32 arrays, in their own resolution."""
    import OpenEXR

    try:
        with watched() as said, OpenEXR.File(str(path), separate_channels=True) as file:
            channels = file.parts[layer.part].channels
            planes = [np.asarray(channels[name].pixels) for name in layer.channels]
    except Exception as error:  # the binding raises bare exceptions of several types
        raise SimrigError(f"'{path}' is a damaged OpenEXR file: pixels are missing") from error
    # chunks that are missing or broken are printed, and their pixels are whatever was there
    if said.getvalue() or any(plane.ndim != 2 or plane.size == 0 for plane in planes):
        raise SimrigError(f"'{path}' is a damaged OpenEXR file: pixels are missing")
    with np.errstate(over="ignore", invalid="ignore"):
        return [plane.astype(np.float32, copy=False) for plane in planes]


def _full(path: Path, plane: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    if plane.shape != shape:
        raise SimrigError(
            f"'{path}' stores its colours in different resolutions, {shape} and {plane.shape}; "
            "only luminance and chroma are read that way"
        )
    return plane


def _placed(
    path: Path, header: dict[str, Any], pixels: np.ndarray
) -> tuple[np.ndarray, Box | None, tuple[str, ...]]:
    """Return the display window, the part of it that the file holds, and what was done."""
    display, data = _box(header, "displayWindow"), _box(header, "dataWindow")
    if (data[2] - data[0], data[3] - data[1]) != pixels.shape[1::-1]:
        raise SimrigError(f"'{path}' is a damaged OpenEXR file: its windows do not fit its pixels")
    if data == display:
        return pixels, None, ()
    width, height = display[2] - display[0], display[3] - display[1]
    window = (
        max(data[0], display[0]) - display[0],
        max(data[1], display[1]) - display[1],
        min(data[2], display[2]) - display[0],
        min(data[3], display[3]) - display[1],
    )
    left, top, right, bottom = window
    if right <= left or bottom <= top:
        raise SimrigError(
            f"'{path}' shows nothing: its data window ({data[0]}, {data[1]}) to "
            f"({data[2] - 1}, {data[3] - 1}) lies outside of its display window"
        )
    held = pixels.shape[0] * pixels.shape[1]
    if width * height > max(_SMALL, _MOST_EMPTY * held):
        raise SimrigError(
            f"'{path}' holds {pixels.shape[1]} × {pixels.shape[0]} pixels of a display window of "
            f"{width} × {height}: crop the window first"
        )
    whole = np.zeros((height, width, pixels.shape[2]), dtype=np.float32)
    row, column = top + display[1] - data[1], left + display[0] - data[0]
    whole[top:bottom, left:right] = pixels[row : row + bottom - top, column : column + right - left]
    made = f"data window placed in the display window of {width} × {height} pixels"
    return whole, (None if window == (0, 0, width, height) else window), (made,)


def _says(header: dict[str, Any], layer: _Layer, headers: list[dict[str, Any]]) -> dict[str, str]:
    """Return what the header says about the values and their places."""
    data, display = _box(header, "dataWindow"), _box(header, "displayWindow")
    says = {
        "channels": ", ".join(channel.name for channel in header["channels"]),
        "used": ", ".join(layer.channels),
        "compression": str(header.get("compression", "")).rsplit(".", 1)[-1],
        "data window": f"({data[0]}, {data[1]}) to ({data[2] - 1}, {data[3] - 1})",
        "display window": f"({display[0]}, {display[1]}) to ({display[2] - 1}, {display[3] - 1})",
    }
    if len(headers) > 1:
        says["parts"] = ", ".join(str(h.get("name", "?")) for h in headers)
    if layer.alpha is not None:
        says["alpha"] = f"{layer.alpha}: colours are premultiplied, as on black"
    for key in (
        "type",
        "chromaticities",
        "colorInteropID",
        "oiio:ColorSpace",
        "whiteLuminance",
        "adoptedNeutral",
        "pixelAspectRatio",
        "envmap",
        "multiView",
        "view",
        "acesImageContainerFlag",
        "comments",
        "simrigUtiaLayout",
    ):
        if key in header and not (key == "pixelAspectRatio" and header[key] == 1.0):
            says[key] = _text(header[key])
    if header.get("software") == "simrig" and "exposure" in header:
        says["exposure"] = _text(header["exposure"])
    return says


def _text(value: Any) -> str:
    if isinstance(value, tuple | list) and all(isinstance(v, float) for v in value):
        return ", ".join(f"{v:.6g}" for v in value)
    return str(value).rsplit(".", 1)[-1] if "." in str(type(value)) else str(value)

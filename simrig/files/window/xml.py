"""The XML around the data of WINDOW and Radiance: which side, which colours, which structure.

A file holds reflection and transmission of both sides; a material is one reflection. "Front" and
"Back" are WINDOW's; Radiance calls WINDOW's back its front. Values are f_r in 1/sr. Colours: the
Visible data are Y; CIE-X and CIE-Z beside them in matrices, CIE-u and CIE-v in trees. Sources:
BSDF-v1.4.xsd, and Radiance's ``bsdf_m.c`` and ``bsdf_t.c``.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from simrig.core.errors import SimrigError, check_known
from simrig.files.atomic import existing_file

SIDES = ("front", "back")
_LARGEST_FILE = 1 << 28
_COLOURS = {"visible": "Y", "cie-x": "X", "cie-y": "Y", "cie-z": "Z", "cie-u": "u", "cie-v": "v"}


@dataclass(frozen=True)
class Block:
    """The data of one side and colour.

    Attributes:
        side: ``"front"`` or ``"back"``.
        colour: Y, X, Z, u or v.
        node: the ``WavelengthDataBlock``.
    """

    side: str
    colour: str
    node: ElementTree.Element

    def text(self, tag: str) -> str:
        """Return the text of a child, empty without one."""
        return text_of(self.node, tag)


def is_window_xml(text: str) -> bool:
    """Return whether the start of a text file is a BSDF in XML."""
    return "<WindowElement" in text


def read_layer(path: str | Path) -> tuple[ElementTree.Element, list[Block]]:
    """Return the first layer and the blocks of its reflection.

    Raises:
        SimrigError: no XML, none of this format, or no reflection in it.
    """
    path = existing_file(path)
    if path.stat().st_size > _LARGEST_FILE:
        raise SimrigError(f"BSDF file '{path}' is too large to be one")
    content = path.read_bytes()
    if b"<!DOCTYPE" in content or b"<!ENTITY" in content:
        raise SimrigError(f"'{path}' defines entities, which a BSDF file does not need")
    try:
        root = ElementTree.fromstring(content)
    except (ElementTree.ParseError, ValueError, LookupError, RecursionError) as error:
        raise SimrigError(f"'{path}' is damaged or truncated: it is no XML ({error})") from error
    for node in root.iter():  # names without the namespace
        if isinstance(node.tag, str):
            node.tag = node.tag.rpartition("}")[2]
    layers = root.findall("./Optical/Layer")
    if root.tag != "WindowElement" or not layers:
        raise SimrigError(f"'{path}' is XML, but no BSDF of WINDOW or Radiance: it has no layer")
    blocks = []
    for data in layers[0].findall("WavelengthData"):
        colour = _COLOURS.get(text_of(data, "Wavelength").lower())
        for node in data.findall("WavelengthDataBlock"):
            direction = text_of(node, "WavelengthDataDirection").lower().split()
            if colour and len(direction) == 2 and direction[0] == "reflection":
                blocks.append(Block(direction[1], colour, node))
    if not any(block.colour == "Y" for block in blocks):
        raise SimrigError(
            f"'{path}' holds no visible reflection of a surface: transmission is not read"
        )
    return layers[0], blocks


def text_of(node: ElementTree.Element, tag: str) -> str:
    """Return the text of the first child with a tag, stripped; empty without one."""
    return (node.findtext(tag) or "").strip()


def choose_side(
    path: Path, blocks: list[Block], side: str | None, empty: Callable[[Block], bool]
) -> tuple[str, list[str]]:
    """Return the side that is the material, and what to say about it.

    Args:
        side: what was asked for; None where the file must tell.
        empty: whether a block is zero everywhere.

    Raises:
        SimrigError: an unknown side, or two that differ and none asked for.
    """
    held = [s for s in SIDES if any(b.side == s and b.colour == "Y" for b in blocks)]
    if side is not None:
        check_known("side of a BSDF", side, SIDES)
        if side not in held:
            raise SimrigError(
                f"'{path}' holds no reflection of the {side}, only: {', '.join(held)}"
            )
        return side, [f"reflection of WINDOW's {side}"]
    lit = [s for s in held if not all(empty(b) for b in blocks if b.side == s and b.colour == "Y")]
    if len(lit) == 1 or len(held) == 1:
        chosen = (lit or held)[0]
        return chosen, [f"reflection of WINDOW's {chosen}, the only one"]
    texts = [
        [re.sub(r"\s+", " ", b.text("ScatteringData")) for b in blocks if b.side == s]
        for s in SIDES
    ]
    if texts[0] == texts[1]:
        return "front", ["reflection, the same of both sides"]
    raise SimrigError(
        f"'{path}' reflects differently on its two sides: choose --side front or back"
    )


def numbers(text: str, what: str) -> np.ndarray:
    """Return the numbers of a text, separated by blanks or commas.

    Raises:
        SimrigError: something that is no finite number.
    """
    try:
        values = np.array(text.replace(",", " ").split(), dtype=np.float64)
    except ValueError as error:
        raise SimrigError(f"{what} has data that are not numeric") from error
    if not np.all(np.isfinite(values)):
        raise SimrigError(f"{what} has NaN or infinite values")
    return values


def document(name: str, structure: str, definition: str, data: str) -> str:
    """Return a whole file.

    Args:
        structure: ``IncidentDataStructure``.
        definition: further XML of the data definition.
        data: the ``WavelengthData`` elements.
    """
    escaped = name.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<WindowElement xmlns="http://windows.lbl.gov">
<WindowElementType>System</WindowElementType>
<FileType>BSDF</FileType>
<Optical>
<Layer>
<Material>
<Name>{escaped}</Name>
<Manufacturer>simrig</Manufacturer>
<DeviceType>Other</DeviceType>
</Material>
<DataDefinition>
<IncidentDataStructure>{structure}</IncidentDataStructure>
{definition}</DataDefinition>
{data}</Layer>
</Optical>
</WindowElement>
"""


def wavelength_data(colour: str, side: str, basis: str, values: str) -> str:
    """Return one ``WavelengthData`` element.

    Args:
        colour: ``Visible``, ``CIE-X``, ``CIE-Z``, ``CIE-u`` or ``CIE-v``.
        side: ``"front"`` or ``"back"``.
        basis: the XML that names the basis of angles.
    """
    return f"""<WavelengthData>
<LayerNumber>System</LayerNumber>
<Wavelength unit="Integral">{colour}</Wavelength>
<SourceSpectrum>CIE Illuminant D65 1nm.ssp</SourceSpectrum>
<DetectorSpectrum>ASTM E308 1931 Y.dsp</DetectorSpectrum>
<WavelengthDataBlock>
<WavelengthDataDirection>Reflection {side.capitalize()}</WavelengthDataDirection>
{basis}
<ScatteringDataType>BRDF</ScatteringDataType>
<ScatteringData>
{values}
</ScatteringData>
</WavelengthDataBlock>
</WavelengthData>
"""

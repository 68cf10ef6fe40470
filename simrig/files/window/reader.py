"""A BSDF in XML, whichever structure it has."""

from __future__ import annotations

from pathlib import Path

from simrig.brdf.protocol import Brdf
from simrig.core.errors import SimrigError
from simrig.core.gamut import CLIP, KEEP
from simrig.files.window import klems, tensor_tree, xml


def load_window(
    path: str | Path,
    clamp_negative: bool = False,
    side: str | None = None,
    gamut: str | None = None,
) -> tuple[Brdf, list[str]]:
    """Read the reflection of a Klems matrix or a tensor tree.

    Args:
        clamp_negative: set negative values to 0 instead of refusing them (trees always do).
        gamut: of colours outside sRGB, of a matrix (``simrig.core.gamut``).
        side: ``"front"`` or ``"back"`` as WINDOW names them, where the file has two that differ.

    Returns:
        The material, and what was done.

    Raises:
        SimrigError: not such a file, two sides and none chosen, broken or impossible data.
    """
    layer, blocks = xml.read_layer(path)
    structure = xml.text_of(layer, "DataDefinition/IncidentDataStructure")
    if structure.lower() in ("columns", "rows"):
        return klems.read_klems(Path(path), layer, blocks, side, clamp_negative, gamut or CLIP)
    if structure in ("TensorTree3", "TensorTree4"):
        if gamut == KEEP:
            raise SimrigError(
                f"the colours of the tensor tree '{path}' are clipped as they are refined: leave "
                "gamut 'keep' out"
            )
        return tensor_tree.read_tree(Path(path), layer, blocks, side, clamp_negative)
    raise SimrigError(
        f"BSDF file '{path}' has the structure '{structure}'; Columns, Rows, TensorTree3 and "
        "TensorTree4 are read"
    )

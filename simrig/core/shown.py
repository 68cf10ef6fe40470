"""How results show themselves in a notebook: a picture, what they are and what they cost."""

from __future__ import annotations

import base64
import html
from collections.abc import Mapping
from dataclasses import dataclass, field
from io import BytesIO
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # the command line shows its help without NumPy
    import numpy as np

_LARGEST = 512  # pixels of the longer side; larger pictures are thinned
_GAP = 4  # white pixels between two pictures


@dataclass(frozen=True, eq=False)
class Exhibit:
    """What is shown of a result.

    Attributes:
        title: what it is, in a few words.
        facts: what to say about it, in order: name to text.
        picture: uint8 (height, width, 3), sRGB-encoded; None without one.
    """

    title: str
    facts: Mapping[str, str] = field(default_factory=dict)
    picture: np.ndarray | None = None


class Shown:
    """What shows itself in a notebook; the last line of a cell is enough."""

    def exhibit(self) -> Exhibit:
        """Return what is shown of it."""
        raise NotImplementedError

    def __str__(self) -> str:
        """Return what it is in one line."""
        return str(getattr(self, "name", type(self).__name__))

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self}>"

    def _repr_html_(self) -> str:
        """Return the picture and the facts as HTML; all text is escaped."""
        shown = self.exhibit()
        rows = "".join(
            f"<tr><th style='text-align:left'>{html.escape(name)}</th>"
            f"<td style='text-align:left'>{html.escape(text)}</td></tr>"
            for name, text in shown.facts.items()
        )
        picture = ""
        if shown.picture is not None:
            encoded = base64.b64encode(png_bytes(shown.picture)).decode("ascii")
            title = html.escape(shown.title)
            picture = f"<img alt='{title}' src='data:image/png;base64,{encoded}'>"
        return f"<div><b>{html.escape(shown.title)}</b><table>{rows}</table>{picture}</div>"

    def _repr_png_(self) -> bytes | None:
        """Return the picture as PNG; None without one."""
        picture = self.exhibit().picture
        return None if picture is None else png_bytes(picture)


def png_bytes(picture: np.ndarray) -> bytes:
    """Return a picture as PNG, thinned to at most 512 pixels a side.

    Args:
        picture: uint8 (height, width, 3), sRGB-encoded.
    """
    import numpy as np
    from matplotlib.image import imsave

    step = -(-max(picture.shape[:2]) // _LARGEST)
    stream = BytesIO()
    imsave(stream, np.ascontiguousarray(picture[::step, ::step]), format="png")
    return stream.getvalue()


def beside(pictures: list[np.ndarray]) -> np.ndarray:
    """Return pictures of one height side by side on white.

    Args:
        pictures: uint8 (height, width, 3) each.
    """
    import numpy as np

    white = np.full((pictures[0].shape[0], _GAP, 3), 255, dtype=np.uint8)
    parts = [part for picture in pictures for part in (white, picture)]
    return np.concatenate(parts[1:], axis=1)

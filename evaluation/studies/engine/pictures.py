"""Pictures among the rows of a study: cells run anywhere, so what they render travels as text."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from itertools import chain
from pathlib import Path

import numpy as np

from simrig.evaluation.studies.engine.base import Row
from simrig.evaluation.studies.engine.rows import where
from simrig.files.atomic import atomic_write
from simrig.viewing.plots import finish_figure, new_figure

PICTURE = "picture"  # the ``kind`` of such a row


def picture_row(name: str, image: np.ndarray) -> dict[str, str]:
    """Return a row that holds a picture.

    Args:
        image: (height, width, 3) uint8.
    """
    from matplotlib import image as images

    buffer = io.BytesIO()
    images.imsave(buffer, image, format="png")
    png = base64.b64encode(buffer.getvalue()).decode("ascii")
    return {"kind": PICTURE, "picture": name, "png": png}


def picture_of(row: Row) -> np.ndarray:
    """Return the picture that a row holds, (height, width, 3) floats in [0, 1]."""
    from matplotlib import image as images

    return np.asarray(images.imread(io.BytesIO(base64.b64decode(row["png"])))[..., :3])


def write_pictures(rows: Sequence[Row], folder: Path) -> list[Path]:
    """Write every picture among rows as a PNG with its name, and return the files."""
    paths = []
    for row in where(rows, kind=PICTURE):
        paths.append(folder / f"{row['picture']}.png")
        with atomic_write(paths[-1]) as temporary:
            temporary.write_bytes(base64.b64decode(row["png"]))
    return paths


def draw_sheet(
    path: Path, lines: Sequence[Sequence[tuple[str, Row]]], side: float = 1.9, title: str = ""
) -> Path:
    """Draw pictures side by side, each with what is said about it above.

    Args:
        path: of the PNG.
        lines: (caption, row) of every picture, line by line, all lines of one length.
        side: of a picture in inches.
    """
    columns = len(lines[0])
    figure = new_figure(side * columns, (side + 0.45) * len(lines) + (0.3 if title else 0.0))
    panels = figure.subplots(len(lines), columns, squeeze=False)
    for panel, (caption, row) in zip(panels.ravel(), chain(*lines), strict=True):
        panel.imshow(picture_of(row), interpolation="nearest")
        panel.set_title(caption, fontsize=7)
        panel.set_axis_off()
    if title:
        figure.suptitle(title, fontsize=9)
    finish_figure(figure, path)
    return path

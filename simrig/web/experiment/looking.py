"""What virtual observers see on the pictures of an experiment."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path

import numpy as np

from simrig.core.colour import LUMINANCE, decode_srgb
from simrig.perception.observer import BANDS, Observer, band_contrasts
from simrig.scenes.cylinder_layout import ROWS, columns
from simrig.scenes.perspective import focal_pixels
from simrig.scenes.receding_cylinders import HALF_HEIGHT
from simrig.web.experiment.design import PICTURES, Design, Stimulus

_INNER = 0.8  # of a cylinder's width and half height, away from its outline


class Looks:
    """The pictures of an experiment, each looked at once."""

    def __init__(self, folder: Path, design: Design) -> None:
        self._folder, self._design = folder, design
        self._seen: dict[str, tuple[np.ndarray, int]] = {}

    @cached_property
    def _row(self) -> str | None:
        count = len(self._design.distances_m)
        return next((name for name, row in ROWS.items() if row.count == count), None)

    def answer(self, stimulus: Stimulus, observer: Observer, rng: np.random.Generator) -> int:
        """Return what an observer answers; by chance where pictures show no cylinders of ours."""
        if self._row is None or len(stimulus.pictures) != 1:
            return int(rng.integers(0, len(self._design.answers)))
        contrasts, width = self._contrasts(stimulus.pictures[0])
        pixel = self._design.display.width_mm / width
        return observer.answer(observer.visibility(contrasts, pixel), rng)

    def look_at_all(self) -> None:
        """Look at every picture now."""
        if self._row is not None:
            for stimulus in self._design.asked:
                self._contrasts(stimulus.pictures[0])

    def _contrasts(self, name: str) -> tuple[np.ndarray, int]:
        """Return contrasts by cylinder and band, and the width of the picture in pixels."""
        if name not in self._seen:
            grey = _luminance(self._folder / PICTURES / name)
            self._seen[name] = _by_cylinder(grey, str(self._row)), grey.shape[1]
        return self._seen[name]


def _luminance(path: Path) -> np.ndarray:
    """Return linear luminance of a picture, or of the first frame of a film."""
    import cv2

    read = (
        cv2.VideoCapture(str(path)).read()[1] if path.suffix == ".webm" else cv2.imread(str(path))
    )
    if read is None:
        return np.zeros((2, 2))
    return decode_srgb(np.arange(256) / 255.0).astype(np.float32)[read[..., ::-1]] @ LUMINANCE


def _by_cylinder(grey: np.ndarray, experiment: str) -> np.ndarray:
    row = ROWS[experiment]
    height, width = grey.shape
    found = np.zeros((row.count, len(BANDS) - 1))
    for number, (left, right) in enumerate(zip(*columns(row, width), strict=True)):
        half = HALF_HEIGHT / row.distances_mm[number] * focal_pixels(height) * _INNER
        middle, rows = height // 2, int(half)
        inset = 0.5 * (1.0 - _INNER) * (right - left)
        across = slice(int(np.ceil(left + inset)), int(right - inset))
        plain = grey[middle - rows : middle - 1, across].mean(axis=0, keepdims=True)
        found[number] = band_contrasts(grey[middle + 1 : middle + rows, across], plain)
    return found

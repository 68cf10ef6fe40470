"""What virtual observers see on the pictures of an experiment."""

from __future__ import annotations

import csv
from functools import cached_property
from pathlib import Path

import numpy as np

from simrig.core.colour import LUMINANCE, decode_srgb, encode_srgb
from simrig.perception.features import (
    WINDOW,
    contrast,
    luminance,
    perceptual_difference,
    structural_difference,
)
from simrig.perception.observer import BANDS, Observer, band_contrasts
from simrig.perception.saliency import luminance_contrast, saliency, texture_contrast
from simrig.perception.sensitivity import pixels_per_degree
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
    def row(self) -> str | None:
        """The thesis's arrangement that the pictures show, if it is one."""
        count = len(self._design.distances_m)
        return next((name for name, row in ROWS.items() if row.count == count), None)

    def answer(self, stimulus: Stimulus, observer: Observer, rng: np.random.Generator) -> int:
        """Return what an observer answers; by chance where pictures show no cylinders of ours."""
        if self.row is None or len(stimulus.pictures) != 1:
            return int(rng.integers(0, len(self._design.answers)))
        contrasts, width = self._contrasts(stimulus.pictures[0])
        pixel = self._design.display.width_mm / width
        return observer.answer(observer.visibility(contrasts, pixel), rng)

    def look_at_all(self) -> None:
        """Look at every picture now."""
        if self.row is not None:
            for stimulus in self._design.asked:
                self._contrasts(stimulus.pictures[0])

    def _contrasts(self, name: str) -> tuple[np.ndarray, int]:
        """Return contrasts by cylinder and band, and the width of the picture in pixels."""
        if name not in self._seen:
            grey = _luminance(self._folder / PICTURES / name)
            self._seen[name] = _by_cylinder(grey, str(self.row)), grey.shape[1]
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


def _halves(grey: np.ndarray, experiment: str, number: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the inner part of a cylinder's upper and lower half."""
    row = ROWS[experiment]
    height, width = grey.shape
    left, right = (float(side[number]) for side in columns(row, width))
    half = HALF_HEIGHT / row.distances_mm[number] * focal_pixels(height) * _INNER
    middle, rows = height // 2, int(half)
    inset = 0.5 * (1.0 - _INNER) * (right - left)
    across = slice(int(np.ceil(left + inset)), int(right - inset))
    return grey[middle - rows : middle - 1, across], grey[middle + 1 : middle + rows, across]


def _by_cylinder(grey: np.ndarray, experiment: str) -> np.ndarray:
    found = np.zeros((ROWS[experiment].count, len(BANDS) - 1))
    for number in range(len(found)):
        upper, lower = _halves(grey, experiment, number)
        found[number] = band_contrasts(lower, upper.mean(axis=0, keepdims=True))
    return found


def write_features(folder: Path, design: Design, to: Path) -> None:
    """Write the features of thesis Table 3.1 of every picture's nearest cylinder.

    Its lower half beside its upper one, as a display shows them; nothing is written where pictures
    show no cylinders of ours, or fewer pixels than the features' windows.
    """
    looks = Looks(folder, design)
    if looks.row is None:
        return
    rows = []
    for stimulus in design.asked:
        path = folder / PICTURES / stimulus.pictures[0]
        if not path.is_file():
            return
        grey = encode_srgb(_luminance(path))
        plain, textured = _halves(grey, looks.row, 0)
        if min(plain.shape) < WINDOW or stimulus.role != "test":
            continue
        degree = pixels_per_degree(
            design.display.width_mm / grey.shape[1], 1000.0 * design.display.viewing_m
        )
        found = {
            "luminance": luminance(textured),
            "contrast": contrast(plain, textured),
            "1-SSIM": structural_difference(plain, textured),
            "FLIP": perceptual_difference(plain, textured, degree),
            "luminance_contrast": luminance_contrast(textured),
            "texture_contrast": texture_contrast(textured),
            "saliency": saliency(textured),
        }
        rows.append({"stimulus": stimulus.id, **found})
    if rows:
        with to.open("w", newline="", encoding="utf-8") as handle:
            writer = csv.DictWriter(handle, list(rows[0]))
            writer.writeheader()
            writer.writerows({row["stimulus"]: row for row in rows}.values())

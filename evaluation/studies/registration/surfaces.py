"""Surfaces for the study of registration: colour and relief of a sample, drawn from a seed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

TEXEL_MM = 0.08
SIZE_MM = 64.0  # larger than the sample, so that a shift never leaves it
_SIDE = round(SIZE_MM / TEXEL_MM)
_Rng = np.random.Generator


@dataclass(frozen=True, eq=False)
class Surface:
    """A surface, row 0 at -y, column 0 at -x.

    Attributes:
        albedo: (side, side).
        height_mm: (side, side), of mean 0.
        gloss: strength of its highlight.
    """

    albedo: np.ndarray
    height_mm: np.ndarray
    gloss: float


def _noise(rng: _Rng, *sigmas_mm: float) -> np.ndarray:
    """Return smooth noise of mean 0 and variance 1; two sigmas are those of y and x."""
    widths = [sigma / TEXEL_MM for sigma in sigmas_mm]
    made = ndimage.gaussian_filter(rng.normal(size=(_SIDE, _SIDE)), widths, mode="wrap")
    return (made - made.mean()) / made.std()


def _coordinates() -> tuple[np.ndarray, np.ndarray]:
    along = (np.arange(_SIDE) + 0.5) * TEXEL_MM
    return np.meshgrid(along, along)


def _printout(rng: _Rng) -> Surface:
    ink = ndimage.gaussian_filter((_noise(rng, 0.5, 0.5) > 0.3).astype(float), 1.0)
    return Surface(0.8 - 0.7 * ink, np.zeros((_SIDE, _SIDE)), 0.02)


def _weave(rng: _Rng) -> Surface:
    x, y = _coordinates()
    warp = x + 0.12 * _noise(rng, 3.0, 3.0)
    weft = y + 0.12 * _noise(rng, 3.0, 3.0)
    over = np.sin(np.pi * warp / 0.9) * np.sin(np.pi * weft / 0.9)
    height = 0.06 * over
    shade = 1.0 + 0.25 * over + 0.12 * _noise(rng, 0.15, 2.5) + 0.08 * _noise(rng, 2.5, 0.15)
    return Surface(0.35 * np.clip(shade, 0.2, 2.0), height, 0.15)


def _leather(rng: _Rng) -> Surface:
    pebbles = np.abs(_noise(rng, 0.7, 0.7)) - 0.3 * np.abs(_noise(rng, 0.3, 0.3))
    height = 0.08 * ndimage.gaussian_filter(np.tanh(2.0 * pebbles), 1.5)
    return Surface(0.3 * np.clip(0.8 + 3.0 * height, 0.3, 1.5), height - height.mean(), 0.2)


def _wood(rng: _Rng) -> Surface:
    rings = 0.5 + 0.5 * np.sin(6.0 * _noise(rng, 4.0, 30.0) + 0.6 * _noise(rng, 0.4, 6.0))
    pores = (_noise(rng, 0.12, 1.4) > 1.7).astype(float)
    return Surface(0.45 * (0.7 + 0.3 * rings) * (1.0 - 0.5 * pores), -0.02 * pores, 0.1)


def _faint(rng: _Rng) -> Surface:
    return Surface(0.4 * (1.0 + 0.02 * _noise(rng, 0.4, 0.4)), np.zeros((_SIDE, _SIDE)), 0.02)


def _periodic(rng: _Rng) -> Surface:
    x, y = _coordinates()
    squares = np.sin(np.pi * x / 1.5) * np.sin(np.pi * y / 1.5)
    return Surface(0.4 + 0.3 * np.tanh(4.0 * squares), np.zeros((_SIDE, _SIDE)), 0.02)


def _relief(rng: _Rng) -> Surface:
    height = 0.3 * _noise(rng, 1.5, 1.5)
    return Surface(0.4 * (1.0 + 0.2 * _noise(rng, 0.4, 0.4)), height, 0.05)


def _blank(rng: _Rng) -> Surface:
    return Surface(np.full((_SIDE, _SIDE), 0.6), np.zeros((_SIDE, _SIDE)), 0.02)


SURFACES: dict[str, Callable[[_Rng], Surface]] = {
    "printout": _printout,  # flat paper, as in the thesis's first experiment
    "weave": _weave,
    "leather": _leather,
    "wood": _wood,
    "faint": _faint,  # contrast of 2 %
    "periodic": _periodic,  # a checker that repeats exactly
    "relief": _relief,  # 0.3 mm rms: structure that moves against itself
    "blank": _blank,  # nothing to align
}
"""By name: what makes a surface from random numbers."""

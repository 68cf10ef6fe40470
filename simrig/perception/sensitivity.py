"""How well the eye sees gratings, and the visual angles that this depends on."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from simrig.core.errors import SimrigError

_WIDTH = 45.9  # of the exponential, in Kelly's units of 2π cycles per degree
STATIC_HZ = 1.0  # the temporal frequency of thesis Fig. 3.15


def visual_angle_deg(size_mm: ArrayLike, distance_mm: ArrayLike) -> np.ndarray:
    """Return the angle that a length across the line of sight takes up, in degrees.

    Args:
        size_mm: the length, > 0.
        distance_mm: from the eye, > 0; broadcast with the size.

    Raises:
        SimrigError: a size or a distance that is not positive and finite.
    """
    size, distance = _positive(size_mm, "sizes"), _positive(distance_mm, "distances")
    return np.degrees(2.0 * np.arctan2(0.5 * size, distance))


def cycles_per_degree(size_mm: ArrayLike, distance_mm: ArrayLike) -> np.ndarray:
    """Return the spatial frequency where every element is one cycle; see ``visual_angle_deg``."""
    return 1.0 / visual_angle_deg(size_mm, distance_mm)


def pixels_per_degree(pixel_mm: float, distance_mm: float) -> float:
    """Return how many pixels of a size cover a degree; see ``visual_angle_deg``."""
    return float(cycles_per_degree(pixel_mm, distance_mm))


def contrast_sensitivity(spatial_cpd: ArrayLike, temporal_hz: ArrayLike = STATIC_HZ) -> np.ndarray:
    """Return the achromatic contrast sensitivity of Burbeck and Kelly [BK80].

    CSF = 4π² f_s f_t · exp(−4π(f_t + 2 f_s)/45.9) · (6.1 + 7.3 |log10(f_t / (3 f_s))|³), thesis
    section 3.3.2. Over gratings that move at a constant speed v = f_t/f_s (degrees per second) it
    peaks at f_s = 45.9 / (2π (v + 2)), Kelly 1979.

    Args:
        spatial_cpd: f_s in cycles per degree, > 0.
        temporal_hz: f_t in Hz, > 0.

    Returns:
        1 / contrast at threshold.

    Raises:
        SimrigError: a frequency that is not positive and finite.
    """
    f_s = _positive(spatial_cpd, "spatial frequencies")
    f_t = _positive(temporal_hz, "temporal frequencies")
    speed = 6.1 + 7.3 * np.abs(np.log10(f_t / (3.0 * f_s))) ** 3
    return 4.0 * np.pi**2 * f_s * f_t * np.exp(-4.0 * np.pi * (f_t + 2.0 * f_s) / _WIDTH) * speed


def _positive(values: ArrayLike, what: str) -> np.ndarray:
    checked = np.asarray(values, dtype=np.float64)
    if not (np.isfinite(checked) & (checked > 0.0)).all():
        raise SimrigError(f"{what} must be positive and finite, got {values!r}")
    return checked

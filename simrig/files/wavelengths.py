"""Values at few or many wavelengths as linear RGB, and what was assumed for it."""

from __future__ import annotations

import numpy as np

from simrig.core.errors import SimrigError
from simrig.files.spectra import rgb_weights

_STEP = 5.0  # nm between the wavelengths at which a spectrum is integrated
_VISIBLE = (380.0, 780.0)
_WIDEST_GAP = 60.0  # nm that may lie between wavelengths of a spectrum
_BANDS = ((400.0, 500.0), (490.0, 590.0), (580.0, 720.0))  # blue, green, red


def to_rgb(
    values: np.ndarray, wavelengths: np.ndarray, what: str, wanted: float | None = None
) -> tuple[np.ndarray, str]:
    """Return linear RGB, and how it came about.

    Args:
        values: shape (n, k) at k wavelengths.
        wavelengths: in nm, in any order, all different.
        what: holds them, for messages.
        wanted: take this wavelength alone, as grey.

    Raises:
        SimrigError: wavelengths that give no colour, with what to do.
    """
    order = np.argsort(wavelengths)
    wavelengths, values = np.asarray(wavelengths, dtype=np.float64)[order], values[:, order]
    listed = ", ".join(f"{w:g}" for w in wavelengths[:12]) + (
        ", ..." if len(wavelengths) > 12 else ""
    )
    if np.any(np.diff(wavelengths) <= 0.0) or not np.all(np.isfinite(wavelengths)):
        raise SimrigError(f"{what} states a wavelength twice: {listed} nm")
    if wanted is not None:
        near = int(np.argmin(np.abs(wavelengths - wanted)))
        if abs(wavelengths[near] - wanted) > 0.5:
            raise SimrigError(f"{what} has no wavelength of {wanted:g} nm, only {listed}")
        return _grey(values[:, near]), f"grey at {wavelengths[near]:g} nm"
    if len(wavelengths) == 1:
        return _grey(values[:, 0]), f"grey: measured at {wavelengths[0]:g} nm alone"
    in_bands = len(wavelengths) == 3 and all(
        low <= w <= high for w, (low, high) in zip(wavelengths, _BANDS, strict=True)
    )
    if in_bands:
        return values[:, ::-1], f"{listed} nm taken as blue, green and red"
    within = (wavelengths >= _VISIBLE[0]) & (wavelengths <= _VISIBLE[1])
    visible = wavelengths[within]
    covers = len(visible) >= 4 and visible[0] <= 450.0 and visible[-1] >= 650.0
    if not covers or np.diff(visible).max() > _WIDEST_GAP:
        raise SimrigError(
            f"{what} has values at {listed} nm, which give no colour: choose one, "
            "--wavelength NM, for a grey material"
        )
    grid = np.arange(visible[0], visible[-1] + 1e-9, _STEP)
    spread = np.stack([np.interp(grid, visible, unit) for unit in np.eye(len(visible))], axis=-1)
    weights = spread.T @ rgb_weights(grid)
    return values[:, within] @ weights, f"spectrum of {len(visible)} wavelengths under D65, 2°"


def _grey(column: np.ndarray) -> np.ndarray:
    return np.repeat(np.asarray(column)[:, None], 3, axis=1)

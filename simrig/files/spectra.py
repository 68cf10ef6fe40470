"""From reflectance spectra to linear RGB."""

from __future__ import annotations

import numpy as np

from simrig.core.colour import FROM_XYZ
from simrig.core.errors import SimrigError


def rgb_weights(wavelengths: np.ndarray) -> np.ndarray:
    """Return the weights that turn a sampled reflectance spectrum into linear sRGB.

    The colour is the surface's under CIE illuminant D65 for the CIE 1931 2° standard observer,
    integrated by the trapezoidal rule over the samples and scaled so that a spectrum of ones
    gives exactly (1, 1, 1).

    Args:
        wavelengths: in nm, increasing, at least two, shape (n,).

    Returns:
        Shape (n, 3): ``spectra @ rgb_weights(wavelengths)`` for spectra of shape (..., n).

    Raises:
        SimrigError: wavelengths that do not increase or miss the visible range.
    """
    import colour

    wavelengths = np.asarray(wavelengths, dtype=np.float64)
    if wavelengths.ndim != 1 or len(wavelengths) < 2 or not np.all(np.diff(wavelengths) > 0.0):
        raise SimrigError("the wavelengths of a spectrum must increase and be at least two")
    if wavelengths[0] > 450.0 or wavelengths[-1] < 650.0:
        raise SimrigError(
            f"the wavelengths {wavelengths[0]:g} to {wavelengths[-1]:g} nm do not cover the "
            "visible range (nm are expected)"
        )
    observer = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
    light = colour.SDS_ILLUMINANTS["D65"]
    width = np.zeros_like(wavelengths)
    width[:-1] += 0.5 * np.diff(wavelengths)
    width[1:] += 0.5 * np.diff(wavelengths)
    power = width * np.interp(wavelengths, light.wavelengths, light.values, left=0.0, right=0.0)
    matching = np.stack(
        [
            np.interp(wavelengths, observer.wavelengths, column, left=0.0, right=0.0)
            for column in observer.values.T
        ],
        axis=-1,
    )
    weights = power[:, None] * matching @ FROM_XYZ.T
    return weights / weights.sum(axis=0)

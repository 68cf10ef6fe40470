"""Linear RGB BRDF to whatever the current variant transports: RGB, luminance or a spectrum.

The spectral variants use the basis of Mallett and Yuksel 2019 ("Spectral primary decomposition
for rendering with sRGB reflectance"): three non-negative spectra that add up to one and whose
colours under D65 are the sRGB primaries. It is linear, so f_r above 1/sr needs no special case and
gradients pass through.
"""

from __future__ import annotations

from functools import cache

import drjit as dr
import numpy as np

from simrig.core.arrays import Array, gather_colour, namespace, to_device, to_index

_FIRST_NM, _STEP_NM, _COUNT = 380.0, 5.0, 81


@cache
def basis() -> np.ndarray:
    """Return the basis, shape (81, 3): red, green, blue from 380 to 780 nm in steps of 5 nm."""
    from colour.recovery import MSDS_BASIS_FUNCTIONS_sRGB_MALLETT2019 as mallett

    wavelengths = _FIRST_NM + _STEP_NM * np.arange(_COUNT)
    if not np.array_equal(mallett.wavelengths, wavelengths):
        raise RuntimeError("colour-science changed the sampling of the basis")
    return np.asarray(mallett.values, dtype=np.float64)


class Upsampler:
    """Converts colours of the current variant's ``Vector3f`` into its ``Spectrum``."""

    def __init__(self) -> None:
        import mitsuba as mi

        self._mi = mi
        needed = mi.is_spectral and dr.is_jit_v(mi.Float)
        self._basis = to_device(basis(), mi.Float) if needed else None

    def __call__(self, colour: Array, wavelengths: Array) -> Array:
        """Return what a linear RGB colour is in the variant.

        Args:
            colour: linear RGB.
            wavelengths: in nm; used by spectral variants only.
        """
        mi = self._mi
        if mi.is_spectral:
            return self._seen(mi.UnpolarizedSpectrum([self._at(colour, w) for w in wavelengths]))
        rgb = mi.Color3f(colour[0], colour[1], colour[2])
        return self._seen(mi.UnpolarizedSpectrum(mi.luminance(rgb)) if mi.is_monochromatic else rgb)

    def _seen(self, value: Array) -> Array:
        """Return a value as the variant transports light: polarized ones see it depolarized."""
        return self._mi.mueller.depolarizer(value) if self._mi.is_polarized else value

    def _at(self, colour: Array, wavelength: Array) -> Array:
        """Interpolate the basis; it holds its end values outside of 380 to 780 nm."""
        xp = namespace(wavelength)
        position = xp.clip((wavelength - _FIRST_NM) / _STEP_NM, 0.0, _COUNT - 1.001)
        index = to_index(position)
        fraction = position - index
        low = gather_colour(self._basis, index)
        high = gather_colour(self._basis, index + 1)
        return sum(colour[c] * (low[c] + (high[c] - low[c]) * fraction) for c in range(3))

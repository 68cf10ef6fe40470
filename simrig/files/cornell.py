"""Spectral BRDF measured at Cornell (Program of Computer Graphics), as text.

After comment lines (``#``): the number of wavelengths, the wavelengths in nm (over one or more
lines), then one row per sample: theta_i, phi_i, theta_s, phi_s in radians and one value of f_r
per wavelength. The samples are isotropic and irregular.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from simrig.brdf.tables.isotropic import IsotropicTable
from simrig.brdf.tables.scattered import ScatteredSamples, interpolate_isotropic
from simrig.core.errors import SimrigError
from simrig.core.gamut import CLIP, outside
from simrig.files.spectra import rgb_weights
from simrig.files.text import not_negative, number_rows, read_text

_MOST_WAVELENGTHS = 10_000


def read_cornell(path: str | Path, clamp_negative: bool = False) -> ScatteredSamples:
    """Read the samples, with spectra converted to linear sRGB.

    The colour is that under D65 for the 2° observer, a constant spectrum of 1 giving (1, 1, 1)
    (see ``simrig.files.spectra``). Colours outside the gamut keep their negative channels.

    Args:
        clamp_negative: set negative spectral values to 0 instead of refusing them.

    Raises:
        SimrigError: not this format, rows of another length, NaN or negative spectral values.
    """
    path, lines = Path(path), read_text(path, "Cornell").splitlines()
    rows = [(n, line.split()) for n, line in enumerate(lines, 1) if line.strip()]
    rows = [(n, words) for n, words in rows if not words[0].startswith("#")]
    wavelengths, first = _wavelengths(path, rows)
    table = number_rows(f"Cornell file '{path}'", rows[first:], 4 + len(wavelengths))
    values = not_negative(path, table[:, 4:], clamp_negative) @ rgb_weights(wavelengths)
    theta_i, phi_i, theta_v, phi_v = table[:, :4].T
    return ScatteredSamples(theta_i, phi_i, theta_v, phi_v, values, path.stem, isotropic=True)


def load_cornell(
    path: str | Path, clamp_negative: bool = False, gamut: str = CLIP
) -> IsotropicTable:
    """Read the samples and interpolate them to a table (see ``interpolate_isotropic``)."""
    samples = read_cornell(path, clamp_negative)
    table = interpolate_isotropic(replace(samples, gamut=gamut))
    table.outside = outside(samples.values)
    return table


def is_cornell(text: str) -> bool:
    """Return whether the start of a text file has this format's header."""
    return any(line.strip().lower().startswith("# num wls") for line in text.splitlines()[:20])


def _wavelengths(path: Path, rows: list[tuple[int, list[str]]]) -> tuple[np.ndarray, int]:
    """Return the wavelengths, and the number of rows that they and their count take."""
    header = _numbers(path, rows[:1])
    if len(header) != 1 or not 2 <= header[0] <= _MOST_WAVELENGTHS or header[0] % 1:
        raise SimrigError(f"'{path}' is not a Cornell file: it gives no number of wavelengths")
    count, found, used = int(header[0]), np.zeros(0), 1
    while len(found) < count and used < len(rows):
        found = np.concatenate((found, _numbers(path, rows[used : used + 1])))
        used += 1
    if len(found) != count:
        raise SimrigError(f"Cornell file '{path}' has {len(found)} instead of {count} wavelengths")
    return found, used


def _numbers(path: Path, rows: list[tuple[int, list[str]]]) -> np.ndarray:
    """Return the numbers of one row, none where there is none."""
    width = len(rows[0][1]) if rows else 0
    return number_rows(f"Cornell file '{path}'", rows, width)[0] if rows else np.zeros(0)

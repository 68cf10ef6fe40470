"""What a film records as linear RGB: any pixel format, further channels, and spectral bands.

Mitsuba puts the film's own channels first and those of an integrator (AOVs, Stokes parameters)
behind them; the film knows how many are its own, and its bitmap what they are called.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mitsuba as mi
import numpy as np

from simrig.core.colour import FROM_XYZ
from simrig.core.errors import SimrigError

_CIE_Y = 106.856895  # ∫ ȳ dλ over nm, by which Mitsuba divides
_STEP = 1.0  # nm
_VISIBLE = (380.0, 780.0)


@dataclass(frozen=True, eq=False)
class FilmColours:
    """How the first channels of a film become RGB.

    Attributes:
        weights: float32 (channels, 3); RGB is channels @ weights.
        note: what the film records, empty for RGB itself.
    """

    weights: np.ndarray
    note: str

    def __call__(self, picture: np.ndarray) -> np.ndarray:
        """Return linear RGB, (height, width, 3), of all channels of a picture."""
        count = len(self.weights)
        if count == 3 and np.array_equal(self.weights, np.eye(3)):
            return picture[..., :3]
        return picture[..., :count] @ self.weights


def film_colours(film: Any) -> FilmColours:
    """Return how to make RGB of what a film recorded.

    Raises:
        SimrigError: a film without colours.
    """
    if film.class_name() == "SpecFilm":
        return _bands(film)
    names = [field.name for field in film.bitmap().struct_()]
    own = names[: film.base_channels_count()]
    for wanted, matrix, note in (
        ("RGB", np.eye(3), ""),
        ("XYZ", FROM_XYZ.T, "film in CIE XYZ, converted to RGB"),
        ("Y", np.ones((1, 3)), "film of luminance alone, shown as grey"),
    ):
        if set(wanted) <= set(own):
            places = [own.index(letter) for letter in wanted]
            weights = np.zeros((max(places) + 1, 3), dtype=np.float32)
            weights[places] = matrix
            return FilmColours(weights, note)
    raise SimrigError(f"the film records {', '.join(own or names)}, which are no colours")


def _bands(film: Any) -> FilmColours:
    """Return the colours of a spectral film.

    A band's value is the integral of radiance times its response. Radiance is taken at the centre
    of each band as its mean, linear between the centres and held beyond the outermost, and
    integrated with the CIE 1931 observer.
    """
    import colour

    centres, widths = _responses(film)
    order = np.argsort(centres)
    grid = np.arange(_VISIBLE[0], _VISIBLE[1] + _STEP / 2, _STEP)
    shares = np.stack(
        [np.interp(grid, centres[order], unit) for unit in np.eye(len(centres))], axis=-1
    )
    observer = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
    matching = np.stack(
        [np.interp(grid, observer.wavelengths, column) for column in observer.values.T]
    )
    xyz = _STEP / _CIE_Y * matching @ shares  # (3, bands), in the order of the centres
    weights = np.empty((len(centres), 3))
    weights[order] = (FROM_XYZ @ xyz).T
    weights /= widths[:, None]
    note = (
        f"spectral film: {len(centres)} bands centred from {centres.min():.0f} to "
        f"{centres.max():.0f} nm made RGB"
    )
    return FilmColours(weights.astype(np.float32), note)


def _responses(film: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return the centre and the integral of each band's response, in nm, in the film's order."""
    found: dict[str, dict[str, np.ndarray]] = {}
    for key, value in dict(mi.traverse(film)).items():
        band, _, part = str(key).rpartition(".")
        if band and part in ("range", "wavelengths", "values", "value"):
            found.setdefault(band, {})[part] = np.ravel(np.array(value, dtype=np.float64))
    names = [field.name for field in film.bitmap().struct_()]
    centres, widths = [], []
    for name in names:
        parts = found.get(name)
        if parts is None:
            break  # the bands stand first
        values = parts.get("values", parts.get("value"))
        if values is None:
            raise SimrigError(f"the band '{name}' of the spectral film has no response")
        waves = parts.get("wavelengths")
        if waves is None:
            low, high = parts.get("range", np.array(_VISIBLE))[:2]
            values = np.repeat(values, 2) if len(values) == 1 else values
            waves = np.linspace(low, high, len(values))
        width = float(np.trapezoid(values, waves))
        if width <= 0.0:
            raise SimrigError(f"the band '{name}' of the spectral film responds to nothing")
        centres.append(float(np.trapezoid(values * waves, waves)) / width)
        widths.append(width)
    if not centres:
        raise SimrigError("the spectral film has no bands that can be told apart")
    return np.array(centres), np.array(widths)

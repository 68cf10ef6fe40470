"""What light and lens do to a picture: the flat field of a white sheet, and the light's profile."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from simrig.core.errors import SimrigError
from simrig.imaging.checks import finite_array
from simrig.imaging.mosaic import channels_of

_MOST_DEGREE = 8
_ROUNDS = 3  # of leaving outliers out
_OUTLIER = 4.0


def flat_field(white: Any, pattern: str | None = None) -> np.ndarray:
    """Return the relative response of every pixel, of mean 1 for each colour.

    Vignetting, the response of each pixel and the light's profile on the sheet, together.

    Args:
        white: merged picture of a white sheet, (height, width) or with channels.
        pattern: of the colour filter array, where it is a mosaic.

    Raises:
        SimrigError: a sheet that is black somewhere.
    """
    values = finite_array(white, "the picture of the white sheet", (2, 3)).astype(np.float64)
    if not values.mean() > 0.0:
        raise SimrigError("the white sheet is black or negative in the mean")
    flat = np.empty_like(values)
    if values.ndim == 3:
        flat[:] = values / values.mean(axis=(0, 1))
    else:
        channels = np.zeros(values.shape) if pattern is None else channels_of(pattern, values.shape)
        for channel in np.unique(channels):
            mine = channels == channel
            flat[mine] = values[mine] / values[mine].mean()
    if not flat.min() > 0.0:
        raise SimrigError(
            f"the white sheet is black or negative in {int((flat <= 0).sum())} pixels: fill "
            "defects first, or take a picture that it fills"
        )
    return flat


def flattened(picture: Any, flat: np.ndarray) -> np.ndarray:
    """Return a picture over the flat field.

    Raises:
        SimrigError: of another shape.
    """
    values = finite_array(picture, "the picture", (2, 3))
    wide = flat[..., None] if values.ndim == 3 and flat.ndim == 2 else flat
    if wide.shape[: values.ndim] != values.shape and wide.shape[:2] != values.shape[:2]:
        raise SimrigError(f"the flat field is {flat.shape}, the picture {values.shape}")
    return values / wide


@dataclass(frozen=True, eq=False)
class Illumination:
    """The profile of the light over an area as a polynomial in x and y (thesis section 4.1).

    Attributes:
        degree: of the polynomial.
        coefficients: of x^i y^j with i + j <= degree, coordinates from -1 to 1.
        centre, half: that map coordinates there, each (2,).
        error: root-mean-square of what it leaves, relative to the mean.
    """

    degree: int
    coefficients: np.ndarray
    centre: np.ndarray
    half: np.ndarray
    error: float

    @classmethod
    def fitted(cls, x: Any, y: Any, values: Any, degree: int = 2) -> Illumination:
        """Fit readings of a lux meter, or of a white sheet; outliers are left out.

        Args:
            x, y: where, any unit.
            values: readings > 0 in the mean.
            degree: 0 to 8.

        Raises:
            SimrigError: fewer readings than coefficients, readings on a line, or darkness.
        """
        columns = [
            np.ravel(finite_array(a, name, (1, 2))).astype(np.float64)
            for a, name in ((x, "x"), (y, "y"), (values, "the readings"))
        ]
        if len({len(column) for column in columns}) > 1:
            raise SimrigError("x, y and the readings differ in number")
        if degree != int(degree) or not 0 <= degree <= _MOST_DEGREE:
            raise SimrigError(f"a degree is 0 to {_MOST_DEGREE}, got {degree}")
        at, read = np.stack(columns[:2], axis=1), columns[2]
        low, high = at.min(axis=0), at.max(axis=0)
        half = np.where(high > low, 0.5 * (high - low), 1.0)
        centre = 0.5 * (low + high)
        powers = _powers((at - centre) / half, int(degree))
        if len(read) < powers.shape[1] or np.linalg.matrix_rank(powers) < powers.shape[1]:
            raise SimrigError(
                f"a polynomial of degree {degree} needs at least {powers.shape[1]} readings that "
                f"do not lie on a line, got {len(read)}"
            )
        if not read.mean() > 0.0:
            raise SimrigError("the readings of the light must be above 0 in the mean")
        keep = np.ones(len(read), dtype=bool)
        for _ in range(_ROUNDS):
            found = np.linalg.lstsq(powers[keep], read[keep], rcond=None)[0]
            off = np.abs(powers @ found - read)
            keep = off <= max(_OUTLIER * 1.4826 * float(np.median(off)), 1e-12 * read.max())
            if keep.sum() < powers.shape[1]:
                keep[:] = True
                break
        error = float(np.sqrt(np.mean(off[keep] ** 2)) / read.mean())
        return cls(int(degree), found, centre, half, error)

    def at(self, x: Any, y: Any) -> np.ndarray:
        """Return the light at x, y, of the shape that these broadcast to."""
        x, y = np.broadcast_arrays(np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64))
        flat = (np.stack([x.ravel(), y.ravel()], axis=1) - self.centre) / self.half
        return (_powers(flat, self.degree) @ self.coefficients).reshape(x.shape)


def _powers(at: np.ndarray, degree: int) -> np.ndarray:
    return np.stack(
        [at[:, 0] ** i * at[:, 1] ** j for i in range(degree + 1) for j in range(degree + 1 - i)],
        axis=1,
    )

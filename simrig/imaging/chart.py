"""Colours of a camera: the 3 × 3 matrix from a chart of known patches (thesis section 4.1).

The reference is CIE XYZ of the patches under the light that the camera saw them in: colour-science
has the spectra of the ColorChecker (Ohta 1997) and the observer (CIE 1931).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from simrig.core.colour import FROM_XYZ, TO_XYZ
from simrig.core.errors import SimrigError
from simrig.imaging.camera import homography, transformed
from simrig.imaging.checks import finite_array

COLUMNS, ROWS = 6, 4
_INNER = 0.5  # side of the middle of a patch that is read, of the patch's
_BRADFORD = np.array(
    [[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]]
)


@dataclass(frozen=True, eq=False)
class ColourMatrix:
    """From a camera's linear values to CIE XYZ.

    Attributes:
        matrix: (3, 3); XYZ = matrix @ camera.
        errors: (n,) ΔE*ab of the patches that it was found from.
        white: (3,) XYZ of the perfect diffuser under the chart's light.
    """

    matrix: np.ndarray
    errors: np.ndarray
    white: np.ndarray

    def xyz(self, picture: Any) -> np.ndarray:
        """Return XYZ of camera values (..., 3)."""
        return np.asarray(picture) @ self.matrix.T

    def srgb(self, picture: Any) -> np.ndarray:
        """Return linear sRGB of camera values (..., 3), white adapted to D65 (Bradford)."""
        return self.xyz(picture) @ (FROM_XYZ @ adaptation(self.white)).T


def colour_matrix(measured: Any, reference_xyz: Any, white: Any) -> ColourMatrix:
    """Find the matrix by least squares.

    Args:
        measured: (n, 3) linear camera values of the patches.
        reference_xyz: (n, 3) of them, Y of the white is 1.
        white: (3,) XYZ of a perfect diffuser under the same light.

    Raises:
        SimrigError: fewer than three patches, or patches that do not span the colours.
    """
    import colour

    seen = finite_array(measured, "the measured patches", (2,)).astype(np.float64)
    known = finite_array(reference_xyz, "the reference", (2,)).astype(np.float64)
    lit = finite_array(white, "the white", (1,)).astype(np.float64)
    if seen.shape != known.shape or seen.shape[1] != 3 or lit.shape != (3,):
        raise SimrigError(
            f"measured and reference patches must both be (n, 3) and the white (3,), got "
            f"{seen.shape}, {known.shape} and {lit.shape}"
        )
    if len(seen) < 3 or np.linalg.cond(seen) > 1e6 or not lit.min() > 0.0:
        raise SimrigError("the patches do not tell three colours apart: at least three that differ")
    matrix = colour.characterisation.matrix_colour_correction_Cheung2004(seen, known, terms=3)
    made = seen @ np.asarray(matrix).T
    at = lit[:2] / lit.sum()
    labs = [colour.XYZ_to_Lab(np.maximum(xyz, 0.0) / lit[1], at) for xyz in (made, known)]
    errors = np.linalg.norm(np.asarray(labs[0]) - np.asarray(labs[1]), axis=-1)
    return ColourMatrix(np.asarray(matrix), errors, lit)


def chart_xyz(wavelengths_nm: Any = None, spectrum: Any = None) -> tuple[np.ndarray, np.ndarray]:
    """Return XYZ of the ColorChecker's 24 patches and of white under a light.

    Args:
        wavelengths_nm, spectrum: of the light, (n,) each; D65 unless given.

    Returns:
        (24, 3), row by row from dark skin to black, and (3,); Y of white is 1.

    Raises:
        SimrigError: a spectrum that is none.
    """
    import colour

    shape = colour.SpectralShape(380.0, 780.0, 5.0)
    if spectrum is None:
        light = colour.SDS_ILLUMINANTS["D65"].copy().align(shape)
    else:
        nm = finite_array(wavelengths_nm, "the wavelengths", (1,))
        power = finite_array(spectrum, "the spectrum", (1,))
        if nm.shape != power.shape or len(nm) < 2 or np.any(np.diff(nm) <= 0) or power.min() < 0:
            raise SimrigError("a spectrum has ascending wavelengths in nm and powers >= 0")
        if nm[0] > 450.0 or nm[-1] < 650.0 or not power.max() > 0.0:
            raise SimrigError("the spectrum of the light must cover 450 to 650 nm and not be dark")
        values = np.interp(shape.wavelengths, nm, power, left=0.0, right=0.0)
        light = colour.SpectralDistribution(values, shape.wavelengths)
    observer = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"].copy().align(shape)
    weighted = observer.values * light.values[:, None]
    weighted = weighted / weighted[:, 1].sum()
    patches = [
        patch.copy().align(shape).values
        for patch in colour.SDS_COLOURCHECKERS["ColorChecker N Ohta"].values()
    ]
    return np.array(patches) @ weighted, weighted.sum(axis=0)


def read_patches(
    picture: Any, corners: Any, columns: int = COLUMNS, rows: int = ROWS
) -> np.ndarray:
    """Return the mean of the middle of every patch, row by row, (patches, channels).

    Args:
        picture: (height, width, channels) linear.
        corners: (4, 2) pixels of the chart's corners: of the first patch, then clockwise.
        columns, rows: of the chart.

    Raises:
        SimrigError: corners outside of the picture, or patches smaller than a pixel.
    """
    values = finite_array(picture, "the picture of the chart", (3,))
    ends = finite_array(corners, "the corners of the chart", (2,))
    if ends.shape != (4, 2):
        raise SimrigError(f"a chart has four corners of two coordinates, got {ends.shape}")
    unit = np.array([[0.0, 0.0], [columns, 0.0], [columns, rows], [0.0, rows]])
    back = homography(ends, unit)
    height, width = values.shape[:2]
    column, row = np.meshgrid(np.arange(width), np.arange(height))
    at = transformed(back, np.stack([column.ravel(), row.ravel()], axis=1).astype(np.float64))
    patch = np.floor(at).astype(np.int64)
    middle = np.abs(at - patch - 0.5).max(axis=1) <= 0.5 * _INNER
    inside = (patch >= 0).all(axis=1) & (patch[:, 0] < columns) & (patch[:, 1] < rows) & middle
    number = (patch[:, 1] * columns + patch[:, 0])[inside]
    count = np.bincount(number, minlength=columns * rows)
    if count.min() == 0:
        raise SimrigError(
            f"{int((count == 0).sum())} of {columns * rows} patches are not in the picture, or "
            "smaller than its pixels: check the corners"
        )
    flat = values.reshape(-1, values.shape[2])[inside].astype(np.float64)
    sums = [np.bincount(number, flat[:, c], columns * rows) for c in range(flat.shape[1])]
    return np.stack(sums, axis=1) / count[:, None]


def adaptation(white: np.ndarray) -> np.ndarray:
    """Return the Bradford matrix (3, 3) from a white to D65; Y of both whites is 1."""
    d65 = TO_XYZ.sum(axis=1)
    gains = (_BRADFORD @ d65) / (_BRADFORD @ (np.asarray(white) / white[1]))
    return np.linalg.inv(_BRADFORD) @ np.diag(gains) @ _BRADFORD

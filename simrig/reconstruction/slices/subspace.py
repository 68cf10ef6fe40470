"""One two-dimensional subspace of two polar angles, from its slices (thesis section 5.3).

The same slices, rows and look-ups as in four dimensions (``simrig.brdf.slices.slices``), without
the two polar angles: r = max(p + q − c, smallest of the four slice values).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from simrig.brdf.slices.slices import along_slice, azimuth_cell
from simrig.core.arrays import (
    Array,
    float_type,
    gather_colour,
    is_numpy,
    lerp,
    namespace,
    to_device,
    vector_type,
)
from simrig.plans.adaptive import AdaptiveSamples
from simrig.plans.placement import SubspacePlacement
from simrig.plans.slices import AXIAL, DIAGONAL
from simrig.reconstruction.slices.along_slices import SliceInterpolator
from simrig.reconstruction.slices.tables import fill_rows, padded_corners, pair_rows, slice_numbers


@dataclass(frozen=True)
class Subspace:
    """Reflectance over both azimuths at fixed polar angles.

    Attributes:
        corners: (a_n + 1, 2·a_n + 1, 3) values at the intersections.
        axial, diagonal: (a_n + 1, M, 3) pre-interpolated slices over the mean azimuth and over
            half the azimuth difference.
    """

    corners: np.ndarray
    axial: np.ndarray
    diagonal: np.ndarray

    def eval(self, phi_i: Array, phi_v: Array) -> Array:
        """Return f_r for azimuths in radians: NumPy (...,) to (..., 3), or Dr.Jit to a colour."""
        a_n, count = self.axial.shape[0] - 1, self.axial.shape[1]
        number = float_type(phi_i)
        like = phi_i if is_numpy(phi_i) else vector_type(number)(0.0)

        def reader(table: np.ndarray):
            values = to_device(table, number)
            return lambda index: gather_colour(values, index, like)

        m, j, y, k, x, b, d = azimuth_cell(phi_i, phi_v, a_n)
        axial, diagonal, corner = map(reader, (self.axial, self.diagonal, self.corners))
        p_0, p_1 = (along_slice(axial, (j + step) * count, m, count) for step in (0, 1))
        q_0, q_1 = (along_slice(diagonal, (b + step) * count, d, count) for step in (0, 1))
        start = j * (2 * a_n + 1) + k
        below = start + (2 * a_n + 1)
        c_0 = lerp(corner(start), corner(start + 1), x)
        c_1 = lerp(corner(below), corner(below + 1), x)
        value = lerp(p_0, p_1, y) + lerp(q_0, q_1, x) - lerp(c_0, c_1, y)
        xp = namespace(value)
        return xp.maximum(value, xp.minimum(xp.minimum(p_0, p_1), xp.minimum(q_0, q_1)))

    def picture(self, size: int = 720) -> np.ndarray:
        """Return the whole subspace on a regular grid, (size, size, 3), phi_i down, phi_v right."""
        phi = np.arange(size) * (2.0 * np.pi / size)
        return self.eval(*np.meshgrid(phi, phi, indexing="ij"))


def reconstruct_subspace(
    samples: AdaptiveSamples,
    placement: SubspacePlacement,
    interpolation: str = "cubic",
    azimuth_samples: int = 720,
) -> Subspace:
    """Return the subspace that samples along its slices give.

    Args:
        samples: what ``sample_adaptively`` measured for ``placement``.
        placement: the subspace and its slices.
        interpolation: along the slices: ``"cubic"``, ``"pchip"`` or ``"linear"``.
        azimuth_samples: samples over 360° along each slice.

    Raises:
        SimrigError: for an unknown interpolation.
    """
    a_n = placement.azimuth_count
    interpolate = SliceInterpolator(samples.knots, samples.values, interpolation)
    number = slice_numbers(placement.slices())
    azimuth = np.arange(azimuth_samples) * (2.0 * np.pi / azimuth_samples)
    shape = (a_n + 1, azimuth_samples, 3)
    axial, diagonal = (
        fill_rows(interpolate, pair_rows(placement.pair, a_n, number, kind), azimuth, shape)
        for kind in (AXIAL, DIAGONAL)
    )
    corners = samples.values[padded_corners(placement.corner_samples())]
    return Subspace(corners, axial, diagonal)

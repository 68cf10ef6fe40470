"""One two-dimensional subspace of two polar angles, from its slices (thesis section 5.3).

The same slices, rows and look-ups as in four dimensions (``simrig.brdf.slices.slices``), without
the two polar angles: r = max(p + q − c, smallest of the four slice values).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from simrig.brdf.slices.cells import along_slice, azimuth_cell, surface_in_cell
from simrig.core.arrays import Array, float_type, gather_colour, lerp, namespace, to_device
from simrig.plans.adaptive import AdaptiveSamples
from simrig.plans.placement import SubspacePlacement
from simrig.plans.slices import AXIAL, DIAGONAL
from simrig.reconstruction.slices.along_slices import SliceInterpolator
from simrig.reconstruction.slices.tables import (
    fill_rows,
    padded_intersections,
    pair_rows,
    slice_numbers,
)


def reader(table: np.ndarray, like: Array) -> Callable[[Array], Array]:
    """Return the function that reads colours of a table by index, for angles like ``like``."""
    values = to_device(table, float_type(like))
    return lambda index: gather_colour(values, index)


@dataclass(frozen=True)
class Subspace:
    """f_r over both azimuths at fixed polar angles.

    Attributes:
        intersections: (a_n + 1, 2·a_n + 1, 3) values at the intersections.
        axial, diagonal: (a_n + 1, M, 3) pre-interpolated slices over the mean azimuth and over
            half the azimuth difference.
    """

    intersections: np.ndarray
    axial: np.ndarray
    diagonal: np.ndarray

    def eval(self, phi_i: Array, phi_v: Array) -> Array:
        """Return f_r for azimuths in radians: NumPy (...,) to (..., 3), or Dr.Jit to a colour."""
        a_n, count = self.axial.shape[0] - 1, self.axial.shape[1]
        own = azimuth_cell(phi_i, phi_v, a_n)
        axial, diagonal, surface = (
            reader(table, phi_i) for table in (self.axial, self.diagonal, self.intersections)
        )
        p_0, p_1 = (
            along_slice(axial, row * count, own.mean, count) for row in (own.row, own.next_row)
        )
        q_0, q_1 = (
            along_slice(diagonal, (own.diagonal + step) * count, own.along_diagonal, count)
            for step in (0, 1)
        )
        value = lerp(p_0, p_1, own.row_weight) + lerp(q_0, q_1, own.column_weight)
        value = value - surface_in_cell(surface, 0, own, a_n)
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
    intersections = samples.values[padded_intersections(placement.corner_samples())]
    return Subspace(intersections, axial, diagonal)

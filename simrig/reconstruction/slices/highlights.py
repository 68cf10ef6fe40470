"""From samples along slices to values, interpolated along highlights (thesis section 5.7).

The measurements are those of section 5.3 (``simrig.reconstruction.slices.tables`` and
``subspace``); only the interpolation differs. ``simrig.brdf.slices.along_highlights`` says how
values between slices come about. The splines along slices are of the same logarithms: they dip less
beside a highlight.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from simrig.brdf.slices.along_highlights import (
    Slice,
    compressed,
    expanded,
    half_vector_turn,
    offsets,
    shift_strength,
    swept_along_highlights,
)
from simrig.brdf.slices.cells import along_slice
from simrig.brdf.slices.highlight_slices import HighlightSlices
from simrig.brdf.slices.slices import SliceBrdf
from simrig.core.arrays import Array
from simrig.directions import wrap_angle
from simrig.plans.adaptive import AdaptiveSamples
from simrig.plans.along_slices import slice_samples
from simrig.plans.placement import SubspacePlacement
from simrig.plans.protocol import Measured
from simrig.reconstruction.slices.subspace import Subspace, reader, reconstruct_subspace
from simrig.reconstruction.slices.tables import full_slices, reconstruct_slices


@dataclass(frozen=True)
class HighlightSubspace(Subspace):
    """f_r over both azimuths at fixed polar angles, interpolated along highlights.

    Attributes:
        intersections, axial, diagonal: as ``Subspace``.
        theta_i, theta_v: the polar angles in radians.
    """

    theta_i: float
    theta_v: float

    @cached_property
    def offset(self) -> np.ndarray:
        """Where values begin to be compared by ratio, (3,)."""
        return offsets(self.axial[:-1], self.diagonal[:-1])

    @cached_property
    def _compressed(self) -> tuple[np.ndarray, np.ndarray]:
        axial, diagonal = (
            compressed(t.astype(np.float64), self.offset) for t in (self.axial, self.diagonal)
        )
        return axial, diagonal

    def eval(self, phi_i: Array, phi_v: Array) -> Array:
        """Return f_r for azimuths in radians: NumPy (...,) to (..., 3), or Dr.Jit to a colour."""
        a_n, count = self.axial.shape[0] - 1, self.axial.shape[1]
        sines = np.sin(self.theta_i), np.sin(self.theta_v)
        strength = float(shift_strength(np.float64(self.theta_i), np.float64(self.theta_v)))

        def slices(table: np.ndarray) -> Slice:
            read = reader(table, phi_i)
            return lambda row, place: along_slice(read, row * count, place, count)

        def shift(d: Array) -> Array:
            return strength * half_vector_turn(d, *(0.0 * d + s for s in sines))

        axial, diagonal = map(slices, self._compressed)
        d = 0.5 * wrap_angle(phi_v - phi_i)
        value = swept_along_highlights(axial, diagonal, phi_i + d, d, a_n, shift)
        return expanded(value, self.offset)


def reconstruct_subspace_along_highlights(
    samples: AdaptiveSamples,
    placement: SubspacePlacement,
    interpolation: str = "cubic",
    azimuth_samples: int = 720,
) -> HighlightSubspace:
    """Return the subspace that samples along its slices give, interpolated along highlights.

    Args and Raises: as ``reconstruct_subspace``.
    """

    def reconstruct(of: AdaptiveSamples) -> Subspace:
        return reconstruct_subspace(of, placement, interpolation, azimuth_samples)

    first = reconstruct(samples)
    offset = offsets(first.axial[:-1], first.diagonal[:-1])
    known = reconstruct(_compressed_samples(samples, offset))
    intersections, axial, diagonal = (
        _expanded_table(table, offset)
        for table in (known.intersections, known.axial, known.diagonal)
    )
    theta_i, theta_v = placement.theta_i, placement.theta_v
    return HighlightSubspace(intersections, axial, diagonal, theta_i, theta_v)


def reconstruct_along_highlights(
    measurement: Measured,
    interpolation: str = "cubic",
    *,
    azimuth_samples: int = 360,
    largest_node_step_deg: float = 2.0,
) -> HighlightSlices:
    """Return the BRDF that a measurement along slices gives, interpolated along highlights.

    Args and Raises: as ``simrig.reconstruction.slices.tables.reconstruct``; the value at
    the pole is always one.
    """
    samples, (placement, slice_types) = slice_samples(measurement), full_slices(measurement)

    def reconstruct(of: AdaptiveSamples) -> SliceBrdf:
        return reconstruct_slices(
            of,
            placement,
            slice_types=slice_types,
            interpolation=interpolation,
            azimuth_samples=azimuth_samples,
            largest_node_step_deg=largest_node_step_deg,
        )

    first = reconstruct(samples).data()
    offset = offsets(first["axial"], first["diagonal"])
    known = reconstruct(_compressed_samples(samples, offset))
    tables = {key: _expanded_table(table, offset) for key, table in known.data().items()}
    name = f"{measurement.material} from {len(samples.values)} samples, along highlights"
    return HighlightSlices(known.layout, **tables, name=name, offset=offset)


def _compressed_samples(samples: AdaptiveSamples, offset: np.ndarray) -> AdaptiveSamples:
    return replace(samples, values=compressed(samples.values, offset))


def _expanded_table(table: np.ndarray, offset: np.ndarray) -> np.ndarray:
    return expanded(table.astype(np.float64), offset)

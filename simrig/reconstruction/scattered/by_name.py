"""The methods for samples at any directions, by name: from a measurement to a BRDF."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType

from simrig.brdf.protocol import Brdf
from simrig.core.errors import unknown_name
from simrig.reconstruction.scattered.barycentric import reconstruct_barycentric
from simrig.reconstruction.scattered.pairs import PairMeasurement
from simrig.reconstruction.scattered.rbf import NEIGHBOURS, reconstruct_rbf
from simrig.reconstruction.scattered.regular_grid import reconstruct_regular_grid


@dataclass(frozen=True, eq=False)
class Reconstructed:
    """What a method made of a measurement.

    Attributes:
        brdf: the result.
        bytes: storage of the result.
        notes: what a reader must know: nodes, condition numbers, fall-backs.
    """

    brdf: Brdf
    bytes: int
    notes: tuple[str, ...] = ()


def reconstruct_by_name(name: str, measurement: PairMeasurement) -> Reconstructed:
    """Return what the method ``name``, a key of ``RECONSTRUCTIONS``, makes of a measurement.

    Raises:
        SimrigError: an unknown name, or a measurement that the method cannot use.
    """
    if name not in RECONSTRUCTIONS:
        raise unknown_name("method", name, RECONSTRUCTIONS)
    return RECONSTRUCTIONS[name](measurement)


def _barycentric(measurement: PairMeasurement) -> Reconstructed:
    result = reconstruct_barycentric(measurement)
    return Reconstructed(result, result.stored_bytes)


def _regular_grid(measurement: PairMeasurement) -> Reconstructed:
    table = reconstruct_regular_grid(measurement)
    return Reconstructed(table, table.values.nbytes)


def _rbf(neighbours: int | None, logarithms: bool, measurement: PairMeasurement) -> Reconstructed:
    result = reconstruct_rbf(measurement, neighbours, logarithms=logarithms)
    return Reconstructed(result.brdf, result.brdf.stored_bytes, result.notes)


RECONSTRUCTIONS: Mapping[str, Callable[[PairMeasurement], Reconstructed]] = MappingProxyType(
    {
        "barycentric": _barycentric,
        "rbf_global": partial(_rbf, None, False),
        "rbf_local": partial(_rbf, NEIGHBOURS, False),
        "rbf_global_log": partial(_rbf, None, True),
        "rbf_local_log": partial(_rbf, NEIGHBOURS, True),
        "regular_grid": _regular_grid,
    }
)

"""The methods by name: how each measures a material, and the reflectance that it makes of that.

Studies and plots run any of them alike. A method asks the rig for its own plan; where it cannot
take exactly the samples that were wished, it takes the most that its plans allow below, and says
how many. The methods themselves are in ``simrig.reconstruction`` and never see the truth.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import Any

import numpy as np

from simrig.cost import Cost
from simrig.directions.schemes import HemisphereScheme
from simrig.errors import SimrigError, unknown_name
from simrig.reconstruction.barycentric import reconstruct_barycentric
from simrig.reconstruction.rbf import NEIGHBOURS, reconstruct_rbf
from simrig.reconstruction.regular_grid import reconstruct_regular_grid
from simrig.reconstruction.slices import reconstruct
from simrig.reflectance.protocol import Reflectance
from simrig.rigs.directions_measurement import DirectionsMeasurement
from simrig.rigs.gonioreflectometer import Gonioreflectometer, Progress
from simrig.sampling.placement import optimal_placement
from simrig.sampling.uniform import largest_uniform_scheme, uniform_plan

LARGEST_THETA_DEG = 80.0  # that of the thesis; real arms do not reach much further


@dataclass(frozen=True, eq=False)
class MethodResult:
    """What a method made of a material, and what that cost.

    Attributes:
        reflectance: the result.
        samples: how many were really taken.
        hardware_seconds: simulated time of the measuring device.
        sampling_seconds: time of computing while measuring.
        reconstruction_seconds: time from the samples to the reflectance.
        bytes: storage of the result.
        notes: what a reader must know: condition numbers, fall-backs, assumptions.
    """

    reflectance: Reflectance
    samples: int
    hardware_seconds: float
    sampling_seconds: float
    reconstruction_seconds: float
    bytes: int
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Method:
    """A way from a material to its reconstruction.

    Attributes:
        name: its key in ``METHODS``.
        about: one line.
        run: ``run(rig, reflectance, samples, progress=None)`` measures and reconstructs.
        least_samples: fewer than these are refused.
    """

    name: str
    about: str
    run: Callable[..., MethodResult]
    least_samples: int


Rebuild = Callable[[DirectionsMeasurement], tuple[Reflectance, int, tuple[str, ...]]]


def method(name: str) -> Method:
    """Return a method by name: a key of ``METHODS``.

    Raises:
        SimrigError: unknown name, with the nearest known one.
    """
    if name not in METHODS:
        raise unknown_name("method", name, METHODS)
    return METHODS[name]


def rebuilt(
    cost: Cost, rebuild: Callable[[], tuple[Reflectance, int, tuple[str, ...]]]
) -> MethodResult:
    """Time a reconstruction and return it with the cost of its measurement.

    Args:
        cost: of the measurement.
        rebuild: returns the reflectance, its stored bytes and its notes.
    """
    start = time.perf_counter()
    reflectance, stored, notes = rebuild()
    seconds = time.perf_counter() - start
    return MethodResult(
        reflectance,
        cost.samples,
        cost.hardware_seconds,
        cost.compute_seconds,
        seconds,
        stored,
        notes,
    )


def _slices(
    slice_types: str,
    rig: Gonioreflectometer,
    reflectance: Reflectance,
    samples: int,
    progress: Progress | None = None,
) -> MethodResult:
    placement = optimal_placement(samples, _theta_max_deg(reflectance))
    measurement = rig.measure(
        reflectance, placement, samples, slice_types=slice_types, progress=progress
    )

    def rebuild() -> tuple[Reflectance, int, tuple[str, ...]]:
        result = reconstruct(measurement)
        return result, result.stored_bytes, (placement.describe(), *_assumed(reflectance))

    return rebuilt(measurement.cost, rebuild)


def _on_scheme(
    plan: Callable[[int, Reflectance], HemisphereScheme],
    rebuild: Rebuild,
    rig: Gonioreflectometer,
    reflectance: Reflectance,
    samples: int,
    progress: Progress | None = None,
) -> MethodResult:
    scheme = plan(samples, reflectance)
    measurement = rig.measure_scheme(reflectance, scheme, reciprocal=True, progress=progress)

    def complete() -> tuple[Reflectance, int, tuple[str, ...]]:
        result, stored, notes = rebuild(measurement)
        told = f"{scheme.name}, {len(scheme)} directions"
        return result, stored, (told, *notes, *_assumed(reflectance))

    return rebuilt(measurement.cost, complete)


def _uniform(samples: int, reflectance: Reflectance) -> HemisphereScheme:
    """Return the densest uniform scheme; its rings must lie within the data."""
    scheme = largest_uniform_scheme(samples)
    if scheme.theta.max() > reflectance.theta_max + 1e-6:
        raise SimrigError(
            f"'{reflectance.name}' has data up to {np.degrees(reflectance.theta_max):g}° only; "
            f"the uniform schemes reach {LARGEST_THETA_DEG:g}°: use regular_grid or slices"
        )
    return scheme


def _regular(samples: int, reflectance: Reflectance) -> HemisphereScheme:
    theta_max = float(np.radians(_theta_max_deg(reflectance)))
    return uniform_plan(samples, theta_max).scheme()


def _theta_max_deg(reflectance: Reflectance) -> float:
    """Return 80, or where the data end earlier, that rounded down to whole degrees."""
    data_end = float(np.degrees(reflectance.theta_max))
    return min(LARGEST_THETA_DEG, float(np.floor(data_end + 5e-5)))


def _assumed(reflectance: Reflectance) -> tuple[str, ...]:
    if reflectance.reciprocal:
        return ()
    return ("not reciprocal: only theta_i <= theta_v was measured",)


def _barycentric(measurement: DirectionsMeasurement) -> Any:
    result = reconstruct_barycentric(measurement)
    return result, result.stored_bytes, ()


def _regular_grid(measurement: DirectionsMeasurement) -> Any:
    table = reconstruct_regular_grid(measurement)
    return table, table.values.nbytes, ()


def _rbf(neighbours: int | None, logarithms: bool, measurement: DirectionsMeasurement) -> Any:
    result = reconstruct_rbf(measurement, neighbours, logarithms=logarithms)
    return result.reflectance, result.reflectance.stored_bytes, result.notes


_ALL = (
    Method("slices", "adaptive slices, all kinds (5.3)", partial(_slices, "all"), 55),
    Method(
        "slices_axial_diagonal",
        "adaptive slices, axial and diagonal only (5.3)",
        partial(_slices, "axial_diagonal"),
        55,
    ),
    Method(
        "barycentric",
        "uniform scheme, barycentric interpolation (5.5.2)",
        partial(_on_scheme, _uniform, _barycentric),
        435,
    ),
    Method(
        "rbf_global",
        "uniform scheme, one radial basis function per sample (5.5.2)",
        partial(_on_scheme, _uniform, partial(_rbf, None, False)),
        435,
    ),
    Method(
        "rbf_local",
        "uniform scheme, radial basis functions of the nearest samples",
        partial(_on_scheme, _uniform, partial(_rbf, NEIGHBOURS, False)),
        435,
    ),
    Method(
        "rbf_global_log",
        "as rbf_global, of the logarithms of the values",
        partial(_on_scheme, _uniform, partial(_rbf, None, True)),
        435,
    ),
    Method(
        "rbf_local_log",
        "as rbf_local, of the logarithms of the values",
        partial(_on_scheme, _uniform, partial(_rbf, NEIGHBOURS, True)),
        435,
    ),
    Method(
        "regular_grid",
        "regular grid, multilinear interpolation",
        partial(_on_scheme, _regular, _regular_grid),
        10,
    ),
)

METHODS: Mapping[str, Method] = MappingProxyType({entry.name: entry for entry in _ALL})

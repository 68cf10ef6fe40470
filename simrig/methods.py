"""The methods by name: how each measures a material, and the BRDF that it makes of that.

Studies and plots run any of them alike. A method asks the rig for its own plan; where it cannot
take exactly the samples that were wished, it takes the most that its plans allow below, and says
how many. The methods themselves are in ``simrig.reconstruction`` and never see the truth.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType

import numpy as np

from simrig.brdf.protocol import Brdf
from simrig.brdf.slices.slices import SliceBrdf
from simrig.core.cost import Cost, stopwatch
from simrig.core.errors import SimrigError, unknown_name
from simrig.directions.schemes import HemisphereScheme
from simrig.plans.auto.plan import LEAST_SAMPLES, AutomaticPlan
from simrig.plans.gantry import gantry_plan
from simrig.plans.placement import optimal_placement
from simrig.plans.uniform import largest_uniform_scheme, uniform_plan
from simrig.reconstruction.gantry.brdfs import reconstruct_gantry
from simrig.reconstruction.kriging import reconstruct_kriging
from simrig.reconstruction.scattered.by_name import Reconstructed, reconstruct_by_name
from simrig.reconstruction.slices.highlights import reconstruct_along_highlights
from simrig.reconstruction.slices.tables import SliceMeasurement, reconstruct
from simrig.rigs.direct.gonioreflectometer import Gonioreflectometer, Progress
from simrig.rigs.gantry.rig import Gantry

LARGEST_THETA_DEG = 80.0  # that of the thesis; real arms do not reach much further


@dataclass(frozen=True, eq=False)
class MethodResult:
    """What a method made of a material, and what that cost.

    Attributes:
        brdf: the result.
        samples: how many were really taken.
        hardware_seconds: simulated time of the measuring device.
        sampling_seconds: time of computing while measuring.
        reconstruction_seconds: time from the samples to the BRDF.
        bytes: storage of the result.
        notes: what a reader must know: condition numbers, fall-backs, assumptions.
    """

    brdf: Brdf
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
        run: ``run(rig, brdf, samples, progress=None)`` measures and reconstructs.
        least_samples: fewer than these are refused.
    """

    name: str
    about: str
    run: Callable[..., MethodResult]
    least_samples: int


def method(name: str) -> Method:
    """Return a method by name: a key of ``METHODS``.

    Raises:
        SimrigError: unknown name, with the nearest known one.
    """
    if name not in METHODS:
        raise unknown_name("method", name, METHODS)
    return METHODS[name]


def reconstructed(
    cost: Cost, reconstruct: Callable[[], Reconstructed], *notes: str
) -> MethodResult:
    """Time a reconstruction and return it with the cost of its measurement.

    Args:
        cost: of the measurement.
        reconstruct: makes the BRDF.
        notes: said before those of the reconstruction.
    """
    elapsed = stopwatch()
    made = reconstruct()
    return MethodResult(
        brdf=made.brdf,
        samples=cost.samples,
        hardware_seconds=cost.hardware_seconds,
        sampling_seconds=cost.compute_seconds,
        reconstruction_seconds=elapsed(),
        bytes=made.bytes,
        notes=(*notes, *made.notes),
    )


def _slices(
    slice_types: str,
    reconstruct_from: Callable[[SliceMeasurement], SliceBrdf],
    rig: Gonioreflectometer,
    brdf: Brdf,
    samples: int,
    progress: Progress | None = None,
) -> MethodResult:
    placement = optimal_placement(samples, _theta_max_deg(brdf))
    measurement = rig.measure(brdf, placement, samples, slice_types=slice_types, progress=progress)

    def reconstruct() -> Reconstructed:
        result = reconstruct_from(measurement)
        return Reconstructed(result, result.stored_bytes)

    return reconstructed(measurement.cost, reconstruct, placement.describe(), *_assumed(brdf))


def _on_scheme(
    name: str,
    plan: Callable[[int, Brdf], HemisphereScheme],
    rig: Gonioreflectometer,
    brdf: Brdf,
    samples: int,
    progress: Progress | None = None,
) -> MethodResult:
    scheme = plan(samples, brdf)
    measurement = rig.measure_scheme(brdf, scheme, reciprocal=True, progress=progress)
    return reconstructed(
        measurement.cost,
        partial(reconstruct_by_name, name, measurement),
        f"{scheme.name}, {len(scheme)} directions",
        *_assumed(brdf),
    )


def _uniform(samples: int, brdf: Brdf) -> HemisphereScheme:
    """Return the densest uniform scheme; its rings must lie within the data."""
    scheme = largest_uniform_scheme(samples)
    if scheme.theta.max() > brdf.theta_max + 1e-6:
        raise SimrigError(
            f"'{brdf.name}' has data up to {np.degrees(brdf.theta_max):g}° only; "
            f"the uniform schemes reach {LARGEST_THETA_DEG:g}°: use regular_grid or slices"
        )
    return scheme


def _regular(samples: int, brdf: Brdf) -> HemisphereScheme:
    theta_max = float(np.radians(_theta_max_deg(brdf)))
    return uniform_plan(samples, theta_max).scheme()


def _theta_max_deg(brdf: Brdf) -> float:
    """Return 80, or where the data end earlier, that rounded down to whole degrees."""
    data_end = float(np.degrees(brdf.theta_max))
    return min(LARGEST_THETA_DEG, float(np.floor(data_end + 5e-5)))


def _assumed(brdf: Brdf) -> tuple[str, ...]:
    if brdf.reciprocal:
        return ()
    return ("not reciprocal: only theta_i <= theta_v was measured",)


def _gantry(
    name: str,
    rig: Gonioreflectometer,
    brdf: Brdf,
    samples: int,
    progress: Progress | None = None,
) -> MethodResult:
    """Measure on a gantry of its own, which simulates no effects."""
    if rig.effects:
        raise SimrigError("a gantry simulates no effects: give a rig without")
    plan = gantry_plan(samples)
    measurement = Gantry().measure(brdf, plan)
    if progress is not None:
        progress(plan.samples, plan.samples)

    def reconstruct() -> Reconstructed:
        made = reconstruct_gantry(measurement, name)
        return Reconstructed(made.brdf, made.brdf.values.nbytes, made.notes)

    return reconstructed(measurement.cost, reconstruct, plan.describe())


def _automatic(
    rig: Gonioreflectometer,
    brdf: Brdf,
    samples: int,
    progress: Progress | None = None,
) -> MethodResult:
    measurement = rig.measure_plan(brdf, AutomaticPlan(samples), progress=progress)
    plan = str(measurement.provenance["plan"])
    return reconstructed(measurement.cost, partial(reconstruct_kriging, measurement), plan)


# name and one line of each, by how it measures
_ALONG_SLICES = (
    ("slices", "adaptive slices, all kinds (5.3)", "all", reconstruct),
    (
        "slices_axial_diagonal",
        "adaptive slices, axial and diagonal only (5.3)",
        "axial_diagonal",
        reconstruct,
    ),
    (
        "along-highlights",
        "adaptive slices, all kinds, interpolated along highlights (5.7 in 4-D)",
        "all",
        reconstruct_along_highlights,
    ),
    (
        "along_highlights_axial_diagonal",
        "as along-highlights, axial and diagonal slices only",
        "axial_diagonal",
        reconstruct_along_highlights,
    ),
)
_ON_UNIFORM_SCHEMES = {
    "barycentric": "uniform scheme, barycentric interpolation (5.5.2)",
    "rbf_global": "uniform scheme, one radial basis function per sample (5.5.2)",
    "rbf_local": "uniform scheme, radial basis functions of the nearest samples",
    "rbf_global_log": "as rbf_global, of the logarithms of the values",
    "rbf_local_log": "as rbf_local, of the logarithms of the values",
}
_ON_GANTRIES = {
    "a": "gantry slices, radial basis functions between polar angles (6.1, A)",
    "b": "gantry slices, linear along a Lafortune model (6.1, B)",
    "bd": "gantry slices, displacement interpolation (6.1, BD)",
}
_ALL = (
    Method(
        "auto",
        "looks first, measures where it shows, kriging of logarithms",
        _automatic,
        least_samples=LEAST_SAMPLES,
    ),
    *(
        Method(name, about, partial(_slices, slice_types, reconstruct), least_samples=55)
        for name, about, slice_types, reconstruct in _ALONG_SLICES
    ),
    *(
        Method(name, about, partial(_on_scheme, name, _uniform), least_samples=435)
        for name, about in _ON_UNIFORM_SCHEMES.items()
    ),
    Method(
        "regular_grid",
        "regular grid, multilinear interpolation",
        partial(_on_scheme, "regular_grid", _regular),
        least_samples=10,
    ),
    *(
        Method(f"gantry_{name}", about, partial(_gantry, name), least_samples=32)
        for name, about in _ON_GANTRIES.items()
    ),
)

METHODS: Mapping[str, Method] = MappingProxyType({entry.name: entry for entry in _ALL})

"""The methods by name: which measurements each takes, and the BRDF that it makes of one.

A method sees the measurement and never the truth. It also has a plan and a rig of its own, those
that it was made for, so that studies and plots run any of them alike (``Method.run``).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from simrig.brdf.protocol import Brdf
from simrig.brdf.slices.slices import SliceBrdf
from simrig.brdf.tables.grid import azimuths_of
from simrig.core.cost import stopwatch
from simrig.core.effects import Tolerance
from simrig.core.errors import SimrigError, check_known
from simrig.core.gamut import KEEP
from simrig.core.options import Option, checked_options
from simrig.core.progress import Progress
from simrig.plans.auto.plan import LEAST_SAMPLES
from simrig.plans.large_sample import LargeSamplePlan
from simrig.plans.minimal import DATABASE, MinimalPlan
from simrig.plans.protocol import Plan
from simrig.plans.registry import PLANS, plan_type
from simrig.plans.visible_normals import LEAST_SAMPLES as LEAST_OF_GRIDS
from simrig.reconstruction.basis.method import ALL_SOLVERS, PROCESS, reconstruct_from_basis
from simrig.reconstruction.gantry.brdfs import reconstruct_gantry
from simrig.reconstruction.kriging import reconstruct_kriging
from simrig.reconstruction.result import Reconstructed as Reconstructed
from simrig.reconstruction.scattered.barycentric import reconstruct_barycentric
from simrig.reconstruction.scattered.dense_bins import reconstruct_dense_bins
from simrig.reconstruction.scattered.rbf import NEIGHBOURS
from simrig.reconstruction.scattered.rbf_table import rbf_or_table
from simrig.reconstruction.scattered.regular_grid import reconstruct_regular_grid
from simrig.reconstruction.slices.along_slices import INTERPOLATIONS
from simrig.reconstruction.slices.highlights import reconstruct_along_highlights
from simrig.reconstruction.slices.tables import reconstruct
from simrig.reconstruction.visible_normals import reconstruct_visible_normals
from simrig.rigs.direct.gonioreflectometer import Gonioreflectometer
from simrig.rigs.gantry.rig import Gantry
from simrig.rigs.measurements.measurement import Measurement
from simrig.rigs.protocol import Rig
from simrig.rigs.registry import make_rig


@dataclass(frozen=True, eq=False)
class MethodResult:
    """What a method made of a material, and what that cost.

    Attributes:
        samples: how many were really taken.
        hardware_seconds: simulated time of the measuring device.
        sampling_seconds: time of computing while measuring.
        reconstruction_seconds: time from the samples to the BRDF.
        bytes: storage of the result.
        notes: what a reader must know: the plan, condition numbers, fall-backs, assumptions.
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
    """A way from a measurement to a BRDF.

    Attributes:
        name: its key in ``METHODS``, lower case with hyphens.
        make: ``make(measurement, **options)``.
        plan_name: of the plan that it was made for, a key of ``PLANS``.
        least_samples: of that plan; fewer are refused.
        plan_options: of that plan.
        any_plan: whether it takes measurements by any plan, or by its own alone.
        rig: name of the rig that it was made for.
        instrument: that its plan needs, where the rig's usual one will not do.
        options: what ``make`` takes.
        to_store: options with which the result can be stored, where without them it cannot.
        linear: whether the result is linear in the values, so that they may be negative.
    """

    name: str
    about: str
    make: Callable[..., Reconstructed]
    plan_name: str
    least_samples: int
    plan_options: Mapping[str, Any] = field(default_factory=dict)
    any_plan: bool = False
    rig: str = Gonioreflectometer.name
    instrument: str = ""
    options: tuple[Option, ...] = ()
    to_store: Mapping[str, Any] = field(default_factory=dict)
    linear: bool = False

    def check(self, measurement: Measurement) -> None:
        """Raise SimrigError for a measurement by a plan that the method cannot use."""
        if measurement.gamut == KEEP and not self.linear:
            able = ", ".join(m.name for m in METHODS.values() if m.linear)
            raise SimrigError(
                f"{self.name} works with values >= 0, those of colours outside sRGB are negative: "
                f"use {able}, or gamut 'clip'"
            )
        found = measurement.plan.name
        if self.any_plan or found == self.plan_name:
            return
        fitting = [m.name for m in METHODS.values() if m.any_plan or m.plan_name == found]
        raise SimrigError(
            f"{self.name} needs a measurement by plan '{self.plan_name}', this one is by plan "
            f"'{found}': use {', '.join(fitting[:-1])} or {fitting[-1]}"
        )

    def plan(self, material: Brdf | None, samples: int, **options: Any) -> Plan:
        """Return the method's own plan.

        Args:
            samples: at most so many, as near as the plan can.
            options: of the plan; None is: not given.

        Raises:
            SimrigError: too few samples, or options that cannot be.
        """
        kind = plan_type(self.plan_name)
        given = {"samples": samples, **options}
        checked = checked_options(kind, given, PLANS.values(), "plan")
        return kind.for_material(material, **{**checked, **self.plan_options})

    def reconstruct(
        self, measurement: Measurement, progress: Progress | None = None, **options: Any
    ) -> Reconstructed:
        """Return what the method makes of a measurement.

        Args:
            progress: called with the steps done and in total, by methods that take long.
            options: see ``options``; None is: not given.

        Raises:
            SimrigError: a measurement that the method cannot use, or an option that it does not
                have.
        """
        self.check(measurement)
        given = checked_options(self, options, METHODS.values(), "method")
        return self.make(measurement, progress=progress, **given)

    def run(
        self,
        material: Brdf,
        samples: int,
        rigs: Iterable[Rig] = (),
        tolerance: Tolerance | None = None,
        progress: Progress | None = None,
    ) -> MethodResult:
        """Measure a material by the method's own plan and reconstruct it.

        Args:
            material: the truth, which the reconstruction does not see.
            samples: that are wished; the plan takes the most that it can below.
            rigs: in the place of those that come with simrig, for the methods made for them.
            tolerance: chooses the effects that the rig simulates, if it can; none unless given.

        Raises:
            SimrigError: too few samples, or what the rig refuses.
        """
        usual = make_rig(self.instrument or self.rig)
        rig = next((r for r in rigs if r.name == self.rig), usual)
        plan = self.plan(material, samples)
        allowed = tolerance if rig.effect_names else None
        measurement = rig.measure(material, plan, tolerance=allowed, progress=progress)
        elapsed = stopwatch()
        made = self.reconstruct(measurement)
        seconds = elapsed()
        cost = measurement.cost
        return MethodResult(
            brdf=made.brdf,
            samples=cost.samples,
            hardware_seconds=cost.hardware_seconds,
            sampling_seconds=cost.compute_seconds,
            reconstruction_seconds=seconds,
            bytes=made.bytes,
            notes=(plan.describe(), *_assumed(material, plan), *made.notes),
        )


def method(name: str) -> Method:
    """Return a method by name: a key of ``METHODS``.

    Raises:
        SimrigError: unknown name, with the nearest known one.
    """
    check_known("method", name, METHODS)
    return METHODS[name]


def method_for(measurement: Measurement) -> Method:
    """Return the first method made for such a plan; basis where it has a database, barycentric."""
    own = (m for m in METHODS.values() if m.plan_name == measurement.plan.name)
    return next(own, METHODS["basis" if measurement.plan.needs else _ANY_DIRECTIONS])


def _assumed(material: Brdf, plan: Plan) -> tuple[str, ...]:
    if material.reciprocal or not plan.one_order:
        return ()
    return ("not reciprocal: only theta_i <= theta_v was measured",)


# --- how each makes a BRDF ---


def _from_slices(
    reconstruct_from: Callable[..., SliceBrdf],
    measurement: Measurement,
    *,
    interpolation: str = "cubic",
    progress: Progress | None = None,
) -> Reconstructed:
    return Reconstructed.of(reconstruct_from(measurement, interpolation))


def _from_any(how: Callable[..., Any]) -> Callable[..., Reconstructed]:
    """Return a reconstruction without options as methods take it."""

    def make(measurement: Measurement, *, progress: Progress | None = None) -> Reconstructed:
        made = how(measurement)
        return made if isinstance(made, Reconstructed) else Reconstructed.of(made)

    return make


def _from_gantry(
    which: str,
    measurement: Measurement,
    *,
    interpolation: str = "pchip",
    step_deg: float = 7.5,
    progress: Progress | None = None,
) -> Reconstructed:
    return reconstruct_gantry(
        measurement,
        which,
        theta_step_deg=step_deg,
        azimuths=azimuths_of(step_deg),
        interpolation=interpolation,
    )


_ANY_DIRECTIONS = "barycentric"
_ONCE = {"reciprocal": True}  # pairs are measured in one order
_INTERPOLATION = "Along the slices: {} unless given; pchip never overshoots."
_OF_SLICES = (
    Option("interpolation", str, _INTERPOLATION.format("cubic"), "cubic", INTERPOLATIONS),
)
_OF_RBF = (
    Option("step_deg", float, "Degrees between the nodes of a table.", least=0.5, most=30.0),
)
_OF_GANTRY = (
    Option("interpolation", str, _INTERPOLATION.format("pchip"), "pchip", INTERPOLATIONS),
    Option("step_deg", float, "Degrees between the table's nodes.", 7.5, least=0.5, most=30.0),
)
_FLAT = "axial-diagonal"  # slices within subspaces
# name, one line, how, the slices that its plan measures
_ALONG_SLICES = (
    ("slices", "adaptive slices, all kinds (5.3)", reconstruct, "all"),
    ("slices-axial-diagonal", "adaptive slices, axial and diagonal only (5.3)", reconstruct, _FLAT),
    (
        "along-highlights",
        "adaptive slices, all kinds, interpolated along highlights (5.7 in 4-D)",
        reconstruct_along_highlights,
        "all",
    ),
    (
        "along-highlights-axial-diagonal",
        "as along-highlights, axial and diagonal slices only",
        reconstruct_along_highlights,
        _FLAT,
    ),
)
_BY_RBF = (
    ("rbf-global", "uniform scheme, one radial basis function per sample (5.5.2)", None, False),
    ("rbf-local", "uniform scheme, splines of the nearest samples", NEIGHBOURS, False),
    ("rbf-global-log", "as rbf-global, of the logarithms of the values", None, True),
    ("rbf-local-log", "as rbf-local, of the logarithms of the values", NEIGHBOURS, True),
)
_BY_GANTRY = (
    ("gantry-b", "gantry slices, linear along a Minnaert model (6.1, B)"),
    ("gantry-a", "gantry slices, radial basis functions between polar angles (6.1, A)"),
    ("gantry-bd", "gantry slices, displacement interpolation (6.1, BD)"),
)
_ALL = (
    Method(
        "auto",
        "looks first, measures where it shows, kriging of logarithms",
        _from_any(reconstruct_kriging),
        "auto",
        least_samples=LEAST_SAMPLES,
        any_plan=True,
    ),
    Method(
        "visible-normals",
        "retro-reflection, then a grid of visible normals [DJ18]",
        _from_any(reconstruct_visible_normals),
        "visible-normals",
        least_samples=LEAST_OF_GRIDS,
    ),
    *(
        Method(
            name,
            about,
            partial(_from_slices, how),
            "slices",
            least_samples=55,
            plan_options={"slice_types": slice_types},
            options=_OF_SLICES,
        )
        for name, about, how, slice_types in _ALONG_SLICES
    ),
    Method(
        _ANY_DIRECTIONS,
        "uniform scheme, barycentric interpolation (5.5.2)",
        _from_any(reconstruct_barycentric),
        "uniform",
        least_samples=435,
        plan_options=_ONCE,
        any_plan=True,
        linear=True,
    ),
    *(
        Method(
            name,
            about,
            partial(rbf_or_table, neighbours=neighbours, logarithms=logarithms),
            "uniform",
            least_samples=435,
            plan_options=_ONCE,
            any_plan=True,
            options=_OF_RBF,
            to_store={"step_deg": 5.0},
        )
        for name, about, neighbours, logarithms in _BY_RBF
    ),
    Method(
        "dense-bins",
        "very many samples in the bins of a dense table, medians (4.3)",
        reconstruct_dense_bins,
        LargeSamplePlan.name,
        least_samples=841,
        any_plan=True,
        instrument="utia-large",
        options=(
            Option(
                "step_deg", float, "Degrees of a bin; as many samples allow.", least=1.0, most=30.0
            ),
        ),
    ),
    Method(
        "regular-grid",
        "regular grid, multilinear interpolation",
        _from_any(reconstruct_regular_grid),
        "regular-grid",
        least_samples=10,
        plan_options=_ONCE,
        any_plan=True,
        linear=True,
    ),
    Method(
        "basis",
        "few samples and a database: its rotation-stationary process, or ridge (7.2)",
        reconstruct_from_basis,
        MinimalPlan.name,
        least_samples=1,
        any_plan=True,
        options=(DATABASE, Option("solver", str, "Of the basis.", PROCESS, ALL_SOLVERS)),
    ),
    *(
        Method(
            which,
            about,
            partial(_from_gantry, which),
            "gantry",
            least_samples=32,
            rig=Gantry.name,
            options=_OF_GANTRY,
        )
        for which, about in _BY_GANTRY
    ),
)

METHODS: dict[str, Method] = {entry.name: entry for entry in _ALL}
"""Every method. A new one is one more entry."""
ALONE = [name for name, entry in METHODS.items() if not plan_type(entry.plan_name).needs]
"""Those that need nothing but a material."""

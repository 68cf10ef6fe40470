"""``simrig measure`` and ``simrig reconstruct``: from a material to samples to a BRDF."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from simrig.cli import effect_options, frame
from simrig.cli.gantry import measure_gantry
from simrig.cli.measured import measurement_report
from simrig.cli.outputs import output_file
from simrig.cli.reconstruct import Method, load_measurement, reconstructed
from simrig.cli.schemes import DEFAULT_THETA_MAX, measure_scheme, scheme_of
from simrig.core.cost import stopwatch
from simrig.core.errors import SimrigError

if TYPE_CHECKING:
    from simrig.plans.placement import SlicePlacement


class Rig(StrEnum):
    """The devices that measure a material."""

    GONIOREFLECTOMETER = "gonioreflectometer"
    GANTRY = "gantry"


class SliceTypes(StrEnum):
    """Which slices are measured; the library writes the second with an underscore."""

    ALL = "all"
    AXIAL_DIAGONAL = "axial-diagonal"


class Interpolation(StrEnum):
    """How values are interpolated along a slice."""

    CUBIC = "cubic"
    PCHIP = "pchip"
    LINEAR = "linear"


def register(app: typer.Typer) -> None:
    """Add the commands to the application."""
    frame.command(app)(measure)
    frame.command(app)(reconstruct)


def measure(
    material: Annotated[str, typer.Argument(help="A built-in material or a material file.")],
    output: Annotated[Path, typer.Option(help="The measurement (.h5).")],
    samples: Annotated[
        int | None,
        typer.Option(
            help="Distinct direction pairs to measure; 8911 if not given, of a gantry 168."
        ),
    ] = None,
    rig: Annotated[Rig, typer.Option(help="The device.")] = Rig.GONIOREFLECTOMETER,
    isotropic: Annotated[
        bool, typer.Option(help="Of a gantry: diagonal slices alone, half the samples.")
    ] = False,
    scheme: Annotated[
        str | None,
        typer.Option(help="All pairs of a scheme instead: 1 to 30, a name, uniform or regular."),
    ] = None,
    theta_step: Annotated[
        float | None,
        typer.Option(help="Degrees between polar angles; by Table 5.1 for --samples else."),
    ] = None,
    azimuth_step: Annotated[
        float | None, typer.Option(help="Degrees between slices; given with --theta-step.")
    ] = None,
    theta_max: Annotated[
        float, typer.Option(help="Largest polar angle in degrees.")
    ] = DEFAULT_THETA_MAX,
    slices: Annotated[SliceTypes, typer.Option(help="Which slices.")] = SliceTypes.ALL,
    k: Annotated[float, typer.Option(help="Parameter k of algorithm 5.1.")] = 0.9,
    p_1: Annotated[int, typer.Option("--p1", help="Parameter p_1 of algorithm 5.1.")] = 5,
    p_2: Annotated[int, typer.Option("--p2", help="Parameter p_2 of algorithm 5.1.")] = 5,
    tolerance: effect_options.Tolerance = None,
    enable: effect_options.Enable = None,
    disable: effect_options.Disable = None,
    everything: effect_options.Everything = False,
    ideal: Annotated[
        bool, typer.Option(help="A rig without effects: points, exact axes, a perfect sensor.")
    ] = False,
    seed: Annotated[int, typer.Option(min=0, help="Of noise and errors of the axes.")] = 0,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace an existing output.")
    ] = False,
) -> frame.Report:
    """Measure a material with the virtual gonioreflectometer, adaptively along slices.

    With --scheme it measures all pairs of a scheme's directions instead, each unordered pair once
    for a reciprocal material: one of the thirty uniform schemes by its number, another scheme by
    its name, or the densest uniform scheme or regular grid that --samples allow.

    With --rig gantry it measures one axial and one diagonal slice at each pair of two polar angles,
    168 samples in six minutes; with --samples as many slices as those allow.

    Which effects of the rig are simulated follows from the tolerance (dE=0.5 unless given): those
    that could change the measured values by more together. The plan is kept in the measurement.

    What was measured so far is kept in .NAME.checkpoint beside the output: after Ctrl-C (or a
    kill) the same command goes on from there, with the same result as without the interruption.
    """
    placed = theta_step or azimuth_step or slices != SliceTypes.ALL
    if scheme is not None and placed:
        raise SimrigError("--scheme measures no slices: leave out the options that place them")
    if isotropic and rig != Rig.GANTRY:
        raise SimrigError("--isotropic chooses the slices of a gantry: add --rig gantry")
    if rig == Rig.GANTRY:
        if placed or scheme is not None or theta_max != DEFAULT_THETA_MAX:
            raise SimrigError("a gantry has its own slices: give --samples or --isotropic alone")
        if tolerance or enable or disable or everything:
            raise SimrigError(
                "a gantry simulates no effects: leave out the options that choose some"
            )
    wished = 8911 if samples is None else samples
    if ideal and (tolerance or enable or disable or everything):
        raise SimrigError("--ideal simulates no effect: leave out the options that choose some")
    slice_types = slices.replace("-", "_")

    from simrig.core.effects import Overrides, parse_tolerance
    from simrig.files.load import load_material
    from simrig.instruments.instrument import Instrument
    from simrig.rigs.direct.gonioreflectometer import Gonioreflectometer
    from simrig.rigs.direct.planning import plan_rig, with_plan

    allowed = parse_tolerance(tolerance or effect_options.DEFAULT_TOLERANCE)
    overrides = Overrides(tuple(enable or ()), tuple(disable or ()), everything)
    device, plan = Gonioreflectometer(instrument=Instrument(seed=seed)), None
    listed = None if scheme is None else scheme_of(scheme, samples, theta_max)
    with output_file(output, overwrite):
        brdf = load_material(material)
        if rig == Rig.GANTRY:
            return measure_gantry(brdf, samples, isotropic, output)
        checkpoint = output.with_name(f".{output.name}.checkpoint")
        frame.on_interrupt(f"run the same command again to go on from '{checkpoint}'")
        if listed is not None:
            effects = None if ideal else (allowed, overrides)
            return measure_scheme(brdf, device, listed, output, checkpoint, effects)
        placement = _placement(wished, theta_step, azimuth_step, theta_max)
        if not ideal:
            plan = plan_rig(
                brdf,
                device,
                allowed,
                placement=placement,
                samples=wished,
                overrides=overrides,
                slice_types=slice_types,
            )
            device = with_plan(device, plan)
        with frame.progress(f"measuring {brdf.name}") as report:
            measurement = device.measure(
                brdf,
                placement,
                wished,
                slice_types=slice_types,
                k=k,
                p_1=p_1,
                p_2=p_2,
                checkpoint=checkpoint,
                progress=report,
            )
        measurement.save(output)
    layout = f"{placement.describe()} ({placement.intersections} intersections), {slices} slices"
    about = {
        "placement": placement.describe(),
        "intersections": placement.intersections,
        "slices": str(slices),
        "plan": plan.as_dict() if plan else None,
    }
    tables = [effect_options.plan_table(plan, f"effects at {allowed}")] if plan else []
    return measurement_report(output, measurement, layout, about, tables)


def _placement(
    samples: int, theta_step: float | None, azimuth_step: float | None, theta_max: float
) -> SlicePlacement:
    from simrig.plans.placement import SlicePlacement, optimal_placement

    if (theta_step is None) != (azimuth_step is None):
        raise SimrigError("give --theta-step and --azimuth-step together, or neither")
    if theta_step is None or azimuth_step is None:
        return optimal_placement(samples, theta_max)
    return SlicePlacement.from_degrees(theta_step, azimuth_step, theta_max)


def reconstruct(
    measurement: Annotated[Path, typer.Argument(help="A measurement written by 'measure'.")],
    output: Annotated[Path, typer.Option(help="The BRDF: .h5, or another format by its ending.")],
    method: Annotated[
        Method | None,
        typer.Option(help="By what was measured else: slices, barycentric or gantry-b."),
    ] = None,
    interpolation: Annotated[
        Interpolation | None,
        typer.Option(help="Along the slices: cubic else, pchip (never overshoots) of a gantry."),
    ] = None,
    step: Annotated[
        float | None,
        typer.Option(help="Degrees between nodes: 5 of the table of an RBF, 7.5 of a gantry else."),
    ] = None,
    format: Annotated[
        str | None, typer.Option(help="See 'simrig convert --help'; by the ending else.")
    ] = None,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace an existing output.")
    ] = False,
) -> frame.Report:
    """Reconstruct the whole BRDF from a measurement: of slices, a scheme or a gantry.

    The methods: docs/methods.md. Radial basis functions (rbf-…) are too slow to render and are
    stored as a table.
    """
    from simrig.files.load import save_material

    measured = load_measurement(measurement)
    with output_file(output, overwrite):
        elapsed = stopwatch()
        made = reconstructed(measured, method, interpolation and str(interpolation), step)
        seconds = elapsed()
        saved = save_material(output, made.brdf, format)
    return frame.Report(
        data={
            "output": output,
            "material": made.brdf.name,
            "samples": measured.cost.samples,
            "method": made.method,
            "interpolation": made.interpolation,
            "notes": list(made.notes),
            "compute_seconds": seconds,
            "format": saved.format,
            "bytes": saved.bytes,
        },
        shown=[
            f"{output}: {made.brdf.name}, {saved.format} format, in {seconds:.2f} s, "
            f"{saved.bytes:,} bytes",
            *([", ".join(made.notes)] if made.notes else []),
        ],
    )

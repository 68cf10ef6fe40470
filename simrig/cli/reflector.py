"""``simrig reflector``: pictures under an ellipsoidal mirror, and what they show of a material."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from simrig.cli import effect_options, frame
from simrig.cli.options import Material, Overwrite, Seed, check_picture, numbers, write_picture
from simrig.cli.outputs import output_file
from simrig.core.errors import SimrigError

Instrument = Annotated[
    str, typer.Option(help="'reflector', or the TOML file of one (docs/instruments.md).")
]

_UNALIGNED = (
    "without a reference highlights may be missed, and axes be farther off than stated: give the "
    "picture of a black paper in the same place (--reference)"
)
_MOST_COLUMNS = 16  # of a sheet


def picture(
    material: Material,
    output: Annotated[Path, typer.Option(help="The picture: .exr holds values, .png shows them.")],
    rotation: Annotated[float, typer.Option(help="Of the material, degrees.")] = 0.0,
    pixels: Annotated[int, typer.Option(min=8, max=2048, help="Along each side.")] = 192,
    instrument: Instrument = "reflector",
    *,
    effects: effect_options.Effects,
    overwrite: Overwrite = False,
) -> frame.Report:
    """Record the picture of a material under the reflector, folded (docs/reflector.md).

    Which imperfections of the mirror are simulated follows from the tolerance (dE=0.5 unless
    given): those that could change the picture by more together.
    """
    import json

    from simrig.core.cost import stopwatch
    from simrig.core.effects import Overrides, parse_tolerance
    from simrig.files.load import load_material
    from simrig.rigs.reflector.effects import plan_picture, simulated
    from simrig.rigs.reflector.folded import fold
    from simrig.rigs.reflector.folded import picture as record

    check_picture(output)
    mirror, brdf = _mirror(instrument), load_material(material)
    tolerance = parse_tolerance(effects.tolerance or effect_options.DEFAULT_TOLERANCE)
    with output_file(output, overwrite):
        plan = plan_picture(mirror, brdf, rotation, tolerance, Overrides(**effects.overrides))
        elapsed = stopwatch()
        folded = fold(simulated(mirror, tuple(plan.settings["effects"])), pixels)
        image = record(folded, brdf, rotation)
        seconds = elapsed()
        level = float(image[folded.inside].max())
        about = {"material": brdf.name, "rotation_deg": rotation, "unit": "radiance",
                 "plan": json.dumps(plan.as_dict())}  # fmt: skip
        write_picture(output, image, about, 1.0 / level if level > 0.0 else 1.0)
    data = {"file": output, "pixels": pixels, "largest": level, "compute_seconds": seconds}
    return frame.Report(
        data={**data, "effects": plan.as_dict()},
        shown=[
            f"{output}: {pixels} × {pixels} pixels, {seconds:.2f} s",
            effect_options.plan_table(plan, f"effects at {plan.tolerance}"),
        ],
    )


def analyse(
    photograph: Annotated[Path, typer.Argument(help="A picture of the opening: .exr, .png, …")],
    reference: Annotated[
        Path | None, typer.Option(help="The same with an even dull material (black paper).")
    ] = None,
    opening: Annotated[
        str | None,
        typer.Option(metavar="X,Y,DIAMETER", help="Of the opening in pixels; found else."),
    ] = None,
    flash_azimuth: Annotated[
        float | None,
        typer.Option(help="Degrees from the picture's right to the flash; found else."),
    ] = None,
    instrument: Instrument = "reflector",
    sheet: Annotated[
        Path | None, typer.Option(help="Draw picture, axes, unrolled picture and profile, .png.")
    ] = None,
    overwrite: Overwrite = False,
) -> frame.Report:
    """Find the anisotropic highlights that one picture under the reflector shows."""
    import numpy as np

    from simrig.core.cost import stopwatch
    from simrig.rigs.reflector.photograph import analyse_photograph, read_photograph

    if sheet is None:
        frame.refuse_unused("nothing is drawn without --sheet", "overwrite")
    elif sheet.suffix.lower() != ".png":
        raise SimrigError(f"'{sheet}': sheets are drawn as .png")
    mirror = _mirror(instrument)
    shown = read_photograph(photograph)
    even = None if reference is None else read_photograph(reference)
    elapsed = stopwatch()
    found = analyse_photograph(shown, mirror, even, _opening(opening), flash_azimuth)
    seconds = elapsed()
    if sheet is not None:
        from simrig.viewing.reflector import draw_sheet

        with output_file(sheet, overwrite):
            draw_sheet(found, sheet)
    modes = found.anisotropy.modes
    note = _UNALIGNED if even is None else None
    highlights = [
        {
            "axis_deg": np.degrees(m.axis),
            "axis_uncertainty_deg": np.degrees(m.axis_uncertainty),
            "width_deg": np.degrees(m.width),
            "width_uncertainty_deg": np.degrees(m.width_uncertainty),
            "flanks_deg": [float(np.degrees(f)) for f in m.flanks],
            "strength": m.strength,
            "strength_uncertainty": m.strength_uncertainty,
            "colour": list(m.colour),
        }
        for m in modes.found
    ]
    rows = [
        (
            f"{h['axis_deg']:.2f}° ± {h['axis_uncertainty_deg']:.2f}°",
            f"{h['width_deg']:.1f}° ± {h['width_uncertainty_deg']:.1f}°",
            f"{h['strength']:.4f} ± {h['strength_uncertainty']:.4f}",
            " ".join(f"{c:.2f}" for c in m.colour),
        )
        for h, m in zip(highlights, modes.found, strict=True)
    ]
    said = f"{len(rows)} anisotropic highlight{'s' if len(rows) != 1 else ''}"
    return frame.Report(
        data={
            "highlights": highlights,
            "count": len(rows),
            "modulation": modes.modulation,
            "significance": modes.significance,
            "opening": [found.opening.x, found.opening.y, found.opening.diameter],
            "flash_azimuth_deg": found.mirror.flash_azimuth_deg,
            "residual": found.anisotropy.residual,
            "note": note,
            "detection_seconds": found.seconds,
            "compute_seconds": seconds,
            "sheet": sheet,
        },
        shown=[
            f"{said} (modulation {modes.modulation:.4f}, {modes.significance:.1f} standard "
            "uncertainties)",
            *([frame.table(("axis", "width", "strength", "colour"), rows)] if rows else []),
            f"opening {found.opening.diameter:.1f} pixels at {found.opening.x:.1f}, "
            f"{found.opening.y:.1f}; flash at {found.mirror.flash_azimuth_deg:.1f}°; detection "
            f"{found.seconds:.2f} s of {seconds:.2f} s",
            *([] if note is None else [note]),
        ],
    )


def sheet(
    materials: Annotated[list[str], typer.Argument(help="Names or files, one column each.")],
    output: Annotated[Path, typer.Option(help="The sheet, .png.")],
    rotation: Annotated[float, typer.Option(help="Of the materials, degrees.")] = 0.0,
    overwrite: Overwrite = False,
) -> frame.Report:
    """Draw picture, axes, unrolled picture and profile of materials (thesis Fig. 3.3)."""
    import numpy as np

    from simrig.files.load import load_material
    from simrig.viewing.reflector import draw_sheet, material_sheet, true_profile

    if output.suffix.lower() != ".png":
        raise SimrigError(f"'{output}': sheets are drawn as .png")
    if len(materials) > _MOST_COLUMNS:
        raise SimrigError(f"a sheet has {_MOST_COLUMNS} columns at most, got {len(materials)}")
    brdfs = [load_material(name) for name in materials]
    with output_file(output, overwrite):
        found = [material_sheet(brdf, rotation) for brdf in brdfs]
        truths = [true_profile(brdf, rotation) for brdf in brdfs]
        draw_sheet(found, output, truths, [brdf.name for brdf in brdfs])
    axes = {
        brdf.name: [float(np.degrees(m.axis)) for m in own.anisotropy.modes.found]
        for brdf, own in zip(brdfs, found, strict=True)
    }
    lines = [
        f"{n}: {', '.join(f'{a:.2f}°' for a in own) or 'isotropic'}" for n, own in axes.items()
    ]
    return frame.Report(data={"file": output, "axes_deg": axes}, shown=[*lines, str(output)])


def subspace(
    material: Material,
    output: Annotated[
        Path, typer.Option(help="f_r by azimuths of light (down) and view, 0 if unseen: .exr.")
    ],
    theta_i: Annotated[float, typer.Option(help="Polar angle of the ray, degrees.")] = 50.0,
    theta_v: Annotated[float, typer.Option(help="Of the view, degrees.")] = 50.0,
    step: Annotated[float, typer.Option(help="Of the azimuths, degrees.")] = 1.0,
    patterns: Annotated[str, typer.Option(help="ray, or hadamard: half of them at once.")] = "ray",
    lumens: Annotated[float, typer.Option(help="Of the projector.")] = 300.0,
    slope_error: Annotated[float, typer.Option(help="Of the mirror, mrad.")] = 1.0,
    rotation: Annotated[float, typer.Option(help="Of the material, degrees.")] = 0.0,
    seed: Seed = 0,
    overwrite: Overwrite = False,
) -> frame.Report:
    """Sweep a ray about the reflector and record one azimuthal subspace of a BRDF."""
    from dataclasses import replace

    import numpy as np

    from simrig.core.cost import stopwatch
    from simrig.files.load import load_material
    from simrig.rigs.reflector.mirror import CONJUGATE
    from simrig.rigs.reflector.subspace import Projector, measure_subspace, true_subspace

    check_picture(output)
    brdf = load_material(material)
    polar = float(np.radians(theta_i)), float(np.radians(theta_v))
    with output_file(output, overwrite):
        elapsed = stopwatch()
        found = measure_subspace(
            brdf,
            *polar,
            mirror=replace(CONJUGATE, slope_rms_mrad=slope_error),
            projector=Projector(lumens=lumens),
            patterns=patterns,
            step_deg=step,
            rotation_deg=rotation,
            seed=seed,
        )
        truth = true_subspace(brdf, *polar, found.phi, rotation)
        about = {"material": brdf.name, "theta_i_deg": theta_i, "theta_v_deg": theta_v,
                 "patterns": patterns, "unit": "1/sr"}  # fmt: skip
        write_picture(
            output, np.nan_to_num(found.values), about, 1.0 / max(float(truth.max()), 1e-12)
        )
        seconds = elapsed()
    away = found.values - truth
    level = max(float(truth.mean()), 1e-12)
    data: dict[str, Any] = {
        "file": output,
        "azimuths": len(found.phi),
        "pictures": found.pictures,
        "hardware_seconds": found.hardware_seconds,
        "exposure_seconds": found.exposure_s,
        "unseen": float(np.isnan(found.values[..., 0]).mean()),
        "relative_rmse": float(np.sqrt(np.nanmean(away**2)) / level),
        "relative_bias": float(np.nanmean(away) / level),
        "compute_seconds": seconds,
    }
    return frame.Report(
        data=data,
        shown=[
            f"{output}: {len(found.phi)} × {len(found.phi)} azimuths at {theta_i:g}° and "
            f"{theta_v:g}°, {found.pictures} pictures in {found.hardware_seconds:.1f} s of the "
            f"instrument, {seconds:.1f} s of computing",
            f"against f_r itself: RMSE {100.0 * data['relative_rmse']:.1f} % of the mean, bias "
            f"{100.0 * data['relative_bias']:.2f} %; {100.0 * data['unseen']:.1f} % not seen",
        ],
    )


def _mirror(instrument: str) -> Any:
    from simrig.instruments.description import ReflectorDescription, read_description, shipped
    from simrig.rigs.reflector.mirror import Reflector

    found = read_description(instrument) if instrument.endswith(".toml") else shipped(instrument)
    if not isinstance(found, ReflectorDescription):
        raise SimrigError(
            f"'{instrument}' is a {found.instrument.kind}, not a reflector: name one of kind "
            "'reflector'"
        )
    return Reflector.from_description(found)


def _opening(text: str | None) -> tuple[float, float, float] | None:
    if text is None:
        return None
    x, y, diameter = numbers(text, "--opening is x,y,diameter in pixels", 3)
    if not (diameter > 0.0 and max(abs(x), abs(y), diameter) < float("inf")):
        raise SimrigError(f"--opening must be finite, its diameter above 0, got '{text}'")
    return x, y, diameter

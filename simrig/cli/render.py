"""``simrig render``: a material on one of the scenes, or a Mitsuba scene file, as a picture."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from simrig.cli import effect_options, frame
from simrig.cli.options import (
    Exposure,
    Overwrite,
    Seed,
    Variant,
    check_exposure,
    check_picture,
    write_picture,
)
from simrig.cli.outputs import output_file
from simrig.cli.scene_argument import Define, Scale, Sensor
from simrig.core.errors import SimrigError

if TYPE_CHECKING:
    from simrig.core.effects import EffectPlan
    from simrig.evaluation.baking import Baked

_SPP = 64  # where nothing is planned


def render(
    output: Annotated[Path, typer.Option(help="The picture: .exr (linear RGB) or .png (sRGB).")],
    material: Annotated[
        str | None,
        typer.Option(help="A built-in material, a material file or a BTF, for a built-in scene."),
    ] = None,
    scene: Annotated[
        str, typer.Option(help="See 'simrig materials', or a Mitsuba scene (.xml).")
    ] = "sphere",
    spp: Annotated[int | None, typer.Option(min=1, help="Samples per pixel; planned else.")] = None,
    integrator: Annotated[
        str | None,
        typer.Option(help="Plugin, or 'scene' for the scene's own; planned else."),
    ] = None,
    *,
    effects: effect_options.Effects,
    resolution: Annotated[
        int | None, typer.Option(min=1, max=16384, help="Width of the picture in pixels.")
    ] = None,
    light: Annotated[
        str | None, typer.Option(help="Side of the cylinder's light: top, bottom, left, right.")
    ] = None,
    environment: Annotated[
        Path | None,
        typer.Option(help="Latitude-longitude EXR or HDR; environment_sphere has its own else."),
    ] = None,
    lights: Annotated[
        int | None, typer.Option(min=1, help="Directional lights of the environment (256).")
    ] = None,
    rotation: Annotated[float, typer.Option(help="Degrees about the surface normal.")] = 0.0,
    scale_mm: Annotated[
        float | None, typer.Option(help="Of a BTF: mm of it along u (around a sphere once).")
    ] = None,
    exposure: Exposure = None,
    budget: effect_options.Budget = None,
    verify: Annotated[
        bool, typer.Option(help="Check the planned picture against an independent estimate.")
    ] = True,
    bake: Annotated[
        bool,
        typer.Option(help="Bake the material, with a quarter of the tolerance, where it pays."),
    ] = True,
    define: Define = None,
    scale: Scale = None,
    sensor: Sensor = 0,
    png: Annotated[bool, typer.Option(help="Also write a PNG beside the EXR.")] = True,
    seed: Seed = 0,
    variant: Variant = "auto",
    overwrite: Overwrite = False,
) -> frame.Report:
    """Render a material on a scene, or a scene file, to an EXR picture and a PNG to look at.

    What is simulated follows from the tolerance, see 'simrig plan'. With --spp or --integrator
    nothing is planned: the scene's own integrator and 64 samples stand for the one not given.
    """
    check_picture(output)
    check_exposure(exposure)
    by_hand = spp is not None or integrator is not None
    if by_hand and (budget or effects.given):
        raise SimrigError("--spp and --integrator replace the plan: leave them or its options out")
    if by_hand:
        frame.refuse_unused("without a plan nothing is verified or baked", "verify", "bake")
    if output.suffix.lower() != ".exr":
        frame.refuse_unused("the picture is no EXR", "png")
    files = [output]
    if png and output.suffix.lower() == ".exr":
        files.append(output.with_suffix(".png"))

    from contextlib import ExitStack
    from dataclasses import replace
    from functools import partial

    from simrig import planning
    from simrig.core import backend
    from simrig.rendering import render as rendering

    with ExitStack() as held:
        for path in files:
            held.enter_context(output_file(path, overwrite))
        variant = backend.select(variant)
        options = {
            "resolution": resolution,
            "light": light,
            "environment": environment,
            "lights": lights,
            "rotation": rotation or None,
            "scale_mm": scale_mm,
        }
        options = {key: value for key, value in options.items() if value is not None}
        subject, look_up, about = _subject(scene, material, options, define, scale)

        planned, baked = None, None
        with frame.progress("rendering") as report:
            if by_hand:
                chosen = None if integrator == "scene" else integrator
                source = planning.scene_source(subject, sensor)
                result = rendering.render(
                    rendering.load(source.build()), spp or _SPP, seed, chosen, report, sensor=sensor
                )
            else:
                decided = planning.checked_overrides(**effects.overrides)
                loading = decided, variant, exposure, sensor
                at_work = held.enter_context(planning.planned_subject(subject, *loading))
                planned = effect_options.planned(at_work, effects, budget, thrifty=True)
                if bake and budget is None:
                    baked = _baked(look_up, planned)
                if baked is not None:
                    subject = partial(subject, baked.brdf)
                    at_work = held.enter_context(planning.planned_subject(subject, *loading))
                    rest = replace(effects, tolerance=str(baked.rest))
                    planned = effect_options.planned(at_work, rest, None, thrifty=True)
                    about["baked"] = baked.line
                if verify:
                    result, planned = planning.verified_render(at_work, planned, seed, report)
                else:
                    result = planning.planned_render(at_work, planned, seed, report)
        if exposure is None:
            exposure = _exposure(planned, result.image)
        about |= {
            "spp": result.spp,
            "seed": seed,
            "variant": result.variant,
            "integrator": result.integrator,
            **({"film": result.film} if result.film else {}),
            "exposure": exposure,
        }
        plan = planned.as_dict() if planned else None
        held_plan = {"plan": json.dumps(plan)} if plan else {}  # a header holds strings
        for path in files:
            write_picture(path, result.image, about | held_plan, exposure)
    height, width, _ = result.image.shape
    sizes = {"files": files, "width": width, "height": height}
    return frame.Report(
        data={**about, **sizes, **result.cost.as_dict(), "plan": plan},
        shown=[
            f"{', '.join(map(str, files))}: {width} × {height}, {result.spp} samples per pixel, "
            f"{result.run_seconds:.2f} s and {result.compile_seconds:.2f} s of compilation",
            *([f"environment: {about['environment']}"] if "environment" in about else []),
            *([result.film] if result.film else []),
            *([baked.line] if baked else []),
            *_shown(planned),
        ],
    )


def _subject(
    scene: str,
    material: str | None,
    options: dict[str, Any],
    define: list[str] | None,
    scale: float | None,
) -> tuple[Any, Any, dict]:
    """Return what is rendered, for the current variant, its material, and both for the report.

    A function that builds the dictionary of a built-in scene (again where a plan asks for another
    variant; of another material where it is given one), or the path of a scene file.
    """
    from simrig.cli.scene_argument import for_files, is_scene_file, scene_file
    from simrig.front_door.pictures import bsdf_of, looked_up
    from simrig.rendering.environment import BUILTIN, described_lights
    from simrig.scenes import build_scene

    if is_scene_file(scene):
        given = [f"--{name}" for name in (*(["material"] if material else []), *options)]
        if given:
            raise SimrigError(f"'{scene}' is a scene of its own: leave out {', '.join(given)}")
        return scene_file(scene, define, scale), None, {"scene": scene}
    for_files(scene, define, scale)
    if material is None:
        raise SimrigError(f"the scene '{scene}' needs a --material: see 'simrig materials'")
    about = {"scene": scene, "material": material}
    rotation = options.pop("rotation", 0.0)
    source = options.pop("environment", None)
    if source is not None or "lights" in options:
        made = described_lights(source or BUILTIN, options.get("lights", 256))
        options["lights"], about["environment"] = made
    look_up, scale_mm = looked_up(material), options.pop("scale_mm", None)

    def build(material: Any = look_up) -> dict[str, Any]:
        return build_scene(scene, bsdf_of(material, rotation, scale_mm), **options)

    return build, look_up, about


def _baked(look_up: Any, planned: EffectPlan) -> Baked | None:
    """Return the material baked for a planned picture, where that pays."""
    from simrig.evaluation.baking import bake_for

    return bake_for(look_up, planned.tolerance, planned.about["render_s"])


def _exposure(planned: EffectPlan | None, image: Any) -> float:
    """Return the factor with which a picture is shown: that of its plan, or what suits it."""
    from simrig.rendering.render import display_exposure

    if planned:
        return float(planned.about["exposure"])
    return display_exposure(image) if (image > 0.0).any() else 1.0


def _shown(planned: EffectPlan | None) -> list[Any]:
    if planned is None:
        return []
    return [effect_options.plan_table(planned), *effect_options.plan_lines(planned)]

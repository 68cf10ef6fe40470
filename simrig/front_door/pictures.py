"""Materials in scenes, and pictures of them with what they cost."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from simrig.btf.full import FullBtf
from simrig.btf.spatial import SpatialBrdf
from simrig.btf.stack import BtfStack
from simrig.core import backend
from simrig.core.effects import DEFAULT_TOLERANCE, Tolerance
from simrig.core.errors import SimrigError
from simrig.front_door.materials import as_brdf, load
from simrig.plugins import make_bsdf, make_btf
from simrig.scenes import SCENES, build_scene

if TYPE_CHECKING:
    from simrig.core.effects import EffectPlan
    from simrig.rendering.render import RenderResult

_SPP = 64  # where nothing is planned


def scene(
    name: str, material: Any, *, rotation: float = 0.0, scale: float | None = None, **settings: Any
) -> dict[str, Any]:
    """Return a scene with a material on it, as a dictionary for ``mi.load_dict``.

    The dictionary belongs to the Mitsuba variant that is set; the automatic one is set where there
    is none (see ``set_variant``).

    Args:
        name: ``sphere``, ``four_spheres``, ``cylinder``, ``environment_sphere``, ...; 'simrig
            materials' lists them and 'simrig materials NAME' their settings.
        material: a BRDF or BTF, its name or its file, or a BSDF as Mitsuba takes it (a dictionary
            or an object); of ``four_spheres`` also a list of four, of ``receding_cylinders`` and
            ``room`` also a dictionary by part.
        rotation: of the material about the surface normal, in degrees.
        scale: of a BTF, mm of material per unit of u; required there.
        settings: of the scene: ``resolution`` (width in pixels), ``light``, ...; ``environment``
            may be a latitude-longitude file, ``lights`` the number of lights to make of it.

    Raises:
        SimrigError: an unknown scene or setting, with the nearest known one; a setting that cannot
            be; a material that does not load or lacks its scale.
    """
    backend.current()
    if not isinstance(rotation, int | float) or not math.isfinite(rotation):
        raise SimrigError(f"rotation is a finite number of degrees, got {rotation!r}")
    if isinstance(material, Mapping) and "type" not in material:
        made: Any = {part: bsdf_of(one, rotation, scale) for part, one in material.items()}
    elif isinstance(material, Sequence) and not isinstance(material, str):
        made = [bsdf_of(one, rotation, scale) for one in material]
    else:
        made = bsdf_of(material, rotation, scale)
    return build_scene(name, made, **_with_environment(name, settings))


def looked_up(material: Any) -> Any:
    """Return a material, its name or its file as what pictures look up; a stack in full."""
    if isinstance(material, str | Path):
        material = load(material)
    return FullBtf.from_stack(material) if isinstance(material, BtfStack) else material


def bsdf_of(material: Any, rotation: float, scale: float | None) -> Any:
    """Return a material as a BSDF of the current variant.

    Args:
        material: what ``looked_up`` takes.
        rotation, scale: see ``scene``.

    Raises:
        SimrigError: a BTF without a scale, or a scale of anything else.
    """
    material = looked_up(material)
    if isinstance(material, SpatialBrdf):
        if scale is None:
            raise SimrigError(
                f"the BTF '{material.name}' needs its scale: scale=100.0 lays 100 mm of it along u"
            )
        return make_btf(material, scale=scale, rotation=rotation)
    if scale is not None:
        raise SimrigError("scale is that of a BTF: leave it out")
    if isinstance(material, Mapping) or hasattr(material, "eval_pdf"):
        if rotation:
            raise SimrigError("rotation is that of our own materials: leave it out for a BSDF")
        return material
    return make_bsdf(as_brdf(material), rotation)


def _with_environment(name: str, settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return the settings with the file of an environment read as the scene wants it."""
    from simrig.rendering.environment import environment_lights, read_environment

    made = dict(settings)
    known = SCENES[name].options if name in SCENES else {}
    if "environment" in known and isinstance(made.get("environment"), str | Path):
        made["environment"] = read_environment(made["environment"])
    elif "lights" in known and "environment" in made:
        made["lights"] = environment_lights(made.pop("environment"), made.get("lights", 256))
    return made


def plan(
    scene: Any,
    tolerance: str | Tolerance = DEFAULT_TOLERANCE,
    *,
    enable: Iterable[str] = (),
    disable: Iterable[str] = (),
    everything: bool = False,
    exposure: float | None = None,
) -> EffectPlan:
    """Return which effects a picture of a scene calls for, and the settings that follow.

    Nothing is rendered but a look at the scene.

    Args:
        scene: what ``scene`` returned, any other Mitsuba dictionary, a loaded scene, or the path
            of a scene file (``.xml``).
        tolerance: how far the picture may be from the converged one with every effect: ``dE=0.5``
            (mean CIE ΔE 1976), ``psnr=45`` (dB) or ``relative=0.01``.
        enable: effects to simulate whatever their bound.
        disable: effects to leave out whatever their bound.
        everything: simulate all that is there.
        exposure: of the display that the tolerance is meant for; what shows the picture well else.

    Returns:
        Decisions with bounds and reasons, settings (integrator, depth, spp, variant), and what to
        expect.

    Raises:
        SimrigError: a scene that cannot be built, an unknown effect or tolerance, or overrides
            that contradict each other.
    """
    from simrig.planning import plan_scene

    backend.current()
    return plan_scene(
        scene, tolerance, enable=enable, disable=disable, everything=everything, exposure=exposure
    )


def render(
    scene: Any,
    *,
    spp: int | None = None,
    integrator: str | None = None,
    tolerance: str | Tolerance | None = None,
    plan: EffectPlan | None = None,
    enable: Iterable[str] = (),
    disable: Iterable[str] = (),
    everything: bool = False,
    verify: bool = True,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> RenderResult:
    """Render a scene; what is simulated follows from a tolerance, unless ``spp`` is given.

    Args:
        scene: see ``plan``.
        spp: samples per pixel, >= 1; with it, or an integrator, nothing is planned (the other is
            then 64, or the scene's own).
        integrator: name of a Mitsuba integrator.
        tolerance: how far from simulating everything: ``dE=0.5`` unless given, see ``plan``.
        plan: what ``plan`` returned for this scene, in place of a tolerance.
        enable, disable, everything: see ``plan``.
        verify: check the planned picture against an independent estimate; where that contradicts
            it, what explains it comes on and the picture is rendered again. Where asking what may
            be left out costs more than the picture, nothing is left out, or checked.
        seed: >= 0; the same seed gives the same picture.
        progress: called with samples per pixel done and in total.

    Returns:
        ``image`` (float32, height × width × 3, linear RGB radiance), ``cost``, ``error`` (what the
        plan expects; None without one) and the ``plan``. ``np.asarray`` gives the image.

    Raises:
        SimrigError: a scene that cannot be built, options that contradict each other, or a picture
            that is not finite.
    """
    from simrig.planning import checked_overrides, plan_scene, planned_subject, scene_source
    from simrig.rendering import render as rendering

    backend.current()
    decided = tolerance is not None or bool(tuple(enable) or tuple(disable) or everything)
    if (spp is not None or integrator is not None) and (decided or plan is not None):
        raise SimrigError("spp and integrator replace the plan: leave them or its options out")
    if plan is not None and decided:
        raise SimrigError("a plan is made already: leave out what another would be made by")
    if spp is not None or integrator is not None:
        loaded = rendering.load(scene_source(scene).build())
        return rendering.render(loaded, _SPP if spp is None else spp, seed, integrator, progress)
    if plan is not None:
        return _by_plan(scene, plan, verify, seed, progress)
    overrides = checked_overrides(enable, disable, everything)
    with planned_subject(scene, overrides) as at_work:  # loaded once
        allowed = DEFAULT_TOLERANCE if tolerance is None else tolerance
        plan = plan_scene(at_work, allowed, enable, disable, everything, thrifty=True)
        return _by_plan(at_work, plan, verify, seed, progress)


def _by_plan(
    scene: Any,
    plan: EffectPlan,
    verify: bool,
    seed: int,
    progress: Callable[[int, int], None] | None,
) -> RenderResult:
    from simrig.planning import planned_render, verified_render

    if verify:
        picture, plan = verified_render(scene, plan, seed, progress)
        return replace(picture, plan=plan)
    return replace(planned_render(scene, plan, seed, progress), plan=plan)

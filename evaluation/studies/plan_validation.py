"""Validation of the planner: planned renders against converged ones with every effect.

All scenes, four of them built as traps, over five materials and four tolerances. A row compares
one render by plan with the picture that has everything on and is rendered until its noise is small
(or its share of the time is spent). ``met`` says whether the mean ΔE of the planned render is
within the tolerance with all noise included, its own and that of the reference; it is None where
it is not and the reference is too noisy to tell, even after it was rendered again for longer.
``delta_e_corrected`` has the standard error of
the reference, stated beside, taken off in quadrature. ``everything_seconds`` is the render that
the same planner chooses for the same tolerance with everything on; both run one after the other,
and compilation is told from running. ``time_saved_in_all`` counts checks and the planning of both,
``time_saved_beside_known`` leaves out that of everything.

All bounds are checked as ``simrig ablate`` does: a violation is a bound smaller than the change
that is certain beyond noise, in plans that looked for all. ``direct`` compares, where nothing but
direct light matters, the planned render with a hand-written scene of the same samples (medians of
alternating renders).

Source: none published: the figures are our own.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from simrig.core import backend
from simrig.core.effects import EffectPlan, Tolerance
from simrig.core.tables import text_table
from simrig.evaluation.ablation.pictures import Pictures
from simrig.evaluation.ablation.run import effect_rows, plan_row, planned_render_row
from simrig.evaluation.benchmarks import planned
from simrig.evaluation.metrics.replicates import Change
from simrig.evaluation.studies.engine.base import Cell, Config, Row
from simrig.evaluation.studies.engine.rows import distinct, grouped, where
from simrig.files.load import load_material
from simrig.planning import plan_scene, planned_render
from simrig.planning.verification import Check, checked, may_lack
from simrig.planning.view import View
from simrig.plugins import make_bsdf
from simrig.rendering.render import RenderResult
from simrig.scenes import build_scene
from simrig.viewing.plots import dot_style, drawn_panel

# scene: options that keep it small; an environment of fewer lights is no easier to plan
SCENE_OPTIONS: dict[str, dict[str, Any]] = {
    "sphere": {},
    "four_spheres": {"columns": 2},
    "cylinder": {},
    "environment_sphere": {"lights": 64},
    "mirror_neighbour": {},
    "bright_corner": {},
    "hidden_light": {},
    "hidden_sun": {},
    "environment_map": {},
    "map_spheres": {},
}
MATERIALS = ("lambert", "ward", "yellow_satin", "fabric002", "brushed_aluminium")
TOLERANCES = (0.2, 0.5, 1.0, 2.0)  # mean ΔE
_TELLS = 0.5  # of the tolerance: a reference of a larger standard error cannot tell a miss
_DIRECT_SCENES = tuple(planned.BY_HAND)
_DIRECT_ROUNDS = 9
_DIRECT_WIDTH = 256  # pixels


PRESETS: dict[str, dict[str, Any]] = {
    "quick": {
        "scenes": ["sphere", "bright_corner"],
        "materials": ["lambert"],
        "tolerances": [4.0],
        "resolution": 20,
        "budget_seconds": 100.0,  # far more than it takes: the noise of the picture ends it
        "longer_seconds": 100.0,
    },
    "full": {
        "scenes": list(SCENE_OPTIONS),
        "materials": list(MATERIALS),
        "tolerances": list(TOLERANCES),
        "resolution": 64,  # width of the pictures in pixels
        # for the picture with everything of one scene and material; the pictures that check the
        # bounds take as long each, or less
        "budget_seconds": 2.5,
        # likewise where the first one is too noisy to judge a planned render
        "longer_seconds": 60.0,
    },
}


def cells(config: Config) -> list[dict[str, Any]]:
    """Return one cell per scene and material, and one per scene that is timed by hand."""
    scenes, materials = config["scenes"], config["materials"]
    planned = [{"part": "planned", "scene": s, "material": m} for s in scenes for m in materials]
    direct = [name for name in scenes if name in _DIRECT_SCENES]
    return planned + [{"part": "direct", "scene": s, "material": materials[0]} for s in direct]


def run_cell(config: Config, cell: Cell) -> list[dict[str, Any]]:
    """Plan and render one scene with one material.

    Returns:
        Rows of three kinds: ``render`` (one per tolerance) and ``check`` (one per bound) of a
        planned part, and ``timing`` of a direct one.
    """
    backend.select("auto")
    if cell["part"] == "direct":
        return [{"kind": "timing", **_direct(cell["scene"], cell["material"])}]
    allowed = [Tolerance("dE", value) for value in sorted(config["tolerances"])]
    build = _builder(cell["scene"], cell["material"], config["resolution"])
    seconds = (config["budget_seconds"], config["longer_seconds"])
    renders, checks = _cell(build, allowed, *seconds)
    return [{"kind": "render", **row} for row in renders] + [
        {"kind": "check", **check} for check in checks
    ]


def summarise(config: Config, rows: Sequence[Row]) -> dict[str, Any]:
    """Return the rows by their kind, and what they say together."""
    renders, checks, direct = (
        [
            {k: v for k, v in row.items() if k not in ("kind", "part")}
            for row in where(rows, kind=kind)
        ]
        for kind in ("render", "check", "timing")
    )
    summary = _summary(renders, checks)
    return {"rows": renders, "checks": checks, "direct": direct, "summary": summary}


def _builder(scene: str, material: str, resolution: int) -> Callable[[], dict[str, Any]]:
    brdf = load_material(material)
    options = {"resolution": resolution, **SCENE_OPTIONS[scene]}
    return lambda: build_scene(scene, make_bsdf(brdf), **options)


def _cell(
    scene: Callable[[], dict[str, Any]],
    tolerances: Sequence[Tolerance],
    budget_seconds: float,
    longer_seconds: float,
) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Return the rows and the checks of one scene with one material."""
    strictest = plan_scene(scene, tolerances[0])
    pictures = Pictures(scene, strictest, budget_seconds)
    found = [row for decision in strictest.effects for row in effect_rows(pictures, decision)]
    plans = [plan_scene(scene, one, exposure=pictures.exposure) for one in tolerances]
    found += [plan_row(pictures, plan) for plan in plans]
    plans = [plan_scene(scene, one, exposure=pictures.exposure, thrifty=True) for one in tolerances]
    rows = [_row(pictures, plan) for plan in plans]
    if any(row["met"] is None for row in rows):
        longer = Pictures(scene, strictest, longer_seconds)
        rows = [
            {**row, **_judged(longer, plan)[0]} if row["met"] is None else row
            for row, plan in zip(rows, plans, strict=True)
        ]
    kept = ("effect", "what", "bound", "measured", "noise", "least", "violated")
    checks = [row.as_dict() for row in found if row.bound is not None]
    return rows, [{key: check[key] for key in kept} for check in checks]


def _row(pictures: Pictures, plan: EffectPlan) -> dict[str, Any]:
    judged, result = _judged(pictures, plan)
    everything = plan_scene(
        pictures.scene, plan.tolerance, everything=True, exposure=pictures.exposure, thrifty=True
    )
    full = planned_render(pictures.scene, everything, seed=pictures.seed + 2)
    check = Check(0.0, 0, 0.0)
    if not plan.about["unlooked"]:
        check = checked(View(pictures.loaded(plan)), plan, result)
    return {
        "tolerance": plan.tolerance.value,
        **judged,
        "kept": plan.about["kept"],
        "integrator": plan.settings["integrator"],
        "depth": plan.settings["depth"],
        "spp": plan.settings["spp"],
        "seconds": result.run_seconds,
        "compile_seconds": result.compile_seconds,
        "everything_spp": everything.settings["spp"],
        "everything_seconds": full.run_seconds,
        "everything_planning_seconds": everything.about["planning_s"],
        "everything_compile_seconds": full.compile_seconds,
        "time_saved": 1.0 - result.run_seconds / full.run_seconds,
        "planning_seconds": plan.about["planning_s"],
        "check_seconds": check.seconds,
        "contradicted": check.least > may_lack(plan),
    }


def _judged(pictures: Pictures, plan: EffectPlan) -> tuple[dict[str, Any], RenderResult]:
    """Return how far the planned render is from the reference, and the render."""
    off, result = planned_render_row(pictures, plan)
    judged = {
        "delta_e": off.change.measured,
        "reference_error": off.change.noise,
        "delta_e_corrected": off.change.corrected,
        "met": _met(off.change, plan.tolerance),
    }
    return judged, result


def _met(change: Change, tolerance: Tolerance) -> bool | None:
    """Return whether a tolerance is met, None where the reference is too noisy to tell."""
    if change.measured <= tolerance.amount:  # even with the noise of the reference
        return True
    return None if change.noise > _TELLS * tolerance.amount else False


def _direct(scene: str, material: str) -> dict[str, Any]:
    """Return the run times of a planned render and of a scene written by hand for direct light."""
    row = planned.compare(scene, material, _DIRECT_WIDTH, _DIRECT_ROUNDS)
    return {
        "spp": row["spp"],
        "seconds": row["planned_seconds"],
        "minimal_seconds": row["minimal_seconds"],
        "ratio": row["ratio"],
    }


def _summary(rows: Sequence[dict[str, Any]], checks: Sequence[dict[str, Any]]) -> dict[str, Any]:
    planned = sum(row["seconds"] for row in rows)
    everything = sum(row["everything_seconds"] for row in rows)
    planning = [row["planning_seconds"] for row in rows]
    both = everything + sum(row["everything_planning_seconds"] for row in rows)
    checking = sum(row["check_seconds"] for row in rows)
    contradicted = [row for row in rows if row["contradicted"]]
    cheap = [
        row["planning_seconds"] < 0.2 or row["planning_seconds"] < 0.05 * row["seconds"]
        for row in rows
    ]
    return {
        "cases": len(rows),
        "met": sum(row["met"] is True for row in rows),
        "missed": sum(row["met"] is False for row in rows),
        "checks": len(checks),
        "violations": sum(check["violated"] for check in checks),
        "seconds": planned,
        "everything_seconds": everything,
        "time_saved": 1.0 - planned / everything,
        "check_seconds": checking,
        "time_saved_in_all": 1.0 - (planned + sum(planning) + checking) / both,
        "time_saved_beside_known": 1.0 - (planned + sum(planning) + checking) / everything,
        "contradicted": len(contradicted),
        "contradicted_rightly": sum(row["met"] is False for row in contradicted),
        "planning_median_s": float(np.median(planning)),
        "planning_max_s": float(np.max(planning)),
        "planning_cheap": sum(cheap),
    }


def table(summary: Mapping[str, Any]) -> Any:
    """Return the summary as a table for the terminal."""
    from rich.console import Group

    values = distinct(summary["rows"], "tolerance")
    columns = ["scene", "material", "reference ±ΔE", *(f"tolerance {v:g}" for v in values)]
    rows = []
    for (scene, material), cell in grouped(summary["rows"], "scene", "material").items():
        planning = max(row["planning_seconds"] for row in cell)
        known = f"{max(row['reference_error'] for row in cell):.3f}"
        rows.append((scene, material, known, *map(_text, cell), f"{planning:.2f}"))
    title = "planned renders: ΔE (spp, time saved); ! missed, ? reference too noisy"
    shown = text_table(title, [*columns, "planning [s]"], rows, left=(0, 1))
    direct = (
        "direct light only, {scene}: planned {seconds:.4f} s, written by hand "
        "{minimal_seconds:.4f} s, ratio {ratio:.2f}"
    )
    said = (
        "{met} of {cases} renders meet their tolerance, {missed} miss it; "
        "{violations} of {checks} bounds are violated; rendering took {seconds:.1f} s planned and "
        "{everything_seconds:.1f} s with everything ({time_saved:.0%} saved, "
        "{time_saved_in_all:.0%} with planning and checks counted, {time_saved_beside_known:.0%} "
        "beside everything whose samples are known); the check contradicts "
        "{contradicted} plans, {contradicted_rightly} of them rightly; "
        "planning {planning_median_s:.2f} s in the median, {planning_max_s:.2f} s at most, "
        "below 0.2 s or 5 % of its render in {planning_cheap} of {cases} cases"
    )
    lines = [direct.format_map(one) for one in summary["direct"]]
    return Group(shown, *lines, said.format_map(summary["summary"]))


def _text(row: Row) -> str:
    missed = {True: "", False: " !", None: " ?"}[row["met"]]
    return f"{row['delta_e_corrected']:.3f} ({row['spp']}, {row['time_saved']:.0%}){missed}"


def plots(summary: Mapping[str, Any], rows: Sequence[Row], folder: Path) -> list[Path]:
    """Draw what the planned renders miss over what they may miss."""
    path, legend = folder / "plan_validation.png", {"loc": "outside right center"}
    axes: dict[str, Any] = {"xlabel": "tolerance [mean ΔE]", "ylabel": "reached [mean ΔE]"}
    with drawn_panel(path, 5.6, 4.6, legend=legend, xscale="log", yscale="log", **axes) as panel:
        for number, ((scene,), own) in enumerate(grouped(summary["rows"], "scene").items()):
            tolerances = [row["tolerance"] * 1.04 ** (number - 3) for row in own]  # side by side
            reached = [max(row["delta_e_corrected"], 1e-3) for row in own]
            panel.plot(tolerances, reached, label=scene.replace("_", " "), **dot_style(number))
        panel.axline((1.0, 1.0), slope=1.0, color="0.7", zorder=0, label="tolerance")
    return [path]

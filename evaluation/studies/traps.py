"""Traps for the planner: scenes that defeat looks, planned, rendered, checked, and compared.

Every scene of ``simrig.scenes.traps``, and those of the laboratory with one material, is rendered
by plan and compared with a converged picture by one of Mitsuba's own integrators, at the exposure
of that picture. A row is ``kept`` where the picture is within the tolerance as far as the reference
can tell (three standard errors), ``warned`` of where it is not and the plan does not say that it is
kept, ``broken`` where the plan does, ``refused`` where nothing was rendered.

The expected noise stands beside that which planned pictures of independent random numbers show.
The check after the render *spoke* where it switched an effect on or said that the plan is
contradicted, *rightly* where the picture was further off than its tolerance, and was *silent
wrongly* where it did not speak and the picture is.

Source: none published: the figures are our own.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from simrig.core import backend
from simrig.core.effects import EffectPlan, Tolerance
from simrig.core.errors import SimrigError
from simrig.core.tables import text_table
from simrig.evaluation.metrics.images import foreground_mask
from simrig.evaluation.metrics.replicates import Replicates, converged, distances
from simrig.evaluation.studies.engine.base import Cell, Config, Row
from simrig.evaluation.studies.engine.rows import distinct, grouped
from simrig.evaluation.studies.plan_validation import SCENE_OPTIONS
from simrig.files.load import load_material
from simrig.planning import plan_scene, planned_render, planned_subject, verified_render
from simrig.planning.integrators import hides_emitters
from simrig.plugins import make_bsdf
from simrig.rendering import multijitter
from simrig.rendering import render as rendering
from simrig.scenes import build_scene
from simrig.scenes.traps import PARTICLES, PATHS, TRAPS
from simrig.viewing.plots import dot_style, drawn_panel

KEPT, WARNED, BROKEN, REFUSED = "kept", "warned", "broken", "refused"
MATERIAL = "yellow_satin"  # of the laboratory's scenes
NOISE_RANGE = (0.8, 1.5)  # of expected over measured noise
_CERTAIN = 3.0  # standard errors
_TELLING = 0.06  # of the tightest tolerance: no better reference is waited for
_MOST_SAMPLES = 1 << 23  # of a reference
_PICTURES, _PIXELS = (4, 32), 4096  # that tell noise, and pixels of all of them together
_LITTLE = 0.02  # ΔE: noise below it is no more than rounding and what two pictures tell

PRESETS: dict[str, dict[str, Any]] = {
    "quick": {
        "scenes": ["leaves", "hot_texel"],
        "tolerances": [2.0],
        "resolution": 20,
        "reference_seconds": 1.0,
    },
    "full": {
        "scenes": [*TRAPS, *SCENE_OPTIONS],
        "tolerances": [0.5, 2.0],
        "resolution": 48,  # of the laboratory's scenes; traps have their own
        "reference_seconds": 60.0,  # at most
    },
}


def cells(config: Config) -> list[dict[str, Any]]:
    """Return one cell per scene."""
    return [{"scene": name} for name in config["scenes"]]


def run_cell(config: Config, cell: Cell) -> list[dict[str, Any]]:
    """Plan, render and check one scene at every tolerance.

    Returns:
        One row for each.
    """
    backend.select("auto")
    scene, converges = _scene(cell["scene"], config["resolution"])
    rows: list[dict[str, Any]] = []
    reference: Replicates | None = None
    for value in config["tolerances"]:
        try:
            with planned_subject(scene) as at_work:
                if reference is None:
                    seconds = config["reference_seconds"]
                    error = _TELLING * min(config["tolerances"])
                    reference = _reference(at_work.scene, converges, seconds, error)
                rows.append(_row(at_work, Tolerance("dE", value), reference))
        except SimrigError as refusal:
            rows.append({"tolerance": value, "verdict": REFUSED, "advice": str(refusal)})
    return rows


def _scene(name: str, resolution: int) -> tuple[Any, str]:
    """Return what builds a scene, and the integrator that converges there."""
    if name in TRAPS:
        return TRAPS[name].build, TRAPS[name].converges
    bsdf = make_bsdf(load_material(MATERIAL))
    options = {"resolution": resolution, **SCENE_OPTIONS[name]}
    return (lambda: build_scene(name, bsdf, **options)), PATHS


def _reference(scene: Any, converges: str, seconds: float, error: float) -> Replicates:
    """Return the converged picture, to within an error in ΔE unless its time is spent before."""
    integrator = {"type": converges, "max_depth": -1}
    if converges != PARTICLES:
        integrator["hide_emitters"] = hides_emitters(scene)
    made = rendering.made_integrator(integrator)
    sampler = "independent" if converges == PARTICLES else multijitter.NAME

    def good(so_far: Replicates) -> bool:
        exposure = rendering.display_exposure(so_far.image)
        return _apart(so_far.halves[0], so_far.halves[1], exposure) / 2.0 < error

    return converged(
        lambda spp, seed: rendering.render(scene, spp, seed, made, sampler=sampler),
        good,
        seconds,
        seed=11,
        most=_MOST_SAMPLES,
    )


def _row(at_work: Any, tolerance: Tolerance, reference: Replicates) -> dict[str, Any]:
    plan = plan_scene(at_work, tolerance, thrifty=True)
    result, checked = verified_render(at_work, plan, seed=1)
    check = checked.about["verification"]
    planned = result.image
    if check["switched_on"]:
        planned = planned_render(at_work, plan, seed=1).image
    more = [planned_render(at_work, plan, seed).image for seed in range(2, _times(planned) + 1)]
    exposure = rendering.display_exposure(reference.image)
    measured = _apart(reference.image, result.image, exposure)
    error = _apart(reference.halves[0], reference.halves[1], exposure) / 2.0
    before = _apart(reference.image, planned, exposure)
    own = plan.about["exposure"]
    return {
        "tolerance": tolerance.value,
        "verdict": _verdict(checked, measured, error),
        "measured": measured,
        "reference_error": error,
        "expected": plan.about["expected_error"],
        "kept": checked.about["kept"],
        "noise_expected": plan.about["noise"],
        "noise_measured": _off_their_mean([planned, *more], own),
        "spoke": bool(check["switched_on"] or check["contradicted"]),
        "off": before - _CERTAIN * error > tolerance.amount,
        "switched_on": check["switched_on"],
        "integrator": checked.settings["integrator"],
        "depth": checked.settings["depth"],
        "spp": checked.settings["spp"],
        "advice": checked.about["advice"],
        "planning_seconds": plan.about["planning_s"],
        "seconds": result.run_seconds,
        "check_seconds": check["seconds"],
    }


def _times(picture: np.ndarray) -> int:
    """Return how many pictures tell their noise: the more, the fewer pixels each has."""
    return int(np.clip(_PIXELS / picture[..., 0].size, *_PICTURES))


def _off_their_mean(pictures: Sequence[np.ndarray], exposure: float) -> float:
    """Return how far pictures of independent random numbers are off what they converge to.

    Not how far two of them are apart: stratified samples of a sharp edge take one of two values,
    so that two differ by no more than one is off.
    """
    mean = np.mean(pictures, axis=0)
    off = np.mean([_apart(mean, one, exposure) for one in pictures])
    return float(off * math.sqrt(len(pictures) / (len(pictures) - 1.0)))


def _verdict(plan: EffectPlan, measured: float, error: float) -> str:
    if measured - _CERTAIN * error <= plan.tolerance.amount:
        return KEPT
    return BROKEN if plan.about["kept"] else WARNED


def _apart(first: np.ndarray, second: np.ndarray, exposure: float) -> float:
    """Return the mean ΔE of two pictures over what is lit in either."""
    mask = foreground_mask(first, second)
    return distances(first, second, mask, exposure)["dE"] if mask.any() else 0.0


def summarise(config: Config, rows: Sequence[Row]) -> dict[str, Any]:
    """Return the rows, and what they say together."""
    rendered = [row for row in rows if row["verdict"] != REFUSED]
    ratios = [
        row["noise_expected"] / row["noise_measured"]
        for row in rendered
        if row["noise_measured"] > _LITTLE
    ]
    low, high = NOISE_RANGE
    spoke = [row for row in rendered if row["spoke"]]
    return {
        "rows": [dict(row) for row in rows],
        "summary": {
            "cases": len(rows),
            **{
                name: sum(row["verdict"] == name for row in rows)
                for name in (KEPT, WARNED, BROKEN, REFUSED)
            },
            "noise_ratios": len(ratios),
            "noise_in_range": sum(low <= ratio <= high for ratio in ratios),
            "noise_median": float(np.median(ratios)) if ratios else None,
            "spoke": len(spoke),
            "spoke_rightly": sum(row["off"] for row in spoke),
            "silent_wrongly": sum(row["off"] and not row["spoke"] for row in rendered),
            "planning_cheap": sum(_cheap(row) for row in rendered),
            "planning_seconds": sum(row["planning_seconds"] for row in rendered),
            "check_seconds": sum(row["check_seconds"] for row in rendered),
            "seconds": sum(row["seconds"] for row in rendered),
        },
    }


def _cheap(row: Row) -> bool:
    return bool(row["planning_seconds"] < max(0.2, 0.05 * row["seconds"]))


def table(summary: Mapping[str, Any]) -> Any:
    """Return the summary as a table for the terminal."""
    from rich.console import Group

    values = distinct(summary["rows"], "tolerance")
    columns = ["scene", *(f"tolerance {v:g}" for v in values)]
    rows = [
        (scene, *(_text(row) for row in cell))
        for (scene,), cell in grouped(summary["rows"], "scene").items()
    ]
    title = "traps: verdict, ΔE ± that of the reference, expected; settings; noise over measured"
    said = (
        "{kept} kept, {warned} warned of, {broken} broken, {refused} refused of {cases}; "
        "expected over measured noise is within 0.8 and 1.5 in {noise_in_range} of "
        "{noise_ratios}; the check spoke {spoke} times, {spoke_rightly} of them rightly, and was "
        "silent wrongly {silent_wrongly} times; planning took {planning_seconds:.1f} s, checks "
        "{check_seconds:.1f} s, rendering {seconds:.1f} s; planning below 0.2 s or 5 % of its "
        "render in {planning_cheap} cases"
    )
    return Group(text_table(title, columns, rows, left=(0,)), said.format_map(summary["summary"]))


def _text(row: Row) -> str:
    if row["verdict"] == REFUSED:
        return f"{REFUSED}: {row['advice']}"
    expected = "?" if row["expected"] is None else f"{row['expected']:.2f}"
    settings = f"{row['integrator']} {row['depth']}, {row['spp']}"
    noise = "–"
    if row["noise_measured"] > _LITTLE:
        noise = f"{row['noise_expected'] / row['noise_measured']:.2f}"
    on = f"; switched on {', '.join(row['switched_on'])}" if row["switched_on"] else ""
    off = f"{row['measured']:.2f} ±{row['reference_error']:.2f}, {expected}"
    return f"{row['verdict']}, {off}; {settings}; {noise}{on}"


def plots(summary: Mapping[str, Any], rows: Sequence[Row], folder: Path) -> list[Path]:
    """Draw the expected noise over the measured one."""
    path = folder / "traps.png"
    axes: dict[str, Any] = {
        "xlabel": "measured noise [mean ΔE]",
        "ylabel": "expected noise [mean ΔE]",
    }
    shown = [row for row in summary["rows"] if row.get("noise_measured", 0.0) > _LITTLE]
    with drawn_panel(path, 4.6, 4.0, xscale="log", yscale="log", **axes) as panel:
        measured = [row["noise_measured"] for row in shown]
        panel.plot(measured, [row["noise_expected"] for row in shown], **dot_style(0))
        for factor in (1.0, *NOISE_RANGE):
            panel.axline((1.0, factor), (2.0, 2.0 * factor), color="0.7", zorder=0)
    return [path]

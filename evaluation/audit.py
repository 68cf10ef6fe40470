"""Scenes of strangers, one after the other: planned, rendered, checked, and how long each took.

Every scene file of a folder that has a sensor is planned and rendered, by a tolerance or by a
budget of seconds, and compared with a reference where time is given for one: paths of all orders,
as many as the time allows. Nothing stops the run: what is refused is a row with its reason. A
record holds every row as soon as it is there, and a run with the same record goes on behind it.
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from simrig.core import backend
from simrig.core.effects import Tolerance
from simrig.core.errors import SimrigError
from simrig.core.progress import Progress
from simrig.evaluation.metrics.images import foreground_mask
from simrig.evaluation.metrics.replicates import Replicates, converged, distances
from simrig.planning import plan_budget, plan_scene, planned_subject, verified_render
from simrig.planning.integrators import UNLIMITED, path_integrator
from simrig.planning.source import scene_source_in
from simrig.planning.survey import Survey
from simrig.rendering import render as rendering
from simrig.rendering.scene_file import SceneFile, parsed

_CERTAIN = 3.0  # standard errors of the reference
KEPT, WARNED, BROKEN, UNTOLD, REFUSED = "kept", "warned", "broken", "not told", "refused"


@dataclass(frozen=True)
class Audited:
    """What became of one scene.

    Attributes:
        scene: its path within the folder.
        verdict: ``kept``, ``warned`` of, ``broken`` in silence, ``not told`` without a reference
            that could, or ``refused``.
        settings: of the plan, in one line; the reason where it was refused.
        expected: error, in the unit of the tolerance; None where the plan cannot tell.
        measured: against the reference, and the reference's own error; None without.
        reference_error: see ``measured``.
        switched_on: effects that the check of the picture brought on.
        planning_s, render_s, verification_s: seconds without compilation.
        wall_s: all of it, with compilation.
    """

    scene: str
    verdict: str
    settings: str
    expected: float | None = None
    measured: float | None = None
    reference_error: float | None = None
    advice: str = ""
    switched_on: tuple[str, ...] = ()
    planning_s: float = 0.0
    render_s: float = 0.0
    verification_s: float = 0.0
    wall_s: float = 0.0

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return asdict(self)


def scene_files(folder: Path) -> Iterator[Path]:
    """Yield the scene files below a folder, by name; fragments without a sensor are none.

    Files that cannot be parsed are scenes: why they are refused is to be told.
    """
    import mitsuba as mi

    for path in sorted(folder.rglob("*.xml")):
        try:
            with parsed(SceneFile(path)) as state:
                if any(node.type == mi.ObjectType.Sensor for node in state.nodes):
                    yield path
        except SimrigError:
            yield path


def audit(
    folder: Path,
    tolerance: Tolerance,
    budget_seconds: float | None = None,
    scale: float = 1.0,
    reference_seconds: float = 0.0,
    parameters: dict[str, str] | None = None,
    progress: Progress | None = None,
    record: Path | None = None,
) -> list[Audited]:
    """Plan and render every scene of a folder.

    Args:
        folder: of scene files; those in folders below it count.
        tolerance: of the pictures, or whose metric tells what is best in a budget.
        budget_seconds: that each picture may take; a tolerance decides by default.
        scale: of the pictures' width and height.
        reference_seconds: for a reference of each; none by default.
        parameters: values of ``$names``, for the files that have them.
        record: a file of JSON lines, the questions and a row for each scene, which are not asked
            again.

    Raises:
        SimrigError: a folder without scenes; a record of other questions.
    """
    paths = list(scene_files(folder))
    if not paths:
        raise SimrigError(f"there is no scene file with a sensor in '{folder}'")
    asked: dict[str, Any] = {
        "tolerance": str(tolerance),
        "budget_seconds": budget_seconds,
        "scale": scale,
        "reference_seconds": reference_seconds,
        "parameters": parameters or {},
    }
    known = {} if record is None else _recorded(record, asked)
    rows = []
    for done, path in enumerate(paths):
        name = str(path.relative_to(folder))
        if progress:
            progress(done, len(paths), name)
        row = known.get(name)
        if row is None:
            row = _one(path, name, tolerance, budget_seconds, scale, reference_seconds, parameters)
            if record is not None:
                _append(record, row.as_dict())
        rows.append(row)
    if progress:
        progress(len(paths), len(paths), "")
    return rows


def _recorded(record: Path, asked: dict[str, Any]) -> dict[str, Audited]:
    """Return the rows of a record, by scene; it is begun where there is none.

    A last line that a kill has cut off is taken away.
    """
    try:
        text = record.read_text() if record.exists() else ""
        lines = text[: text.rfind("\n") + 1].splitlines()
        if not text:
            record.write_text(json.dumps(asked) + "\n")
            return {}
        before, *rows = map(json.loads, lines)
        found = [Audited(**{**row, "switched_on": tuple(row["switched_on"])}) for row in rows]
        if len(text) > text.rfind("\n") + 1:
            record.write_text("\n".join(lines) + "\n")
    except (ValueError, TypeError, KeyError) as error:
        raise SimrigError(f"'{record}' is no record of an audit: choose another file") from error
    except OSError as error:
        raise SimrigError(f"cannot keep the record '{record}': {error.strerror}") from error
    if before != asked:
        raise SimrigError(f"'{record}' was begun with {before}, not {asked}: choose another file")
    return {row.scene: row for row in found}


def _append(record: Path, row: dict[str, Any]) -> None:
    with record.open("a") as file:
        file.write(json.dumps(row) + "\n")


def _one(
    path: Path,
    name: str,
    tolerance: Tolerance,
    budget_seconds: float | None,
    scale: float,
    reference_seconds: float,
    parameters: dict[str, str] | None,
) -> Audited:
    start = time.perf_counter()
    try:
        scene = SceneFile(path, _asked_for(path, parameters or {}), scale)
        backend.select("auto")
        with planned_subject(scene) as at_work:
            if budget_seconds is None:
                plan = plan_scene(at_work, tolerance, thrifty=True)
            else:
                plan = plan_budget(at_work, budget_seconds, tolerance)
            result, plan = verified_render(at_work, plan)
        measured = error = None
        if reference_seconds > 0.0:
            reference = _reference(scene, plan, reference_seconds)
            measured, error = _off(result.image, reference, plan)
    except SimrigError as refusal:
        seconds = time.perf_counter() - start
        return Audited(name, REFUSED, str(refusal), wall_s=seconds)
    finally:
        backend.select("auto")
    verification = plan.about["verification"]
    return Audited(
        name,
        _verdict(plan.about["kept"], measured, error, plan.tolerance.amount),
        plan.settings_line,
        plan.about["expected_error"],
        measured,
        error,
        plan.about["advice"],
        tuple(verification["switched_on"]),
        plan.about["planning_s"],
        result.run_seconds,
        verification["seconds"],
        time.perf_counter() - start,
    )


def _asked_for(path: Path, parameters: dict[str, str]) -> dict[str, str]:
    """Return those of the parameters that a file asks for."""
    text = path.read_text(errors="replace")
    return {name: value for name, value in parameters.items() if f"${name}" in text}


def _verdict(kept: bool | None, measured: float | None, error: float | None, allowed: float) -> str:
    if measured is not None and error is not None:
        if measured - _CERTAIN * error <= allowed:
            return KEPT
        return BROKEN if kept else WARNED
    return UNTOLD if kept else WARNED


def _reference(scene: SceneFile, plan: Any, seconds: float) -> Replicates:
    loaded = scene_source_in(scene, plan.settings["variant"]).build()
    paths = path_integrator(loaded, UNLIMITED, Survey(loaded).needs_volpath)
    sensor = plan.settings.get("sensor", 0)
    return converged(
        lambda spp, seed: rendering.render(
            loaded, spp, seed, paths, sensor=sensor, sampler="independent"
        ),
        lambda so_far: False,
        seconds,
        seed=1,
    )


def _off(image: np.ndarray, reference: Replicates, plan: Any) -> tuple[float | None, float | None]:
    """Return how far a picture is from its reference, and the error of that."""
    mask = foreground_mask(reference.image, image)
    if not mask.any():
        return 0.0, 0.0
    metric, exposure = plan.tolerance.metric, plan.about["exposure"]
    first, second = reference.halves
    error = distances(first, second, mask, exposure)[metric] / 2.0
    return distances(reference.image, image, mask, exposure)[metric], error


def summary(rows: Sequence[Audited]) -> dict[str, Any]:
    """Return the counts of verdicts, and what planning and verification cost."""
    rendered = [row for row in rows if row.verdict != REFUSED]
    render = sum(row.render_s for row in rendered)
    cheap = [r.planning_s < 0.2 or r.planning_s < 0.05 * r.render_s for r in rendered]
    return {
        "scenes": len(rows),
        **{name: sum(row.verdict == name for row in rows) for name in _VERDICTS},
        "switched_on": sum(bool(row.switched_on) for row in rendered),
        "planning_s": sum(row.planning_s for row in rendered),
        "longest_plan_s": max((row.planning_s for row in rendered), default=0.0),
        "cheap_plans": sum(cheap),
        "render_s": render,
        "verification_s": sum(row.verification_s for row in rendered),
        "wall_s": sum(row.wall_s for row in rows),
    }


_VERDICTS = (KEPT, WARNED, BROKEN, UNTOLD, REFUSED)

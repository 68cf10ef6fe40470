"""The main job: measure a material, reconstruct it, render both, compare, and say what it cost."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import simrig
from simrig.brdf.protocol import Brdf
from simrig.core import backend
from simrig.core.progress import Progress
from simrig.evaluation.experiment.checkpoint import Parts, Steps
from simrig.evaluation.experiment.config import Experiment, SceneSettings, demo_experiment
from simrig.evaluation.experiment.plans import check_plans
from simrig.evaluation.experiment.reconstructions import MeasurementRunner, Subject, make_plans
from simrig.evaluation.experiment.results import (
    FORMAT,
    FORMAT_VERSION,
    accuracy_versus_cost,
    brdf_errors,
    comparison_grid,
    material_facts,
    metric_meanings,
    provenance,
    total_costs,
)
from simrig.evaluation.experiment.scenes import SceneRenderer
from simrig.evaluation.report import html as report
from simrig.files.atomic import atomic_write
from simrig.files.load import load_material
from simrig.plans.protocol import largest_theta_deg
from simrig.plugins.importance_sampling import sample_alike
from simrig.rigs.fingerprint import fingerprint
from simrig.rigs.registry import make_rig

__all__ = ["Experiment", "SceneSettings", "demo_experiment", "run_experiment"]

RESULTS, REPORT, SETTINGS = "results.json", "report.html", "experiment.toml"


def run_experiment(
    experiment: Experiment, folder: str | Path, progress: Progress | None = None
) -> dict[str, Any]:
    """Run an experiment into a folder, going on from the parts that are finished there.

    The folder then holds ``report.html``, ``results.json``, ``experiment.toml`` and the folders
    ``measurements``, ``reconstructions`` (HDF5) and ``pictures`` (EXR and PNG). Files appear
    there one by one; the command line therefore hands in a working folder and gives it its final
    name when this function is done.

    Args:
        folder: is made when it does not exist.

    Returns:
        What ``results.json`` holds (``docs/experiments.md`` documents the keys).

    Raises:
        SimrigError: an experiment that cannot be carried out; nothing is measured then.
    """
    variant = backend.select(experiment.variant)
    check_plans(experiment)
    truth = load_material(experiment.material)
    theta_max_deg = largest_theta_deg(truth, experiment.measurement.theta_max_deg)
    rig = make_rig(experiment.measurement.rig)
    plans = make_plans(experiment.measurement, theta_max_deg, truth.theta_max)
    for plan in plans:
        rig.check(truth, plan.plan)
    grid = comparison_grid(experiment.comparison, theta_max_deg)

    folder = Path(folder)
    for name in ("measurements", "reconstructions", *_picture_folders(experiment)):
        (folder / name).mkdir(parents=True, exist_ok=True)
    identity = {
        "simrig": simrig.__version__,
        "settings": experiment.as_dict(),
        "instrument": rig.instrument_facts(),
        "material": fingerprint(truth),
    }
    parts = Parts(folder, identity)
    steps = Steps(len(plans) * (2 + len(experiment.scenes)) + len(experiment.scenes) + 1, progress)

    runner = MeasurementRunner(
        truth,
        rig,
        experiment.measurement,
        experiment.reconstruction.interpolation,
        folder,
        parts,
        steps,
    )
    subjects = [runner.subject(plan) for plan in plans]
    renderers = [
        SceneRenderer(key, scene, experiment, folder, parts, steps)
        for key, scene in experiment.keyed_scenes.items()
    ]
    scenes = {renderer.key: renderer.reference(truth) for renderer in renderers}
    records = [
        _reconstruction(s, truth, renderers, grid, experiment, parts, steps) for s in subjects
    ]
    samples = experiment.comparison.estimate_samples
    results = {
        "format": FORMAT,
        "format_version": FORMAT_VERSION,
        "title": experiment.title or truth.name.replace("_", " "),
        "experiment": experiment.as_dict(),
        "material": material_facts(truth, experiment.material, grid, samples, experiment.seed),
        "theta_max_deg": theta_max_deg,
        "metrics": metric_meanings(),
        "scenes": scenes,
        "reconstructions": records,
        "accuracy_versus_cost": accuracy_versus_cost(records),
        "provenance": provenance(variant),
    }
    steps.begin("writing the report")
    settings = experiment.to_toml()
    _write(folder / SETTINGS, settings)
    _write(folder / RESULTS, json.dumps(results, indent=2, allow_nan=False) + "\n")
    _write(folder / REPORT, report.render(results, folder, truth, subjects, settings))
    parts.close()
    steps.end()
    return results


def _picture_folders(experiment: Experiment) -> list[str]:
    return [f"pictures/{key}" for key in experiment.keyed_scenes]


def _reconstruction(
    subject: Subject,
    truth: Brdf,
    renderers: list[SceneRenderer],
    grid: Any,
    experiment: Experiment,
    parts: Parts,
    steps: Steps,
) -> dict[str, Any]:
    """Compare a reconstruction with the truth over all angles and on all scenes."""
    plan = subject.plan
    sample_alike(subject.brdf, truth)  # noise is then no difference between their pictures
    steps.begin(f"comparing all angles, {plan.label}")
    name = f"errors {plan.key}"
    errors = parts.get(name) or parts.put(
        name,
        {
            "brdf": brdf_errors(truth, subject.brdf, grid, experiment.comparison, experiment.seed),
            "files": {},
        },
    )
    steps.end()
    record = {
        "key": plan.key,
        "method": plan.method,
        "label": plan.label,
        "samples": plan.samples,
        "plan": plan.plan.describe(),
        "found": subject.measurement.provenance.get("found"),
        **subject.record,
        "brdf": errors["brdf"],
        "scenes": {
            renderer.key: renderer.reconstruction(plan.key, plan.label, subject.brdf)
            for renderer in renderers
        },
    }
    return {**record, "total": total_costs(record)}


def _write(path: Path, text: str) -> None:
    with atomic_write(path) as temporary:
        temporary.write_text(text, encoding="utf-8")

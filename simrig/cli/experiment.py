"""``simrig demo`` and ``simrig run``: the whole path from a material to a report."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from simrig.cli import effect_options, frame
from simrig.cli.options import IntoFolder
from simrig.cli.outputs import output_folder

if TYPE_CHECKING:
    from simrig.evaluation.experiment.config import Experiment

_Output = Annotated[Path, typer.Option(help="The folder for pictures, data and the report.")]
_Variant = Annotated[str | None, typer.Option(help="Mitsuba variant, or 'auto'.")]


def demo(
    material: Annotated[
        str | None, typer.Option(help="A built-in material or a material file.")
    ] = None,
    output: _Output = Path("output/demo"),
    *,
    effects: effect_options.Effects,
    variant: _Variant = None,
    overwrite: IntoFolder = False,
) -> frame.Report:
    """Measure, reconstruct, render and compare one material, and write a report.

    The folder holds pictures (EXR and PNG), the measurement (HDF5), results.json and report.html,
    which is one file and needs nothing else. After Ctrl-C the same command goes on. What the
    pictures simulate follows from the tolerance, see 'simrig plan'.
    """
    from simrig.evaluation.experiment.config import demo_experiment

    config = effect_options.experiment_with(demo_experiment(material), effects)
    return _experiment(config, output, variant, overwrite)


def run(
    experiment: Annotated[Path, typer.Argument(help="An experiment (.toml).")],
    output: Annotated[
        Path | None, typer.Option(help="The folder for the results; output/NAME else.")
    ] = None,
    *,
    effects: effect_options.Effects,
    variant: _Variant = None,
    overwrite: IntoFolder = False,
) -> frame.Report:
    """Run an experiment: as 'demo', with every setting from a TOML file.

    Every scene is planned for the tolerance that is given here or in the file (see 'simrig plan').
    """
    from simrig.evaluation.experiment.config import Experiment

    config = effect_options.experiment_with(Experiment.from_toml(experiment), effects)
    return _experiment(config, output or Path("output") / experiment.stem, variant, overwrite)


def _experiment(
    config: Experiment, output: Path, variant: str | None, overwrite: bool
) -> frame.Report:
    from simrig.core import backend
    from simrig.evaluation.experiment.plans import check_plans
    from simrig.evaluation.experiment.run import run_experiment

    if variant is not None:
        config = replace(config, variant=variant)
    backend.resolve(config.variant)  # refused before anything is measured or written
    check_plans(config)
    with (
        output_folder(output, overwrite, config.as_dict()) as folder,
        frame.progress(config.title or config.material) as report,
    ):
        results = run_experiment(config, folder, report)
    written = output / "report.html"
    return frame.Report(
        data={"output": output, "report": written, "results": results},
        shown=[_summary(results), *_families(results), f"{output}: open {written}"],
    )


def _summary(results: dict[str, Any]) -> Any:
    """Return one line per reconstruction: what it cost beside how far off it is."""
    first = next(iter(results["scenes"]))
    pictures = f"ΔE 1976, {first}"
    columns = ("reconstruction", "hardware h", "computing s", pictures, "log error %", "MRE %")
    rows = [
        (
            record["label"],
            record["total"]["hardware_hours"],
            record["total"]["compute_seconds"],
            record["scenes"][first]["errors"]["delta_e"],
            record["brdf"]["log_error_percent"],
            record["brdf"]["mre_percent"],
        )
        for record in results["reconstructions"]
    ]
    return frame.table(columns, rows, results["title"])


def _families(results: dict[str, Any]) -> list[str]:
    """Return which family each automatic measurement took and why, one line each."""
    return [
        f"{record['label']}: {record['found']['why']}"
        for record in results["reconstructions"]
        if record["found"]
    ]

"""What accuracy costs, and published figures beside ours; every finished result is kept."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from simrig.brdf.protocol import Brdf
from simrig.core.errors import SimrigError, check_known
from simrig.core.progress import Progress
from simrig.evaluation.studies import STUDIES
from simrig.evaluation.studies.engine.base import Study
from simrig.evaluation.studies.engine.run import StudyResults, run_study
from simrig.evaluation.studies.engine.storage import cell_key
from simrig.evaluation.studies.pareto import study as pareto_study
from simrig.files.load import save_material
from simrig.rigs.fingerprint import fingerprint


def pareto(
    materials: Brdf | str | Path | Sequence[Brdf | str | Path],
    *,
    methods: Sequence[str] = (),
    samples: Sequence[int] = pareto_study.SAMPLES,
    folder: str | Path | None = None,
    workers: int = 1,
    progress: Progress | None = None,
) -> StudyResults:
    """Measure materials by every method with several numbers of samples: what accuracy costs.

    Args:
        materials: one or more BRDFs, their names or their files.
        methods: names; all of them when none is given.
        samples: wished numbers; a method takes the most below that its plans allow.
        folder: keeps every finished result, so that an interrupted call goes on; by default
            ``output/pareto/...``, one of its own for every configuration.
        workers: processes; more than one need ``simrig[studies]``.
        progress: called with what is done and how much there is.

    Returns:
        ``summary["subjects"]``: one for each material, with ``rows`` (method, samples, hardware
        hours, seconds, bytes, MRE with its standard error, ΔE, PSNR, and on which Pareto fronts it
        is) and what was ``refused``; ``rows`` is the same as one table.

    Raises:
        SimrigError: unknown materials or methods, no samples, a folder of another configuration.
    """
    items = [materials] if isinstance(materials, Brdf | str | Path) else materials
    if not isinstance(items, Sequence) or not all(isinstance(i, Brdf | str | Path) for i in items):
        raise SimrigError("materials are BRDFs, their names or their files, one or a list of them")
    names = [_named(item) for item in items]
    config = pareto_study.configuration(names, methods, samples)
    place = Path(folder) if folder is not None else pareto_folder(config)
    return run_study(STUDIES["pareto"], config, place, None, workers, progress)


def _named(material: Brdf | str | Path) -> str:
    """Return a name or file by which a worker finds a material; objects are written first."""
    if not isinstance(material, Brdf):
        return str(material)
    path = Path("output", "pareto", "materials", f"{fingerprint(material)}.h5")
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        save_material(path, material)
    return str(path)


def pareto_folder(config: dict[str, Any]) -> Path:
    """Return a folder of its own for every configuration."""
    names = "-".join(Path(name).stem for name in config["materials"])
    return Path("output", "pareto", f"{names[:60]}-{cell_key(config)[:8]}")


def study(
    name: str,
    *,
    preset: str = "quick",
    folder: str | Path | None = None,
    workers: int = 1,
    scheduler: str | None = None,
    progress: Progress | None = None,
) -> StudyResults:
    """Run a study: a published table or figure computed again, beside what was published.

    Args:
        name: see 'simrig study list'.
        preset: ``quick``, small enough to try, or ``full``, as published.
        folder: keeps every finished cell, so that an interrupted call goes on; by default
            ``output/studies/NAME-PRESET``.
        workers: processes; more than one need ``simrig[studies]``.
        scheduler: address of a Dask scheduler whose workers are used instead.
        progress: called with the cells done and in total.

    Raises:
        SimrigError: an unknown study or preset, or a folder of another configuration.
    """
    chosen = find_study(name)
    check_known("preset", preset, chosen.presets)
    place = Path(folder) if folder is not None else study_folder(name, preset)
    return run_study(chosen, chosen.presets[preset], place, scheduler, workers, progress)


def find_study(name: str) -> Study:
    """Return a study by name.

    Raises:
        SimrigError: unknown name, with the nearest known one.
    """
    check_known("study", name, STUDIES)
    return STUDIES[name]


def study_folder(name: str, preset: str) -> Path:
    """Return where the results of a preset go when nothing else is asked for."""
    return Path("output", "studies", f"{name}-{preset}")

"""From a film, or from a user's own videos, to the file of a BTF."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from simrig.btf.stack import BtfStack
from simrig.core.errors import SimrigError
from simrig.core.progress import Progress
from simrig.files.btf.hdf5 import write_btf
from simrig.files.checkpoint import Checkpoint, checkpoint_of
from simrig.instruments.description import Description, described
from simrig.plans.gantry import GantryPlan
from simrig.reconstruction.gantry.btf import reconstruct_btf
from simrig.rigs.film.processing import FilmProcessing, FilmSettings
from simrig.rigs.film.recorder import CHART, filming_plan, read_film, video_names
from simrig.rigs.film.setup import Setup
from simrig.rigs.imaging.recorder import chart_albedos


def filmed_in(folder: Path, settings: FilmSettings) -> FilmProcessing:
    """Return the processing of a film that ``simrig record`` made.

    Raises:
        SimrigError: no film, or slices that are still to be filmed.
    """
    about = read_film(folder)
    try:
        plan = GantryPlan.restored(about["plan"], np.zeros((0, 4)))
        setup = Setup.of(described(about["instrument"]), float(about["sample_mm"]), 0)
        chart = (folder / CHART, np.array(about["chart_albedo"]), float(about["chart_mm"]))
    except (KeyError, TypeError, ValueError) as error:
        raise SimrigError(f"'{folder}': film.json is damaged: {error}") from error
    videos = [folder / name for name in video_names(plan)]
    missing = [video.name for video in videos if not video.is_file()]
    if missing:
        raise SimrigError(
            f"'{folder}' lacks {len(missing)} of {len(videos)} slices ({missing[0]}, ...): go on "
            "filming with the same command"
        )
    return FilmProcessing(videos, plan, setup, settings, chart)


def filmed_by(
    videos: Sequence[Path],
    description: Description,
    settings: FilmSettings,
    chart: Path | None = None,
    sample_mm: float | None = None,
) -> FilmProcessing:
    """Return the processing of a user's own videos.

    Args:
        videos: of the slices by pairs of polar angles, axial before diagonal.
        description: of the instrument that filmed them.
        settings: what is made.
        chart: a still of a ColorChecker of the sample's size, while the first slice is filmed.
        sample_mm: side of the sample; the instrument's diameter unless given.
    """
    setup = Setup.of(description, sample_mm, 0)
    camera = description.camera  # type: ignore[attr-defined]
    plan = filming_plan(GantryPlan.from_degrees(*camera.theta_deg))
    still = None if chart is None else (chart, chart_albedos(), setup.optics.sample_mm)
    return FilmProcessing(list(videos), plan, setup, settings, still)


def make_btf(
    work: FilmProcessing,
    output: Path,
    method: str,
    slices: Path | None = None,
    name: str = "film",
    progress: Progress | None = None,
) -> tuple[BtfStack, dict[str, Any]]:
    """Write the BTF of films; frames that were selected are kept until it stands.

    Args:
        work: the stages.
        output: the HDF5 file.
        method: of the gantry's, ``"gantry-a"``, ``"gantry-b"`` or ``"gantry-bd"``.
        slices: a file for the images of the slices alone too.
        name: of the material.
        progress: called with steps done and in total.

    Returns:
        The stack that was written, and what the stages found.

    Raises:
        SimrigError: what any stage refuses; what was selected is kept.
    """
    kept = checkpoint_of(output)
    work = replace(work, checkpoint=kept, progress=progress, notes=[])
    measured, plan = work.stack(name)
    found = work.found()
    if slices is not None:
        write_btf(slices, measured)
    stack = reconstruct_btf(measured, method, plan=plan, progress=progress)
    write_btf(output, replace(stack, name=name))
    Checkpoint.forget(kept)
    return stack, found | {"images": len(measured), "settings": asdict(work.settings)}


def filmed_plan(stack: BtfStack) -> GantryPlan | None:
    """Return the plan of a file of filmed slices; None of other BTFs."""
    said = stack.provenance.get("filmed")
    return None if said is None else GantryPlan.restored(said, stack.angles)

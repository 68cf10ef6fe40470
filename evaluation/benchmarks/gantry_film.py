"""Films of the gantry: filming, choosing frames, and making a BTF, by the clock and the processor.

One slice is filmed (a tile; frames that are not chosen small), its video is read and its frames
are chosen, and method B reconstructs 128 × 128 texels at 6,561 pairs. A film has eight slices.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from simrig.btf.stack import BtfStack
from simrig.core.cost import stopwatch
from simrig.core.tables import text_table
from simrig.instruments.description import shipped
from simrig.mesostructure import build_tile
from simrig.plans.gantry import GantryPlan
from simrig.reconstruction.gantry.btf import reconstruct_btf
from simrig.rigs.film.effects import film_effects
from simrig.rigs.film.recorder import Film, filming_plan, targets
from simrig.rigs.film.selection import select_frames

_NUMBER = 4  # the slice: axial, light at 75 and camera at 30 degrees


def run(progress: Any = None) -> dict[str, Any]:
    """Return seconds by the clock and of the processor, of each part."""
    description = shipped("merkur-gantry")
    effects = tuple(effect.name for effect in film_effects(description))  # type: ignore[arg-type]
    plan = filming_plan(GantryPlan())
    film = Film(build_tile("leather_tan"), description, plan, effects)
    setup = film.camera(_NUMBER)[0].setup
    theta = plan.thetas[plan.slices[_NUMBER].pair[1]]
    values = np.random.default_rng(0).uniform(0.1, 0.3, (plan.samples, 128, 128, 3))
    stack = BtfStack(values.astype(np.float16), plan.angles(), (16.0, 16.0))
    rows: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "slice.avi"
        parts: dict[str, Callable[[], Any]] = {
            "film one slice": lambda: film.film_slice(path, _NUMBER),
            "choose its frames": lambda: select_frames(path, setup, *targets(plan, _NUMBER), theta),
            "reconstruct 128 × 128 texels": lambda: reconstruct_btf(stack, plan=plan),
        }
        for name, work in parts.items():
            if progress is not None:
                progress(len(rows), len(parts), name)
            elapsed, before = stopwatch(), time.process_time()
            work()
            used = time.process_time() - before
            rows.append({"part": name, "seconds": elapsed(), "cpu_seconds": used})
    return {"rows": rows, "frames": setup.frames}


def table(results: dict[str, Any]) -> Any:
    """Return the seconds as a table for the terminal."""
    shown = [
        (row["part"], f"{row['seconds']:.1f}", f"{row['cpu_seconds']:.1f}")
        for row in results["rows"]
    ]
    return text_table("gantry that films", ("part", "seconds", "processor seconds"), shown)

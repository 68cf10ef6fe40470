"""The basis of a database: slices, basis, directions, reconstruction, patterns, joint design."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from simrig.core.progress import Progress
from simrig.core.tables import text_table
from simrig.database import design, linear
from simrig.database.known import known
from simrig.database.patterns import Subspaces, reference_pattern
from simrig.database.posterior import Posterior
from simrig.database.process import RotationProcess
from simrig.database.slices import Slices
from simrig.directions.half_difference import from_half_difference
from simrig.evaluation.database.built_in import built_in

_WANTED = 150  # materials of the whole database
# what: seconds that are aimed at, seconds of the thesis
_AIMS: dict[str, tuple[float, float | None]] = {
    "slices and basis of 32,400": (20.0, 240.0),
    "20 directions of least condition": (10.0, 180.0),
    "20 directions, I-optimal": (10.0, None),
    "reconstruction, n = 20, r = 72": (0.1, 14.0),
    "pattern of 1,438 samples": (120.0, 4200.0),
    "joint design of 160": (10.0, None),
    "process from 160 samples, whole table": (10.0, None),
}


def run(progress: Progress) -> dict[str, Any]:
    """Measure, and scale what depends on the number of materials to 150.

    The database is that of SIMRIG_DATABASE, or the built-in materials. Both clocks are given: on a
    machine with other work the processor's says more.
    """
    folder = os.environ.get("SIMRIG_DATABASE")
    own = known(folder) if folder else built_in()
    database = own.database
    found: list[dict[str, Any]] = []

    def timed(name: str, call: Callable[[], Any], times: float = 1.0) -> Any:
        progress(len(found), len(_AIMS), name)
        wall, processor = time.perf_counter(), time.process_time()
        result = call()
        aim, thesis = _AIMS[name]
        found.append(
            {
                "name": name,
                "seconds": (time.perf_counter() - wall) * times,
                "processor_seconds": (time.process_time() - processor) * times,
                "aim": aim,
                "thesis": thesis,
                "scaled": times,
            }
        )
        return result

    database.entries[0].load()
    Slices.sampled(database.without([e.name for e in database.entries[1:]]))  # compiles
    scale = _WANTED / len(database)

    def made() -> Any:
        slices = Slices.sampled(database)
        return slices, slices.basis()

    slices, basis = timed("slices and basis of 32,400", made, scale)
    process = RotationProcess.of(basis)
    count = min(20, basis.principal.shape[1])
    rows = timed("20 directions of least condition", lambda: design.least_condition(basis, count))
    timed("20 directions, I-optimal", lambda: design.optimal(process.basis, count))
    turns = 2.0 * np.pi / 72 * np.arange(72)
    values = slices.logs(0)[rows] - basis.mean[rows][:, None, None]
    few = basis.first(100)

    def reconstructed() -> np.ndarray:
        c = linear.solved(few, few.principal[rows], values, turns, "constrained")
        return few.principal.astype(np.float32) @ c.reshape(len(c), -1).astype(np.float32)

    reconstructed()
    timed("reconstruction, n = 20, r = 72", reconstructed)
    table = database.entries[0].load()
    spaces = Subspaces.of([table.values])  # type: ignore[attr-defined]
    most = min(1438, sum(len(v) for v in spaces.values))
    timed("pattern of 1,438 samples", lambda: reference_pattern(spaces, most))
    half = timed("joint design of 160", lambda: design.joint(process, 160))
    wi, wv = from_half_difference(*half.T)
    measured = table.eval(wi, wv)
    timed(
        "process from 160 samples, whole table",
        lambda: Posterior.of(process, wi, wv, measured).logs(),
    )
    return {"materials": len(database), "rows": found}


def table(results: dict[str, Any]) -> Any:
    """Return the results as a table for the terminal."""
    columns = ("what", "s", "processor s", "aim / s", "thesis / s")
    lines = [
        (
            row["name"],
            f"{row['seconds']:.3g}",
            f"{row['processor_seconds']:.3g}",
            f"{row['aim']:g}",
            "–" if row["thesis"] is None else f"{row['thesis']:g}",
        )
        for row in results["rows"]
    ]
    return text_table(f"Basis, from {results['materials']} materials", columns, lines)

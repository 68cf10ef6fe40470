"""Bytes on the device for slices, beside thesis Table D.3, with the error they buy.

``stored`` is the layout of appendix D.4 in float32 RGB; ``look-up`` is what rendering reads (the
polar angle surfaces folded into one table, colours packed in 64 bits); ``differentiable`` is the
same in float32.
"""

from __future__ import annotations

from typing import Any

from simrig.brdf import kurt_material
from simrig.brdf.tables.grid import to_dense
from simrig.core import backend
from simrig.core.arrays import table_bytes
from simrig.core.progress import Progress, tracked
from simrig.core.tables import MIB, Column, record_table, scaled
from simrig.evaluation.metrics.mre import mre_exact
from simrig.plans.along_slices import SlicePlan
from simrig.plans.placement import SlicePlacement
from simrig.reconstruction.slices.tables import reconstruct
from simrig.rigs.direct.gonioreflectometer import Gonioreflectometer

MATERIAL = "fabric112"
# samples: (polar angle step, azimuth step, published MB); thesis Table D.3
LAYOUTS = {8911: (14.0, 36.0, 3.3), 18721: (10.0, 36.0, 5.1)}


def run(progress: Progress | None = None) -> dict[str, Any]:
    """Run the benchmark.

    Returns:
        ``rows`` with ``samples``, ``published_megabytes``, ``stored_bytes``, ``lookup_bytes``,
        ``differentiable_bytes``, ``mre_percent`` and ``hardware_hours``.
    """
    types = backend.types("float32")
    truth = kurt_material(MATERIAL)
    rows = []
    for samples in tracked(LAYOUTS, progress):
        e_s, a_s, published = LAYOUTS[samples]
        placement = SlicePlacement.from_degrees(e_s, a_s)
        measurement = Gonioreflectometer().measure(truth, SlicePlan(placement, samples))
        slices = reconstruct(measurement)
        sizes = {}
        for key, differentiable in (("lookup", False), ("differentiable", True)):
            prepared = slices.prepare(slices.on(types.Float), differentiable)
            sizes[f"{key}_bytes"] = table_bytes(prepared)
        rows.append(
            {
                "samples": samples,
                "placement": placement.describe(),
                "published_megabytes": published,
                "stored_bytes": slices.stored_bytes,
                **sizes,
                "mre_percent": mre_exact(truth, to_dense(slices)).percent,
                "hardware_hours": measurement.cost.hardware_hours,
            }
        )
    return {"benchmark": "storage", "material": MATERIAL, "rows": rows}


def table(results: dict[str, Any]) -> Any:
    """Return the results as a table for the terminal."""
    columns: dict[str, Column] = {
        "samples": "{samples:,} ({placement})",
        "Table D.3 [MB]": "{published_megabytes:.1f}",
        "stored [MiB]": scaled("stored_bytes", MIB, "{:.2f}"),
        "look-up [MiB]": scaled("lookup_bytes", MIB, "{:.2f}"),
        "differentiable [MiB]": scaled("differentiable_bytes", MIB, "{:.2f}"),
        "MRE [%]": "{mre_percent:.2f}",
        "hardware [h]": "{hardware_hours:.0f}",
    }
    return record_table(f"Storage of slices, {results['material']}", columns, results["rows"])

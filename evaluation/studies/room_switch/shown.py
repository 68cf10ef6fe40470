"""What the study of the room shows: Table 3.4 beside ours, and the pictures of Fig. 3.18."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from simrig.core.tables import Column, known, named_rows, record_table
from simrig.evaluation.studies.engine.base import Row
from simrig.evaluation.studies.engine.pictures import write_pictures

_NAMES = {
    "btf": "BTF only",
    "brdf": "BRDF only",
    "switched": "switched",
    "planned": "switched as planned",
}
_FARTHEST_M = 13.0  # of the range map's colours


def table(summary: Mapping[str, Any]) -> Any:
    """Return the forms beside Table 3.4, and the distances of the switch."""
    from rich.console import Group

    forms: dict[str, Column] = {
        "form": lambda row: _NAMES[row["form"]],
        "rendering [s] (range)": "{seconds:.3f} ({range_seconds[0]:.3f}–{range_seconds[1]:.3f})",
        "tracing [s]": "{tracing_seconds:.2f}",
        "first [s]": "{first_seconds:.2f}",
        "÷ BTF": "{faster:.2f}×",
        "÷ BTF, published": known("{published_faster:.2f}× ({published_fps:g} FPS)"),
        "PSNR [dB]": known("{psnr:.1f}"),
        "PSNR, published": known("{published_psnr:g}"),
        "BRDF pixels": lambda row: f"{100.0 * row['far_share']:.0f} %",
        "MiB": lambda row: f"{row['device_bytes'] / 2**20:.1f}",
    }
    title = (
        f"The room, {summary['resolution']} pixels wide, {summary['spp']} spp, "
        f"{summary['variant']}, median of {summary['rounds']}; '÷ BTF' says how many times faster "
        "than BTF only"
    )
    seconds = summary["forms"]["planned"]["planning_seconds"]
    distances: dict[str, Column] = {
        "part": "{name}",
        "material": "{material}",
        f"switch [m], {summary['distances']}": "{distance_m:.1f}",
        "group [m]": "{group_distance_m:g}",
        f"for {summary['tolerance']} [m], planned in {seconds:.1f} s": "{planned_distance_m:.1f}",
    }
    about = "From where on the BRDF is shown, and the thesis's distances of the groups"
    return Group(
        record_table(title, forms, named_rows(summary["forms"], "form")),
        record_table(about, distances, named_rows(summary["parts"], "name")),
    )


def plots(summary: Mapping[str, Any], rows: Sequence[Row], folder: Path) -> list[Path]:
    """Write the pictures: the three forms, 30 times their differences, and the range map."""
    return write_pictures(rows, folder)


def range_picture(distance_m: np.ndarray) -> np.ndarray:
    """Return distances in m as colours, near ones bright, up to 13 m; black where nothing is."""
    import matplotlib

    share = np.clip(distance_m / _FARTHEST_M, 0.0, 1.0)
    colours = matplotlib.colormaps["viridis"](1.0 - share)[..., :3]
    colours[distance_m == 0.0] = 0.0
    return np.round(255.0 * colours).astype(np.uint8)

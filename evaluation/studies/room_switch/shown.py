"""What the study of the room shows: Table 3.4 beside ours, and the pictures of Fig. 3.18."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from simrig.core.tables import text_table
from simrig.files.atomic import atomic_write

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

    columns = ["form", "rendering [s] (range)", "tracing [s]", "first [s]", "÷ BTF", "published"]
    columns += ["PSNR [dB]", "published", "BRDF pixels", "MiB"]
    rows = []
    for form, row in summary["forms"].items():
        low, high = row["range_seconds"]
        rows.append(
            [
                _NAMES[form],
                f"{row['seconds']:.3f} ({low:.3f}–{high:.3f})",
                f"{row['tracing_seconds']:.2f}",
                f"{row['first_seconds']:.2f}",
                f"{row['faster']:.2f}×",
                f"{row['published_faster']:.2f}× ({row['published_fps']:g} FPS)"
                if row["published_fps"]
                else "–",
                "–" if row["psnr"] is None else f"{row['psnr']:.1f}",
                "–" if row["published_psnr"] is None else f"{row['published_psnr']:g}",
                f"{100.0 * row['far_share']:.0f} %",
                f"{row['device_bytes'] / 2**20:.1f}",
            ]
        )
    title = (
        f"The room, {summary['resolution']} pixels wide, {summary['spp']} spp, "
        f"{summary['variant']}, median of {summary['rounds']}; '÷ BTF' says how many times faster "
        "than BTF only"
    )
    distances = [
        [
            part,
            one["material"],
            f"{one['distance_m']:.1f}",
            f"{one['group_distance_m']:g}",
            f"{one['planned_distance_m']:.1f}",
        ]
        for part, one in summary["parts"].items()
    ]
    source = f"switch [m], {summary['distances']}"
    seconds = summary["forms"]["planned"]["planning_seconds"]
    planned = f"for {summary['tolerance']} [m], planned in {seconds:.1f} s"
    return Group(
        text_table(title, columns, rows),
        text_table(
            "From where on the BRDF is shown, and the thesis's distances of the groups",
            ["part", "material", source, "group [m]", planned],
            distances,
        ),
    )


def plots(summary: Mapping[str, Any], rows: Sequence[Mapping[str, Any]], folder: Path) -> list:
    """Write the pictures: the three forms, 30 times their differences, and the range map."""
    paths = []
    for row in rows:
        if row["kind"] == "picture":
            path = folder / f"{row['name']}.png"
            with atomic_write(path) as temporary:
                temporary.write_bytes(base64.b64decode(row["png"]))
            paths.append(path)
    return paths


def encoded(picture: np.ndarray) -> str:
    """Return a uint8 picture (height, width, 3) as a PNG in base64."""
    from matplotlib import image

    buffer = io.BytesIO()
    image.imsave(buffer, picture, format="png")
    return base64.b64encode(buffer.getvalue()).decode()


def range_picture(distance_m: np.ndarray) -> np.ndarray:
    """Return distances in m as colours, near ones bright, up to 13 m; black where nothing is."""
    import matplotlib

    share = np.clip(distance_m / _FARTHEST_M, 0.0, 1.0)
    colours = matplotlib.colormaps["viridis"](1.0 - share)[..., :3]
    colours[distance_m == 0.0] = 0.0
    return np.round(255.0 * colours).astype(np.uint8)

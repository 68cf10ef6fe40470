"""What the study of a BTF against its structure shows: tables, and pictures side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from simrig.core.tables import text_table
from simrig.evaluation.studies.engine.base import Row
from simrig.evaluation.studies.engine.pictures import PICTURE, draw_sheet
from simrig.viewing.plots import COLOURS, MARKERS, finish_figure, new_figure, plain_ticks

_STRUCTURE, _DIFFERENCE = "structure", "difference"


def table(summary: Mapping[str, Any]) -> Any:
    """Return the summary as tables for the terminal."""
    from rich.console import Group

    sights = (
        (
            lines["full"]["material"],
            _angles(lines["full"]),
            f"{lines['full']['distance_m']:g}",
            "yes" if lines["full"]["measured"] else "between",
            *(_errors(lines[form]) for form in ("full", "factored")),
            f"{lines['full']['noise_delta_e']:.2f}",
        )
        for lines in _by_sight([*summary["angle"], *summary["distance"]])
    )
    means = (
        (
            f"mean, {mean['form']}",
            *("", "0.6", "measured" if mean["measured"] else "between"),
            *(_errors(mean), "", ""),
        )
        for mean in summary["means"]
    )
    far = (
        (
            row["material"],
            _angles(row),
            f"{100 * row['btf_off']:+.4f} %",
            f"{100 * row['perspective_off']:+.3f} %",
            f"{100 * row['structure_off']:+.2f} ± {100 * row['standard_error']:.2f} %",
            f"{row['structure_off_errors']:+.1f}",
        )
        for row in summary["far"]
    )
    speed = (
        (
            row["material"],
            row["form"],
            row["integrator"],
            f"{row['samples_per_second'] / 1e6:.2f}",
            f"{row['times_structure']:.2f}",
            f"{row['kernel_seconds']:.3f}",
            f"{row['first_seconds']:.2f}",
            f"{row['bytes'] / 2**20:.2f}",
        )
        for row in summary["speed"]
    )
    sight = ("material", "θ_i/θ_v/φ_i/φ_v")
    return Group(
        text_table(
            "BTF against structure, ΔE / PSNR [dB] / SSIM",
            (*sight, "m", "measured", "full", "factored", "noise ΔE"),
            sights,
            below=means,
        ),
        text_table(
            "Far field: mean radiance over one period, ABRDF · cos θ_i = 1",
            (*sight, "BTF off", "perspective", "structure off", "errors"),
            far,
        ),
        text_table(
            "Speed, same picture, by the time of the kernels",
            ("material", "form", "light", "M/s", "÷ structure", "kernels [s]", "first [s]", "MiB"),
            speed,
        ),
    )


def plots(summary: Mapping[str, Any], rows: Sequence[Row], folder: Path) -> list[Path]:
    """Draw structure, BTFs and their difference side by side, and the errors over distance."""
    pictures = [row for row in rows if row["kind"] == PICTURE]
    files = []
    for material in dict.fromkeys(row["material"] for row in pictures):
        own = [row for row in pictures if row["material"] == material]
        for name, kind in (("angles", "angle"), ("distances", "distance")):
            lines: dict[str, list[tuple[str, Row]]] = {}
            for row in own:
                if row["picture"].startswith(kind):
                    lines.setdefault(row["picture"], []).append((_caption(row), row))
            path = folder / f"{material}_{name}.png"
            if lines:
                files.append(draw_sheet(path, list(lines.values()), 2.2, material))
    return [*files, _beside(pictures, folder / "beside.png"), _over_distance(summary, folder)]


def _beside(pictures: Sequence[Row], path: Path) -> Path:
    """Draw structure, full BTF and difference of every material, between measured pairs."""
    lines = []
    for material in dict.fromkeys(row["material"] for row in pictures):
        own = [row for row in pictures if row["material"] == material and not row["measured"]]
        own = own or [row for row in pictures if row["material"] == material]
        first = {row["form"]: row for row in own if row["picture"] == own[0]["picture"]}
        full = first["full"]
        captions = {
            _STRUCTURE: f"{material}\nstructure, {_angles(full)}°",
            "full": f"BTF, {full['distance_m']:g} m\n{_errors(full)}",
            _DIFFERENCE: "BTF − structure\n4 ×",
        }
        lines.append([(caption, first[form]) for form, caption in captions.items()])
    return draw_sheet(path, lines, 1.8)


def _over_distance(summary: Mapping[str, Any], folder: Path) -> Path:
    path = folder / "distance.png"
    figure = new_figure(5.6, 3.8)
    panel = figure.subplots()
    for number, material in enumerate(dict.fromkeys(r["material"] for r in summary["distance"])):
        own = [r for r in summary["distance"] if (r["material"], r["form"]) == (material, "full")]
        colour, marker = COLOURS[number % len(COLOURS)], MARKERS[number % len(MARKERS)]
        place = [row["distance_m"] for row in own]
        panel.plot(place, [r["delta_e"] for r in own], color=colour, marker=marker, label=material)
        panel.plot(place, [r["noise_delta_e"] for r in own], color=colour, linestyle=":")
    panel.set_xscale("log")
    plain_ticks(panel.xaxis)
    panel.set_xlabel("distance [m]")
    panel.set_ylabel("ΔE of the full form; dotted: noise of the structure")
    panel.set_ylim(bottom=0.0)
    panel.legend(frameon=False, fontsize=7)
    finish_figure(figure, path)
    return path


def _by_sight(rows: Sequence[Row]) -> list[dict[str, Row]]:
    """Return the forms of each material and sight, by the form."""
    found: dict[tuple, dict[str, Row]] = {}
    for row in rows:
        key = (row["material"], *row["angles_deg"], row["distance_m"])
        found.setdefault(key, {})[row["form"]] = row
    return list(found.values())


def _angles(row: Row) -> str:
    return "/".join(f"{angle:g}" for angle in row["angles_deg"])


def _errors(row: Row) -> str:
    psnr = "∞" if row["psnr"] is None else f"{row['psnr']:.1f}"
    return f"{row['delta_e']:.1f} / {psnr} / {row['ssim']:.2f}"


def _caption(row: Row) -> str:
    if row["form"] == _DIFFERENCE:
        return "full − structure, 4 ×\n"
    if row["form"] == _STRUCTURE:
        text = "measured" if row["measured"] else "between"
        return f"structure, {_angles(row)}°\n{text}, {row['distance_m']:g} m"
    return f"{row['form']}\n{_errors(row)}"

"""What the study of a BTF against its structure shows: tables, and pictures side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from simrig.core.tables import Column, record_table, text_table
from simrig.evaluation.studies.engine.base import Row
from simrig.evaluation.studies.engine.pictures import PICTURE, draw_sheet
from simrig.evaluation.studies.engine.rows import distinct, grouped, where
from simrig.viewing.plots import drawn_panel, line_style

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
    far: dict[str, Column] = {
        "material": "{material}",
        "θ_i/θ_v/φ_i/φ_v": _angles,
        "BTF off": lambda row: f"{100 * row['btf_off']:+.4f} %",
        "perspective": lambda row: f"{100 * row['perspective_off']:+.3f} %",
        "structure off": lambda row: (
            f"{100 * row['structure_off']:+.2f} ± {100 * row['standard_error']:.2f} %"
        ),
        "errors": "{structure_off_errors:+.1f}",
    }
    speed: dict[str, Column] = {
        "material": "{material}",
        "form": "{form}",
        "light": "{integrator}",
        "M/s": lambda row: f"{row['samples_per_second'] / 1e6:.2f}",
        "÷ structure": "{times_structure:.2f}",
        "kernels [s]": "{kernel_seconds:.3f}",
        "first [s]": "{first_seconds:.2f}",
        "MiB": lambda row: f"{row['bytes'] / 2**20:.2f}",
    }
    sight = ("material", "θ_i/θ_v/φ_i/φ_v")
    return Group(
        text_table(
            "BTF against structure, ΔE / PSNR [dB] / SSIM",
            (*sight, "m", "measured", "full", "factored", "noise ΔE"),
            sights,
            below=means,
        ),
        record_table(
            "Far field: mean radiance over one period, ABRDF · cos θ_i = 1", far, summary["far"]
        ),
        record_table("Speed, same picture, by the time of the kernels", speed, summary["speed"]),
    )


def plots(summary: Mapping[str, Any], rows: Sequence[Row], folder: Path) -> list[Path]:
    """Draw structure, BTFs and their difference side by side, and the errors over distance."""
    pictures = where(rows, kind=PICTURE)
    files = []
    for (material,), own in grouped(pictures, "material").items():
        for kind in ("angle", "distance"):
            sights = grouped((r for r in own if r["picture"].startswith(kind)), "picture")
            lines = [[(_caption(row), row) for row in sight] for sight in sights.values()]
            path = folder / f"{material}_{kind}s.png"
            if lines:
                files.append(draw_sheet(path, lines, 2.2, material))
    return [*files, _beside(pictures, folder / "beside.png"), _over_distance(summary, folder)]


def _beside(pictures: Sequence[Row], path: Path) -> Path:
    """Draw structure, full BTF and difference of every material, between measured pairs."""
    lines = []
    for (material,), every in grouped(pictures, "material").items():
        own = where(every, measured=False) or every
        first = {row["form"]: row for row in where(own, picture=own[0]["picture"])}
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
    label = "ΔE of the full form; dotted: noise of the structure"
    axes: dict[str, Any] = {"xscale": "log", "xlabel": "distance [m]", "ylabel": label}
    with drawn_panel(path, 5.6, 3.8, legend={"fontsize": 7}, **axes) as panel:
        for number, material in enumerate(distinct(summary["distance"], "material")):
            own = where(summary["distance"], material=material, form="full")
            style, keys = line_style(number), ("distance_m", "delta_e", "noise_delta_e")
            place, delta_e, noise = ([row[key] for row in own] for key in keys)
            panel.plot(place, delta_e, label=material, **style)
            panel.plot(place, noise, color=style["color"], linestyle=":")
        panel.set_ylim(bottom=0.0)
    return path


def _by_sight(rows: Sequence[Row]) -> list[dict[str, Row]]:
    """Return the forms of each material and sight, by the form."""
    keyed = ({**row, "sight": tuple(row["angles_deg"])} for row in rows)
    sights = grouped(keyed, "material", "sight", "distance_m").values()
    return [{row["form"]: row for row in own} for own in sights]


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

"""Tables and plots of the study of Table 5.2."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from simrig.core.tables import record_table, text_table
from simrig.evaluation.studies.engine.base import Row
from simrig.viewing.plots import COLOURS, finish_figure, finish_panel, line_style, new_figure

_KINDS = {"barycentric": "barycentric", "rbf": "RBF"}
_CURVES = {"slices": "adaptive slices", **_KINDS}


def table(summary: Mapping[str, Any]) -> Any:
    """Return the summary as tables for the terminal."""
    from rich.console import Group

    parts: list[Any] = [_set_table(about, found) for about, found in summary["sets"].items()]
    parts += [_curve_table(name, curves) for name, curves in summary["curves"].items()]
    if summary["global_and_local"]:
        parts.append(_splines_table(summary["global_and_local"]))
    share = summary["largest_relative_standard_error"]
    parts.append(
        f"{len(summary['schemes'])} of the thirty schemes; the least certain error has a standard "
        f"error of {share:.1%} of it"
    )
    return Group(*parts)


def _set_table(about: str, found: Mapping[str, Any]) -> Any:
    names = ("published", "ours", "its median", "of mean errors", "slices better in")
    columns = ("material", *(f"{kind}\n{name}" for kind in _KINDS.values() for name in names))
    rows = (
        (row["material"], *(text for kind in _KINDS for text in _cells(row[kind])))
        for row in found["rows"]
    )
    means = []
    for kind in _KINDS:
        mean = found["means"][kind]
        means += [f"{mean[key]:.2f}×" for key in ("published", "ours", "median")] + ["", ""]
    title = f"Table 5.2: error over that of slices, materials {about}"
    return text_table(title, columns, rows, below=[("mean", *means)])


def _cells(ratio: Mapping[str, Any]) -> list[str]:
    cells = ["{published:.2f}×", "{ours:.2f} ± {standard_error:.2f}×", "{median:.2f}×"]
    cells += ["{of_mean_errors:.2f}×", "{slices_better} of {schemes}"]
    return [cell.format_map(ratio) for cell in cells]


def _curve_table(name: str, curves: Mapping[str, Any]) -> Any:
    errors = [curves[kind]["mre_percent"] for kind in _CURVES]
    rows = (
        (f"{samples:,}", *(f"{error:.2f}" for error in row))
        for samples, *row in zip(curves["slices"]["samples"], *errors, strict=True)
    )
    title = f"MRE [%] of {name} over the number of samples (Fig. 5.8)"
    return text_table(title, ("samples", *_CURVES.values()), rows, left=())


def _splines_table(both: Sequence[Mapping[str, Any]]) -> Any:
    columns = {"material": "{material}", "samples": "{samples:,}"}
    columns |= {"global": "{global:.2f}", "local": "{local:.2f}"}
    return record_table(
        "MRE [%] of one spline through all samples, and of local ones", columns, both
    )


def plots(summary: Mapping[str, Any], rows: Sequence[Row], folder: Path) -> list[Path]:
    """Draw the curves of Fig. 5.8, and the ratios of every set beside the published ones."""
    files = [folder / "figure_5_8.png"]
    finish_figure(_curve_plot(summary["curves"]), files[0])
    for about, found in summary["sets"].items():
        files.append(folder / f"table_5_2_{about.replace(' ', '_')}.png")
        finish_figure(_ratio_plot(about, found["rows"]), files[-1])
    return files


def _curve_plot(every: Mapping[str, Any]) -> Any:
    """Draw error over the number of samples, one panel per material."""
    figure = new_figure(5.0 * len(every), 4.3)
    panels = figure.subplots(1, len(every), squeeze=False)[0]
    for panel, (name, curves) in zip(panels, every.items(), strict=True):
        for number, (kind, label) in enumerate(_CURVES.items()):
            x, y = curves[kind]["samples"], curves[kind]["mre_percent"]
            panel.plot(
                x,
                y,
                label=label if panel is panels[0] else None,
                markersize=4,
                **line_style(number),
            )
        panel.grid(which="major", color="0.9")
        panel.spines[["top", "right"]].set_visible(False)
        title = name.replace("_", " ")
        finish_panel(panel, xscale="log", yscale="log", xlabel="samples n", title=title)
    panels[0].set_ylabel("MRE [%]")
    return figure


def _ratio_plot(about: str, rows: Sequence[Mapping[str, Any]]) -> Any:
    """Draw published and our ratios per material as bars."""
    figure = new_figure(max(6.0, 1.0 * len(rows) + 1.0), 6.4)
    panels = figure.subplots(len(_KINDS), 1, sharex=True)
    place = np.arange(len(rows))
    for panel, (kind, label) in zip(panels, _KINDS.items(), strict=True):
        ours = [row[kind]["ours"] for row in rows]
        spread = [row[kind]["standard_error"] for row in rows]
        published = [row[kind]["published"] for row in rows]
        panel.bar(place - 0.2, published, 0.4, color="0.75", label="published")
        panel.bar(place + 0.2, ours, 0.4, yerr=spread, color=COLOURS[0], label="ours")
        panel.axhline(1.0, color="0.4", linewidth=0.8)
        panel.set_ylabel(f"error of {label} ÷ slices")
        panel.spines[["top", "right"]].set_visible(False)
    names = [row["material"].replace("_", "\n") for row in rows]
    panels[-1].set_xticks(place, names, fontsize="small")
    panels[0].legend(frameon=False)
    figure.suptitle(f"Table 5.2, materials {about}")
    return figure

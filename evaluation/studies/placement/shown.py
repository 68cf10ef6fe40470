"""Tables and plots of the placement study."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.patches import Patch

from simrig.core.tables import Column, record_table, text_table
from simrig.evaluation.studies.engine.base import Row
from simrig.plans.placement import TABLE_5_1
from simrig.viewing.plots import COLOURS, dot_style, finish_figure, finish_panel, new_figure

_PANELS = {
    "theta_step_deg": ("e_s", "a_s", "azimuth_step_deg"),
    "azimuth_step_deg": ("a_s", "e_s", "theta_step_deg"),
}


def table(summary: Mapping[str, Any]) -> Any:
    """Return the summary as tables for the terminal."""
    from rich.console import Group

    parts: list[Any] = []
    for about, found in summary["sets"].items():
        parts += [_optimal_table(about, found), _beside_table(about, found)]
        parts.append(_stability_table(about, found))
    cost = (
        "{reconstructions:,} reconstructions, {seconds_each:.3f} s each: sampling "
        "{sampling_seconds:.0f} s, reconstruction {reconstruction_seconds:.0f} s, "
        "errors {error_seconds:.0f} s; the least certain error has a standard error of "
        "{largest_relative_standard_error:.1%} of it"
    )
    return Group(*parts, cost.format_map(summary["cost"]))


def _optimal_table(about: str, found: Mapping[str, Any]) -> Any:
    columns: dict[str, Column] = {"n from": "{from:,}", "n ≤": "{up_to:,}", "e_s / a_s": _name}
    title = f"Table 5.1 from our own study, materials {about}"
    return record_table(title, columns, found["table_5_1"], left=())


def _beside_table(about: str, found: Mapping[str, Any]) -> Any:
    columns: dict[str, Column] = {
        "n ≤": lambda row: "∞" if row["up_to"] is None else f"{row['up_to']:,}",
        "published": _name,
        "ours, with its share of the range": lambda row: ", ".join(
            f"{_name(one)} ({one['share']:.0%})" for one in row["ours"]
        ),
        "published ÷ ours\n(Eq. 5.3)": lambda row: _ratio(row["loss"]),
    }
    title = f"Table 5.1 as published, and what our study finds there, {about}"
    return record_table(title, columns, found["published"], left=(2,))


def _stability_table(about: str, found: Mapping[str, Any]) -> Any:
    columns = ("material", "published", "ours", "ours with the\npublished Table 5.1")
    rows = []
    without = {row["material"]: row for row in found["leave_one_out"]}
    for row in found["table_5_4"]:
        cells = [_ratio(row[key]) for key in ("published", "ours", "table_5_1")]
        left = without.get(row["material"])
        stable = ("", "") if left is None else (f"{left['same']:.0%}", f"{left['loss']:.3f}×")
        rows.append((row["material"], *cells, *stable))
    means = [_ratio(_mean(found["table_5_4"], key)) for key in ("published", "ours", "table_5_1")]
    same, loss = (_mean(found["leave_one_out"], key) for key in ("same", "loss"))
    stable = ("", "") if same is None else (f"{same:.0%}", f"{loss:.3f}×")
    return text_table(
        f"Table 5.4 and leave-one-out (Fig. 5.13), {about}",
        (*columns, "without it:\nsame choice", "without it:\nEq. 5.3"),
        rows,
        below=[("mean", *means, *stable)],
    )


def _mean(rows: Sequence[Mapping[str, Any]], key: str) -> float | None:
    values = [row[key] for row in rows if row[key] is not None]
    return float(np.mean(values)) if values else None


def _ratio(value: float | None) -> str:
    return "–" if value is None else f"{value:.2f}×"


def _name(row: Mapping[str, Any]) -> str:
    return f"{row['theta_step_deg']:g}°/{row['azimuth_step_deg']:g}°"


def plots(summary: Mapping[str, Any], rows: Sequence[Row], folder: Path) -> list[Path]:
    """Draw Fig. 5.5, the placements of Fig. 5.13 and Table 5.4 for every set of materials."""
    files = []
    for about, found in summary["sets"].items():
        for name, draw in (
            ("figure 5.5", _error_plot),
            ("figure 5.13", _placement_plot),
            ("table 5.4", _increase_plot),
        ):
            path = (
                folder / f"{name.replace(' ', '_').replace('.', '_')}_{about.replace(' ', '_')}.png"
            )
            finish_figure(draw(found, f"{name}, materials {about}"), path)
            files.append(path)
    return files


def _error_plot(found: Mapping[str, Any], title: str) -> Any:
    """Draw the mean error over the number of samples (Fig. 5.5)."""
    keys = [key for key in _PANELS if any(c["panel"] == key for c in found["figure_5_5"])]
    figure = new_figure(5.2 * max(len(keys), 1), 4.6)
    panels = figure.subplots(1, max(len(keys), 1), sharey=True, squeeze=False)[0]
    for panel, key in zip(panels, keys, strict=False):  # one is left empty where no key is
        fixed, free, free_key = _PANELS[key]
        curves = [curve for curve in found["figure_5_5"] if curve["panel"] == key]
        for number, curve in enumerate(sorted(curves, key=lambda curve: curve[free_key])):
            panel.plot(
                curve["samples"],
                curve["mre_percent"],
                color=COLOURS[number % len(COLOURS)],
                linestyle="--" if number >= len(COLOURS) else "-",
                label=f"{free} = {curve[free_key]:g}°",
            )
        panel.grid(which="major", color="0.9")
        panel.spines[["top", "right"]].set_visible(False)
        title = f"{fixed} = {curves[0][key]:g}°"
        finish_panel(panel, xscale="log", yscale="log", title=title, xlabel="samples n")
    panels[0].set_ylabel("MRE, mean over the materials [%]")
    figure.suptitle(title)
    return figure


def _placement_plot(found: Mapping[str, Any], title: str) -> Any:
    """Draw which placement is best for how many samples (Fig. 5.13): one line per choice."""
    lines = [("published", _published_ranges(found["samples"])), ("ours", found["table_5_1"])]
    lines += [(f"without {one['material']}", one["table_5_1"]) for one in found["leave_one_out"]]
    names = sorted({_key(row) for _, ranges in lines for row in ranges})
    colour = dict(zip(names, _palette(len(names)), strict=True))
    figure = new_figure(10.0, max(0.34 * len(lines) + 1.6, 0.25 * len(names) + 1.2))
    panel = figure.subplots()
    for height, (_, ranges) in enumerate(lines):
        for row in ranges:
            panel.barh(
                height, row["up_to"] - row["from"], left=row["from"], color=colour[_key(row)]
            )
    panel.set_yticks(range(len(lines)), [name.replace("_", " ") for name, _ in lines])
    panel.invert_yaxis()
    finish_panel(panel, xscale="log", xlim=found["samples"], xlabel="samples n")
    handles = [Patch(color=colour[k], label=f"{-k[1]:g}/{-k[0]:g}") for k in names]
    figure.legend(handles=handles, loc="outside right center", frameon=False, title="e_s/a_s")
    figure.suptitle(title)
    return figure


def _published_ranges(samples: Sequence[int]) -> list[dict[str, float]]:
    """Return the rows of Table 5.1 that meet a range of n, cut to it."""
    ranges, least = [], 0.0
    for largest, e_s, a_s in TABLE_5_1:
        low, high = max(least, samples[0]), min(largest, samples[1])
        if low < high:
            steps = {"theta_step_deg": float(e_s), "azimuth_step_deg": float(a_s)}
            ranges.append({"from": low, "up_to": high, **steps})
        least = largest
    return ranges


def _key(row: Mapping[str, Any]) -> tuple[float, float]:
    """Return what orders placements from sparse to fine."""
    return -row["azimuth_step_deg"], -row["theta_step_deg"]


def _palette(count: int) -> np.ndarray:
    import matplotlib

    return matplotlib.colormaps["turbo"](np.linspace(0.04, 0.96, max(count, 2)))[:count]


def _increase_plot(found: Mapping[str, Any], title: str) -> Any:
    """Draw the increase of the error with one placement for all materials (Table 5.4)."""
    rows = found["table_5_4"]
    figure = new_figure(8.0, 4.0)
    panel = figure.subplots()
    place = np.arange(len(rows))
    series = {"published": "published", "ours": "ours", "table_5_1": "ours, published Table 5.1"}
    for number, (key, label) in enumerate(series.items()):
        values = [np.nan if row[key] is None else row[key] for row in rows]
        panel.plot(place, values, label=label, **dot_style(number))
    names = [row["material"].replace("_", " ") for row in rows]
    panel.set_xticks(place, names, rotation=35, ha="right")
    panel.grid(axis="y", color="0.9")
    finish_panel(panel, ylabel="MRE ÷ smallest possible MRE")
    figure.suptitle(title)
    return figure

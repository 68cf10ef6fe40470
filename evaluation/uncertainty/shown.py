"""Tables and plots of an uncertainty budget."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from operator import itemgetter
from pathlib import Path
from typing import Any

from simrig.core.tables import text_table
from simrig.evaluation.uncertainty.budget import K, Table
from simrig.evaluation.uncertainty.result import PUBLISHED, Budget
from simrig.viewing.plots import (
    COLOURS,
    dot_style,
    finish_figure,
    finish_panel,
    line_style,
    new_figure,
)

_ROUNDING = 1e-11
_AXES = {
    "hours": ("hours", "measurement repeated: hours"),
    "exposures": ("exposures", "exposures of every value"),
    "price": ("price_eur", "price in addition [EUR]"),
}


def tables(budget: Budget) -> list[Any]:
    """Return the budget for the terminal: tables, then lines."""
    unit = budget.values.unit
    standard = "against a standard" if budget.settings["against_standard"] else "absolute"
    parts = [
        _table(
            f"f_r of {budget.material} by {budget.instrument}, {standard}: expanded uncertainty "
            f"(k = 2) [{unit}], median at each polar angle of light and view",
            budget.values,
            budget.thetas_deg,
        )
    ]
    if budget.albedos is not None:
        title = f"albedo, seen from each polar angle: expanded uncertainty (k = 2) [{unit}]"
        parts.append(_table(title, budget.albedos, budget.thetas_deg))
    parts.append(_costs(budget.curves, unit))
    return [*parts, *lines(budget)]


def lines(budget: Budget) -> list[str]:
    """Return what is to be said in words, one line each."""
    said = []
    if budget.dominant:
        said.append(f"dominant: {budget.dominant['line']}")
    else:
        said.append("no source is uncertain: the file states none, or all of them as 0")
    for name, keys in budget.unstated.items():
        said.append(f"not stated, so not counted: {name} (u of {', '.join(keys)})")
    if budget.saturated:
        said.append(
            f"{budget.saturated} of {len(budget.values.angles)} values saturate the shortest "
            "exposure: they cannot be measured"
        )
    renderer = budget.renderer
    shown = {key: value for key, value in renderer.items() if value is not None and key != "spp"}
    said += [
        "not in the budget, of the simulation itself: "
        + ", ".join(f"{key.removesuffix('_percent')} {v:.2g} %" for key, v in shown.items())
        + f" ({renderer['spp']} samples per pixel)"
    ] * bool(shown)
    published = "; ".join(f"{name} {value:g} %" for name, value in PUBLISHED.items())
    return [*said, f"published expanded uncertainties of f_r: {published}"]


def _table(title: str, table: Table, thetas_deg: Sequence[float]) -> Any:
    groups = range(len(thetas_deg))

    def row(name: str, rms: Any, worst: bool = False) -> list[str]:
        how = table.worst if worst else table.typical
        return [name, *(_number(how(rms, which)) for which in groups)]

    rows = [row(name, spread.rms) for name, spread in table.alone.items()]
    below = [row("all together", table.total.rms), row("largest of them", table.total.rms, True)]
    columns = ["source", *(f"{theta:g}°" for theta in thetas_deg)]
    return text_table(title, columns, rows, below=below)


def _number(uncertainty: float | None) -> str:
    if uncertainty is None:
        return "–"
    return f"{K * uncertainty:.3g}" if uncertainty > _ROUNDING else "0"


def _costs(curves: Sequence[Mapping[str, Any]], unit: str) -> Any:
    rows = (
        (
            _AXES[row["over"]][1],
            row["what"],
            "–" if row["hours"] is None else f"{row['hours']:.3g}",
            f"{row['price_eur']:,.0f}",
            f"{row['U']:.4g}",
            "*" if row["front"] else "",
        )
        for row in curves
        if row["front"] or " + " not in row["what"]
    )
    title = "what accuracy costs; * nothing else of its kind is both cheaper and better"
    columns = ("over", "what", "hours", "EUR", f"U [{unit}]", "")
    return text_table(title, columns, rows, left=(0, 1, -1))


def draw(budget: Budget, path: Path) -> Path:
    """Draw the sources by polar angle, and the uncertainty over each cost."""
    figure = new_figure(12.8, 7.6)
    grid = figure.add_gridspec(2, 1, height_ratios=(1.25, 1.0))
    above, below = figure.add_subfigure(grid[0]), figure.add_subfigure(grid[1])
    panel, table = above.subplots(), budget.values
    marks = range(len(budget.thetas_deg))
    ranked = sorted(table.alone, key=table.share, reverse=True)
    for number, name in enumerate(ranked):
        own = [table.typical(table.alone[name].rms, which) for which in marks]
        heights = [K * value if value else float("nan") for value in own]
        if any(value > _ROUNDING for value in heights):
            dash = "-" if number < len(COLOURS) else "--"  # colours come back after seven
            panel.plot(marks, heights, label=name, linestyle=dash, **line_style(number))
    total = [K * (table.typical(table.total.rms, which) or float("nan")) for which in marks]
    panel.plot(marks, total, color="black", linewidth=2.5, label="all together")
    panel.set_xticks(list(marks), [f"{theta:g}°" for theta in budget.thetas_deg])
    panel.grid(which="major", color="0.9", linewidth=0.8)
    label = f"U of f_r [{table.unit}]"
    legend = {"loc": "outside right upper", "fontsize": 8}
    most = max((value for value in total if value > 0.0), default=None)
    if most is not None:
        panel.set(yscale="log", ylim=(most * 1e-4, most * 2.0))
    finish_panel(panel, legend, xlabel="polar angle of light and view", ylabel=label)
    panels = below.subplots(1, 3, sharey=True)
    for number, (over, (key, title)) in enumerate(_AXES.items()):
        own_rows = [row for row in budget.curves if row["over"] == over and row[key] is not None]
        panel = panels[number]
        front = sorted((row for row in own_rows if row["front"]), key=itemgetter(key))
        panel.step(
            [row[key] for row in front], [row["U"] for row in front], where="post", color="0.8",
            linewidth=5, zorder=1,
        )  # fmt: skip
        panel.plot([r[key] for r in own_rows], [r["U"] for r in own_rows], **dot_style(number))
        panel.grid(which="major", color="0.9", linewidth=0.8)
        finish_panel(panel, xlabel=title, xscale="linear" if over == "price" else "log")
    panels[0].set_ylabel(label)
    figure.suptitle(f"{budget.material}, {budget.instrument}")
    finish_figure(figure, path)
    return path

"""Plots: accuracy against cost, with the Pareto front, and what all figures share.

Figures are made without pyplot: nothing global is read or changed, and no display is needed.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from numpy.typing import ArrayLike

from simrig.core.cost import Cost
from simrig.core.errors import SimrigError
from simrig.files.atomic import atomic_write

# Okabe and Ito 2008: told apart by colour-blind readers too; markers differ as well
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
MARKERS = ("o", "s", "^", "D", "v", "P", "X")
DPI = 150


@dataclass(frozen=True)
class CostPoint:
    """One result: what method it is of, what it cost, and its error.

    Attributes:
        method: name in the legend; points of one method are joined by a line.
        error: its error, in the unit of the plot's error axis; lower is better.
    """

    method: str
    cost: Cost
    error: float


@dataclass(frozen=True)
class CostAxis:
    """One way to count a cost."""

    label: str
    of: Callable[[Cost], float]


COST_AXES: tuple[CostAxis, ...] = (
    CostAxis("samples taken", lambda cost: float(cost.samples)),
    CostAxis("simulated hardware time [h]", lambda cost: cost.hardware_hours),
    CostAxis("computing time [s]", lambda cost: cost.compute_seconds),
)


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure of a size in inches, drawn by Agg."""
    figure = Figure(figsize=(width, height), dpi=DPI, layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def finish_figure(figure: Figure, path: str | Path | None = None) -> bytes:
    """Return a figure as PNG bytes, and write them to ``path`` if one is given.

    Raises:
        SimrigError: when the file cannot be written.
    """
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", metadata={"Software": "simrig"})
    if path is not None:
        with atomic_write(path) as temporary:
            temporary.write_bytes(buffer.getvalue())
    return buffer.getvalue()


@contextmanager
def drawn_panel(
    path: str | Path,
    width: float,
    height: float,
    *,
    legend: Mapping[str, Any] | None = None,
    **axes: Any,
) -> Iterator[Axes]:
    """Give one panel to draw into, and write the figure when the block ends.

    Args:
        path: of the PNG.
        width, height: in inches.
        legend: settings of the legend, which is there where something has a label; with a ``loc``
            outside the panel it belongs to the figure.
        axes: properties of the panel, set at the end; logarithmic axes get plain numbers.

    Raises:
        SimrigError: when the file cannot be written.
    """
    figure = new_figure(width, height)
    panel = figure.subplots()
    yield panel
    finish_panel(panel, legend, **axes)
    finish_figure(figure, path)


def finish_panel(panel: Axes, legend: Mapping[str, Any] | None = None, **axes: Any) -> None:
    """Set the properties and the legend of a panel; see ``drawn_panel``."""
    panel.set(**axes)
    for scale in (panel.xaxis, panel.yaxis):
        if scale.get_scale() == "log":
            plain_ticks(scale)
    if panel.get_legend_handles_labels()[0]:
        settings = {"frameon": False, **(legend or {})}
        outside = str(settings.get("loc", "")).startswith("outside")
        (panel.get_figure() if outside else panel).legend(**settings)  # type: ignore[union-attr]


def dot_style(number: int) -> dict[str, Any]:
    """Return what draws dots among several kinds, hollow and not joined."""
    return {**line_style(number), "linestyle": "", "markerfacecolor": "white"}


def line_style(number: int) -> dict[str, Any]:
    """Return colour and marker of a line among several; after seven they come back."""
    return {"color": COLOURS[number % len(COLOURS)], "marker": MARKERS[number % len(MARKERS)]}


def pareto_front(costs: ArrayLike, errors: ArrayLike) -> np.ndarray:
    """Return the indices of the results that no other beats, in order of rising cost.

    A result is beaten when another costs no more and errs no more, and is better in one of the
    two. Of equal results the first is kept. Results with NaN are never on the front.

    Raises:
        SimrigError: for lists of different lengths.
    """
    cost, error = np.asarray(costs, dtype=np.float64), np.asarray(errors, dtype=np.float64)
    if cost.shape != error.shape or cost.ndim != 1:
        raise SimrigError(f"{cost.size} costs do not fit {error.size} errors")
    front: list[int] = []
    best = np.inf
    for index in np.lexsort((error, cost)):  # by cost, then by error
        if error[index] < best and not np.isnan(cost[index]):
            front.append(int(index))
            best = error[index]
    return np.array(front, dtype=np.int64)


def accuracy_versus_cost(
    points: Sequence[CostPoint],
    error_label: str,
    *,
    axes: Sequence[CostAxis] = COST_AXES,
    title: str = "",
    path: str | Path | None = None,
) -> bytes:
    """Plot error over each kind of cost, one panel each, with the Pareto front marked.

    A panel is left out when no result has that cost. Both scales are logarithmic; an error of
    zero cannot be shown there and is left out.

    Args:
        error_label: name and unit of the error, for example ``"MRE [%]"``.
        path: where to write the PNG as well.

    Returns:
        PNG bytes.

    Raises:
        SimrigError: when no point can be shown.
    """
    shown = [axis for axis in axes if any(_visible(point, axis) for point in points)]
    if not shown:
        raise SimrigError("there is nothing to plot: no result has an error and a cost above 0")
    figure = new_figure(4.4 * len(shown), 4.3)
    methods = list(dict.fromkeys(point.method for point in points))
    panels = figure.subplots(1, len(shown), sharey=True, squeeze=False)[0]
    for panel, axis in zip(panels, shown, strict=True):
        _panel(panel, [p for p in points if _visible(p, axis)], axis, methods)
    panels[0].set_ylabel(f"{error_label}  (lower is better)")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, frameon=False)
    if title:
        figure.suptitle(title)
    return finish_figure(figure, path)


def _visible(point: CostPoint, axis: CostAxis) -> bool:
    """Return whether a point has a place on logarithmic axes."""
    x, y = axis.of(point.cost), point.error
    return bool(np.isfinite([x, y]).all() and x > 0.0 and y > 0.0)


def _panel(
    panel: Axes, points: Sequence[CostPoint], axis: CostAxis, methods: Sequence[str]
) -> None:
    """Draw the points of one kind of cost, joined per method, over their Pareto front."""
    x = np.array([axis.of(point.cost) for point in points])
    y = np.array([point.error for point in points])
    front = pareto_front(x, y)
    panel.set_xscale("log")
    panel.set_yscale("log")
    panel.margins(0.06)
    label = "Pareto front (filled: nothing is both cheaper and better)"
    panel.step(x[front], y[front], where="post", color="0.8", linewidth=5, zorder=1, label=label)
    for number, method in enumerate(methods):
        own = np.array([k for k, point in enumerate(points) if point.method == method], dtype=int)
        own = own[np.argsort(x[own], kind="stable")]
        style: dict[str, Any] = {
            "color": COLOURS[number % len(COLOURS)],
            # beyond seven the colours come back with other markers
            "marker": MARKERS[(number + number // len(COLOURS)) % len(MARKERS)],
            "markeredgewidth": 1.3,
        }
        panel.plot(x[own], y[own], markerfacecolor="white", label=method, zorder=2, **style)
        best = own[np.isin(own, front)]
        panel.plot(x[best], y[best], linestyle="", zorder=3, **style)
    panel.set_xlabel(axis.label)
    panel.grid(which="major", color="0.88", linewidth=0.8)
    panel.set_axisbelow(True)
    panel.spines[["top", "right"]].set_visible(False)
    for scale in (panel.xaxis, panel.yaxis):
        plain_ticks(scale)


def plain_ticks(scale: Axis) -> None:
    """Label a logarithmic axis with plain numbers, as many as fit."""
    low, high = sorted(scale.get_view_interval())
    decades = np.log10(high / low)
    subs = (1.0, 2.0, 5.0) if decades < 1.6 else (1.0, 3.0) if decades < 3.2 else (1.0,)
    scale.set_major_locator(LogLocator(subs=subs))
    scale.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,.10g}"))
    scale.set_minor_formatter(NullFormatter())

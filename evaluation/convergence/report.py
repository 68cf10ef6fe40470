"""What ``converge`` found, to read: tables for the terminal, CSV, and a plot."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from simrig.core.tables import record_table
from simrig.evaluation.convergence.results import Convergence, Point
from simrig.files.atomic import atomic_write
from simrig.viewing.plots import finish_figure, line_style, new_figure, pareto_front, plain_ticks

_NO_RATES = "too few numbers of samples to fit how fast the noise falls: raise --budget-seconds"
_METHOD = {"integrator": "{integrator}", "sampler": "{sampler}"}
_LABELS = {"dE": "mean ΔE", "psnr": "displayed RMS [steps of 255]", "relative": "relative error"}


def convergence_tables(result: Convergence, every: bool = False) -> list[Any]:
    """Return tables of the settings and the rates, and what follows from them.

    Args:
        every: all settings, not only those that nothing beats in both error and time.
    """
    points = list(result.points) if every else _front(result.points)
    reference = result.reference
    title = (
        f"reference: path tracing of all orders, {reference.spp:,} samples per pixel; "
        f"its standard error is ΔE {reference.delta_e:.2g}, relative {reference.relative_rmse:.2g}"
    )
    rates = [_rates_table(result)] if result.rates else [_NO_RATES]
    settings = [_settings_table(points, every)] if points else []
    return [title, *settings, *rates, _verdict(result)]


def _front(points: Sequence[Point]) -> list[Point]:
    front = pareto_front([p.run_seconds for p in points], [p.error for p in points])
    return [points[index] for index in front]


def _settings_table(points: Sequence[Point], every: bool) -> Any:
    title = "all settings" if every else "settings that none beats in both error and time"
    columns = _METHOD | {
        "spp": "{spp}",
        "ΔE": "{delta_e:.3g}",
        "relative RMSE": "{relative_rmse:.3g}",
        "of that noise": "{noise:.3g}",
        "bias": "{bias:.3g}",
        "PSNR [dB]": "{psnr:.1f}",
        "compile [s]": "{compile_seconds:.2f}",
        "run [s]": "{run_seconds:.4f}",
    }
    return record_table(title, columns, map(asdict, points), left=(0, 1))


def _rates_table(result: Convergence) -> Any:
    columns = {
        "slope": "{slope:.3f}",
        "standard error": "{standard_error:.3f}",
        "points": "{points}",
    }
    title = "noise ∝ spp^slope (−0.5: Monte Carlo)"
    return record_table(title, _METHOD | columns, map(asdict, result.rates), left=(0, 1))


def _verdict(result: Convergence) -> str:
    """Return one line: the cheapest setting, or why none can be named."""
    left_out = f"; {result.left_out} settings had no time left" if result.left_out else ""
    if not result.reference.suffices:
        return (
            f"The reference is known to {result.reference.error:.2g} only, too little to tell what "
            f"meets {result.tolerance}: raise --budget-seconds{left_out}"
        )
    cheapest = result.cheapest
    if cheapest is None:
        return f"No setting meets {result.tolerance}{left_out}"
    return (
        f"Cheapest that meets {result.tolerance}: {cheapest.integrator}, {cheapest.sampler}, "
        f"{cheapest.spp} samples per pixel: {cheapest.run_seconds:.4f} s{left_out}"
    )


def convergence_csv(result: Convergence, path: str | Path | None = None) -> str:
    """Return all settings as CSV with a header line, and write it to ``path`` if one is given."""
    text = io.StringIO()
    writer = csv.DictWriter(text, [field.name for field in fields(Point)], lineterminator="\n")
    writer.writeheader()
    writer.writerows(asdict(point) for point in result.points)
    if path is not None:
        with atomic_write(path) as temporary:
            temporary.write_text(text.getvalue(), encoding="utf-8")
    return text.getvalue()


def convergence_plot(result: Convergence, path: str | Path | None = None) -> bytes:
    """Plot error over run time: integrators with one sampler, and samplers with one integrator.

    The sampler of the left panel is the first one, the integrator of the right panel that of the
    cheapest setting, or of the least error when nothing meets the tolerance. Lines for the
    tolerance and the reference's standard error.

    Args:
        result: of ``converge``, with at least one setting.
        path: where to write the PNG as well.

    Returns:
        PNG bytes.
    """
    best = result.cheapest or min(result.points, key=lambda point: point.error)
    sampler = result.points[0].sampler
    figure = new_figure(9.2, 4.4)
    left, right = figure.subplots(1, 2, sharey=True)
    _panel(left, result, [p for p in result.points if p.sampler == sampler], "integrator")
    _panel(right, result, [p for p in result.points if p.integrator == best.integrator], "sampler")
    left.set_title(f"integrators ({sampler})")
    right.set_title(f"samplers ({best.integrator})")
    for panel in (left, right):
        plain_ticks(panel.xaxis)
    left.set_ylabel(f"{_LABELS[result.tolerance.metric]}  (lower is better)")
    return finish_figure(figure, path)


def _panel(panel: Axes, result: Convergence, points: Sequence[Point], key: str) -> None:
    """Draw error over run time, one line per name."""
    panel.set_xscale("log")
    panel.set_yscale("log")
    for number, name in enumerate(dict.fromkeys(getattr(p, key) for p in points)):
        own = [p for p in points if getattr(p, key) == name and p.error > 0.0]
        seconds, errors = np.array([[p.run_seconds, p.error] for p in own]).reshape(-1, 2).T
        style = line_style(number)
        panel.plot(seconds, errors, markerfacecolor="white", label=name, **style)
    amount, known = result.tolerance.amount, result.reference.error
    panel.axhline(amount, color="0.3", linewidth=1, label=f"tolerance ({result.tolerance})")
    if known > 0.0:
        label = "standard error of the reference"
        panel.axhline(known, color="0.6", linewidth=1, linestyle="--", label=label)
    panel.set_xlabel("run time [s]")
    panel.grid(which="major", color="0.88", linewidth=0.8)
    panel.set_axisbelow(True)
    panel.spines[["top", "right"]].set_visible(False)
    panel.legend(fontsize="small", loc="lower left", edgecolor="none", framealpha=0.9)

"""Figures of an analysis, after thesis Figs. 3.11 to 3.14, 3.16 and B.5."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from simrig.perception.psychometric import Psychometric

_HEADLINE = "censored_nearness"


def write_results(results: dict[str, Any], folder: Path) -> None:
    """Write ``results.json`` and a picture of everything that there is to be drawn."""
    from matplotlib.figure import Figure

    text = json.dumps(results, indent=2, default=float)
    (folder / "results.json").write_text(text + "\n", encoding="utf-8")
    for name, draw in _FIGURES.items():
        figure = Figure(figsize=(10, 5), layout="constrained")
        if draw(figure.subplots(), results):
            figure.savefig(folder / f"{name}.png", dpi=110)


def _stimuli(axes: Any, results: dict[str, Any]) -> bool:
    """Draw mean distances of stimuli, those of other experiments beside them (Fig. 3.11)."""
    rows = {n: r for n, r in results.get("stimuli", {}).items() if r["mean_m"] is not None}
    names = sorted(rows, key=lambda n: (rows[n]["group"], n))
    all_of_them = {results.get("title", ""): rows, **results.get("beside", {})}
    width = 0.8 / len(all_of_them)
    for number, (title, own) in enumerate(all_of_them.items()):
        known = [n for n in names if n in own and own[n]["mean_m"] is not None]
        places = np.array([names.index(n) for n in known]) + width * number
        spread = [own[n]["sd_m"] or 0.0 for n in known]
        means = [own[n]["mean_m"] for n in known]
        axes.bar(places, means, width, yerr=spread, capsize=2, label=title)
    axes.set_xticks(np.arange(len(names)) + 0.5 * (0.8 - width), names, rotation=90, fontsize=7)
    axes.set_ylabel("critical viewing distance / m (mean, deviation)")
    if len(all_of_them) > 1:
        axes.legend(fontsize=8)
    return bool(names)


def _groups(axes: Any, results: dict[str, Any]) -> bool:
    rows = {n: r for n, r in results.get("groups", {}).items() if r["mean_m"] is not None}
    spread = [r["sd_m"] or 0.0 for r in rows.values()]
    axes.bar(list(rows), [r["mean_m"] for r in rows.values()], yerr=spread, capsize=3)
    axes.set_ylabel("critical viewing distance / m (mean, deviation)")
    return bool(rows)


def _functions(axes: Any, results: dict[str, Any]) -> bool:
    fits = {n: r["fits"][_HEADLINE] for n, r in results.get("groups", {}).items() if r["fits"]}
    if not fits:
        return False
    distances = np.linspace(0.05, 1.5 * max(results["distances_m"]), 400)
    for name, fit in fits.items():
        function = Psychometric("nearness", fit["scale_m"], fit["slope"], fit["lapses"])
        axes.plot(distances, function.seen(distances), label=name)
    for level in (0.25, 0.5):
        axes.axhline(level, color="0.7", linewidth=0.8)
    axes.axvline(max(results["distances_m"]), color="0.7", linestyle=":")
    axes.set(xlabel="distance / m", ylabel="share that sees a difference")
    axes.legend(fontsize=8)
    return True


def _thresholds(axes: Any, results: dict[str, Any]) -> bool:
    fits = {n: r["fits"][_HEADLINE] for n, r in results.get("groups", {}).items() if r["fits"]}
    places = np.arange(len(fits))
    for shift, level in ((-0.2, "25"), (0.2, "50")):
        middle = np.array([fit[f"d{level}_m"] for fit in fits.values()])
        axes.bar(places + shift, middle, 0.38, label=f"{level} %")
        ends = [
            fit.get(f"d{level}_interval_m", (m, m))
            for fit, m in zip(fits.values(), middle, strict=True)
        ]
        for x, (low, high) in zip(places + shift, ends, strict=True):
            axes.plot([x, x], [low, high], color="black")
    axes.set_xticks(places, list(fits), fontsize=8)
    axes.set_ylabel("threshold / m (95 % interval over subjects)")
    axes.legend()
    return bool(fits)


def _predictions(axes: Any, results: dict[str, Any]) -> bool:
    features = results.get("predictors", {}).get("features", {})
    fitted = {n: f for n, f in features.items() if "left_out_m" in f}
    if not fitted:
        return False
    best = min(fitted, key=lambda n: fitted[n]["left_out_error_m"])
    predicted = fitted[best]["left_out_m"]
    names = sorted(predicted, key=lambda n: results["stimuli"][n]["mean_m"])
    seen = np.array([results["stimuli"][n]["mean_m"] for n in names])
    said = np.array([predicted[n] for n in names])
    axes.bar(names, said, color="0.7", label=f"predicted by S · {best}, left out")
    less = said < seen
    places = np.arange(len(names))
    axes.bar(
        places[less], (seen - said)[less], bottom=said[less], color="tab:red", label="too short"
    )
    axes.bar(
        places[~less], (said - seen)[~less], bottom=seen[~less], color="tab:green", label="too long"
    )
    axes.tick_params(axis="x", rotation=90, labelsize=7)
    axes.set_ylabel("critical viewing distance / m")
    axes.legend(fontsize=8)
    return True


def _rotations(axes: Any, results: dict[str, Any]) -> bool:
    rows = results.get("rotations", {})
    angles = sorted({float(angle) for row in rows.values() for angle in row})
    for number, angle in enumerate(angles):
        places = np.arange(len(rows)) + 0.25 * (number - 0.5 * (len(angles) - 1))
        heights = [row.get(f"{angle:g}") or np.nan for row in rows.values()]
        axes.bar(places, heights, 0.23, label=f"{angle:g}°")
    axes.set_xticks(np.arange(len(rows)), list(rows))
    axes.set_ylabel("critical viewing distance / m")
    if rows:
        axes.legend()
    return bool(rows)


def _chosen(axes: Any, results: dict[str, Any]) -> bool:
    rows = results.get("choices", {})
    share = np.array([row["share"] for row in rows.values()])
    ends = np.array([row["interval"] for row in rows.values()]).reshape(-1, 2)
    axes.bar(list(rows), share, yerr=np.abs(ends.T - share), capsize=3)
    axes.axhline(0.5, color="0.7")
    axes.tick_params(axis="x", rotation=90, labelsize=7)
    axes.set_ylabel("share that chose the first (95 %)")
    return bool(rows)


_FIGURES: dict[str, Callable[[Any, dict[str, Any]], bool]] = {
    "stimuli": _stimuli,
    "groups": _groups,
    "functions": _functions,
    "thresholds": _thresholds,
    "predictions": _predictions,
    "rotations": _rotations,
    "choices": _chosen,
}

"""What the study of BTFs from slices shows: errors, costs, and pictures with the failures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from simrig.core.tables import text_table
from simrig.evaluation.studies.engine.base import Config, Row
from simrig.evaluation.studies.engine.pictures import PICTURE, draw_sheet
from simrig.viewing.plots import COLOURS, MARKERS, finish_figure, new_figure

ALL = "all"  # the method that measures every image
ERRORS = {"delta_e": "ΔE", "psnr": "PSNR [dB]", "ssim": "SSIM"}
FAILED = ("corduroy", "Lego")  # thesis Figure 6.18
CLOSE = ("fabric dark", "fabric light", "leather light")  # thesis section 6.3.5
_WORST = 3  # materials named, and shown with their differences
_COSTS = ("images", "hardware_seconds", "measured_bytes", "bytes")


def summarise(config: Config, rows: Sequence[Row]) -> dict[str, Any]:
    """Return the errors by material, flattest first, what each method costs, and the exact BD."""
    from scipy.stats import spearmanr

    found = sorted(
        (dict(row) for row in rows if row["kind"] == "errors"),
        key=lambda row: (row["depth_over_element"], row["method"]),
    )
    errors = [row for row in found if row["method"] != ALL]
    costs, trends = {}, {}
    images = tuple(f"images_{name}" for name in ERRORS)
    for method in (ALL, *config["methods"]):
        own = [row for row in found if row["method"] == method]
        names = (*_COSTS, *images, *(() if method == ALL else (*ERRORS, "reconstruction_seconds")))
        costs[method] = {name: float(np.mean([row[name] for row in own])) for name in names}
        if method == ALL:
            continue
        depth = [row["depth_over_element"] for row in own]
        enough = len(own) > 2  # of two materials every order is perfect
        trends[method] = (
            float(spearmanr(depth, [row["psnr"] for row in own]).statistic) if enough else None
        )
    psnr = {
        name: float(np.mean([row["psnr"] for row in errors if row["material"] == name]))
        for name in config["materials"]
    }
    return {
        "rows": errors,
        "costs": costs,
        "exact": [dict(row) for row in rows if row["kind"] == "exact"],
        "psnr_by_depth_rank_correlation": trends,
        "worst_first": sorted(psnr, key=lambda name: psnr[name]),
        "published": {"close": list(CLOSE), "failed": list(FAILED), "numbers": None},
    }


def table(summary: Mapping[str, Any]) -> Any:
    """Return the summary as tables for the terminal."""
    from rich.console import Group

    worst = ", ".join(summary["worst_first"][:_WORST])
    published = summary["published"]
    lines = [
        f"worst here: {worst}; best: {summary['worst_first'][-1]}",
        f"published: close {', '.join(published['close'])}; failed {', '.join(published['failed'])}"
        " (numbers inside the figures only)",
        "single images of 'all images': the same images measured again with other samples",
    ]
    for method, trend in summary["psnr_by_depth_rank_correlation"].items():
        if trend is not None:
            lines.append(f"{method}: PSNR goes with depth by rank {trend:+.2f}")
    parts = [_error_table(summary), _cost_table(summary)]
    if summary["exact"]:
        parts.append(_exact_table(summary["exact"]))
    return Group(*parts, *lines)


def _error_table(summary: Mapping[str, Any]) -> Any:
    rows = []
    for row in summary["rows"]:
        depth = f"{row['depth_over_element']:.2f}"
        rows.append([row["material"], depth, row["method"], *_both(row)])
    columns = ["material", "depth ÷ element", "method", "rendered", "single images"]
    return text_table("BTFs from 168 images: " + " / ".join(ERRORS.values()), columns, rows)


def _cost_table(summary: Mapping[str, Any]) -> Any:
    rows = []
    for method, row in summary["costs"].items():
        measured, bytes_ = (f"{row[k] / 2**20:.1f}" for k in ("measured_bytes", "bytes"))
        cost = [f"{row['images']:.0f}", _duration(row["hardware_seconds"]), measured, bytes_]
        if method == ALL:
            rows.append(["all images", *cost, "–", "–", _three(row, "images_")])
        else:
            seconds = f"{row['reconstruction_seconds']:.1f}"
            rows.append([method, *cost, seconds, *_both(row)])
    columns = ["", "images", "hardware", "measured [MiB]", "renders [MiB]", "processor [s]"]
    title = "What each costs, means over the materials: " + " / ".join(ERRORS.values())
    return text_table(title, [*columns, "rendered", "single images"], rows)


def _exact_table(exact: Sequence[Mapping[str, Any]]) -> Any:
    rows = []
    for row in exact:
        solver, batch = row["solver_seconds"], row["batch_seconds"]
        shares = [
            f"{100.0 * row[f'{name}_off_{which}']:.2f}"
            for name in ("bd", "b")
            for which in ("mean", "largest")
        ]
        times = [f"{1e3 * solver:.0f}", f"{1e3 * batch:.1f}", f"{solver / batch:.0f}×"]
        rows.append([row["material"], *shares, *times])
    columns = ["material", "off, mean [%]", "largest [% of peak]", "B off, mean", "B largest"]
    columns += ["solver [ms]", "at once [ms]", "faster"]
    return text_table("Method BD at once beside one solver per line, per texel", columns, rows)


def _both(row: Mapping[str, Any]) -> list[str]:
    return [_three(row, ""), _three(row, "images_")]


def _three(row: Mapping[str, Any], prefix: str) -> str:
    delta_e, psnr, ssim = (row[prefix + name] for name in ERRORS)
    return f"{delta_e:.1f} / {psnr:.1f} / {ssim:.2f}"


def _duration(seconds: float) -> str:
    return f"{seconds / 60.0:.0f} min" if seconds < 3600.0 else f"{seconds / 3600.0:.1f} h"


def plots(summary: Mapping[str, Any], rows: Sequence[Row], folder: Path) -> list[Path]:
    """Draw PSNR over depth, and renderings and texels side by side."""
    _draw_depth(summary, folder / "depth.png")
    pictures = {(r["material"], r["picture"]): r for r in rows if r["kind"] == PICTURE}
    of = {(row["material"], row["method"]): row for row in summary["rows"]}
    methods = [method for method in summary["costs"] if method != ALL]

    def line(name: str, part: str, errors: str | None) -> list[tuple[str, Row]]:
        found = [] if part == ", difference" else [(f"{name}, all", pictures[name, ALL + part])]
        for method in methods:
            numbers = "" if errors is None else f": {_three(of[name, method], errors)}"
            found.append((f"{method}{numbers}", pictures[name, method + part]))
        return found

    materials = list(dict.fromkeys(row["material"] for row in summary["rows"]))
    worst, best = summary["worst_first"][:_WORST], summary["worst_first"][-1]
    extremes = list(dict.fromkeys([best, worst[0]]))
    sheets = {
        "best_and_worst": [line(n, "", "") + line(n, ", texels", None) for n in extremes],
        "renderings": [line(name, "", "") for name in materials],
        "texels": [line(name, ", texels", None) for name in materials],
        "differences": [line(name, ", difference", "") for name in worst],
    }
    titles = {
        "best_and_worst": "best and worst: renderings (ΔE / PSNR / SSIM), and one image",
        "renderings": "renderings, ΔE / PSNR / SSIM",
        "texels": "one image between the measured polar angles, 2 × 2 tiles",
        "differences": "worst: 255 − 10 × difference",
    }
    files = [
        draw_sheet(folder / f"{name}.png", lines, side=1.4, title=titles[name])
        for name, lines in sheets.items()
    ]
    return [folder / "depth.png", *files]


def _draw_depth(summary: Mapping[str, Any], path: Path) -> None:
    figure = new_figure(5.6, 4.0)
    panel = figure.subplots()
    trends = summary["psnr_by_depth_rank_correlation"]
    for number, method in enumerate(trends):
        own = [row for row in summary["rows"] if row["method"] == method]
        depth, psnr = ([row[name] for row in own] for name in ("depth_over_element", "psnr"))
        panel.plot(depth, psnr, MARKERS[number], color=COLOURS[number], label=method)
        if number == 0:
            for row in own:
                place = (row["depth_over_element"], row["psnr"])
                panel.annotate(row["material"], place, fontsize=6, rotation=20)
    panel.margins(x=0.18)  # for the names
    panel.set_xlabel("depth of the structure ÷ size of its largest element")
    panel.set_ylabel("PSNR of the rendering [dB]  (higher is better)")
    panel.legend(frameon=False)
    finish_figure(figure, path)

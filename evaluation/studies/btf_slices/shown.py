"""What the study of BTFs from slices shows: errors, costs, and pictures with the failures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from simrig.core.tables import Column, record_table, text_table
from simrig.evaluation.studies.engine.base import Config, Row
from simrig.evaluation.studies.engine.pictures import PICTURE, draw_sheet
from simrig.evaluation.studies.engine.rows import distinct, means, where
from simrig.viewing.plots import COLOURS, MARKERS, drawn_panel

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
        map(dict, where(rows, kind="errors")),
        key=lambda row: (row["depth_over_element"], row["method"]),
    )
    errors = [row for row in found if row["method"] != ALL]
    costs, trends = {}, {}
    images = tuple(f"images_{name}" for name in ERRORS)
    for method in (ALL, *config["methods"]):
        own = where(found, method=method)
        names = (*_COSTS, *images, *(() if method == ALL else (*ERRORS, "reconstruction_seconds")))
        costs[method] = means(own, names)
        if method == ALL:
            continue
        depth = [row["depth_over_element"] for row in own]
        enough = len(own) > 2  # of two materials every order is perfect
        trends[method] = (
            float(spearmanr(depth, [row["psnr"] for row in own]).statistic) if enough else None
        )
    psnr = {
        name: means(where(errors, material=name), ["psnr"])["psnr"] for name in config["materials"]
    }
    return {
        "rows": errors,
        "costs": costs,
        "exact": list(map(dict, where(rows, kind="exact"))),
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
    columns: dict[str, Column] = {
        "material": "{material}",
        "depth ÷ element": "{depth_over_element:.2f}",
        "method": "{method}",
        "rendered": _three,
        "single images": lambda row: _three(row, "images_"),
    }
    title = "BTFs from 168 images: " + " / ".join(ERRORS.values())
    return record_table(title, columns, summary["rows"])


def _cost_table(summary: Mapping[str, Any]) -> Any:
    rows = []
    for method, row in summary["costs"].items():
        measured, bytes_ = (f"{row[k] / 2**20:.1f}" for k in ("measured_bytes", "bytes"))
        cost = [f"{row['images']:.0f}", _duration(row["hardware_seconds"]), measured, bytes_]
        if method == ALL:
            rows.append(["all images", *cost, "–", "–", _three(row, "images_")])
        else:
            seconds = f"{row['reconstruction_seconds']:.1f}"
            rows.append([method, *cost, seconds, _three(row), _three(row, "images_")])
    columns = ["", "images", "hardware", "measured [MiB]", "renders [MiB]", "processor [s]"]
    title = "What each costs, means over the materials: " + " / ".join(ERRORS.values())
    return text_table(title, [*columns, "rendered", "single images"], rows)


def _exact_table(exact: Sequence[Mapping[str, Any]]) -> Any:
    def share(key: str) -> Column:
        return lambda row: f"{100.0 * row[key]:.2f}"

    columns: dict[str, Column] = {
        "material": "{material}",
        "off, mean [%]": share("bd_off_mean"),
        "largest [% of peak]": share("bd_off_largest"),
        "B off, mean": share("b_off_mean"),
        "B largest": share("b_off_largest"),
        "solver [ms]": lambda row: f"{1e3 * row['solver_seconds']:.0f}",
        "at once [ms]": lambda row: f"{1e3 * row['batch_seconds']:.1f}",
        "faster": lambda row: f"{row['solver_seconds'] / row['batch_seconds']:.0f}×",
    }
    return record_table("Method BD at once beside one solver per line, per texel", columns, exact)


def _three(row: Mapping[str, Any], prefix: str = "") -> str:
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

    materials = distinct(summary["rows"], "material")
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
    axes: dict[str, Any] = {
        "xlabel": "depth of the structure ÷ size of its largest element",
        "ylabel": "PSNR of the rendering [dB]  (higher is better)",
    }
    with drawn_panel(path, 5.6, 4.0, **axes) as panel:
        for number, method in enumerate(summary["psnr_by_depth_rank_correlation"]):
            own = where(summary["rows"], method=method)
            depth, psnr = ([row[name] for row in own] for name in ("depth_over_element", "psnr"))
            panel.plot(depth, psnr, MARKERS[number], color=COLOURS[number], label=method)
            if number == 0:
                for row, x, y in zip(own, depth, psnr, strict=True):
                    panel.annotate(row["material"], (x, y), fontsize=6, rotation=20)
        panel.margins(x=0.18)  # for the names

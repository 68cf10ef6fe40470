"""From which distance on a BRDF is enough: our materials with structure beside the thesis's.

The thesis asked people (Figs 3.11 to 3.14) and fitted E = k_1 + k_2·S·F to their answers (Tables
3.1 and 3.2). Here the features F look at the presets of ``simrig.mesostructure`` as
``simrig/viewing/structure/probe.py`` shows them, S is the size of the presets' largest element, and
the published constants give the distances. Our materials are not the thesis's, so groups are
compared; its distances of single materials are drawn only. The same features are then fitted to the
published distances of the groups, with leave-one-out, beside Tables 3.1 and 3.2.

Source: thesis section 3.3 with Tables 3.1 to 3.3, Figs 3.11 to 3.16; section 3.4.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from simrig.core.tables import text_table
from simrig.evaluation.studies.engine.base import Cell, Config, Row, Study
from simrig.mesostructure import PRESETS as MATERIALS
from simrig.mesostructure import build_tile
from simrig.perception import (
    PUBLISHED_MODELS,
    contrast_sensitivity,
    cycles_per_degree,
    fit_distances,
)
from simrig.viewing.plots import COLOURS, finish_figure, new_figure
from simrig.viewing.room import GROUP_DISTANCES_M
from simrig.viewing.structure.probe import FEATURES, PATCH, PREDICTING, probe, tile_stimulus

# thesis Table 3.1: Pearson correlation of S·F with experiment B; VDP2 stands beside FLIP
PUBLISHED_CORRELATIONS = {
    "luminance": 0.499,
    "contrast": 0.777,
    "ssim": 0.878,
    "flip": 0.808,
    "luminance_contrast": 0.941,
    "texture_contrast": 0.934,
    "saliency": 0.943,
}
CSF_SIZES_MM = (1.0, 3.4, 8.0)  # thesis Fig. 3.15: smallest, typical, largest
CSF_DISTANCES_MM = (600.0, 4400.0)  # of the test scene, thesis section B.2
_FEWEST_TO_FIT = 4

PRESETS: dict[str, dict[str, Any]] = {
    "quick": {
        "materials": ["twill_blue", "canvas_beige", "leather_tan", "wood_walnut"],
        "pixels": PATCH // 2,
        "spp": 16,
    },
    "full": {
        "materials": [n for n, preset in MATERIALS.items() if preset.group in GROUP_DISTANCES_M],
        "pixels": PATCH,
        "spp": 256,
    },
}


def cells(config: Config) -> list[dict[str, Any]]:
    """Return one cell per material."""
    return [{"material": name} for name in config["materials"]]


def run_cell(config: Config, cell: Cell) -> list[dict[str, Any]]:
    """Render one material and look at it."""
    from simrig.core import backend

    backend.select()
    tile = build_tile(cell["material"])
    seen = probe(tile_stimulus(tile, config["pixels"], config["spp"]), tile.element_mm)
    found = {f"found_{method}_mm": size for method, size in seen.found_mm.items()}
    automatic = {
        f"{name}_found_m": float(
            PUBLISHED_MODELS[name].distance(seen.found_mm["spectrum"], seen.features[name])
        )
        for name in PREDICTING
    }
    return [
        {
            "group": tile.group,
            "structure_mm": tile.element_mm,
            **found,
            **seen.features,
            **{f"{name}_m": distance for name, distance in seen.distances_m.items()},
            **automatic,
            "compute_seconds": seen.cost.compute_seconds,
        }
    ]


def summarise(config: Config, rows: Sequence[Row]) -> dict[str, Any]:
    """Return distances by group beside the published ones, and fits to the latter."""
    ratios = [np.log(row["found_spectrum_mm"] / row["structure_mm"]) for row in rows]
    return {
        "groups": [_group(name, rows) for name in GROUP_DISTANCES_M if _of(name, rows)],
        "fits": {name: _fit(name, rows) for name in FEATURES} if _can_fit(rows) else {},
        "found_over_given": float(np.exp(np.median(ratios))),
        "found_spread": float(np.exp(np.std(ratios))),
        "materials": len(rows),
        "spp": config["spp"],
    }


def _of(group: str, rows: Sequence[Row]) -> list[Row]:
    return [row for row in rows if row["group"] == group]


def _can_fit(rows: Sequence[Row]) -> bool:
    return len(rows) >= _FEWEST_TO_FIT


def _group(name: str, rows: Sequence[Row]) -> dict[str, Any]:
    """Return the means of a group, and the F that its published distance asks for."""
    own = _of(name, rows)
    size = float(np.mean([row["structure_mm"] for row in own]))
    wanted = GROUP_DISTANCES_M[name]
    found: dict[str, Any] = {"group": name, "materials": len(own), "published_m": wanted}
    found["structure_mm"] = size
    for feature in PREDICTING:
        model = PUBLISHED_MODELS[feature]
        found[feature] = float(np.mean([row[feature] for row in own]))
        found[f"{feature}_m"] = float(np.mean([row[f"{feature}_m"] for row in own]))
        found[f"{feature}_found_m"] = float(np.mean([row[f"{feature}_found_m"] for row in own]))
        found[f"{feature}_needed"] = (wanted - model.k_1) / (model.k_2 * size)
    return found


def _fit(feature: str, rows: Sequence[Row]) -> dict[str, Any]:
    """Return the robust line of a feature through the published distances of the groups."""
    distances = [GROUP_DISTANCES_M[row["group"]] for row in rows]
    fitted = fit_distances(
        [row["structure_mm"] for row in rows], [row[feature] for row in rows], distances
    )
    off = np.abs(fitted.left_out - distances)
    return {
        "k_1": fitted.model.k_1,
        "k_2": fitted.model.k_2,
        "k_1_std": fitted.model.k_1_std,
        "k_2_std": fitted.model.k_2_std,
        "correlation": fitted.correlation,
        "published_correlation": PUBLISHED_CORRELATIONS[feature],
        "left_out_error_m": float(np.median(off)),
        "outliers": int((fitted.weights == 0.0).sum()),
    }


def table(summary: Mapping[str, Any]) -> Any:
    """Return the summary as tables for the terminal."""
    from rich.console import Group

    distances = ("published_m", "ssim_m", "saliency_m")
    groups = text_table(
        "critical viewing distance in metres, means of the groups",
        ("group", "materials", "S / mm", "published", "by SSIM", "by saliency"),
        (
            (
                row["group"],
                row["materials"],
                f"{row['structure_mm']:.2f}",
                *(f"{row[key]:.1f}" for key in distances),
            )
            for row in summary["groups"]
        ),
    )
    ratio, spread = summary["found_over_given"], summary["found_spread"]
    found = f"S found in the spectrum over the given one: median {ratio:.2f}, spread × {spread:.2f}"
    if not summary["fits"]:
        return Group(groups, found)
    fits = text_table(
        "fitted to the published distances of the groups, E = k_1 + k_2·S·F",
        ("feature", "r (published)", "k_1", "k_2", "left out: error / m"),
        (
            (
                name,
                f"{fit['correlation']:.3f} ({fit['published_correlation']:.3f})",
                f"{fit['k_1']:.3f} ± {fit['k_1_std']:.3f}",
                f"{fit['k_2']:.3f} ± {fit['k_2_std']:.3f}",
                f"{fit['left_out_error_m']:.2f}",
            )
            for name, fit in summary["fits"].items()
        ),
    )
    return Group(groups, found, fits, "flip stands where the thesis has VDP2")


def plots(summary: Mapping[str, Any], rows: Sequence[Row], folder: Path) -> list[Path]:
    """Draw the distances of all materials, and the contrast sensitivity of Fig. 3.15."""
    return [_draw_distances(rows, folder / "distances.png"), draw_sensitivity(folder / "csf.png")]


def _draw_distances(rows: Sequence[Row], path: Path) -> Path:
    ordered = [row for name in GROUP_DISTANCES_M for row in _of(name, rows)]
    places = np.arange(len(ordered))
    figure = new_figure(max(5.0, 0.34 * len(ordered) + 1.5), 4.6)
    panel = figure.subplots()
    for number, name in enumerate(PREDICTING):
        values = [row[f"{name}_m"] for row in ordered]
        panel.bar(places + 0.4 * number - 0.2, values, 0.4, color=COLOURS[number], label=name)
    published = [GROUP_DISTANCES_M[row["group"]] for row in ordered]
    label = "published, of the group"
    panel.hlines(published, places - 0.45, places + 0.45, color="black", linewidth=2, label=label)
    panel.set_xticks(places, [row["material"] for row in ordered], rotation=90, fontsize=8)
    panel.set_ylabel("critical viewing distance [m]")
    panel.legend(frameon=False, fontsize=8)
    panel.spines[["top", "right"]].set_visible(False)
    finish_figure(figure, path)
    return path


def draw_sensitivity(path: Path) -> Path:
    """Draw thesis Fig. 3.15: contrast sensitivity over the distance, for three sizes of elements.

    Relative to the highest of all frequencies; one element is one cycle, 1 Hz.
    """
    distances = np.linspace(*CSF_DISTANCES_MM, 200)
    highest = contrast_sensitivity(np.geomspace(0.05, 60.0, 2000)).max()
    figure = new_figure(5.6, 3.8)
    panel = figure.subplots()
    for colour, size in zip(COLOURS, CSF_SIZES_MM, strict=False):
        curve = contrast_sensitivity(cycles_per_degree(size, distances)) / highest
        panel.plot(1e-3 * distances, curve, color=colour, label=f"{size:g} mm")
    panel.set(xlabel="viewing distance [m]", ylabel="relative contrast sensitivity", ylim=(0, 1.05))
    panel.legend(frameon=False, title="structural element")
    panel.spines[["top", "right"]].set_visible(False)
    finish_figure(figure, path)
    return path


STUDY: Study = Study(
    name="critical-distance",
    about="From which distance on structure cannot be seen, predicted for all materials.",
    source="thesis section 3.3, Tables 3.1 to 3.3, Figs 3.11 to 3.16",
    presets=PRESETS,
    cells=cells,
    run_cell=run_cell,
    summarise=summarise,
    table=table,
    plots=plots,
)

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

from simrig.core.tables import named_rows, record_table
from simrig.evaluation.studies.engine.base import Cell, Config, Row, one_per
from simrig.evaluation.studies.engine.rows import means, where
from simrig.mesostructure import PRESETS as MATERIALS
from simrig.mesostructure import build_tile
from simrig.perception import (
    PUBLISHED_MODELS,
    contrast_sensitivity,
    cycles_per_degree,
    fit_distances,
)
from simrig.viewing.plots import COLOURS, drawn_panel
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

cells = one_per(material="materials")


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
        "groups": [
            _group(name, own) for name in GROUP_DISTANCES_M if (own := where(rows, group=name))
        ],
        "fits": {name: _fit(name, rows) for name in FEATURES}
        if len(rows) >= _FEWEST_TO_FIT
        else {},
        "found_over_given": float(np.exp(np.median(ratios))),
        "found_spread": float(np.exp(np.std(ratios))),
        "materials": len(rows),
        "spp": config["spp"],
    }


def _group(name: str, own: Sequence[Row]) -> dict[str, Any]:
    """Return the means of a group, and the F that its published distance asks for."""
    wanted = GROUP_DISTANCES_M[name]
    found: dict[str, Any] = {"group": name, "materials": len(own), "published_m": wanted}
    found |= means(own, ["structure_mm"])
    for feature in PREDICTING:
        model = PUBLISHED_MODELS[feature]
        found |= means(own, [feature, f"{feature}_m", f"{feature}_found_m"])
        found[f"{feature}_needed"] = (wanted - model.k_1) / (model.k_2 * found["structure_mm"])
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

    columns = {
        "group": "{group}",
        "materials": "{materials}",
        "S / mm": "{structure_mm:.2f}",
        "published": "{published_m:.1f}",
        "by SSIM": "{ssim_m:.1f}",
        "by saliency": "{saliency_m:.1f}",
    }
    title = "critical viewing distance in metres, means of the groups"
    groups = record_table(title, columns, summary["groups"])
    ratio, spread = summary["found_over_given"], summary["found_spread"]
    found = f"S found in the spectrum over the given one: median {ratio:.2f}, spread × {spread:.2f}"
    if not summary["fits"]:
        return Group(groups, found)
    columns = {
        "feature": "{feature}",
        "r (published)": "{correlation:.3f} ({published_correlation:.3f})",
        "k_1": "{k_1:.3f} ± {k_1_std:.3f}",
        "k_2": "{k_2:.3f} ± {k_2_std:.3f}",
        "left out: error / m": "{left_out_error_m:.2f}",
    }
    title = "fitted to the published distances of the groups, E = k_1 + k_2·S·F"
    fits = record_table(title, columns, named_rows(summary["fits"], "feature"))
    return Group(groups, found, fits, "flip stands where the thesis has VDP2")


def plots(summary: Mapping[str, Any], rows: Sequence[Row], folder: Path) -> list[Path]:
    """Draw the distances of all materials, and the contrast sensitivity of Fig. 3.15."""
    return [_draw_distances(rows, folder / "distances.png"), draw_sensitivity(folder / "csf.png")]


def _draw_distances(rows: Sequence[Row], path: Path) -> Path:
    ordered = [row for name in GROUP_DISTANCES_M for row in where(rows, group=name)]
    places = np.arange(len(ordered))
    width, axes = max(5.0, 0.34 * len(ordered) + 1.5), {"ylabel": "critical viewing distance [m]"}
    with drawn_panel(path, width, 4.6, legend={"fontsize": 8}, **axes) as panel:
        for number, name in enumerate(PREDICTING):
            values = [row[f"{name}_m"] for row in ordered]
            panel.bar(places + 0.4 * number - 0.2, values, 0.4, color=COLOURS[number], label=name)
        published = [GROUP_DISTANCES_M[row["group"]] for row in ordered]
        line: dict[str, Any] = {
            "color": "black",
            "linewidth": 2,
            "label": "published, of the group",
        }
        panel.hlines(published, places - 0.45, places + 0.45, **line)
        panel.set_xticks(places, [row["material"] for row in ordered], rotation=90, fontsize=8)
        panel.spines[["top", "right"]].set_visible(False)
    return path


def draw_sensitivity(path: Path) -> Path:
    """Draw thesis Fig. 3.15: contrast sensitivity over the distance, for three sizes of elements.

    Relative to the highest of all frequencies; one element is one cycle, 1 Hz.
    """
    distances = np.linspace(*CSF_DISTANCES_MM, 200)
    highest = contrast_sensitivity(np.geomspace(0.05, 60.0, 2000)).max()
    axes: dict[str, Any] = {
        "xlabel": "viewing distance [m]",
        "ylabel": "relative contrast sensitivity",
    }
    legend = {"title": "structural element"}
    with drawn_panel(path, 5.6, 3.8, legend=legend, ylim=(0, 1.05), **axes) as panel:
        for colour, size in zip(COLOURS, CSF_SIZES_MM, strict=False):
            curve = contrast_sensitivity(cycles_per_degree(size, distances)) / highest
            panel.plot(1e-3 * distances, curve, color=colour, label=f"{size:g} mm")
        panel.spines[["top", "right"]].set_visible(False)
    return path

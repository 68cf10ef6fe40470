"""The BRDF picture with axis labels, slices and sample positions (thesis Figures 1.3 and 5.2)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.lines import Line2D

from simrig.brdf.protocol import Brdf
from simrig.directions.spherical import TWO_PI, wrap_angle
from simrig.files.images import to_srgb8
from simrig.plans.placement import SlicePlacement
from simrig.reconstruction.slices.tables import full_slices
from simrig.rigs.measurements.measurement import Measurement
from simrig.viewing.brdf.picture import THETAS_DEG, brdf_exposure, brdf_picture, check_thetas
from simrig.viewing.plots import finish_figure, new_figure

SLICE_COLOURS = {"axial": "#ff2020", "diagonal": "#3060ff"}  # of thesis Figure 5.2
_SAME_THETA = 1e-6  # radians


def brdf_figure(
    brdf: Brdf, measurement: Measurement | None = None, title: str | None = None
) -> bytes:
    """Draw the BRDF picture with labelled axes, and a measurement's slices and samples over it.

    Tiles are every 15° from 0 to 75°, those of a measurement at its polar angles. The exposure,
    chosen by ``brdf_exposure``, is stated in the figure.

    Args:
        measurement: along slices; draw its axial and diagonal slices, and its samples as dots.
        title: above the picture; the reflectance's name by default.

    Returns:
        PNG bytes.

    Raises:
        SimrigError: see ``brdf_picture``.
    """
    placement = full_slices(measurement)[0] if measurement else None
    thetas_deg = THETAS_DEG if placement is None else np.degrees(placement.thetas).tolist()
    thetas = np.radians(check_thetas(thetas_deg))
    picture = brdf_picture(brdf, thetas_deg)
    exposure = brdf_exposure(picture)
    figure = new_figure(9.0, 9.7)
    panel = figure.subplots()
    count = len(thetas)
    panel.imshow(to_srgb8(picture, exposure), extent=(0, count, count, 0), interpolation="nearest")
    legend: list[Line2D] = []
    note = f"shown as sRGB, white is {1.0 / exposure:.3g} 1/sr (exposure {exposure:.3g})"
    if measurement is not None and placement is not None:
        legend += _draw_slices(panel, placement, count)
        legend += _draw_samples(panel, measurement, thetas)
        note += "; tiles with θ_i > θ_v follow by reciprocity"
    _label(panel, thetas_deg, note)
    panel.set_title(title if title is not None else brdf.name, fontsize=13)
    if legend:
        figure.legend(
            handles=legend, loc="outside upper center", ncols=4, frameon=False, fontsize=9
        )
    return finish_figure(figure)


def _label(panel: Axes, thetas_deg: Sequence[float], note: str) -> None:
    """Label the tiles by their polar angle and separate them."""
    count = len(thetas_deg)
    centres = np.arange(count) + 0.5
    names = [f"{degrees:g}°" for degrees in thetas_deg]
    panel.set_xticks(centres, names)
    panel.set_yticks(centres, names)
    panel.tick_params(length=0)
    panel.set_xlabel(
        "view: polar angle θ_v of each tile, azimuth φ_v from 0 to 360° within it  →\n" + note
    )
    panel.set_ylabel("←  illumination: polar angle θ_i of each tile, azimuth φ_i within it")
    panel.hlines(np.arange(1, count), 0, count, color="0.5", linewidth=0.8)
    panel.vlines(np.arange(1, count), 0, count, color="0.5", linewidth=0.8)
    panel.set_xlim(0, count)
    panel.set_ylim(count, 0)


def _draw_slices(panel: Axes, placement: SlicePlacement, count: int) -> list[Line2D]:
    """Draw slices in the tiles that a rig measures, theta_i <= theta_v; return their legend."""
    tiles = [(row, column) for row in range(1, count) for column in range(row, count)]
    handles = []
    for kind, colour in SLICE_COLOURS.items():
        own = list(_tile_segments(placement.azimuth_count, rising=kind == "axial"))
        segments = [np.add(s, (column, row)) for row, column in tiles for s in own]
        panel.add_collection(LineCollection(segments, colors=colour, linewidths=0.6, alpha=0.7))
        handles.append(Line2D([], [], color=colour, label=f"{kind} slices"))
    return handles


def _tile_segments(azimuths: int, rising: bool) -> Iterator[np.ndarray]:
    """Yield the axial (φ_v − φ_i = α) or diagonal (φ_i + φ_v = β) slices of a tile of side 1.

    A slice leaves the tile at one side and comes back at the opposite one, so it has two parts.
    """
    for k in range(azimuths):
        at = k / azimuths
        if rising:
            parts = (((at, 0.0), (1.0, 1.0 - at)), ((0.0, 1.0 - at), (at, 1.0)))
        else:
            parts = (((at, 0.0), (0.0, at)), ((1.0, at), (at, 1.0)))
        for part in parts:
            yield np.array(part)


def sample_positions(
    measurement: Measurement, thetas: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return where samples lie in the picture.

    A sample between two polar angles lies on a horizontal slice; it is put between its positions in
    the two tiles, in proportion.

    Args:
        measurement: along slices.
        thetas: those of the tiles, in radians.

    Returns:
        Column and row in tiles (tile number plus azimuth / 360°), and whether both polar angles
        are those of a tile.
    """
    places, gaps = [], []
    for theta, phi in (
        (measurement.theta_v, measurement.phi_v),
        (measurement.theta_i, measurement.phi_i),
    ):
        tile = np.interp(theta, thetas, np.arange(len(thetas)))
        places.append(tile + wrap_angle(phi) / TWO_PI)
        gaps.append(np.abs(theta[:, None] - thetas).min(axis=1))
    return places[0], places[1], np.maximum(*gaps) < _SAME_THETA


def _draw_samples(panel: Axes, measurement: Measurement, thetas: np.ndarray) -> list[Line2D]:
    """Draw the samples as dots and return their legend entries."""
    columns, rows, inside = sample_positions(measurement, thetas)
    handles = []
    for chosen, colour, label in (
        (inside, "white", "samples in the tiles"),
        (~inside, "#a0ff60", "samples between two polar angles"),
    ):
        if chosen.any():
            style: dict[str, Any] = {
                "linestyle": "",
                "marker": "o",
                "color": colour,
                "markeredgecolor": "black",
            }
            panel.plot(columns[chosen], rows[chosen], markersize=1.9, markeredgewidth=0.25, **style)
            text = f"{int(chosen.sum()):,} {label}"
            handles.append(Line2D([], [], markersize=5, label=text, **style))
    return handles

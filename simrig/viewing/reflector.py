"""The sheet of thesis Fig. 3.3: picture, axes, unrolled picture and profile of a material."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from simrig.brdf.protocol import Brdf
from simrig.core.cost import stopwatch
from simrig.directions.spherical import to_vector
from simrig.files.images import to_srgb8
from simrig.imaging.anisotropy import analyse
from simrig.imaging.anisotropy_opening import Opening
from simrig.instruments.description import shipped
from simrig.rigs.reflector.folded import fold, picture
from simrig.rigs.reflector.lighting import lighting_of
from simrig.rigs.reflector.mirror import Reflector
from simrig.rigs.reflector.photograph import PIXELS, Analysed
from simrig.viewing.plots import finish_figure, new_figure

_COLOURS = ("limegreen", "royalblue", "orange", "magenta")


def material_sheet(material: Brdf, rotation_deg: float = 0.0) -> Analysed:
    """Return what a picture without noise, of a mirror without errors, shows of a material."""
    mirror = Reflector.from_description(shipped("reflector")).perfect  # type: ignore[arg-type]
    folded = fold(mirror, PIXELS, flash_points=1)
    image = picture(folded, material, rotation_deg)
    elapsed = stopwatch()
    found = analyse(image, lighting_of(folded))
    middle = 0.5 * PIXELS - 0.5
    opening = Opening(middle, middle, mirror.opening_mm / folded.width_mm * PIXELS)
    return Analysed(found, image, opening, mirror, elapsed())


def true_profile(material: Brdf, rotation_deg: float = 0.0, theta_deg: float = 50.0) -> np.ndarray:
    """Return f_r at azimuths in steps of 1°, θ_v = 0, both sides' mean, channels' mean, (180,)."""
    phi = np.radians(np.arange(360.0) - rotation_deg)
    values = material.eval(to_vector(np.radians(theta_deg), phi), np.array([0.0, 0.0, 1.0]))
    return np.asarray(values.mean(axis=-1).reshape(2, 180).mean(axis=0))


def draw_sheet(
    found: Analysed | Sequence[Analysed],
    path: Path | None = None,
    truths: Sequence[np.ndarray] | None = None,
    names: Sequence[str] | None = None,
) -> bytes:
    """Draw one column for each picture, as PNG.

    Args:
        path: where to write it as well.
        truths: (180,) true profile of each over the azimuth in steps of 1°, at θ_i = 50°, θ_v = 0.
    """
    columns = [found] if isinstance(found, Analysed) else list(found)
    figure = new_figure(2.6 * len(columns) + 1.0, 8.2)
    panels = figure.subplots(4, len(columns), squeeze=False)
    for k, own in enumerate(columns):
        anisotropy = own.anisotropy
        image = np.nan_to_num(own.picture, nan=float(np.nanmax(own.picture)))  # saturated
        shown = to_srgb8(image, 0.9 / max(float(np.quantile(image, 0.985)), 1e-12))
        top = panels[:, k]
        for panel in top[:2]:
            panel.imshow(shown)
            panel.set_axis_off()
        if names is not None:
            top[0].set_title(names[k], fontsize=9)
        middle = 0.5 * len(image)
        for mode, colour in zip(anisotropy.modes.found, _COLOURS, strict=False):
            x, y = middle * 0.9 * np.cos(mode.axis), middle * 0.9 * np.sin(mode.axis)
            top[1].plot([middle - x, middle + x], [middle + y, middle - y], color=colour, lw=1.2)
        unrolled = anisotropy.unrolled / max(float(anisotropy.unrolled.max()), 1e-12)
        steps = len(anisotropy.phi_h)
        shift = 0
        if anisotropy.modes.found:
            shift = steps // 2 - round(anisotropy.modes.found[0].axis / np.pi * steps)
        extent = (-90.0, 90.0, *np.degrees(anisotropy.theta_h[[0, -1]]))
        turned = np.roll(to_srgb8(np.maximum(unrolled, 0.0)), shift, axis=1)
        top[2].imshow(turned, aspect="auto", origin="lower", extent=extent)
        top[2].set_ylabel("θ_h [°]" if k == 0 else "")
        phi = np.degrees(anisotropy.phi_h) - 90.0
        profile = anisotropy.at(np.radians(25.0)).mean(axis=-1)
        top[3].plot(phi, np.roll(profile / profile.mean(), shift), color="firebrick", label="found")
        if truths is not None:
            truth = truths[k] / truths[k].mean()
            top[3].plot(phi, np.roll(truth, shift), color="deepskyblue", ls="--", label="true")
        top[3].set_xlabel("azimuth from the main axis [°]", fontsize=8)
        top[3].tick_params(labelsize=7)
    panels[3, 0].legend(fontsize=7)
    return finish_figure(figure, path)

"""What is shown of a material, and a page of it that needs no server."""

from __future__ import annotations

import base64
import html
import io
from dataclasses import dataclass
from typing import Any

import numpy as np

from simrig.brdf.protocol import Brdf
from simrig.evaluation.metrics.images import delta_e_map
from simrig.files.images import to_srgb8
from simrig.viewing.brdf.figure import brdf_figure
from simrig.web.viewer.shading import in_plane, lit, views_deg

COLOURS = ("#1f77b4", "#d62728", "#2ca02c", "#9467bd", "#ff7f0e", "#17becf", "#8c564b", "#e377c2")


@dataclass(frozen=True, eq=False)
class Shown:
    """A material of the viewer.

    Attributes:
        name: what it is called.
        brdf: the material.
        source: as it was given on the command line.
        measurement: whose sample positions are drawn on its picture, if there is one.
    """

    name: str
    brdf: Brdf
    source: str
    measurement: Any = None

    def figure(self) -> bytes:
        """Return the picture of all subspaces as a PNG, with the measured points where known."""
        return brdf_figure(self.brdf, measurement=self.measurement, title=self.name)

    def albedo(self, theta_deg: float, phi_deg: float) -> list[float]:
        """Return the directional albedo towards a direction, linear RGB."""
        found = self.brdf.directional_albedo(np.radians(theta_deg), np.radians(phi_deg), 64, 128)
        return [float(v) for v in found]


def command(shown: list[Shown], state: dict[str, Any]) -> str:
    """Return the command that makes the page of a state again."""
    import shlex

    options = {
        "form": state["form"],
        "light": f"{state['theta']:g},{state['phi']:g}",
        "rotation": f"{state['rotation']:g}",
        "zoom": f"{state['zoom']:g}",
        "exposure": f"{state['exposure']:g}",
        "slice": f"{state['theta_i']:g},{state['phi_i']:g},{state['phi_v']:g}",
    }
    words = ["simrig", "view", *(s.source for s in shown)]
    words += [word for name, value in options.items() for word in (f"--{name}", value)]
    return shlex.join([*words, "--export", "view.html"])


def static_page(shown: list[Shown], state: dict[str, Any]) -> str:
    """Return one HTML file: pictures, differences, slices, albedo, subspaces.

    Args:
        shown: the materials.
        state: ``State`` of the server, as a dictionary.
    """
    light = [state[key] for key in ("form", "resolution", "theta", "phi", "rotation", "zoom")]
    images = [lit(s.brdf, *light) * state["exposure"] for s in shown]
    parts = ["<div class=row>"]
    for own, image in zip(shown, images, strict=True):
        parts.append(_figure(own.name, _png(to_srgb8(image))))
    for own, image in zip(shown[1:], images[1:], strict=True):
        error = np.abs(to_srgb8(images[0]).astype(int) - to_srgb8(image).astype(int))
        difference = delta_e_map(images[0], image)
        said = f"255 − 10·|{shown[0].name} − {own.name}|, mean ΔE {difference.mean():.3f}"
        parts.append(_figure(said, _png(np.clip(255 - 10 * error, 0, 255).astype(np.uint8))))
    parts.append("</div><h2>Slice</h2>" + _plot(shown, state))
    rows = []
    for own in shown:
        values = " ".join(f"{v:.4f}" for v in own.albedo(state["theta_i"], state["phi_i"]))
        rows.append(f"<tr><td>{html.escape(own.name)}<td>{values}")
    parts.append(
        f"<table><tr><th>material<th>albedo at {state['theta_i']:g}°{''.join(rows)}</table>"
    )
    parts.append("<h2>Subspaces</h2>")
    parts += [_figure(own.name, own.figure()) for own in shown]
    parts.append(f"<h2>Again</h2><pre>{html.escape(command(shown, state))}</pre>")
    names = html.escape(", ".join(s.name for s in shown))
    return (
        f"<!doctype html><html lang=en><meta charset=utf-8><title>{names}</title>"
        "<style>body{font:16px sans-serif;margin:2em}.row{display:flex;flex-wrap:wrap;gap:1em}"
        "figure{margin:0}img{display:block;max-width:100%}td,th{padding:.2em 1em;text-align:left}"
        f"</style><h1>{names}</h1>{''.join(parts)}</html>\n"
    )


def _figure(said: str, png: bytes) -> str:
    data = base64.b64encode(png).decode()
    text = html.escape(said)
    image = f'<img alt="{text}" src="data:image/png;base64,{data}">'
    return f"<figure>{image}<figcaption>{text}</figcaption></figure>"


def _png(image: np.ndarray) -> bytes:
    from PIL import Image

    target = io.BytesIO()
    Image.fromarray(image).save(target, "PNG")
    return target.getvalue()


def _plot(shown: list[Shown], state: dict[str, Any]) -> str:
    """Return a Cartesian plot of log10(1 + f_r), mean of the channels, as SVG."""
    views = views_deg()
    curves = [
        np.log10(1.0 + in_plane(s.brdf, state["theta_i"], state["phi_i"], state["phi_v"]).mean(1))
        for s in shown
    ]
    most = max(max(float(curve.max()) for curve in curves), 1e-6)
    lines = []
    for number, (own, curve) in enumerate(zip(shown, curves, strict=True)):
        points = " ".join(
            f"{40 + (v + 90) * 4:.1f},{280 - 250 * c / most:.1f}"
            for v, c in zip(views, curve, strict=True)
        )
        colour = COLOURS[number % len(COLOURS)]
        lines.append(
            f'<polyline fill="none" stroke="{colour}" stroke-width="2" points="{points}"/>'
        )
        lines.append(
            f'<text x="50" y="{24 + 18 * number}" fill="{colour}">{html.escape(own.name)}</text>'
        )
    axis = "".join(
        f'<text x="{40 + (a + 90) * 4}" y="298" text-anchor="middle">{a}°</text>'
        for a in (-90, -60, -30, 0, 30, 60, 90)
    )
    said = f"θ_i {state['theta_i']:g}°, φ_i {state['phi_i']:g}°, views along {state['phi_v']:g}°"
    return (
        f'<svg viewBox="0 0 800 320" width="800" font-size="13" font-family="sans-serif">'
        f'<path d="M40 20V280H760" fill="none" stroke="#888"/>{axis}'
        f'<text x="44" y="14">log10(1 + f_r), at most {most:.3g}; {said}</text>'
        f"{''.join(lines)}</svg>"
    )

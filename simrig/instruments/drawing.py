"""An instrument as a picture: its arms from the side, its reach and what is hidden from above."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from simrig.files.atomic import atomic_write
from simrig.instruments.description import Description, ReflectorDescription
from simrig.instruments.kinematics import (
    BEYOND,
    ArmKinematics,
    Kinematics,
    Placement,
    kinematics_of,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_LIGHT = (45.0, 60.0)  # degrees, of which the hidden views are shown
_COLOURS = {"free": "#7fbf7b", "over the pole": "#fdb863", "hidden": "#b2182b", "beyond": "#dddddd"}


def draw(description: Description, path: str | Path) -> None:
    """Draw an instrument into a picture file (.png, .pdf or .svg).

    Raises:
        SimrigError: a folder that does not exist or cannot be written.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.0, 5.0), layout="constrained")
    figure.suptitle(description.instrument.name)
    side = figure.add_subplot(1, 2, 1)
    if isinstance(description, ReflectorDescription):
        _reflector(side, description)
        _rays(figure.add_subplot(1, 2, 2), description)
    else:
        moves = kinematics_of(description)
        _from_the_side(side, moves)
        _from_above(figure.add_subplot(1, 2, 2, projection="polar"), moves)
    path = Path(path)
    with atomic_write(path) as temporary:
        figure.savefig(temporary, dpi=120, format=path.suffix[1:].lower() or "png")


def views(moves: Kinematics, light_deg: tuple[float, float]) -> Placement:
    """Return how views all over the hemisphere are reached under one light, by whole degrees."""
    theta, phi = np.meshgrid(np.radians(np.arange(0.0, 90.0)), np.radians(np.arange(0.0, 360.0)))
    light = np.radians(light_deg)
    full = np.full(theta.size, 1.0)
    angles = np.stack([full * light[0], theta.ravel(), full * light[1], phi.ravel()], axis=1)
    return moves.placed(angles)


def _from_above(axes: Any, moves: Kinematics) -> None:
    if isinstance(moves, ArmKinematics) and moves.polar is None:
        found = views(moves, _LIGHT)
        kind = np.select(
            [found.fault == BEYOND, ~found.reached, (found.settings[:, :2] < 0.0).any(axis=1)],
            ["beyond", "hidden", "over the pole"],
            "free",
        )
        for name, colour in _COLOURS.items():
            here = kind == name
            if not here.any():
                continue
            theta, phi = np.degrees(found.angles[here, 1]), found.angles[here, 3]
            axes.plot(phi, theta, ".", ms=2.0, color=colour, label=name)
        axes.plot(np.radians(_LIGHT[1]), _LIGHT[0], "*", ms=8, color="black", label="light")
        axes.set_title(f"views under a light at {_LIGHT[0]:g}°, {_LIGHT[1]:g}°")
    else:
        for name, theta, phi in _fixed(moves):
            axes.plot(phi, np.degrees(theta), "." if name != "cameras" else "+", label=name)
        axes.set_title("directions that are reached")
    axes.set_rlim(0.0, 90.0)
    axes.legend(loc="lower left", bbox_to_anchor=(-0.15, -0.1), fontsize=8)


def _fixed(moves: Kinematics) -> list[tuple[str, np.ndarray, np.ndarray]]:
    if not isinstance(moves, ArmKinematics):
        return [("cameras and lights", *moves.directions.T)]
    phi = np.radians(np.arange(0.0, 360.0, 2.0))
    rings = [
        (name, *np.meshgrid(np.asarray(theta), phi))
        for name, theta in zip(("lights", "cameras"), moves.polar or (), strict=False)
    ]
    return [(name, theta.ravel(), around.ravel()) for name, theta, around in rings]


def _from_the_side(axes: Axes, moves: Kinematics) -> None:
    t = np.radians(np.linspace(0.0, 90.0, 91))
    if isinstance(moves, ArmKinematics):
        for name, bow, theta, sign in (
            ("camera", moves.camera, np.radians(30.0), -1.0),
            ("light", moves.light, np.radians(50.0), 1.0),
        ):
            part = t[t >= theta]
            line = axes.plot(
                sign * bow.distance * np.sin(part), bow.distance * np.cos(part), lw=4, label=name
            )
            place = bow.distance * np.array([sign * np.sin(theta), np.cos(theta)])
            axes.plot([0.0, place[0]], [0.0, place[1]], ":", color=line[0].get_color())
            axes.plot(*place, "o", ms=8, color=line[0].get_color())
            words = f"{bow.distance:g} mm" + (", may come over the pole" if bow.over else "")
            axes.annotate(
                words,
                tuple(place),
                textcoords="offset points",
                xytext=(0, 9),
                ha="center",
                fontsize=8,
            )
        sample = max(moves.sample_mm, 0.02 * moves.camera.distance)
        axes.plot([-sample, sample], [0.0, 0.0], lw=5, color="black", label="sample")
    else:
        theta = moves.directions[:, 0]
        x = np.sin(theta) * np.cos(moves.directions[:, 1])
        axes.plot(moves.camera_mm * x, moves.camera_mm * np.cos(theta), "s", ms=4, label="cameras")
        axes.plot([0.0], [0.0], "_", ms=20, mew=4, color="black", label="sample")
    axes.set_aspect("equal")
    axes.margins(0.1)
    axes.locator_params(axis="x", nbins=5)
    axes.set_xlabel("mm")
    axes.legend(fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.15), ncol=3)
    axes.set_title("from the side", pad=14)


def _profile(description: ReflectorDescription) -> tuple[np.ndarray, np.ndarray, float]:
    """Return radius and height of the mirror above its lower focus, and the focal distance, mm."""
    mirror = description.reflector
    across, along = (half.value for half in mirror.semi_axes_mm)
    focus = float(np.sqrt(max(along**2 - across**2, 0.0)))
    low, high = mirror.z_range_mm
    z = np.linspace(low, high, 200)
    inside = np.clip(1.0 - ((z - focus) / along) ** 2, 0.0, None)
    return across * np.sqrt(inside), z, focus


def _reflector(axes: Axes, description: ReflectorDescription) -> None:
    radius, z, focus = _profile(description)
    for sign in (-1.0, 1.0):
        axes.plot(sign * radius, z, color="tab:blue", lw=3)
    half = 0.5 * description.sample.diameter_mm.value
    axes.plot([-half, half], [0.0, 0.0], lw=5, color="black", label="sample")
    axes.plot([0.0, 0.0], [0.0, 2.0 * focus], "+", color="tab:red", label="foci")
    axes.set_aspect("equal")
    axes.set_xlabel("mm")
    axes.legend(fontsize=8)
    axes.set_title("mirror, from the side")


def _rays(axes: Axes, description: ReflectorDescription) -> None:
    radius, z, _ = _profile(description)
    axes.plot(radius, np.degrees(np.arctan2(radius, z)), color="tab:green", lw=3)
    axes.set_xlabel("distance from the axis in the picture, mm")
    axes.set_ylabel("polar angle at the sample, degrees")
    axes.set_title("polar angles that the mirror shows")

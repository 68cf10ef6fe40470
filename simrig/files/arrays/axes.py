"""The axes of an array: what a person calls them, and where their nodes lie."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from simrig.core.errors import SimrigError, unknown_name

# What people call the angles; the first is ours
NAMES: dict[str, tuple[str, ...]] = {
    "theta_i": ("theta_i", "thetai", "theta_in", "theta_l", "theta_light", "ti", "theta_inc"),
    "theta_v": (
        *("theta_v", "thetav", "theta_o", "theta_out", "theta_r", "theta_s", "theta_view"),
        *("thetar", "thetao", "thetas", "tv", "to", "tr", "ts"),
    ),
    "phi_i": ("phi_i", "phii", "phi_in", "phi_l", "phi_light", "pi", "phi_inc"),
    "phi_v": (
        *("phi_v", "phiv", "phi_o", "phi_out", "phi_r", "phi_s", "phi_view"),
        *("phir", "phio", "phis", "pv", "po", "pr", "ps"),
    ),
    "dphi": ("dphi", "delta_phi", "phi", "phi_diff", "phi_between"),
    "theta_h": ("theta_h", "thetah", "theta_half", "th"),
    "theta_d": ("theta_d", "thetad", "theta_diff", "td"),
    "phi_d": ("phi_d", "phid", "pd"),
    "rgb": ("rgb", "channel", "channels", "colour", "color", "c"),
    "xyz": ("xyz",),
    "wavelength": ("wavelength", "wavelengths", "lambda", "wl", "wls"),
}
COLOURS = ("rgb", "xyz", "wavelength")
SETS: tuple[frozenset[str], ...] = (
    frozenset({"theta_i", "theta_v", "phi_i", "phi_v"}),
    frozenset({"theta_i", "theta_v", "dphi"}),
    frozenset({"theta_h", "theta_d", "phi_d"}),
)
HELP = (
    "name its axes in their order, --axes theta_i,theta_v,phi_i,phi_v (or theta_i,theta_v,dphi, or "
    "theta_h,theta_d,phi_d; rgb, xyz or wavelength last or where it is)"
)
_USUAL_STEPS = (0.5, 1.0, 2.0, 2.5, 3.0, 5.0, 6.0, 7.5, 10.0, 15.0, 30.0)


@dataclass(frozen=True)
class Axis:
    """One axis of an array.

    Attributes:
        name: a key of ``NAMES``.
        first_deg, last_deg: of its nodes where the caller stated them, in degrees.
    """

    name: str
    first_deg: float | None = None
    last_deg: float | None = None


def parse(text: str) -> list[Axis]:
    """Return the axes that a text names: ``theta_i=0:75,theta_v=0:75,phi_i,phi_v,rgb``.

    Raises:
        SimrigError: an unknown name, one named twice, a range that cannot be, or axes that do not
            belong together.
    """
    axes = []
    known = {alias: name for name, aliases in NAMES.items() for alias in aliases}
    for word in text.replace(" ", "").lower().split(","):
        label, _, limits = word.partition("=")
        if label not in known:
            raise unknown_name("axis", label, NAMES)
        first, last = _limits(label, limits)
        axes.append(Axis(known[label], first, last))
    if any(axis.name == "theta_i" for axis in axes):  # there phi_d is the azimuth between
        axes = [replace(axis, name="dphi") if axis.name == "phi_d" else axis for axis in axes]
    names = [axis.name for axis in axes]
    if len(set(names)) != len(names):
        raise SimrigError(f"--axes names an axis twice: {text}")
    colours = [name for name in names if name in COLOURS]
    if frozenset(names) - set(COLOURS) not in SETS or len(colours) > 1:
        raise SimrigError(f"the axes {', '.join(names)} are no whole set of angles: {HELP}")
    return axes


def _limits(label: str, text: str) -> tuple[float | None, float | None]:
    if not text:
        return None, None
    try:
        numbers = [float(word) for word in text.split(":")]
    except ValueError:
        numbers = []
    if len(numbers) not in (2, 3) or not np.all(np.isfinite(numbers)) or numbers[0] >= numbers[-1]:
        raise SimrigError(
            f"the range '{label}={text}' is not FIRST:LAST or FIRST:STEP:LAST in degrees"
        )
    return numbers[0], numbers[-1]


def nodes(axis: Axis, count: int, stored: np.ndarray | None) -> tuple[np.ndarray, str]:
    """Return the nodes of an axis in degrees, and where they come from.

    Args:
        count: its length in the array.
        stored: nodes that the file holds, in degrees, None without.

    Raises:
        SimrigError: nodes that do not fit, or that cannot be told without being stated.
    """
    if axis.first_deg is not None and axis.last_deg is not None:
        return np.linspace(axis.first_deg, axis.last_deg, count), ""
    if stored is not None:
        if len(stored) != count:
            raise SimrigError(
                f"the file has {len(stored)} nodes of {axis.name}, its array {count} of them"
            )
        return stored, ""
    if axis.name in ("phi_i", "phi_v", "dphi"):
        return 360.0 / count * np.arange(count), f"{axis.name} assumed every {360.0 / count:g}°"
    if axis.name in ("theta_i", "theta_v"):
        return _usual(axis.name, count)
    raise SimrigError(f"the nodes of {axis.name} are not in the file: state {axis.name}=FIRST:LAST")


def _usual(name: str, count: int) -> tuple[np.ndarray, str]:
    """Return polar angles from 0 with the step that is a usual one, if only one of two is."""
    steps = {90.0 / count: 90.0 - 90.0 / count}
    if count > 1:
        steps[90.0 / (count - 1)] = 90.0
    usual = [s for s in steps if any(abs(s - u) < 1e-9 for u in _USUAL_STEPS)]
    if len(usual) != 1:
        stated = " or ".join(f"{name}=0:{last:g}" for last in steps.values())
        raise SimrigError(
            f"{count} polar angles of {name} may end anywhere: state their range, such as {stated}"
        )
    last = steps[usual[0]]
    return np.linspace(
        0.0, last, count
    ), f"{name} assumed 0° to {last:g}° in steps of {usual[0]:g}°"


def in_degrees(stored: dict[str, np.ndarray]) -> tuple[dict[str, np.ndarray], str]:
    """Return the nodes of a file in degrees, and what unit they were taken to be in.

    Nodes that fit into a quarter turn of radians, and azimuths into a whole one, are radians.
    """
    if not stored:
        return {}, ""
    steep = [float(np.abs(a).max()) for n, a in stored.items() if n.startswith("theta")]
    around = [float(np.abs(a).max()) for n, a in stored.items() if not n.startswith("theta")]
    radians = max(steep, default=0.0) <= np.pi / 2 + 1e-3 and max(around, default=0.0) <= 6.2842
    if radians and max([*steep, *around]) > 0.0:
        return {n: np.degrees(a) for n, a in stored.items()}, "nodes in radians"
    return stored, "nodes in degrees"

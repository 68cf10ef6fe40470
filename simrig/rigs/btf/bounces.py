"""How many reflections between the parts of a material its BTF needs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from simrig.core.cost import stopwatch
from simrig.core.effects import Bound, Decision, EffectPlan, Overrides, Tolerance, decide
from simrig.core.errors import SimrigError
from simrig.directions.spherical import to_vector
from simrig.mesostructure.tile import Tile
from simrig.rigs.btf.camera import TileCamera
from simrig.rigs.btf.orders import MOST_BOUNCES, ORDER, ORDERS
from simrig.rigs.tolerances import largest_change

_VIEWS, _LIGHTS = 5, 16  # that are looked at
_TEXELS, _SPP = 24, 16
_LARGEST_RATIO = 0.95  # of an order to the one before it, of what is beyond the last


@dataclass(frozen=True, eq=False)
class BouncesSubject:
    """What the bounds are about.

    Attributes:
        bounces: (k, n, 3) f_r that each order adds to texels of some pairs, the last with an
            estimate of all beyond it.
        theta_i: (n,) polar angles of the light in radians.
        seconds: that one order of all images takes.
    """

    bounces: np.ndarray
    theta_i: np.ndarray
    seconds: float


@dataclass(frozen=True)
class OrderEffect:
    """Light of one order of reflection (see ``simrig.core.effects.Effect``)."""

    order: int

    @property
    def name(self) -> str:
        """``order-2`` and so on."""
        return f"{ORDER}{self.order}"

    @property
    def description(self) -> str:
        """One line."""
        beyond = " or more" if self.order == MOST_BOUNCES else ""
        return f"light that the material reflected {self.order}{beyond} times"

    def bound(self, subject: BouncesSubject, tolerance: Tolerance) -> Bound:
        """Return what the order was measured to add."""
        added = subject.bounces[self.order - 1]
        whole = subject.bounces.sum(axis=0)
        value = largest_change(whole, added, subject.theta_i, tolerance)
        share = float(added.sum() / max(whole.sum(), 1e-30))
        text = f"measured, {100.0 * share:.2g} % of the light"
        return Bound(value, tolerance.unit, text, absent=value == 0.0)

    def cost(self, subject: BouncesSubject) -> float:
        """Return the seconds of one order."""
        return subject.seconds


def plan_bounces(
    tile: Tile,
    angles: np.ndarray,
    tolerance: Tolerance,
    overrides: Overrides | None = None,
    *,
    resolution: tuple[int, int],
    spp: int,
    seed: int = 0,
) -> EffectPlan:
    """Decide how many orders a measurement simulates; ``settings["bounces"]`` says it.

    Each order up to ``MOST_BOUNCES`` is rendered for a few pairs at few texels. What lies beyond
    the last is taken as a geometric series. A flat tile has one order only.

    Args:
        angles: (n, 4) theta_i, theta_v, phi_i, phi_v of the measurement, radians.
        tolerance: by how much all left-out orders together may change the images.
        resolution, spp: of the measurement, for the cost.

    Raises:
        SimrigError: overrides that name an unknown order, or leave one out below another.
    """
    effects = tuple(OrderEffect(int(name.removeprefix(ORDER))) for name in ORDERS)
    elapsed = stopwatch()
    if tile.height_mm[0] == tile.height_mm[1]:
        flat = np.zeros((MOST_BOUNCES, 1, 3))
        flat[0] = 1.0
        subject = BouncesSubject(flat, np.zeros(1), 0.0)
    else:
        subject = _probed(tile, angles, float(resolution[0]) * resolution[1] * spp, seed)
    decisions: tuple[Decision, ...] = decide(effects, subject, tolerance, overrides)
    on = [order for order, decision in enumerate(decisions, start=2) if decision.on]
    bounces = max(on, default=1)
    for name in (overrides or Overrides()).disable:
        if int(name.removeprefix(ORDER)) < bounces:
            raise SimrigError(
                f"light of {ORDER}{bounces} was of {name} before: disable all from {name} on"
            )
    settings = {"bounces": bounces}
    about = {"planning_seconds": elapsed()}
    return EffectPlan(decisions, settings, tolerance, about)


def _probed(tile: Tile, angles: np.ndarray, samples: float, seed: int) -> BouncesSubject:
    """Render all orders of a few pairs; ``samples`` per image tell the cost."""
    views = _spread(np.unique(angles[:, [1, 3]], axis=0), _VIEWS)
    lights = _spread(np.unique(angles[:, [0, 2]], axis=0), _LIGHTS)
    steepest = float(np.degrees(angles[:, :2].max()))
    texels = (_TEXELS, _TEXELS)
    towards = to_vector(lights[:, 0], lights[:, 1])
    camera = TileCamera(tile, towards, steepest, texels, _SPP, seed, grid=False)
    numbers = np.arange(len(lights))
    found: list[np.ndarray] = []
    seconds: list[float] = []
    for number, view in enumerate(to_vector(views[:, 0], views[:, 1])):
        elapsed = stopwatch()
        found.append(camera.view(view, numbers, MOST_BOUNCES, number).values)
        seconds.append(elapsed())
    bounces = np.concatenate(found, axis=1).astype(np.float64)  # (orders, pairs, H, W, 3)
    before, last = bounces[-2].sum(), bounces[-1].sum()
    ratio = min(last / before, _LARGEST_RATIO) if before > 0.0 else 0.0
    bounces[-1] /= 1.0 - ratio
    theta_i = np.repeat(np.tile(lights[:, 0], len(views)), _TEXELS**2)
    # the first view compiles
    per_image = min(seconds) / MOST_BOUNCES / len(lights) / (_TEXELS**2 * _SPP)
    total = per_image * samples * len(angles)
    return BouncesSubject(bounces.reshape(MOST_BOUNCES, -1, 3), theta_i, total)


def _spread(rows: np.ndarray, count: int) -> np.ndarray:
    """Return at most ``count`` rows, evenly apart in their order (by polar angle)."""
    places = np.linspace(0, len(rows) - 1, min(count, len(rows)))
    return rows[np.round(places).astype(int)]

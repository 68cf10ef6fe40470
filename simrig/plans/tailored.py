"""A plan tailored to the anisotropic highlights of a material (thesis section 3.1.5).

Axes and widths come from one picture under the reflector (``simrig reflector analyse``). Every
sample is put where the others are farthest away, and distances count more where half vectors lie
on a highlight: light and view are spread evenly, and up to twice as densely there. More than that
loses: interpolation in four dimensions suffers from every hole, even where samples follow the true
gradient.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np
from scipy.stats import qmc

from simrig.core.errors import SimrigError
from simrig.core.options import Option, numbers_of
from simrig.plans.protocol import THETA_MAX, ListedPlan, largest_theta_deg

if TYPE_CHECKING:
    from simrig.brdf.protocol import Brdf

LEAST_SAMPLES, MOST_SAMPLES = 20, 8_000
_CANDIDATES = 8  # for each sample
_GAIN, _NEXT = 0.5, 0.7  # of squared distances on a highlight; of each one over the one before
_REACH = 0.5  # radians of the half vector, where a highlight is expected to end


@dataclass(frozen=True)
class TailoredPlan(ListedPlan):
    """Samples spread evenly, and more densely along known highlights.

    Attributes:
        axes_deg: azimuths of the half vector where highlights extend, the strongest first.
        widths_deg: of the highlights, full width at half height; one for each axis.
        theta_max: largest polar angle, radians.
    """

    name: ClassVar[str] = "tailored"
    about: ClassVar[str] = "along the highlights that one picture under the reflector shows"
    options: ClassVar[tuple[Option, ...]] = (
        Option(
            "samples", int, "How many samples.", 1025, least=LEAST_SAMPLES, most=MOST_SAMPLES,
            short="-n",
        ),
        Option("axes", str, "Azimuths of the highlights in degrees, with commas: 30,120."),
        Option("widths", str, "Their widths in degrees, with commas; 40 each unless given."),
        THETA_MAX,
    )  # fmt: skip

    count: int
    axes_deg: tuple[float, ...]
    widths_deg: tuple[float, ...]
    theta_max: float

    def __post_init__(self) -> None:
        axes, widths = (tuple(float(v) for v in own) for own in (self.axes_deg, self.widths_deg))
        object.__setattr__(self, "axes_deg", axes)
        object.__setattr__(self, "widths_deg", widths)
        if not LEAST_SAMPLES <= self.count <= MOST_SAMPLES:
            raise SimrigError(
                f"a tailored plan has {LEAST_SAMPLES} to {MOST_SAMPLES} samples, got {self.count}"
            )
        if not 1 <= len(axes) <= 16 or len(axes) != len(widths):
            raise SimrigError(
                f"a tailored plan needs 1 to 16 axes and a width for each, got {len(axes)} and "
                f"{len(widths)}"
            )
        if not np.all(np.isfinite(axes)) or not all(0.0 < w <= 180.0 for w in widths):
            raise SimrigError("axes must be finite, and widths lie between 0 and 180 degrees")
        if not 0.0 < self.theta_max < 0.5 * np.pi:
            raise SimrigError("theta_max must lie between 0 and 90 degrees")

    @classmethod
    def for_material(  # type: ignore[override]
        cls,
        material: Brdf | None,
        samples: int = 1025,
        axes: str | None = None,
        widths: str | None = None,
        theta_max_deg: float | None = None,
    ) -> Self:
        """Return the plan that options give.

        Raises:
            SimrigError: no axes, or what cannot be.
        """
        if axes is None:
            raise SimrigError(
                "plan 'tailored' needs --axes, the azimuths of the highlights: 'simrig reflector "
                "analyse' finds them in a picture"
            )
        found = numbers_of(axes, "axes", float)
        wide = [40.0] * len(found) if widths is None else numbers_of(widths, "widths", float)
        end = float(np.radians(largest_theta_deg(material, theta_max_deg)))
        return cls(samples, tuple(found), tuple(wide), end)

    @property
    def samples(self) -> int:
        """How many samples the plan takes."""
        return self.count

    def angles(self) -> np.ndarray:
        """Return (n, 4) theta_i, theta_v, phi_i, phi_v in radians, in a fixed order."""
        return _angles(self)

    def describe(self) -> str:
        """Return the plan in words."""
        axes = ", ".join(
            f"{a:g}° ({w:g}° wide)" for a, w in zip(self.axes_deg, self.widths_deg, strict=True)
        )
        end = f"up to {np.degrees(self.theta_max):g}°"
        return f"{self.count} samples along highlights at {axes}, {end}"


@lru_cache(maxsize=4)
def _angles(plan: TailoredPlan) -> np.ndarray:
    """Return even candidates, chosen one by one where all chosen ones are farthest away."""
    u = qmc.Halton(4, rng=0).random(_CANDIDATES * plan.count)
    theta = 2.0 * np.arcsin(np.sqrt(u[:, :2]) * np.sin(0.5 * plan.theta_max))
    phi = 2.0 * np.pi * u[:, 2:]
    # directions less the normal, over the largest: no small differences of large numbers
    depth = -2.0 * np.sin(0.5 * theta) ** 2
    flat = np.sin(theta)[..., None] * np.stack([np.cos(phi), np.sin(phi)], axis=-1)
    own = np.concatenate([flat, depth[..., None]], axis=-1)
    half = own.sum(axis=1) + np.array([0.0, 0.0, 2.0])
    weight = 1.0 + _GAIN * _expected(plan, half)
    places = own.reshape(len(u), 6) / np.sin(plan.theta_max)
    swapped = places[:, [3, 4, 5, 0, 1, 2]]  # light and view may change places
    size = np.sum(places**2, axis=1)
    away, chosen = np.full(len(u), np.inf), np.empty(plan.count, dtype=np.int64)
    chosen[0] = int(np.argmax(weight))
    for k in range(1, plan.count):
        last = chosen[k - 1]
        near = np.maximum(places @ places[last], swapped @ places[last])
        away = np.minimum(away, size + size[last] - 2.0 * near)
        chosen[k] = int(np.argmax(away * weight))
    angles = np.concatenate([theta, phi], axis=1)[chosen]
    angles.flags.writeable = False
    return angles


def _expected(plan: TailoredPlan, half: np.ndarray) -> np.ndarray:
    """Return how much of a highlight is expected at half vectors (n, 3) of any length, (n,)."""
    phi = np.arctan2(half[:, 1], half[:, 0])
    theta = np.arctan2(np.hypot(half[:, 0], half[:, 1]), half[:, 2])
    found = np.zeros(len(half))
    for k, (axis, width) in enumerate(zip(plan.axes_deg, plan.widths_deg, strict=True)):
        kappa = np.log(2.0) / (1.0 - np.cos(np.radians(width)))
        found += _NEXT**k * np.exp(kappa * (np.cos(2.0 * (phi - np.radians(axis))) - 1.0))
    return np.asarray(found * np.exp(-((theta / _REACH) ** 2)))

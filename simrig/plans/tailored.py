"""A plan tailored to the anisotropic highlights of a material (thesis section 3.1.5).

Axes and widths come from one picture under the reflector (``simrig reflector analyse``). A share of
the samples fills all directions evenly, one gathers about specular reflection, the others along the
highlights: half vectors at azimuths near an axis, as widely spread as the highlight is.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np
from scipy.special import ndtri
from scipy.stats import qmc

from simrig.core.errors import SimrigError
from simrig.core.options import Option, numbers_of
from simrig.directions.half_difference import from_half_difference
from simrig.directions.spherical import to_angles
from simrig.plans.protocol import THETA_MAX, ListedPlan, largest_theta_deg

if TYPE_CHECKING:
    from simrig.brdf.protocol import Brdf

LEAST_SAMPLES, MOST_SAMPLES = 20, 20_000
_EVEN, _SPECULAR = 0.6, 0.15  # shares of the samples; the others lie along highlights
_SPECULAR_SLOPE = 0.25  # of half vectors
_LARGEST_H = np.radians(65.0)
_SIGMA = 2.355  # full width at half height over the standard deviation


@dataclass(frozen=True)
class TailoredPlan(ListedPlan):
    """Samples along known highlights, about specular reflection, and evenly.

    Attributes:
        count: of samples.
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
        even = round(_EVEN * self.count)
        specular = round(_SPECULAR * self.count)
        parts = [self._drawn(even, 0, None), self._drawn(specular, 1, (0.0, 0.0))]
        left = self.count - even - specular
        # the strongest highlight has the most samples
        shares = np.array([0.7**k for k in range(len(self.axes_deg))])
        ends = np.rint(np.cumsum(shares) / shares.sum() * left).astype(int)
        for k, (axis, width) in enumerate(zip(self.axes_deg, self.widths_deg, strict=True)):
            number = int(ends[k] - (ends[k - 1] if k else 0))
            parts.append(self._drawn(number, 2 + k, (axis, width)))
        return np.concatenate(parts)

    def describe(self) -> str:
        """Return the plan in words."""
        axes = ", ".join(
            f"{a:g}° ({w:g}° wide)" for a, w in zip(self.axes_deg, self.widths_deg, strict=True)
        )
        end = f"up to {np.degrees(self.theta_max):g}°"
        return f"{self.count} samples along highlights at {axes}, {end}"

    def _drawn(self, number: int, stream: int, about: tuple[float, float] | None) -> np.ndarray:
        """Return pairs of a low-discrepancy sequence: even, specular (width 0), or at an axis."""
        kept = np.empty((0, 4))
        sequence = qmc.Halton(4, rng=stream)
        while len(kept) < number:
            u = sequence.random(4 * number + 64)
            pairs = self._even(u) if about is None else self._from_half(u, *about)
            kept = np.concatenate([kept, pairs[(pairs[:, :2] <= self.theta_max).all(axis=1)]])
        return kept[:number]

    def _even(self, u: np.ndarray) -> np.ndarray:
        thetas = np.arccos(1.0 - u[:, :2] * (1.0 - np.cos(self.theta_max)))
        return np.concatenate([thetas, 2.0 * np.pi * u[:, 2:]], axis=1)

    def _from_half(self, u: np.ndarray, axis_deg: float, width_deg: float) -> np.ndarray:
        """Return pairs whose half vectors lie near the normal (width 0), or along an axis."""
        scale = min(self.theta_max / _LARGEST_H, 1.0)  # of angles: below a low end all are smaller
        theta_d, phi_d = scale * 0.5 * np.pi * np.sqrt(u[:, 2]), 2.0 * np.pi * u[:, 3]
        if width_deg == 0.0:
            theta_h = np.arctan(scale * _SPECULAR_SLOPE * np.sqrt(u[:, 0]))
            phi_h = 2.0 * np.pi * u[:, 1]
        else:
            theta_h = scale * _LARGEST_H * u[:, 0]
            side = np.where(u[:, 1] < 0.5, 0.0, np.pi)  # both ends of an axis
            spread = ndtri(np.clip((2.0 * u[:, 1]) % 1.0, 1e-6, 1.0 - 1e-6))
            phi_h = np.radians(axis_deg) + side + np.radians(width_deg) / _SIGMA * spread
        pair = from_half_difference(theta_h, phi_h, theta_d, phi_d)
        (theta_i, phi_i), (theta_v, phi_v) = map(to_angles, pair)
        return np.stack([theta_i, theta_v, phi_i, phi_v], axis=1)

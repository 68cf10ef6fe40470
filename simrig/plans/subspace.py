"""The plan of a whole azimuthal subspace: every azimuth of light with every one of view."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np

from simrig.core.errors import SimrigError
from simrig.core.options import Option
from simrig.plans.protocol import ListedPlan

if TYPE_CHECKING:
    from simrig.brdf.protocol import Brdf


@dataclass(frozen=True)
class SubspacePlan(ListedPlan):
    """All pairs of even azimuths at one polar angle of light and one of view (thesis 3.1.6).

    Attributes:
        theta_i, theta_v: radians, in (0, 90°).
        azimuths: of each, from 0 on.
    """

    name: ClassVar[str] = "subspace"
    about: ClassVar[str] = "all azimuths of light and view at one polar angle of each"
    options: ClassVar[tuple[Option, ...]] = (
        Option("subspace_theta_i", float, "Of light, degrees.", 50.0, least=0.0, most=90.0),
        Option("subspace_theta_v", float, "Of view, degrees.", 50.0, least=0.0, most=90.0),
        Option("azimuths", int, "Of light and of view each.", 360, least=12, most=720),
    )

    theta_i: float
    theta_v: float
    azimuths: int = 360

    def __post_init__(self) -> None:
        if not all(0.0 < theta < 0.5 * np.pi for theta in (self.theta_i, self.theta_v)):
            raise SimrigError("polar angles of a subspace must lie between 0 and 90 degrees")

    @classmethod
    def for_material(  # type: ignore[override]
        cls,
        material: Brdf | None,
        subspace_theta_i: float = 50.0,
        subspace_theta_v: float = 50.0,
        azimuths: int = 360,
    ) -> Self:
        """Return the plan that options give."""
        theta_i, theta_v = np.radians([subspace_theta_i, subspace_theta_v])
        return cls(float(theta_i), float(theta_v), azimuths)

    @property
    def theta_max(self) -> float:
        """The larger polar angle in radians."""
        return max(self.theta_i, self.theta_v)

    @property
    def samples(self) -> int:
        """How many samples the plan takes."""
        return self.azimuths**2

    def angles(self) -> np.ndarray:
        """Return (n, 4) theta_i, theta_v, phi_i, phi_v in radians, the view's azimuth first."""
        phi = 2.0 * np.pi * np.arange(self.azimuths) / self.azimuths
        light, view = (own.ravel() for own in np.meshgrid(phi, phi, indexing="ij"))
        same = np.ones(len(light))
        return np.stack([self.theta_i * same, self.theta_v * same, light, view], axis=1)

    def describe(self) -> str:
        """Return the plan in words."""
        theta_i, theta_v = np.degrees([self.theta_i, self.theta_v])
        return f"{self.azimuths} × {self.azimuths} azimuths at {theta_i:g}° and {theta_v:g}°"

    def probe(self, most: int) -> SubspacePlan:
        """Return the plan with fewer azimuths."""
        fewer = max(min(self.azimuths, int(most**0.5)), 12)
        return SubspacePlan(self.theta_i, self.theta_v, fewer)

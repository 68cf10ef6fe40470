"""The symmetries of a BRDF in half-difference angles, and the images of a sample under them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from simrig.core.arrays import Array, namespace
from simrig.core.errors import SimrigError
from simrig.directions.half_difference import HalfDifference

# what a symmetry makes of theta_h, phi_h, theta_d, phi_d
_SWAPPED, _TURNED = np.array([0.0, 0.0, 0.0, np.pi]), np.array([0.0, np.pi, 0.0, 0.0])
_MIRRORED = np.array([1.0, -1.0, 1.0, -1.0])
IMAGES: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "reciprocal": lambda angles: angles + _SWAPPED,
    "half_turn": lambda angles: angles + _TURNED,
    "mirror": lambda angles: angles * _MIRRORED,
}
"""The image of pairs (n, 4) under each symmetry, phi_h from the axis."""


@dataclass(frozen=True)
class Symmetry:
    """What leaves a BRDF as it is.

    Attributes:
        isotropic: turning both directions about the normal.
        reciprocal: swapping both directions.
        mirror: mirroring both in the plane of the normal and the main axis (of an isotropic BRDF:
            in any plane of the normal).
        half_turn: turning both by 180° about the normal; an isotropic BRDF has it anyway.
        axis: azimuth of the main axis, radians; of no meaning where isotropic.
        bivariate: phi_d does not matter; only what is isotropic, reciprocal and mirror symmetric.

    Raises:
        SimrigError: bivariate without what belongs to it.
    """

    isotropic: bool = False
    reciprocal: bool = False
    mirror: bool = False
    half_turn: bool = False
    axis: float = 0.0
    bivariate: bool = False

    def __post_init__(self) -> None:
        if self.bivariate and not (self.isotropic and self.reciprocal and self.mirror):
            raise SimrigError("only an isotropic, reciprocal, mirror symmetric BRDF is bivariate")

    @property
    def dimensions(self) -> int:
        """How many angles the BRDF depends on."""
        return 2 if self.bivariate else 3 if self.isotropic else 4

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for provenance."""
        return asdict(self)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Symmetry:
        """Return what ``as_dict`` described."""
        flags = {k: bool(values[k]) for k in ("isotropic", "reciprocal", "mirror", "half_turn")}
        bivariate = bool(values.get("bivariate", False))  # absent in files of before
        return cls(**flags, axis=float(values.get("axis", 0.0)), bivariate=bivariate)

    def describe(self) -> str:
        """Return the symmetries in words."""
        words = ["isotropic" if self.isotropic else "anisotropic"]
        words.append("reciprocal" if self.reciprocal else "not reciprocal")
        if self.bivariate:
            words.append("the same at all phi_d")
        elif self.isotropic:
            words.append("bilaterally symmetric" if self.mirror else "not bilaterally symmetric")
        else:
            words += ["mirror symmetric"] if self.mirror else []
            words += ["the same after half a turn"] if self.half_turn else []
            if self.mirror:
                words.append(f"axis at {np.degrees(self.axis):.0f}°")
        return ", ".join(words)

    def images(self, angles: np.ndarray) -> np.ndarray:
        """Return the images of direction pairs that have the same value.

        Args:
            angles: (n, 4) theta_h, phi_h, theta_d, phi_d in radians, phi_h from the axis.

        Returns:
            (i·n, 4): first the pairs themselves, then one image of all after the other. What an
            isotropic BRDF's coordinates do not see makes no image.
        """
        if self.bivariate:
            return angles  # all images have the same coordinates
        found = [angles]
        for name in ("reciprocal",) if self.isotropic else tuple(IMAGES):
            if getattr(self, name):
                found += [IMAGES[name](image) for image in found]
        return np.concatenate(found)

    def fold(self, at: HalfDifference) -> tuple[Array, Array]:
        """Return phi_h and phi_d of the image that a table holds (see ``extent``).

        Args:
            at: half-difference angles, phi_h from the axis, both azimuths in [0, 2π).
        """
        xp = namespace(at.theta_h)
        phi_h, phi_d = at.phi_h, at.phi_d
        if not self.isotropic:
            if self.half_turn:
                phi_h = xp.select(phi_h >= np.pi, phi_h - np.pi, phi_h)
            if self.mirror:
                half = 0.5 * self.extent[0]
                turned = phi_h > half
                phi_d = xp.select(turned, 2.0 * np.pi - phi_d, phi_d)
                phi_h = xp.select(turned, 2.0 * half - phi_h, phi_h)
        if self.reciprocal:
            phi_d = xp.select(phi_d >= np.pi, phi_d - np.pi, phi_d)
        if self.isotropic and self.mirror:
            half = 0.5 * self.extent[1]
            phi_d = xp.select(phi_d > half, 2.0 * half - phi_d, phi_d)
        return phi_h, phi_d

    @property
    def extent(self) -> tuple[float, float]:
        """The period of phi_h and of phi_d, radians; a mirror keeps half of one of them."""
        turn = np.pi if self.half_turn else 2.0 * np.pi
        return turn, (np.pi if self.reciprocal else 2.0 * np.pi)

    @property
    def folded(self) -> tuple[bool, bool]:
        """Whether half the period of phi_h, and of phi_d, is the mirror image of the other."""
        return (self.mirror and not self.isotropic, self.mirror and self.isotropic)

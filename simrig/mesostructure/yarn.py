"""Yarns: strands twisted about an axis, with hairs that stick out."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from simrig.core.errors import SimrigError
from simrig.mesostructure.bsdfs import fibre
from simrig.mesostructure.tile import Part
from simrig.mesostructure.tubes import frames, merged, periodic_noise, sweep, tangents, unit

_SIDES = 5  # of the section of a strand; a monofilament has twice as many


class _Yarns(NamedTuple):
    """Yarns along axes: their frames, half thicknesses and widths, and colours."""

    axes: np.ndarray
    up: np.ndarray
    side: np.ndarray
    a: np.ndarray
    b: np.ndarray
    base: np.ndarray

    @property
    def length(self) -> float:
        """Mean length in mm."""
        return float(np.linalg.norm(np.diff(self.axes, axis=1), axis=-1).sum(axis=1).mean())


@dataclass(frozen=True)
class Yarn:
    """A yarn with an elliptical section; lengths in mm.

    Attributes:
        colour: linear RGB albedo.
        width, thickness: of the section, in the plane of the fabric and across it.
        strands: bundles of fibres that show at the surface; 1 is a smooth monofilament.
        twist: turns per mm about the axis.
        look: BSDF of the strands, see ``simrig.mesostructure.bsdfs``.
        unevenness: relative variation of the thickness along the yarn.
        mottle: relative variation of the colour between strands and along them.
        hairs: fibres that stick out, per mm of yarn.
        hair_length: of those.
        hair_radius: of those.

    Raises:
        SimrigError: sizes that are not positive, or fewer than one strand.
    """

    colour: tuple[float, float, float]
    width: float
    thickness: float
    strands: int = 9
    twist: float = 1.0
    look: dict[str, Any] = field(default_factory=fibre)
    unevenness: float = 0.04
    mottle: float = 0.10
    hairs: float = 0.0
    hair_length: float = 0.6
    hair_radius: float = 0.012

    def __post_init__(self) -> None:
        least = min(self.width, self.thickness, self.hair_length, self.hair_radius)
        if not least > 0.0 or self.strands < 1:
            raise SimrigError(
                "a yarn needs width, thickness and hairs > 0 mm and one strand at least, got "
                f"{self.width:g} x {self.thickness:g} mm, {self.strands} strands"
            )

    def spin(
        self,
        axes: np.ndarray,
        reference: np.ndarray,
        rng: np.random.Generator,
        period: np.ndarray | None = None,
        colours: np.ndarray | None = None,
    ) -> Part:
        """Return the yarn along axes.

        Args:
            axes: (k, n, 3) mm.
            reference: direction of the thickness, broadcasting to the axes, see ``frames``.
            period: of axes that repeat with the tile, see ``simrig.mesostructure.tubes``.
            colours: (k, 3) linear RGB albedo per yarn instead of ``colour``.
        """
        count, points = axes.shape[:2]
        base = np.broadcast_to(self.colour if colours is None else colours, (count, 3))
        swell = 1.0 + self.unevenness * periodic_noise(count, points, 6, rng)
        swell = np.clip(swell, 0.6, 1.5)
        a, b = 0.5 * self.thickness * swell, 0.5 * self.width * swell
        if self.strands == 1:
            shade = self._mottled(base, 1, points, rng)
            return sweep(axes, (a, b), 2 * _SIDES + 2, self.look, shade, reference, period)
        yarns = _Yarns(axes, *frames(axes, reference, period), a, b, base)
        core, dark = (0.72 * a, 0.72 * b), 0.7 * base[:, None]
        parts = [
            sweep(axes, core, 2 * _SIDES, self.look, dark, reference, period),
            self._strands(yarns, rng, period),
        ]
        if self.hairs > 0.0:
            parts.append(self._hairs(yarns, rng, period is not None))
        return merged(parts)

    def _strands(self, yarns: _Yarns, rng: np.random.Generator, period: np.ndarray | None) -> Part:
        """Return the twisted strands, all at once: curve k · strands + s is strand s of yarn k."""
        (axes, up, side, a, b, base), length = yarns, yarns.length
        count, points = axes.shape[:2]
        turns = self.twist * length
        if period is not None:
            turns = np.round(turns)  # so that each strand meets its own copy
        along = np.linspace(0.0, 1.0, points)
        start = np.arange(self.strands)[None, :] / self.strands + rng.random((count, 1))
        phase = 2.0 * np.pi * (start[..., None] + turns * along)  # (k, strands, n)
        wander = periodic_noise(count * self.strands, points, 8, rng).reshape(phase.shape)
        phase = phase + 0.10 * wander
        radius = np.sin(np.pi / self.strands) / (1.0 + np.sin(np.pi / self.strands))
        reach = 1.0 - radius
        cos, sin = np.cos(phase)[..., None], np.sin(phase)[..., None]
        da, db = (reach * r[:, None, :, None] for r in (a, b))
        centres = axes[:, None] + da * cos * up[:, None] + db * sin * side[:, None]
        outward = unit(cos * up[:, None] + sin * side[:, None])
        thick = 1.15 * radius * np.sqrt(a * b)[:, None, :] * np.ones_like(phase)
        shape = (count * self.strands, points)
        shade = self._mottled(np.repeat(base, self.strands, axis=0), self.strands, points, rng)
        return sweep(
            centres.reshape(*shape, 3),
            thick.reshape(shape),
            _SIDES,
            self.look,
            shade,
            outward.reshape(*shape, 3),
            period,
        )

    def _mottled(
        self, base: np.ndarray, strands: int, points: int, rng: np.random.Generator
    ) -> np.ndarray:
        """Return the colour along each strand, (k, n, 3); the ends agree."""
        count = len(base)
        per_strand = rng.standard_normal((count, 1)) if strands > 1 else np.zeros((count, 1))
        along = periodic_noise(count, points, max(8, points // 6), rng)
        shade = np.exp(self.mottle * (0.7 * per_strand + 0.7 * along))
        return np.clip(base[:, None, :] * shade[..., None], 0.0, 0.95)

    def _hairs(self, yarns: _Yarns, rng: np.random.Generator, repeats: bool) -> Part:
        """Return single fibres that leave the surface of the yarn and bend along it."""
        (axes, up, side, a, b, base), length = yarns, yarns.length
        count, points = axes.shape[:2]
        number = max(1, round(self.hairs * length * count))
        k = rng.integers(0, count, number)
        i = rng.integers(0, points - 1 if repeats else points, number)
        phase = rng.uniform(0.0, 2.0 * np.pi, (number, 1))
        out = unit(np.cos(phase) * up[k, i] + np.sin(phase) * side[k, i])
        root = axes[k, i] + np.cos(phase) * (0.8 * a[k, i])[:, None] * up[k, i]
        root = root + np.sin(phase) * (0.8 * b[k, i])[:, None] * side[k, i]
        forward = tangents(axes)[k, i] * rng.choice([-1.0, 1.0], (number, 1))
        across = np.cross(out, forward)
        s = np.linspace(0.0, 1.0, 5)[None, :, None]
        reach = self.hair_length * rng.uniform(0.4, 1.4, (number, 1, 1))
        bend = rng.normal(0.0, 0.35, (number, 1, 1))
        curve = root[:, None] + reach * (
            (s - 0.55 * s**2) * out[:, None]
            + 0.8 * s**1.5 * forward[:, None]
            + bend * s**2 * across[:, None]
        )
        radius = np.broadcast_to(self.hair_radius * (1.0 - 0.6 * s[..., 0]), (number, 5))
        return sweep(curve, radius, 3, self.look, base[k][:, None], across[:, None])

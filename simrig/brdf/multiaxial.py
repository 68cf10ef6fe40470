"""A BRDF with any number of anisotropic modes, each with its own axis (thesis section 3.2)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from simrig.brdf.analytic import (
    checked_colour,
    checked_number,
    exp_or_zero,
    half_vector_terms,
    one_minus_v_dot_h,
)
from simrig.brdf.protocol import Brdf
from simrig.core.arrays import Array, components, namespace, read_only, scale
from simrig.core.errors import SimrigError

_TINY = 1e-12
_WIDTH_AT = np.tan(np.radians(25.0))  # slope of the half vector where widths are stated
ROUGHNESS = (0.005, 30.0)
_MOST_MODES = 16


@dataclass(frozen=True)
class Mode:
    """One anisotropic highlight.

    Attributes:
        colour: f_r where the half vector is the normal and both directions are, linear RGB, 1/sr.
        axis: azimuth of the half vector along which it extends, radians.
        m_along, m_across: slopes of the half vector at which it has fallen to 1/e.
        alpha: exponent of 1 / (cos θ_i cos θ_v), in [0, 1].
        grazing: by how much it grows towards v·h = 0, as (1 − v·h)⁵, in [0, 100].

    Raises:
        SimrigError: numbers out of range.
    """

    colour: tuple[float, float, float]
    axis: float
    m_along: float
    m_across: float
    alpha: float = 0.0
    grazing: float = 0.0

    def __post_init__(self) -> None:
        checked_colour("colour of a mode", self.colour)
        checked_number("axis of a mode in radians", self.axis, -100.0, 100.0)
        checked_number("m_along", self.m_along, *ROUGHNESS)
        checked_number("m_across", self.m_across, *ROUGHNESS)
        checked_number("alpha", self.alpha, 0.0, 1.0)
        checked_number("grazing", self.grazing, 0.0, 100.0)

    @classmethod
    def of(
        cls,
        axis_deg: float,
        width_deg: float,
        length_deg: float,
        strength: float,
        colour: tuple[float, float, float] = (1.0, 1.0, 1.0),
        **rest: float,
    ) -> Mode:
        """Return a mode by what is seen of it.

        Args:
            axis_deg: azimuth along which the highlight extends.
            width_deg: azimuth between the two halves of its height at θ_h = 25°, as one picture
                under the reflector shows it; in (0, 180).
            length_deg: θ_h at which it has fallen to half along its axis, in (0, 90).
            strength: its f_r at the normal, 1/sr.
            colour: linear RGB that the strength multiplies.
            rest: ``alpha``, ``grazing``.

        Raises:
            SimrigError: numbers out of range.
        """
        if not 0.0 < width_deg < 180.0 or not 0.0 < length_deg < 90.0:
            raise SimrigError(
                "a mode's width lies between 0 and 180 degrees and its length between 0 and 90, "
                f"got {width_deg:g} and {length_deg:g}"
            )
        checked_number("strength", strength, 0.0, 1e30)
        half = np.log(2.0)
        low, high = ROUGHNESS
        along = max(np.tan(np.radians(length_deg)) / np.sqrt(half), low)
        sine = max(np.sin(0.5 * np.radians(width_deg)), 0.1 * low)
        across = (along**-2.0 + half / (_WIDTH_AT * sine) ** 2) ** -0.5
        red, green, blue = (float(strength * c) for c in colour)
        return cls(
            (red, green, blue),
            float(np.radians(axis_deg)),
            float(np.clip(along, low, high)),
            float(np.clip(across, low, high)),
            **rest,
        )

    @property
    def width_deg(self) -> float:
        """Azimuth between the halves of its height at θ_h = 25°, degrees; 180 where it has none."""
        steeper = self.m_across**-2.0 - self.m_along**-2.0
        if steeper * _WIDTH_AT**2 <= np.log(2.0):
            return 180.0
        return float(2.0 * np.degrees(np.arcsin(np.sqrt(np.log(2.0) / steeper) / _WIDTH_AT)))


_FIELDS = tuple(field.name for field in fields(Mode))


@dataclass(frozen=True)
class _ModeParameters:
    colour: Array
    axis: Array
    m_along: Array
    m_across: Array
    alpha: Array
    grazing: Array


@dataclass(frozen=True)
class _Parameters:
    k_d: Array
    modes: tuple[_ModeParameters, ...]


@dataclass(eq=False)
class Multiaxial(Brdf):
    """A diffuse part and modes of anisotropy, each with its own axis, width, strength and colour.

    f_r = k_d/π + Σ colour · exp(−(s_along²/m_along² + s_across²/m_across²)) / cos⁴ θ_h / (v·h)
    · (1 + grazing (1 − v·h)⁵) / (cos θ_i cos θ_v)^alpha, with s the slope of the half vector along
    a mode's axis and across it: Beckmann's distribution with a free axis, height and fall-off.

    Source: thesis section 3.2 (any number of modes, each fitted by itself along stencils of
    constant φ_h). The thesis prints no formula; this one is ours.

    Args:
        k_d: diffuse coefficient, linear RGB (divided by π).
        modes: 1 to 16.

    Raises:
        SimrigError: numbers out of range, or too many modes.
    """

    kind = "multiaxial"

    k_d: tuple[float, float, float]
    modes: tuple[Mode, ...]
    name: str = "multiaxial"

    def __post_init__(self) -> None:
        checked_colour("k_d", self.k_d)
        if not 1 <= len(self.modes) <= _MOST_MODES:
            raise SimrigError(f"a BRDF has 1 to {_MOST_MODES} modes, got {len(self.modes)}")

    def data(self) -> Mapping[str, np.ndarray]:
        data = {"k_d": read_only(self.k_d, np.float64)}
        for index, mode in enumerate(self.modes, start=1):
            for key in _FIELDS:
                data[f"mode_{index}_{key}"] = read_only(getattr(mode, key), np.float64)
        return data

    def structure(self) -> dict[str, Any]:
        return {"modes": len(self.modes)}

    @classmethod
    def from_parts(
        cls, structure: Mapping[str, Any], data: Mapping[str, np.ndarray], name: str
    ) -> Multiaxial:
        modes = tuple(
            Mode(
                tuple(data[f"mode_{index}_colour"].tolist()),
                *(float(data[f"mode_{index}_{key}"]) for key in _FIELDS[1:]),
            )
            for index in range(1, int(structure["modes"]) + 1)
        )
        return cls(tuple(data["k_d"].tolist()), modes, name)

    def prepare(self, data: Mapping[str, Array], differentiable: bool = True) -> _Parameters:
        modes = tuple(
            _ModeParameters(**{key: data[f"mode_{index}_{key}"] for key in _FIELDS})
            for index in range(1, len(self.modes) + 1)
        )
        return _Parameters(data["k_d"], modes)

    def look_up(self, wi: Array, wv: Array, tables: _Parameters) -> Array:
        x, y, z, squared, v_dot_h = half_vector_terms(wi, wv)
        xp = namespace(x)
        cosines = xp.maximum(components(wi)[2] * components(wv)[2], _TINY)
        log_cosines = xp.log(cosines)
        slope_x, slope_y = x / z, y / z
        v_dot_h = xp.maximum(v_dot_h, 1e-6)
        cos_squared = xp.maximum(z * z / squared, 1e-8)
        spread = 1.0 / (cos_squared * cos_squared * v_dot_h)
        one_minus = one_minus_v_dot_h(wi, wv, v_dot_h)
        schlick = one_minus * one_minus * one_minus * one_minus * one_minus
        value = scale(tables.k_d, 0.0 * z + 1.0 / np.pi)
        for mode in tables.modes:
            cos, sin = xp.cos(mode.axis), xp.sin(mode.axis)
            along = (cos * slope_x + sin * slope_y) / mode.m_along
            across = (cos * slope_y - sin * slope_x) / mode.m_across
            exponent = -(along * along + across * across) - mode.alpha * log_cosines
            height = exp_or_zero(exponent) * spread * (1.0 + mode.grazing * schlick)
            value = value + scale(mode.colour, height)
        return value

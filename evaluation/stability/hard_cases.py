"""The hard cases of direction pairs and of values, in one list.

Every BRDF, plugin, parameterisation and method is run against them. Directions are unit
vectors in float64, shape (n, 3), of the upper hemisphere unless the case says otherwise.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from simrig.core.errors import unknown_name
from simrig.directions import to_vector

ROUGHNESS = (0.005, 0.01, 0.05, 0.2, 1.0, 3.0)
BRDF_VALUES = (0.0, 1e-12, 1e-6, 1e-3, 1.0, 1e3, 1e6)  # f_r in 1/sr; more than 28 EV apart

Pair = tuple[np.ndarray, np.ndarray]
_CASES: dict[str, tuple[str, Callable[[np.random.Generator, int], Pair]]] = {}


@dataclass(frozen=True, eq=False)
class HardCase:
    """One hard case.

    Attributes:
        name: short, with hyphens.
        wi, wv: illumination and view directions, shape (n, 3), float64.
    """

    name: str
    description: str
    wi: np.ndarray
    wv: np.ndarray


def _case(name: str, description: str) -> Callable:
    def register(make: Callable[[np.random.Generator, int], Pair]) -> Callable:
        _CASES[name] = (description, make)
        return make

    return register


def case_names() -> tuple[str, ...]:
    """Return the names of all hard cases."""
    return tuple(_CASES)


def hard_case(name: str, count: int = 128, seed: int = 0) -> HardCase:
    """Return one hard case.

    Args:
        name: one of ``case_names()``.
        seed: of the random directions; each case has its own stream.

    Raises:
        SimrigError: unknown name.
    """
    if name not in _CASES:
        raise unknown_name("hard case", name, _CASES)
    description, make = _CASES[name]
    rng = np.random.default_rng([seed, *name.encode()])
    wi, wv = make(rng, count)
    return HardCase(name, description, _unit(wi), _unit(wv))


def hard_cases(count: int = 128, seed: int = 0) -> list[HardCase]:
    """Return all hard cases with ``count`` direction pairs each."""
    return [hard_case(name, count, seed) for name in _CASES]


def _unit(v: np.ndarray) -> np.ndarray:
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def _azimuths(rng: np.random.Generator, count: int) -> np.ndarray:
    return rng.uniform(0.0, 2.0 * np.pi, count)


def _between(
    rng: np.random.Generator, count: int, low_deg: float, high_deg: float = 90.0
) -> np.ndarray:
    """Return directions with polar angles between two angles."""
    theta = np.radians(rng.uniform(low_deg, high_deg, count))
    return to_vector(theta, _azimuths(rng, count))


def _anywhere(rng: np.random.Generator, count: int) -> np.ndarray:
    """Return directions uniform on the hemisphere."""
    z = rng.uniform(0.0, 1.0, count)
    return to_vector(np.arccos(z), _azimuths(rng, count))


def _tiny(rng: np.random.Generator, count: int) -> np.ndarray:
    """Return numbers from 1e-12 to 1e-2, uniform in the exponent."""
    return 10.0 ** rng.uniform(-12.0, -2.0, count)


def _tilted(rng: np.random.Generator, v: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Return ``v`` tilted by small angles towards random directions, kept above the horizon."""
    aside = np.cross(v, _anywhere(rng, len(v)))
    tilted = v + angle[:, None] * _unit(aside)
    tilted[:, 2] = np.abs(tilted[:, 2])
    return tilted


@_case("random", "uniform on the hemisphere")
def _random(rng: np.random.Generator, count: int) -> Pair:
    return _anywhere(rng, count), _anywhere(rng, count)


@_case("grazing-one", "illumination at 80° to 89.999°, view anywhere")
def _grazing_one(rng: np.random.Generator, count: int) -> Pair:
    # uniform in the logarithm of the height above the horizon
    theta = 90.0 - 10.0 ** rng.uniform(-3.0, 1.0, count)
    return to_vector(np.radians(theta), _azimuths(rng, count)), _anywhere(rng, count)


@_case("grazing-both", "both at 75° to 90°")
def _grazing_both(rng: np.random.Generator, count: int) -> Pair:
    return _between(rng, count, 75.0), _between(rng, count, 75.0)


@_case("horizon", "both within 1e-12 to 1e-2 rad of the horizon")
def _horizon(rng: np.random.Generator, count: int) -> Pair:
    def low() -> np.ndarray:
        return _unit(np.column_stack([*_circle(rng, count), _tiny(rng, count)]))

    return low(), low()


def _circle(rng: np.random.Generator, count: int) -> Pair:
    phi = _azimuths(rng, count)
    return np.cos(phi), np.sin(phi)


@_case("pole-one", "view exactly at the normal")
def _pole_one(rng: np.random.Generator, count: int) -> Pair:
    return _anywhere(rng, count), np.tile([0.0, 0.0, 1.0], (count, 1))


@_case("pole-both", "both within 1e-12 to 1e-2 rad of the normal, the first pair exactly there")
def _pole_both(rng: np.random.Generator, count: int) -> Pair:
    wi = to_vector(_tiny(rng, count), _azimuths(rng, count))
    wv = to_vector(_tiny(rng, count), _azimuths(rng, count))
    wi[0] = wv[0] = (0.0, 0.0, 1.0)
    return wi, wv


@_case("mirror", "exactly mirrored about the normal: theta_h = 0")
def _mirror(rng: np.random.Generator, count: int) -> Pair:
    wi = _anywhere(rng, count)
    return wi, wi * [-1.0, -1.0, 1.0]


@_case("near-mirror", "theta_h of 1e-12 to 1e-2 rad")
def _near_mirror(rng: np.random.Generator, count: int) -> Pair:
    wi, wv = _mirror(rng, count)
    return wi, _tilted(rng, wv, _tiny(rng, count))


@_case("retro", "the same direction twice: theta_d = 0")
def _retro(rng: np.random.Generator, count: int) -> Pair:
    wi = _anywhere(rng, count)
    return wi, wi.copy()


@_case("near-retro", "directions 1e-12 to 1e-2 rad apart")
def _near_retro(rng: np.random.Generator, count: int) -> Pair:
    wi = _anywhere(rng, count)
    return wi, _tilted(rng, wi, _tiny(rng, count))


@_case("equal-theta", "equal polar angles, any azimuths: the diagonal of a table")
def _equal_theta(rng: np.random.Generator, count: int) -> Pair:
    theta = np.arccos(rng.uniform(0.0, 1.0, count))
    return to_vector(theta, _azimuths(rng, count)), to_vector(theta, _azimuths(rng, count))


@_case(
    "azimuth-wrap", "azimuths and their difference at 0, 90°, ..., ±1 ulp in float32 and float64"
)
def _azimuth_wrap(rng: np.random.Generator, count: int) -> Pair:
    quarter = np.pi / 2 * rng.integers(0, 5, (2, count))
    ulps = rng.integers(-1, 2, (2, count))
    spacing = np.where(rng.random((2, count)) < 0.5, np.spacing(quarter), np.float64(2.4e-7))
    theta = np.arccos(rng.uniform(0.0, 1.0, (2, count)))
    wi, wv = to_vector(theta, quarter + ulps * spacing)
    return wi, wv


@_case("grid", "exactly on and ±1 ulp beside the nodes of 2°, 5° and 15° tables")
def _grid(rng: np.random.Generator, count: int) -> Pair:
    step = rng.choice([2.0, 5.0, 15.0], count)
    theta = np.radians(step * np.floor(rng.uniform(0.0, 81.0, (2, count)) / step))
    phi = np.radians(step * np.floor(rng.uniform(0.0, 360.0, (2, count)) / step))
    theta = np.abs(theta + rng.integers(-1, 2, theta.shape) * np.spacing(theta))
    wi, wv = to_vector(theta, phi + rng.integers(-1, 2, phi.shape) * np.spacing(phi))
    return wi, wv


@_case("opposite", "opposite to within 0 to 1e-2 rad: both at the horizon, half vector undefined")
def _opposite(rng: np.random.Generator, count: int) -> Pair:
    wi = np.column_stack([*_circle(rng, count), _tiny(rng, count)])
    wv = _tilted(rng, -wi, _tiny(rng, count))
    wi[0], wv[0] = (1.0, 0.0, 1e-12), (-1.0, 0.0, 1e-12)
    return wi, wv


@_case("denormal", "components from the smallest denormal of float64 to the normals of float32")
def _denormal(rng: np.random.Generator, count: int) -> Pair:
    def small() -> np.ndarray:
        return np.maximum(10.0 ** rng.uniform(-324.0, -37.0, count), np.nextafter(0.0, 1.0))

    at_pole = np.column_stack([small(), -small(), np.ones(count)])
    at_horizon = np.column_stack([*_circle(rng, count), small()])
    beside_axis = np.column_stack([small(), np.ones(count), rng.uniform(0.1, 1.0, count)])
    kinds = np.stack([at_pole, at_horizon, beside_axis])
    pick, row = rng.integers(0, 3, (2, count)), np.arange(count)
    return kinds[pick[0], row], kinds[pick[1], row]


@_case("bit-patterns", "every bit of every component at random, scaled to unit length")
def _bit_patterns(rng: np.random.Generator, count: int) -> Pair:
    def any_bits() -> np.ndarray:
        bits = rng.integers(0, 2**64, (count, 3), dtype=np.uint64, endpoint=False)
        v = bits.view(np.float64)
        exponent = rng.integers(-1000, 1, v.shape)  # of comparable size in some, not in others
        near = rng.random((count, 1)) < 0.5
        mantissa = np.frexp(np.where(np.isfinite(v), v, 0.5))[0]
        return np.ldexp(mantissa, np.where(near, exponent % 8, exponent))

    def upper() -> np.ndarray:
        v = any_bits()
        v[:, 2] = np.abs(v[:, 2])
        return np.ldexp(v, -np.frexp(np.abs(v).max(axis=-1, keepdims=True))[1])

    return upper(), upper()

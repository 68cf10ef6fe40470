"""Schemes that cover the hemisphere with directions: rings of equal polar angle.

Published, reproduced exactly:

- ``hemisphere_81``: Sattler et al. 2003 (Bonn BTF, UTIA BRDF): polar angles every 15°.
- ``hemisphere_151``: Müller 2009 (Bonn, UBO2014): ten polar angles, some rings turned by half a
  step.
- ``uniform_1``, ``uniform_14``, ``uniform_19``, ``uniform_30``: thesis Table D.2.

The thesis describes thirty uniform schemes, from 29 to 841 directions, and prints those four.
The other twenty-six follow the pattern of the four, **inferred** here:

- Everything lies on the 2° grid of the reference data. Polar angles are multiples of the smallest
  even step that reaches 80° in ``rings`` steps, the last one cut to 80°.
- Azimuth steps come from one ladder, the even divisors of 180° from 60° to 6°: 60, 36, 30, 20,
  18, 12, 10, 6. Every ring outwards goes one rung further; after the last rung it stays at 6°.
  Moving the start of the ladder up by ``shift`` rungs gives a denser scheme with the same
  polar angles.
- Sparse schemes stay on the ladder: 3 to 8 rings, every shift up to the number of rings with
  rings + shift <= 8. There are nineteen. Dense schemes run off it: polar angle steps of 10°, 8° and
  6° with shifts 0, 1, 2 and 7 (all rings at 6°). There are eleven more.

Sorted by their number of directions, which is different for all, the four printed schemes come
out at their printed numbers 1, 14, 19 and 30.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from simrig.core.errors import SimrigError, check_known
from simrig.directions.spherical import to_vector

_LADDER_DEG = (60, 36, 30, 20, 18, 12, 10, 6)  # azimuth steps of the uniform schemes
LARGEST_THETA_DEG = 80.0  # that of the thesis; real arms do not reach much further


@dataclass(frozen=True)
class Ring:
    """Directions of one polar angle: ``count`` of them, the first at ``offset_deg``."""

    theta_deg: float
    count: int
    offset_deg: float = 0.0


@dataclass(frozen=True, eq=False)
class HemisphereScheme:
    """A list of directions that cover the hemisphere.

    Attributes:
        theta: polar angles from the normal, shape (n,), radians in [0, π/2]. Read-only.
        phi: azimuths, shape (n,), radians in [0, 2π]. Read-only.

    Raises:
        SimrigError: the arrays are empty, differ in shape, or hold an angle out of range.
    """

    name: str
    theta: np.ndarray
    phi: np.ndarray

    def __post_init__(self) -> None:
        for key, largest in (("theta", np.pi / 2), ("phi", 2.0 * np.pi)):
            angles = np.array(getattr(self, key), dtype=np.float64)
            inside = (angles >= 0.0) & (angles <= largest)  # false for NaN
            if angles.ndim != 1 or angles.size == 0 or not inside.all():
                raise SimrigError(
                    f"{key} of scheme '{self.name}' must be a list of angles in "
                    f"[0, {np.degrees(largest):g}] degrees (given in radians)"
                )
            angles.flags.writeable = False
            object.__setattr__(self, key, angles)
        if self.theta.shape != self.phi.shape:
            raise SimrigError(
                f"scheme '{self.name}' needs as many phi as theta, "
                f"got {self.phi.size} and {self.theta.size}"
            )

    def __len__(self) -> int:
        return self.theta.size

    @property
    def pair_count(self) -> int:
        """Number of (illumination, view) pairs, n²."""
        return len(self) ** 2

    @property
    def reciprocal_count(self) -> int:
        """Number of pairs when ω_i and ω_v may be exchanged, n(n+1)/2."""
        return len(self) * (len(self) + 1) // 2

    def vectors(self) -> np.ndarray:
        """Return the directions as unit vectors, shape (n, 3)."""
        return to_vector(self.theta, self.phi)

    def pair_angles(self, reciprocal: bool) -> np.ndarray:
        """Return theta_i, theta_v, phi_i, phi_v of all pairs of directions, (m, 4) radians.

        Args:
            reciprocal: each unordered pair once, the direction that comes first as illumination
                (with rings: the one closer to the normal); else all ordered pairs.
        """
        count = len(self)
        all_pairs = np.indices((count, count)).reshape(2, -1)
        first, second = np.triu_indices(count) if reciprocal else all_pairs
        angles = (self.theta[first], self.theta[second], self.phi[first], self.phi[second])
        return np.stack(angles, axis=1)

    @classmethod
    def from_rings(cls, name: str, rings: Iterable[Ring | Sequence[float]]) -> HemisphereScheme:
        """Return the scheme of rings (or their values), in their order, azimuths ascending."""
        theta, phi = [], []
        for given in rings:
            ring = given if isinstance(given, Ring) else Ring(given[0], int(given[1]), *given[2:])
            theta += [ring.theta_deg] * ring.count
            phi += [ring.offset_deg + 360.0 * index / ring.count for index in range(ring.count)]
        return cls(name, np.radians(theta), np.radians(phi))


def hemisphere_81() -> HemisphereScheme:
    """Return the 81 directions of Sattler et al. 2003, at 0°, 15°, ..., 75°."""
    counts = (1, 6, 12, 18, 20, 24)
    rings = (Ring(15.0 * index, count) for index, count in enumerate(counts))
    return HemisphereScheme.from_rings("hemisphere_81", rings)


def hemisphere_151() -> HemisphereScheme:
    """Return the 151 directions of Müller 2009, in the order of the UBO2014 data.

    The data give the rule: the azimuths of a ring start at 0, or at half a step in the rings at
    30° and 67.5°, at 15° in the ring at 11°, and at 7.5° in the ring at 52.5°.
    """
    rings = (
        Ring(0.0, 1),
        Ring(11.0, 6, 15.0),
        Ring(23.5, 12),
        Ring(30.0, 12, 15.0),
        Ring(37.5, 12),
        Ring(45.0, 18),
        Ring(52.5, 18, 7.5),
        Ring(60.0, 24),
        Ring(67.5, 24, 7.5),
        Ring(75.0, 24),
    )
    return HemisphereScheme.from_rings("hemisphere_151", rings)


def _uniform_rings(count: int, shift: int) -> tuple[Ring, ...]:
    """Return the pole and ``count`` rings whose azimuth steps start ``shift`` rungs up."""
    step_deg = 2 * -(
        -int(LARGEST_THETA_DEG) // (2 * count)
    )  # the smallest even step that reaches the end
    rings = [Ring(0.0, 1)]
    for index in range(count):
        azimuth_step_deg = _LADDER_DEG[min(index + shift, len(_LADDER_DEG) - 1)]
        theta_deg = min((index + 1) * step_deg, int(LARGEST_THETA_DEG))
        rings.append(Ring(float(theta_deg), 360 // azimuth_step_deg))
    return tuple(rings)


@functools.cache
def _uniform_schemes() -> tuple[tuple[Ring, ...], ...]:
    """Return the rings of the thirty uniform schemes, sparsest first."""
    rungs = len(_LADDER_DEG)
    sparse = [(n, shift) for n in range(3, rungs + 1) for shift in range(min(n, rungs - n) + 1)]
    # 8, 10 and 14 rings are polar angle steps of 10, 8 and 6 degrees; (8, 0) is on the ladder
    dense = [(n, shift) for n in (8, 10, 14) for shift in (0, 1, 2, rungs - 1)][1:]
    schemes = [_uniform_rings(*choice) for choice in sparse + dense]
    return tuple(sorted(schemes, key=lambda rings: sum(ring.count for ring in rings)))


def uniform_scheme(index: int) -> HemisphereScheme:
    """Return the uniform scheme number ``index`` (1 to 30) of thesis section D.3.

    Schemes 1, 14, 19 and 30 are as printed, the others as the module's docstring says.

    Raises:
        SimrigError: the index is not in 1 to 30.
    """
    schemes = _uniform_schemes()
    if not 1 <= index <= len(schemes):
        raise SimrigError(f"uniform schemes are numbered 1 to {len(schemes)}, got {index}")
    return HemisphereScheme.from_rings(f"uniform_{index}", schemes[index - 1])


SCHEMES: Mapping[str, Callable[[], HemisphereScheme]] = MappingProxyType(
    {"hemisphere_81": hemisphere_81, "hemisphere_151": hemisphere_151}
    | {f"uniform_{index}": functools.partial(uniform_scheme, index) for index in range(1, 31)}
)


def scheme(name: str) -> HemisphereScheme:
    """Return a scheme by name: a key of ``SCHEMES``.

    Raises:
        SimrigError: unknown name, with the nearest known one.
    """
    check_known("scheme", name, SCHEMES)
    return SCHEMES[name]()

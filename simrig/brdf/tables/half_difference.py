"""A table of logarithms in half-difference angles, fitted to highlights and symmetry."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from itertools import product
from typing import Any

import numpy as np

from simrig.brdf.kriging.coordinates import EVEN, Stretch
from simrig.brdf.kriging.symmetry import Symmetry
from simrig.brdf.protocol import Brdf
from simrig.brdf.tables.packed import PlainColours
from simrig.core.arrays import (
    Array,
    components,
    multiply_add,
    namespace,
    read_only,
    scale,
    to_index,
)
from simrig.core.errors import SimrigError
from simrig.directions.half_difference import HalfDifference, to_half_difference

HALF = 0.5 * np.pi
_LARGEST_LOG = 80.0  # exp of it is a float32


@dataclass(frozen=True)
class Logarithms:
    """What a look-up reads; plain, since packed logarithms would lose what f_r needs."""

    table: PlainColours
    profile: PlainColours | None


class HalfDifferenceTable(Brdf):
    """log(f_r · cos(theta_i)^power + floor) over theta_h, phi_h, theta_d, phi_d, multilinear.

    theta_h has nodes at equal steps of a stretched angle, dense where highlights are narrow. The
    azimuths cover what the symmetry leaves of a turn. f_r is continuous at theta_h = 0, at equal
    directions and around all azimuths if the nodes there agree, as those of a reconstruction do.
    Beyond the largest polar angles with samples the table holds what was continued there; below
    the smallest cosine f_r is held. A curve over theta_h may be added to the logarithms, finer than
    the table.

    Args:
        logs: (n_theta_h, n_phi_h, n_theta_d, n_phi_d, 3), finite; n_phi_h is 1 when isotropic.
        stretch: of theta_h.
        floor: under the logarithm, >= 0, in the unit of f_r.
        power: of the cosine of theta_i, 0 or 1.
        theta_max: largest polar angle with samples, radians.
        stretch_d: of theta_d.
        profile: (m, 3) the curve, at even steps of the stretched theta_h, or None.
        dark_beyond: f_r is 0 where a direction lies beyond ``theta_max``.

    Raises:
        SimrigError: shape or values that cannot be.
    """

    kind = "half_difference"

    def __init__(
        self,
        logs: np.ndarray,
        symmetry: Symmetry,
        stretch: Stretch,
        floor: float,
        power: int,
        theta_max: float,
        name: str = "half_difference",
        stretch_d: Stretch = EVEN,
        profile: np.ndarray | None = None,
        dark_beyond: bool = False,
    ):
        logs = np.asarray(logs, dtype=np.float32)
        if logs.ndim != 5 or logs.shape[4] != 3 or min(logs.shape[0], *logs.shape[2:4]) < 2:
            raise SimrigError(
                "a half-difference table must have shape (theta_h, phi_h, theta_d, phi_d, 3) with "
                f"two nodes or more of each angle but phi_h, got {logs.shape}"
            )
        if symmetry.isotropic != (logs.shape[1] == 1):
            raise SimrigError("phi_h has one node in an isotropic table, and more in any other")
        curve = np.zeros((2, 3)) if profile is None else np.asarray(profile, dtype=np.float32)
        if curve.ndim != 2 or curve.shape[1] != 3 or len(curve) < 2:
            raise SimrigError(f"the profile of table '{name}' must have shape (2 or more, 3)")
        largest = logs.max() + max(curve.max(), 0.0)
        if not (np.all(np.isfinite(logs)) and np.all(np.isfinite(curve))) or largest > _LARGEST_LOG:
            raise SimrigError(f"table '{name}' holds values that are not finite or too large")
        if not (np.isfinite(floor) and floor >= 0.0) or power not in (0, 1):
            raise SimrigError(f"table '{name}' needs a floor >= 0 and a power of 0 or 1")
        if not 0.0 < theta_max <= HALF:
            raise SimrigError(f"table '{name}' needs a largest theta in (0, 90] degrees")
        if not all(s.width > 0.0 and 0.0 <= s.linear <= 1.0 for s in (stretch, stretch_d)):
            raise SimrigError(f"table '{name}' needs a width > 0 and a linear share in [0, 1]")
        if symmetry.reciprocal and power:
            raise SimrigError("a reciprocal table cannot hold the cosine of one direction")
        self.logs, self.symmetry, self.stretch = read_only(logs), symmetry, stretch
        self.stretch_d, self.profile = stretch_d, None if profile is None else read_only(curve)
        self.floor, self.power, self.name = float(floor), int(power), name
        self.theta_max, self.reciprocal = float(theta_max), symmetry.reciprocal
        self.dark_beyond = bool(dark_beyond)

    @property
    def stored_bytes(self) -> int:
        """Size of the table and its profile."""
        return sum(int(values.nbytes) for values in self.data().values())

    def data(self) -> Mapping[str, np.ndarray]:
        return {"logs": self.logs} | ({} if self.profile is None else {"profile": self.profile})

    def structure(self) -> dict[str, Any]:
        return {
            **asdict(self.symmetry),
            **asdict(self.stretch),
            "width_d": self.stretch_d.width,
            "linear_d": self.stretch_d.linear,
            "floor": self.floor,
            "power": self.power,
            "theta_max": self.theta_max,
            "dark_beyond": self.dark_beyond,
        }

    @classmethod
    def from_parts(
        cls, structure: Mapping[str, Any], data: Mapping[str, np.ndarray], name: str
    ) -> HalfDifferenceTable:
        return cls(
            data["logs"],
            Symmetry.from_dict(structure),
            Stretch(float(structure["width"]), float(structure["linear"])),
            float(structure["floor"]),
            int(structure["power"]),
            float(structure["theta_max"]),
            name,
            Stretch(float(structure["width_d"]), float(structure["linear_d"])),
            data.get("profile"),
            bool(structure.get("dark_beyond", False)),  # absent in files of before
        )

    def prepare(self, data: Mapping[str, Array], differentiable: bool = True) -> Logarithms:
        profile = PlainColours(data["profile"]) if "profile" in data else None
        return Logarithms(PlainColours(data["logs"]), profile)

    def look_up(self, wi: Array, wv: Array, tables: Logarithms) -> Array:
        at = to_half_difference(wi, wv)
        xp = namespace(at.theta_h)
        phi_h, phi_d = self.symmetry.fold(self._from_axis(at))
        n_h, n_p, n_d, n_q, _ = self.logs.shape
        (turn_h, turn_d), (fold_h, fold_d) = self.symmetry.extent, self.symmetry.folded
        radius = self.stretch(at.theta_h)
        positions = [
            radius * (n_h - 1.0),
            phi_h * ((n_p - 1.0) * 2.0 / turn_h if fold_h else n_p / turn_h),
            self.stretch_d(at.theta_d) * (n_d - 1.0),
            phi_d * ((n_q - 1.0) * 2.0 / turn_d if fold_d else n_q / turn_d),
        ]
        axes = [
            _nodes(position, count, periodic)
            for position, count, periodic in zip(
                positions, (n_h, n_p, n_d, n_q), (False, not fold_h, False, not fold_d), strict=True
            )
        ]
        logs: Array = None
        for (a, p), (b, q), (c, r), (d, s) in product(*axes):
            index = ((a * n_p + b) * n_d + c) * n_q + d
            logs = multiply_add(tables.table.read(index), p * q * r * s, logs)
        if tables.profile is not None and self.profile is not None:
            last = len(self.profile) - 1.0
            for node, weight in _nodes(radius * last, len(self.profile), False):
                logs = multiply_add(tables.profile.read(node), weight, logs)
        value = xp.maximum(xp.exp(logs) - self.floor, 0.0)
        cos_i, cos_v, last = components(wi)[2], components(wv)[2], math.cos(self.theta_max)
        if self.power:
            value = scale(value, 1.0 / xp.maximum(cos_i, last))
        if self.dark_beyond:
            value = scale(
                value, xp.select(xp.minimum(cos_i, cos_v) >= last, 1.0 + 0.0 * cos_i, 0.0 * cos_i)
            )
        return value

    def _from_axis(self, at: HalfDifference) -> HalfDifference:
        """Return the angles with phi_h from the main axis."""
        if self.symmetry.isotropic or self.symmetry.axis == 0.0:
            return at
        xp = namespace(at.theta_h)
        turn = 2.0 * np.pi
        phi_h = at.phi_h - self.symmetry.axis
        phi_h = phi_h - turn * xp.floor(phi_h * (1.0 / turn))
        return at._replace(phi_h=phi_h)


def node_angles(
    shape: tuple[int, int, int, int],
    symmetry: Symmetry,
    stretch: Stretch,
    stretch_d: Stretch = EVEN,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the angles of the nodes of a table along each axis, radians.

    Args:
        shape: (n_theta_h, n_phi_h, n_theta_d, n_phi_d).
    """
    azimuths = []
    for count, period, folded in zip(
        (shape[1], shape[3]), symmetry.extent, symmetry.folded, strict=True
    ):
        last = 0.5 * period if folded else period
        azimuths.append(np.linspace(0.0, last, count, endpoint=folded))
    theta_h = stretch.inverse(np.linspace(0.0, 1.0, shape[0]))
    theta_d = stretch_d.inverse(np.linspace(0.0, 1.0, shape[2]))
    return theta_h, azimuths[0], theta_d, azimuths[1]


def _nodes(position: Array, count: int, periodic: bool) -> list[tuple[Array, Array]]:
    """Return the nodes beside a position and their weights."""
    xp = namespace(position)
    if count == 1:
        return [(to_index(0.0 * position), 1.0)]
    if not periodic:
        held = xp.minimum(xp.maximum(position, 0.0), count - 1.0)
        below = xp.minimum(xp.floor(held), count - 2.0)
        upper = held - below
        return [(to_index(below), 1.0 - upper), (to_index(below + 1.0), upper)]
    held = xp.minimum(xp.maximum(position, 0.0), float(count))
    floor = xp.floor(held)
    upper = held - floor
    first = xp.select(floor >= count, 0.0 * floor, floor)
    second = xp.select(first + 1.0 >= count, 0.0 * first, first + 1.0)
    return [(to_index(first), 1.0 - upper), (to_index(second), upper)]

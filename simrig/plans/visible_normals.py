"""The plan of Dupuy and Jakob 2018: retro-reflection first, then a grid of visible normals.

A few groups of related pairs tell whether the material is isotropic and mirror symmetric (the
article asks the user). Retro-reflection gives the distribution of normals, whose visible part
places a grid of illumination directions for each view. Nodes below the horizon are not measured.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Self

import numpy as np

from simrig.brdf.kriging.displayed import displayed_pairs
from simrig.brdf.kriging.symmetry import Symmetry
from simrig.brdf.tables.visible_normals import (
    grid_of_view,
    normals,
    retro_angles,
    view_thetas,
    visible_normals,
)
from simrig.core.colour import LUMINANCE
from simrig.core.errors import SimrigError
from simrig.core.options import Option
from simrig.directions.spherical import to_angles, to_vector
from simrig.plans.auto.description import describe
from simrig.plans.auto.pilot import OPERATIONS, Pilot, group_pairs
from simrig.plans.listed import Directions
from simrig.plans.protocol import Batches, Plan

if TYPE_CHECKING:
    from simrig.brdf.protocol import Brdf

LEAST_SAMPLES = 200
LARGEST_THETA_I_DEG, LARGEST_THETA_V_DEG = 88.0, 85.0
SIZES = "table_sizes"  # of the layout
_GROUPS = 4
_PUBLISHED = 8192  # samples of the article's isotropic grid, 8 polar angles of views
_RETRO_SHARE = 0.06  # of the samples, of anisotropic materials
_LARGEST_SIDE = 129


@dataclass(frozen=True)
class TableSizes:
    """How a measurement is laid out.

    Attributes:
        isotropic, mirror: what the groups of pairs say; mirror of an anisotropic material: in x
            and in y.
        rows, columns: of the table of retro-reflection, over phi and theta.
        thetas, phis: views with grids of their own.
        side: nodes along each side of a grid.
    """

    isotropic: bool
    mirror: bool
    rows: int
    columns: int
    thetas: int
    phis: int
    side: int

    def as_array(self) -> np.ndarray:
        """Return plain numbers, for a measurement's layout."""
        return np.array([int(getattr(self, name)) for name in self.__dataclass_fields__])

    @classmethod
    def from_array(cls, numbers: np.ndarray) -> TableSizes:
        """Return what ``as_array`` gave.

        Raises:
            SimrigError: other numbers.
        """
        numbers = np.asarray(numbers)
        if numbers.shape != (len(cls.__dataclass_fields__),) or not np.all(numbers == numbers // 1):
            raise SimrigError("it does not say how its tables lie")
        isotropic, mirror, *sizes = (int(n) for n in numbers)
        rows, columns, thetas, phis, side = sizes
        fits = 2 <= rows <= 512 and 3 <= columns <= 512 and 2 <= thetas <= 64 and 1 <= phis <= 128
        if not fits or not 3 <= side <= _LARGEST_SIDE or (isotropic and phis != 1):
            raise SimrigError("the sizes of its tables cannot be")
        return cls(bool(isotropic), bool(mirror), rows, columns, thetas, phis, side)

    @property
    def half(self) -> bool:
        """Whether the tables are their own mirror images in rows, and half is measured."""
        return self.isotropic and self.mirror

    def phi_nodes(self, finer: int = 1) -> np.ndarray:
        """Return the azimuths of views: one, half a turn of them, or a full one."""
        if self.isotropic:
            return np.zeros(1)
        count = (self.phis - 1) * finer + 1
        return np.linspace(-np.pi, 0.0 if self.mirror else np.pi, count)


class Finer(NamedTuple):
    """How many times as many nodes grids have as are measured.

    Attributes:
        views: along the polar angles and the azimuths of views.
        nodes: along each side.
    """

    views: int
    nodes: int


MEASURED = Finer(1, 1)


@dataclass(frozen=True, eq=False)
class Grids:
    """The grids of all views.

    Attributes:
        theta, phi: azimuths and polar angles of views, radians.
        ndf, sigma, vndf: see ``simrig.brdf.tables.visible_normals``.
        light: (phi, theta, side, side, 3) where the nodes look.
        ratio: (phi, theta, side, side) 4 σ / D of each.
    """

    theta: np.ndarray
    phi: np.ndarray
    ndf: np.ndarray
    sigma: np.ndarray
    vndf: np.ndarray
    light: np.ndarray
    ratio: np.ndarray

    def wanted(self, half: bool) -> np.ndarray:
        """Return which nodes are measured, (phi, theta, side, side): those above the horizon.

        Args:
            half: whether rows are each other's mirror images.
        """
        above = self.light[..., 2] > 0.0
        if half:
            above[:, :, above.shape[2] // 2 + 1 :] = False
        return above


@dataclass(frozen=True)
class VisibleNormalsPlan(Plan):
    """The adaptive parameterisation of Dupuy and Jakob 2018, with at most so many samples.

    Attributes:
        samples: the most that are taken.
        theta_i_max, theta_v_max: how far the rig looks, radians.
        pairs: of each group.
    """

    name: ClassVar[str] = "visible-normals"
    about: ClassVar[str] = "retro-reflection, then a grid of visible normals [DJ18]"
    adaptive: ClassVar[bool] = True
    options: ClassVar[tuple[Option, ...]] = (
        Option("samples", int, "At most so many.", 8911, least=1, short="-n"),
    )

    samples: int
    theta_i_max: float = float(np.radians(LARGEST_THETA_I_DEG))
    theta_v_max: float = float(np.radians(LARGEST_THETA_V_DEG))
    pairs: int = len(OPERATIONS)

    def __post_init__(self) -> None:
        if self.samples < LEAST_SAMPLES:
            raise SimrigError(
                f"{self.samples} samples are too few for grids of visible normals, they need at "
                f"least {LEAST_SAMPLES}"
            )

    @classmethod
    def for_material(  # type: ignore[override]
        cls, material: Brdf | None = None, *, samples: int = 8911
    ) -> VisibleNormalsPlan:
        """Return the plan for a material, within its data."""
        end = 0.5 * np.pi if material is None else material.theta_max
        largest = (np.radians(LARGEST_THETA_I_DEG), np.radians(LARGEST_THETA_V_DEG))
        theta_i_max, theta_v_max = (float(min(theta, end)) for theta in largest)
        return cls(samples, theta_i_max, theta_v_max)

    @classmethod
    def restored(cls, settings: Mapping[str, Any], angles: np.ndarray) -> Self:
        """Return the plan of a stored measurement; of before, groups had seven pairs."""
        return cls(**{"pairs": 7, **settings})

    @property
    def theta_max(self) -> float:
        """The largest polar angle in radians."""
        return max(self.theta_i_max, self.theta_v_max)

    def describe(self) -> str:
        """Return the plan in words."""
        return f"visible normals, at most {self.samples} samples"

    def check_layout(self, angles: np.ndarray, layout: Mapping[str, np.ndarray]) -> None:
        """Refuse sizes that do not fit the directions."""
        sizes = TableSizes.from_array(layout.get(SIZES, np.zeros(0)))
        if len(angles) < self.first(sizes):
            raise SimrigError("its arrays do not fit together")

    def batches(self) -> Batches:
        """Yield groups of pairs, retro-reflection, and the grids of all views."""
        wi, wv = self._groups()
        seen = yield _angles(wi, wv)
        numbers = np.arange(len(wi)).reshape(_GROUPS, len(OPERATIONS))
        symmetry = describe(Pilot(wi, wv, numbers), seen.values).symmetry
        rows, columns = self._retro_size(symmetry)
        directions = self._retro(symmetry.isotropic, rows, columns)
        retro = yield _angles(directions, directions)
        left = self.samples - len(wi) - len(directions)
        sizes = self._sizes(symmetry, rows, columns, retro.values, left)
        yield self.angles(self.grids(sizes, retro.values), sizes)
        return {SIZES: sizes.as_array()}

    def probe(self, most: int) -> Plan:
        """Return the groups, retro-reflection, and pairs as pictures show them."""
        wi, wv = self._groups()
        back = self._retro(True, 2, self._retro_size(Symmetry(isotropic=True))[1])
        count = max(1, min(most, self.samples) - len(wi) - len(back))
        shown = displayed_pairs(count, self.theta_i_max, self.theta_v_max)
        sides = ((wi, back, shown[0]), (wv, back, shown[1]))
        return Directions(_angles(*(np.concatenate(side) for side in sides)))

    def first(self, sizes: TableSizes) -> int:
        """Return the number of the first sample of the grids."""
        retro = sizes.columns * (1 if sizes.isotropic else sizes.rows)
        return _GROUPS * self.pairs + retro

    def retro_values(self, sizes: TableSizes, values: np.ndarray) -> np.ndarray:
        """Return what of all values are those of retro-reflection."""
        return values[_GROUPS * self.pairs : self.first(sizes)]

    def grids(self, sizes: TableSizes, retro: np.ndarray, finer: Finer = MEASURED) -> Grids:
        """Return the grids that values of retro-reflection (n, 3) lead to.

        Args:
            finer: how many times as many nodes the grids have.
        """
        luminance = (retro @ LUMINANCE).reshape(-1, sizes.columns)
        ndf, sigma = normals(np.broadcast_to(luminance, (sizes.rows, sizes.columns)))
        theta = view_thetas((sizes.thetas - 1) * finer.views + 1, self.theta_v_max)
        phi = sizes.phi_nodes(finer.views)
        vndf = np.stack([[visible_normals(ndf, t, p, sizes.isotropic) for t in theta] for p in phi])
        side = (sizes.side - 1) * finer.nodes + 1
        found = [
            [
                grid_of_view(ndf, sigma, own, (t, p), side, sizes.isotropic)
                for t, own in zip(theta, of_phi, strict=True)
            ]
            for p, of_phi in zip(phi, vndf, strict=True)
        ]
        light, ratio = (
            np.array([[getattr(at, name) for at in row] for row in found])
            for name in ("light", "ratio")
        )
        return Grids(theta, phi, ndf, sigma, vndf, light, ratio)

    def angles(self, grids: Grids, sizes: TableSizes) -> np.ndarray:
        """Return theta_i, theta_v, phi_i, phi_v of the nodes that are measured, (m, 4) radians."""
        wanted = grids.wanted(sizes.half)
        theta_i, phi_i = to_angles(grids.light[wanted])
        phi_v, theta_v = np.meshgrid(grids.phi, grids.theta, indexing="ij")
        number = np.nonzero(wanted)[:2]
        theta_i = np.minimum(theta_i, self.theta_i_max)
        return np.stack([theta_i, theta_v[number], phi_i, phi_v[number]], axis=1)

    def _groups(self) -> tuple[np.ndarray, np.ndarray]:
        return group_pairs(_GROUPS, min(self.theta_i_max, self.theta_v_max), 0)

    def _retro_size(self, symmetry: Symmetry) -> tuple[int, int]:
        if symmetry.isotropic:
            return 2, int(np.clip(self.samples // 20, 9, 129)) | 1
        side = int(np.clip(np.sqrt(_RETRO_SHARE * self.samples), 5, 33)) | 1
        return side, side

    def _retro(self, isotropic: bool, rows: int, columns: int) -> np.ndarray:
        theta, phi = retro_angles(rows, columns, min(self.theta_i_max, self.theta_v_max))
        if isotropic:
            theta, phi = theta[:1], phi[:1]
        return np.asarray(to_vector(theta, phi)).reshape(-1, 3)

    def _sizes(
        self, symmetry: Symmetry, rows: int, columns: int, retro: np.ndarray, left: int
    ) -> TableSizes:
        """Return the largest grids that the samples left allow."""
        isotropic = symmetry.isotropic
        mirror = symmetry.mirror and symmetry.half_turn
        scale = (self.samples / _PUBLISHED) ** (1.0 / (3.0 if isotropic else 4.0))
        thetas = int(np.clip(round(8.0 * scale), 3, 16))
        phis = 1 if isotropic else (thetas + 1 if mirror else 2 * thetas + 1)
        sides = range(3, _LARGEST_SIDE + 1, 2)

        def with_side(side: int) -> TableSizes:
            return TableSizes(isotropic, mirror, rows, columns, thetas, phis, side)

        def too_many(side: int) -> bool:
            own = with_side(side)
            return bool(np.count_nonzero(self.grids(own, retro).wanted(own.half)) > left)

        fitting = bisect_left(sides, True, key=too_many)  # nodes grow with the side
        if fitting == 0:
            raise SimrigError(
                f"{self.samples} samples are too few for grids of visible normals of an "
                "anisotropic material: take more, or the plan 'auto'"
            )
        return with_side(sides[fitting - 1])


def _angles(wi: np.ndarray, wv: np.ndarray) -> np.ndarray:
    """Return theta_i, theta_v, phi_i, phi_v in radians, (n, 4)."""
    (theta_i, phi_i), (theta_v, phi_v) = to_angles(wi), to_angles(wv)
    return np.stack([theta_i, theta_v, phi_i, phi_v], axis=1)

"""The plan of Dupuy and Jakob 2018: retro-reflection first, then a grid of visible normals.

A few groups of related pairs tell whether the material is isotropic and mirror symmetric (the
article asks the user). Retro-reflection gives the distribution of normals, whose visible part
places a grid of illumination directions for each view. Nodes below the horizon are not measured.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

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

    def phi_nodes(self) -> np.ndarray:
        """Return the azimuths of views: one, half a turn of them, or a full one."""
        if self.isotropic:
            return np.zeros(1)
        return np.linspace(-np.pi, 0.0 if self.mirror else np.pi, self.phis)


@dataclass(frozen=True, eq=False)
class Grids:
    """The grids of all views.

    Attributes:
        theta, phi: azimuths and polar angles of views, radians.
        ndf, sigma, vndf: see ``simrig.brdf.tables.visible_normals``.
        angles: (m, 4) theta_i, theta_v, phi_i, phi_v of the nodes that are measured.
        node: (m,) which node of (phi, theta, row, column), flat, each is.
        factor: (phi, theta, side, side) from f_r to what is stored.
    """

    theta: np.ndarray
    phi: np.ndarray
    ndf: np.ndarray
    sigma: np.ndarray
    vndf: np.ndarray
    angles: np.ndarray
    node: np.ndarray
    factor: np.ndarray


@dataclass(frozen=True)
class VisibleNormalsPlan(Plan):
    """The adaptive parameterisation of Dupuy and Jakob 2018, with at most so many samples.

    Attributes:
        samples: the most that are taken.
        theta_i_max, theta_v_max: how far the rig looks, radians.
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
        return cls(samples, *(float(min(theta, end)) for theta in largest))

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
        yield self.grids(sizes, retro.values).angles
        return {SIZES: sizes.as_array()}

    def first(self, sizes: TableSizes) -> int:
        """Return the number of the first sample of the grids."""
        retro = sizes.columns * (1 if sizes.isotropic else sizes.rows)
        return _GROUPS * len(OPERATIONS) + retro

    def retro_values(self, sizes: TableSizes, values: np.ndarray) -> np.ndarray:
        """Return what of all values are those of retro-reflection."""
        return values[_GROUPS * len(OPERATIONS) : self.first(sizes)]

    def grids(self, sizes: TableSizes, retro: np.ndarray) -> Grids:
        """Return the grids that values of retro-reflection (n, 3) lead to."""
        luminance = (retro @ LUMINANCE).reshape(-1, sizes.columns)
        ndf, sigma = normals(np.broadcast_to(luminance, (sizes.rows, sizes.columns)))
        theta, phi = view_thetas(sizes.thetas, self.theta_v_max), sizes.phi_nodes()
        vndf = np.stack([[visible_normals(ndf, t, p, sizes.isotropic) for t in theta] for p in phi])
        side = sizes.side
        factor = np.zeros((len(phi), len(theta), side, side))
        angles, node = [], []
        # the table of an isotropic, mirror symmetric material is its own mirror image in rows
        half = sizes.isotropic and sizes.mirror
        for p, phi_v in enumerate(phi):
            for t, theta_v in enumerate(theta):
                at = grid_of_view(ndf, sigma, vndf[p, t], (theta_v, phi_v), side, sizes.isotropic)
                factor[p, t] = at.factor
                wanted = at.light[..., 2] > 0.0
                if half:
                    wanted[side // 2 + 1 :] = False
                theta_i, phi_i = to_angles(at.light[wanted])
                theta_i = np.minimum(theta_i, self.theta_i_max)
                view = np.broadcast_to([[theta_v, phi_v]], (len(theta_i), 2))
                angles.append(np.stack([theta_i, view[:, 0], phi_i, view[:, 1]], axis=1))
                first = (p * len(theta) + t) * side * side
                node.append(first + np.flatnonzero(wanted.ravel()))
        return Grids(
            theta, phi, ndf, sigma, vndf, np.concatenate(angles), np.concatenate(node), factor
        )

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
        best = None
        for side in range(3, _LARGEST_SIDE + 1, 2):
            sizes = TableSizes(isotropic, mirror, rows, columns, thetas, phis, side)
            if len(self.grids(sizes, retro).angles) > left:
                break
            best = sizes
        if best is None:
            raise SimrigError(
                f"{self.samples} samples are too few for grids of visible normals of an "
                "anisotropic material: take more, or the plan 'auto'"
            )
        return best


def _angles(wi: np.ndarray, wv: np.ndarray) -> np.ndarray:
    """Return theta_i, theta_v, phi_i, phi_v in radians, (n, 4)."""
    (theta_i, phi_i), (theta_v, phi_v) = to_angles(wi), to_angles(wv)
    return np.stack([theta_i, theta_v, phi_i, phi_v], axis=1)

"""Reflectance of the RGL material database in its adaptive parameterisation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from simrig.brdf.protocol import Brdf
from simrig.brdf.tables.warp2d import (
    Stack,
    distribution,
    interpolate,
    invert,
    single,
    stack_at,
    unit_cell,
)
from simrig.core.arrays import (
    Array,
    components,
    gather_colour,
    multiply_add,
    namespace,
    read_only,
    scale,
)
from simrig.core.errors import SimrigError, check_known
from simrig.core.gamut import CLIP, GAMUTS, KEEP, outside
from simrig.directions.spherical import acute_angle

# f_r is the stored f_r · cos over the cosine, which is held from below at this value
_SMALLEST_COSINE = 1e-6


@dataclass(frozen=True)
class _RglTables:
    ndf: Array
    sigma: Array
    vndf: Array
    vndf_marginal: Array
    vndf_conditional: Array
    rgb: Array


class RglBrdf(Brdf):
    """A measured or converted BRDF as Dupuy and Jakob 2018 store it.

    f_r · cos = rgb(s) · D(m) / (4 σ(ω)), where m is the half vector, D a normal distribution, σ
    its projected area, and s the uniform sample that the distribution of visible normals of ω
    takes to m. The tables over s are interpolated between nodes of theta and phi of ω. The same
    look-ups as Mitsuba's ``measured`` plugin; there ω is the camera's side and the cosine the
    light's, so ω is the view direction here and the cosine that of the illumination.

    Measured colours outside the gamut have negative channels; they count as 0 unless ``gamut`` says
    otherwise.

    Args:
        phi_nodes: azimuths of ω with tables, radians, increasing; one or two: isotropic. When
            they span half a turn, the BRDF repeats after half a turn; a quarter: it is
            mirror symmetric in x and in y.
        theta_nodes: polar angles of ω with tables, radians, increasing.
        ndf: D, shape (n_phi_m, n_theta_m) over phi and sqrt(theta); both ends included.
        sigma: σ, the same form.
        vndf: density of visible normals, shape (n_phi, n_theta, height, width).
        rgb: shape (n_phi, n_theta, rows, columns, 3).
        jacobian: whether D / (4 σ) is a factor at all.
        gamut: ``"clip"`` sets channels of colours outside sRGB to 0, ``"keep"`` keeps them.

    Raises:
        SimrigError: shapes or values that do not fit together.
    """

    kind = "rgl"
    reciprocal = False

    def __init__(
        self,
        phi_nodes: Sequence[float],
        theta_nodes: Sequence[float],
        ndf: np.ndarray,
        sigma: np.ndarray,
        vndf: np.ndarray,
        rgb: np.ndarray,
        jacobian: bool = True,
        name: str = "rgl",
        gamut: str = CLIP,
    ):
        self.phi_nodes = tuple(float(p) for p in phi_nodes)
        self.theta_nodes = tuple(float(t) for t in theta_nodes)
        _check_nodes("phi_i", self.phi_nodes)
        _check_nodes("theta_i", self.theta_nodes)
        _check_tables(self.phi_nodes, self.theta_nodes, ndf, sigma, vndf, rgb)
        check_known("gamut", gamut, GAMUTS)
        self.isotropic, self.gamut = len(self.phi_nodes) <= 2, gamut
        self.outside = outside(np.asarray(rgb))
        self.jacobian, self.name = bool(jacobian), name
        density, marginal, conditional = distribution(vndf)
        self.vndf = read_only(vndf)
        arrays = {
            "ndf": ndf,
            "sigma": sigma,
            "vndf": density,
            "vndf_marginal": marginal,
            "vndf_conditional": conditional,
            "rgb": rgb,
        }
        self._tables = MappingProxyType({name: read_only(a) for name, a in arrays.items()})

    @property
    def symmetry(self) -> int:
        """How many times the table covers the circle of azimuths: 1, 2 or 4."""
        if self.isotropic:
            return 1
        turns = round(2.0 * np.pi / (self.phi_nodes[-1] - self.phi_nodes[0]))
        return 4 if turns == 4 else 2 if turns >= 2 else 1

    def data(self) -> Mapping[str, np.ndarray]:
        return self._tables

    def structure(self) -> dict[str, Any]:
        return {
            "phi_nodes": list(self.phi_nodes),
            "theta_nodes": list(self.theta_nodes),
            "jacobian": self.jacobian,
            **self._gamut(),
        }

    @classmethod
    def from_parts(
        cls, structure: Mapping[str, Any], data: Mapping[str, np.ndarray], name: str
    ) -> RglBrdf:
        return cls(
            list(structure["phi_nodes"]),
            list(structure["theta_nodes"]),
            data["ndf"],
            data["sigma"],
            data["vndf"],
            data["rgb"],
            bool(structure["jacobian"]),
            name,
            str(structure.get("gamut", CLIP)),
        )

    def prepare(self, data: Mapping[str, Array], differentiable: bool = True) -> _RglTables:
        return _RglTables(**data)

    def look_up(self, wi: Array, wv: Array, tables: _RglTables) -> Array:
        light, view = self._fold(components(wi), components(wv))
        xp = namespace(light[0])
        theta, phi = _angles(*view)
        if self.symmetry > 1:  # y <= 0 after folding: Dr.Jit's azimuth of (-1, -0) is π, not -π
            phi = -xp.abs(phi)
        theta_m, phi_m = _angles(*(a + b for a, b in zip(light, view, strict=True)))
        x = theta_to_unit(theta_m)
        y = azimuth_to_unit(phi_m - phi if self.isotropic else phi_m)
        y = y - xp.floor(y)
        stack = stack_at([(self.phi_nodes, phi), (self.theta_nodes, theta)])
        parts = (tables.vndf, tables.vndf_marginal, tables.vndf_conditional)
        u, v = invert(*parts, stack, self._tables["vndf"].shape[2:], x, y)
        factor = 1.0 / xp.maximum(light[2], _SMALLEST_COSINE)
        if self.jacobian:
            one = single(x)
            normals = interpolate(tables.ndf, one, self._tables["ndf"].shape, x, y)
            unit = (theta_to_unit(theta), azimuth_to_unit(phi))
            area = interpolate(tables.sigma, one, self._tables["sigma"].shape, *unit)
            factor = factor * normals / (4.0 * xp.maximum(area, 1e-30))
        return scale(self._colour(tables.rgb, stack, u, v), factor)

    def _fold(self, light: tuple, view: tuple) -> tuple[tuple, tuple]:
        """Turn or mirror a pair so that the view's azimuth is one that has tables."""
        if self.symmetry == 1:
            return light, view
        xp = namespace(view[0])
        flip_y = xp.select(view[1] >= 0.0, -1.0, 1.0)
        flip_x = xp.select(view[0] >= 0.0, -1.0, 1.0) if self.symmetry == 4 else flip_y
        folded_x = -xp.abs(view[0]) if self.symmetry == 4 else view[0] * flip_x
        return (light[0] * flip_x, light[1] * flip_y, light[2]), (
            folded_x,
            -xp.abs(view[1]),
            view[2],
        )

    def _colour(self, rgb: Array, stack: Stack, u: Array, v: Array) -> Array:
        rows, columns = self._tables["rgb"].shape[2:4]
        column, right = unit_cell(u, columns)
        row, up = unit_cell(v, rows)
        base = row * columns + column
        total: Array = None
        for offset, weight in (
            (0, (1.0 - right) * (1.0 - up)),
            (1, right * (1.0 - up)),
            (columns, (1.0 - right) * up),
            (columns + 1, right * up),
        ):
            for number, share in stack:
                index = number * (rows * columns) + base + offset
                total = multiply_add(gather_colour(rgb, index), weight * share, total)
        return total if self.gamut == KEEP else namespace(total).maximum(total, 0.0)


def theta_to_unit(theta: Array) -> Array:
    """Map a polar angle in [0, π/2] to [0, 1], finest at the normal."""
    return namespace(theta).sqrt(theta * (2.0 / np.pi))


def azimuth_to_unit(phi: Array) -> Array:
    """Map an azimuth in [-π, π] to [0, 1]."""
    return (phi + np.pi) * (0.5 / np.pi)


def _angles(x: Array, y: Array, z: Array) -> tuple[Array, Array]:
    """Return theta and phi in [-π, π] of a vector above the horizon; phi is 0 at the pole."""
    xp = namespace(x)
    # NumPy and Dr.Jit disagree on the azimuth of (-0, ±0): adding 0 turns -0 into 0
    return acute_angle(xp.sqrt(x * x + y * y), z), xp.atan2(y, x + 0.0)


def _check_nodes(what: str, nodes: tuple[float, ...]) -> None:
    if not nodes or not np.all(np.isfinite(nodes)) or np.any(np.diff(nodes) <= 0.0):
        raise SimrigError(f"the nodes {what} of an RGL BRDF must increase, got {nodes}")


def _check_tables(phi: tuple, theta: tuple, *tables: np.ndarray) -> None:
    ndf, sigma, vndf, rgb = (np.asarray(table) for table in tables)
    counts = (len(phi), len(theta))
    shapes = f"ndf {ndf.shape}, sigma {sigma.shape}, vndf {vndf.shape}, rgb {rgb.shape}"
    fits = (
        (ndf.ndim, sigma.ndim, vndf.ndim, rgb.ndim) == (2, 2, 4, 5)
        and vndf.shape[:2] == counts == rgb.shape[:2]
        and rgb.shape[4] == 3
        and min(*ndf.shape, *sigma.shape, *vndf.shape[2:], *rgb.shape[2:4]) >= 2
    )
    if not fits:
        raise SimrigError(f"the tables of an RGL BRDF do not fit {counts} nodes: {shapes}")
    for name, table in zip(("ndf", "sigma", "vndf", "rgb"), (ndf, sigma, vndf, rgb), strict=True):
        if not np.all(np.isfinite(table)):
            raise SimrigError(f"table '{name}' of an RGL BRDF has values that are not finite")
        if name != "rgb" and table.min() < 0.0:
            raise SimrigError(f"table '{name}' of an RGL BRDF has negative values")
    if vndf.sum(axis=(2, 3)).min() <= 0.0:
        raise SimrigError("a density of visible normals of an RGL BRDF is zero everywhere")

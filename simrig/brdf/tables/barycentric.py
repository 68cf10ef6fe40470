"""Reflectance between measured directions by barycentric coordinates, one triangle per side."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.sparse import csr_array

from simrig.brdf.checks import check_values
from simrig.brdf.protocol import Brdf
from simrig.brdf.tables.grid import grid_sizes
from simrig.brdf.tables.packed import Colours, colour_table
from simrig.core.arrays import Array, multiply_add, read_only
from simrig.core.errors import SimrigError
from simrig.core.gamut import CLIP
from simrig.directions.spherical import to_vector
from simrig.directions.triangulation import HemisphereTriangulation


class BarycentricBrdf(Brdf):
    """Values at all pairs of n directions, interpolated on the triangulated hemisphere.

    Illumination and view each lie in one spherical triangle of measured directions; the value is
    the sum of the 3 × 3 values at its corners, weighted by the products of their barycentric
    coordinates. It is continuous, exact at measured pairs, never outside the range of the nine
    values, and has no seam in azimuth and none at the normal. Beyond the outermost directions
    the value is held. Thesis section 5.5.2, [Cox69].

    Args:
        theta, phi: the directions in radians, each (n,): all different, around the normal.
        values: (n, n, 3) f_r in 1/sr, illumination first; float32 or float64, finite, >= 0.
        reciprocal: whether the table equals its transpose; ``None`` looks.

    Raises:
        SimrigError: directions that give no triangulation, shapes or values that cannot be.
    """

    kind = "barycentric"

    def __init__(
        self,
        theta: np.ndarray,
        phi: np.ndarray,
        values: np.ndarray,
        *,
        reciprocal: bool | None = None,
        name: str = "barycentric",
        gamut: str = CLIP,
    ):
        self.theta, self.phi = (read_only(angle, np.float64) for angle in (theta, phi))
        values = np.asarray(values)
        if values.dtype not in (np.float32, np.float64):
            values = values.astype(np.float64)
        count = len(self.theta)
        if self.theta.shape != self.phi.shape or values.shape != (count, count, 3):
            raise SimrigError(
                f"'{name}' needs as many theta as phi and values for all their pairs, got "
                f"{self.theta.shape}, {self.phi.shape} and {values.shape}"
            )
        check_values(values, f"table '{name}'", gamut=gamut)
        self._hold(values, gamut)
        self.values, self.name = read_only(values), name
        self.triangulation = HemisphereTriangulation(to_vector(self.theta, self.phi))
        self.theta_max = float(self.theta.max())
        if reciprocal is None:
            reciprocal = np.allclose(values, values.swapaxes(0, 1), rtol=1e-6, atol=0.0)
        self.reciprocal = bool(reciprocal)

    @property
    def stored_bytes(self) -> int:
        """Size of the table and of the directions, in bytes."""
        return self.values.nbytes + self.theta.nbytes + self.phi.nbytes

    def data(self) -> Mapping[str, np.ndarray]:
        return {"values": self.values}

    def structure(self) -> dict[str, Any]:
        return {
            "theta": self.theta.tolist(),
            "phi": self.phi.tolist(),
            "reciprocal": self.reciprocal,
            **self._gamut(),
        }

    def prepare(self, data: Mapping[str, Array], differentiable: bool = True) -> Colours:
        return colour_table(data["values"], differentiable)

    def look_up(self, wi: Array, wv: Array, tables: Colours) -> Array:
        light, view = self.triangulation.locate(wi), self.triangulation.locate(wv)
        count = len(self.theta)
        value: Array = None
        for row, row_weight in zip(light.nodes, light.weights, strict=True):
            inner: Array = None
            for column, weight in zip(view.nodes, view.weights, strict=True):
                inner = multiply_add(tables.read(row * count + column), weight, inner)
            value = multiply_add(inner, row_weight, value)
        return value

    def to_dense(self, step_deg: float = 2.0) -> np.ndarray:
        """Return the whole array on a regular grid of all four angles.

        Every direction is located once and both sides are interpolated one after the other, as
        products with a sparse matrix of three entries per row.

        Args:
            step_deg: step of all four angles in degrees; divides theta_max and 360°.

        Returns:
            float32 array (theta_i, theta_v, phi_i, phi_v, 3).

        Raises:
            SimrigError: a step that does not divide the ranges.
        """
        n_theta, n_phi = grid_sizes(self.theta_max, step_deg)
        theta, phi = (np.radians(step_deg) * np.arange(n) for n in (n_theta, n_phi))
        weights = self._weights(to_vector(theta[:, None], phi).reshape(-1, 3))
        count = len(self.theta)
        by_view = np.ascontiguousarray(self.values.swapaxes(0, 1), dtype=np.float32)
        half = (weights @ by_view.reshape(count, -1)).reshape(-1, count, 3)
        half = np.ascontiguousarray(half.swapaxes(0, 1)).reshape(count, -1)
        out = np.empty((n_theta, n_theta, n_phi, n_phi, 3), dtype=np.float32)
        for row in range(n_theta):
            ring = weights[row * n_phi : (row + 1) * n_phi] @ half
            out[row] = ring.reshape(n_phi, n_theta, n_phi, 3).swapaxes(0, 1)
        return out

    def _weights(self, directions: np.ndarray) -> csr_array:
        """Return the float32 matrix (m, n) that interpolates from the nodes to directions."""
        place = self.triangulation.locate(directions)
        columns, values = np.stack(place.nodes, axis=1), np.stack(place.weights, axis=1)
        first = np.arange(0, columns.size + 1, 3)
        shape = (len(directions), len(self.theta))
        parts = (values.ravel().astype(np.float32), columns.ravel(), first)
        return csr_array(parts, shape=shape)

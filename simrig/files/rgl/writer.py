"""Write any BRDF as an RGL tensor file that Mitsuba's ``measured`` renders."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from simrig.brdf.protocol import Brdf, evaluate
from simrig.brdf.tables.resample import is_isotropic
from simrig.brdf.tables.visible_normals import (
    grid_of_view,
    normals,
    retro_angles,
    view_thetas,
    visible_normals,
)
from simrig.core.colour import LUMINANCE
from simrig.core.errors import SimrigError
from simrig.directions.spherical import to_vector
from simrig.files.rgl.tensor_file import write_tensors

_LUMINANCE_FLOOR = 1e-2  # of its mean, the same for the samples


@dataclass(frozen=True)
class RglResolution:
    """Sizes of the tables of an RGL file.

    The sides are odd, so that half a turn moves nodes onto nodes: otherwise the tables of a
    symmetric material would not join without a seam.

    Attributes:
        theta: polar angles of the view with tables of their own.
        phi: azimuths of the view over the full circle (anisotropic materials only).
        warp: side of the tables of normals and visible normals.
        colour: side of the colour tables.
    """

    theta: int = 16
    phi: int = 24
    warp: int = 65
    colour: int = 41

    def __post_init__(self) -> None:
        sides = (self.warp, self.colour)
        odd = all(side % 2 == 1 and side >= 5 for side in sides)
        if self.theta < 2 or self.phi < 4 or self.phi % 2 or not odd:
            raise SimrigError(
                "an RGL resolution needs theta >= 2, phi even, warp and colour odd and >= 5, "
                f"got {self}"
            )


def write_rgl(path: str | Path, brdf: Brdf, resolution: RglResolution | None = None) -> int:
    """Convert a BRDF to the adaptive parameterisation and write it.

    The normal distribution D comes from the reflectance's own retro-reflection: where the two
    directions agree, f_r · cos ∝ D / σ, and σ is a linear function of D, so D is an eigenvector
    that power iteration finds (Dupuy and Jakob 2018, section 4). The density of visible normals
    follows from D, and the colour tables hold f_r · cos · 4 σ / D at the directions that their
    nodes sample, so the file gives f_r exactly there; where a node's light direction is below
    the horizon they hold 0. An isotropic BRDF needs one azimuth, one that is mirror
    symmetric in x and in y half a turn of them. (A quarter would do, but its tables join with a
    visible seam.)

    Args:
        path: the file, ending in ``.bsdf`` by custom.

    Returns:
        The size of the file in bytes.
    """
    resolution = resolution or RglResolution()
    theta = view_thetas(resolution.theta)
    phi, rows = _azimuths(brdf, resolution)
    ndf, sigma = _normals(brdf, rows, resolution.warp)
    vndf = np.stack([[visible_normals(ndf, t, p, len(phi) == 1) for t in theta] for p in phi])
    rgb = _colours(brdf, theta, phi, ndf, sigma, vndf, resolution.colour)
    luminance = np.einsum("ptcyx,c->ptyx", rgb, LUMINANCE)
    floor = _LUMINANCE_FLOOR * luminance.mean(axis=(2, 3), keepdims=True)
    single_precision = {
        "phi_i": phi,
        "theta_i": theta,
        "sigma": sigma,
        "ndf": ndf,
        "vndf": vndf,
        "luminance": np.maximum(luminance, floor + np.finfo(np.float32).tiny),
        "rgb": rgb,
    }
    return write_tensors(
        path,
        {
            "version": np.array([1, 0], dtype=np.uint32),
            "description": f"{brdf.name}, converted by simrig",
            **{name: array.astype(np.float32) for name, array in single_precision.items()},
            "jacobian": np.array([1], dtype=np.uint8),
        },
    )


def is_mirror_symmetric(brdf: Brdf) -> bool:
    """Return whether mirroring both directions in x, and in y, changes nothing (200 pairs)."""
    rng = np.random.default_rng(2)
    wi, wv = (
        to_vector(rng.uniform(0.0, 1.4, 200), rng.uniform(0.0, 2.0 * np.pi, 200)) for _ in range(2)
    )
    reference = evaluate(brdf, wi, wv)
    return all(
        np.allclose(evaluate(brdf, wi * sign, wv * sign), reference, rtol=1e-6, atol=1e-12)
        for sign in ((-1, 1, 1), (1, -1, 1))
    )


def _azimuths(brdf: Brdf, resolution: RglResolution) -> tuple[np.ndarray, int]:
    """Return the azimuths of the tables, and the rows of the normals' table over phi."""
    if is_isotropic(brdf):
        return np.zeros(1), 2
    if is_mirror_symmetric(brdf):
        return np.linspace(-np.pi, 0.0, resolution.phi // 2 + 1), resolution.warp
    return np.linspace(-np.pi, np.pi, resolution.phi + 1), resolution.warp


def _normals(brdf: Brdf, rows: int, columns: int) -> tuple[np.ndarray, np.ndarray]:
    """Return D and σ of a BRDF's own retro-reflection."""
    directions = to_vector(*retro_angles(rows, columns))
    return normals(evaluate(brdf, directions, directions) @ LUMINANCE)


def _colours(
    brdf: Brdf,
    theta: np.ndarray,
    phi: np.ndarray,
    ndf: np.ndarray,
    sigma: np.ndarray,
    vndf: np.ndarray,
    side: int,
) -> np.ndarray:
    """Return f_r · cos · 4 σ / D where the nodes of each table sample, (phi, theta, 3, y, x)."""
    rgb = np.zeros((len(phi), len(theta), 3, side, side))
    for p, phi_v in enumerate(phi):
        for t, theta_v in enumerate(theta):
            at = grid_of_view(ndf, sigma, vndf[p, t], (theta_v, phi_v), side, len(phi) == 1)
            view = to_vector(float(theta_v), float(phi_v))
            value = evaluate(brdf, at.light, np.broadcast_to(view, at.light.shape))
            factor = at.ratio * np.maximum(at.light[..., 2], 0.0)
            rgb[p, t] = np.moveaxis(value * factor[..., None], -1, 0)
    return rgb

"""A BRDF as a picture, as in thesis section 1.1.2 and Figures 1.3 and 5.2.

The four-dimensional function is cut into two-dimensional subspaces that are put side by side:
within a tile both azimuths run from 0 to 360°, from tile to tile the polar angles change. The
illumination runs downwards (theta_i by tile, phi_i within), the view runs to the right (theta_v,
phi_v). Pictures are linear RGB and hold f_r in 1/sr; whoever shows one chooses an exposure.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from simrig.brdf.protocol import Brdf, evaluate
from simrig.core import backend
from simrig.core.errors import SimrigError
from simrig.directions.spherical import to_vector
from simrig.files.images import to_srgb8

THETAS_DEG = (0.0, 15.0, 30.0, 45.0, 60.0, 75.0)  # as in thesis Figure 5.2
_SHOWN_STEP_DEG = 15.0  # of small pictures
_WHITE_PERCENTILE = 98.0  # of the brightest channel: the few brightest pixels clip


def brdf_picture(
    brdf: Brdf, thetas_deg: Sequence[float] = THETAS_DEG, azimuth_step_deg: float = 3.0
) -> np.ndarray:
    """Return the azimuthal subspaces of all pairs of polar angles as one picture (Figure 1.3 left).

    Args:
        thetas_deg: increasing, in [0, 90) degrees; one row and one column of tiles each.
        azimuth_step_deg: size of a pixel; must divide 360.

    Returns:
        float32 (n·m, n·m, 3) with n polar angles and m azimuths: f_r in 1/sr, linear RGB.

    Raises:
        SimrigError: for polar angles or a step that are not as above, or values that are not
        finite.
    """
    values = _sample(brdf, thetas_deg, azimuth_step_deg)
    side = values.shape[0] * values.shape[2]
    return values.transpose(0, 2, 1, 3, 4).reshape(side, side, 3)


def brdf_exposure(picture: np.ndarray, percentile: float = _WHITE_PERCENTILE) -> float:
    """Return the exposure that shows a percentile of a picture's brightest channel as white.

    Returns 1 for a black picture.
    """
    white = float(np.percentile(np.max(picture, axis=-1), percentile))
    if white <= 0.0:
        white = float(np.max(picture))
    return 1.0 / white if white > 0.0 else 1.0


def shown_brdfs(brdfs: Sequence[Brdf]) -> list[np.ndarray]:
    """Return small pictures of BRDFs, all with the exposure that suits the first.

    Args:
        brdfs: at least one.

    Returns:
        uint8 (144, 144, 3) each, sRGB-encoded: polar angles from 0 to 75°, as far as the data go.
    """
    thetas = _within(brdfs)
    pictures = [brdf_picture(brdf, thetas, _SHOWN_STEP_DEG) for brdf in brdfs]
    exposure = brdf_exposure(pictures[0])
    return [to_srgb8(picture, exposure) for picture in pictures]


def grid_values(brdf: Brdf) -> np.ndarray:
    """Return f_r on a grid of 15° up to 75°, or as far as the data go.

    Returns:
        float32 (theta_i, theta_v, phi_i, phi_v, 3), 1/sr.
    """
    return _sample(brdf, _within([brdf]), _SHOWN_STEP_DEG)


def _within(brdfs: Sequence[Brdf]) -> list[float]:
    """Return the polar angles of pictures at which all BRDFs have data, in degrees."""
    end = float(np.degrees(min(brdf.theta_max for brdf in brdfs)))
    return [theta for theta in THETAS_DEG if theta <= end + 1e-6]


def check_thetas(thetas_deg: Sequence[float]) -> np.ndarray:
    """Return the polar angles as an array of degrees.

    Raises:
        SimrigError: when they are not increasing within [0, 90).
    """
    degrees = np.asarray(thetas_deg, dtype=np.float64)
    increasing = degrees.ndim == 1 and degrees.size > 0 and bool(np.all(np.diff(degrees) > 0.0))
    if not increasing or not 0.0 <= degrees[0] <= degrees[-1] < 90.0:
        raise SimrigError(f"polar angles must increase within [0, 90) degrees, got {thetas_deg}")
    return degrees


def _sample(brdf: Brdf, thetas_deg: Sequence[float], azimuth_step_deg: float) -> np.ndarray:
    """Evaluate f_r, shape (theta_i, theta_v, phi_i, phi_v, rgb), float32."""
    theta = np.radians(check_thetas(thetas_deg))
    count = 360.0 / azimuth_step_deg if azimuth_step_deg > 0.0 else 0.0
    if count < 1.0 or abs(count - round(count)) > 1e-6:
        raise SimrigError(f"the azimuth step must divide 360 degrees, got {azimuth_step_deg:g}")
    phi = 2.0 * np.pi * np.arange(round(count)) / round(count)
    wi = to_vector(theta[:, None, None, None], phi[:, None])
    wv = to_vector(theta[:, None, None], phi)
    values = evaluate(brdf, wi, wv, backend.types("float32").Float).astype(np.float32)
    if not np.isfinite(values).all():
        raise SimrigError(f"'{brdf.name}' has values that are NaN or infinite")
    return values

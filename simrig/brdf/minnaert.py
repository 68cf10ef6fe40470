"""The simplified one-lobe model of Lafortune et al. 1997, and its fit (thesis equation 6.1)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from simrig.brdf.protocol import Brdf
from simrig.core.arrays import Array, components, namespace, read_only, scale
from simrig.core.errors import SimrigError

EXPONENTS = (-8.0, 100.0)
# a fit stays within these: measured means decide no steeper lobe, and nothing extrapolates wildly
FIT_EXPONENTS = (-8.0, 16.0)
_TINY = 1e-12  # smallest product of cosines
_LARGEST_LOG = 60.0  # of the lobe, so that float32 stays finite at the horizon


class Minnaert(Brdf):
    """f_r = k (cos θ_i · cos θ_v)^α: what of Lafortune's lobe does not depend on azimuths.

    Args:
        k: linear RGB, >= 0, in 1/sr.
        exponent: α in [-8, 100]; a negative one brightens towards grazing directions, up to a
            factor of e^60.
    """

    kind = "minnaert"

    def __init__(
        self, k: Sequence[float] = (0.2, 0.2, 0.2), exponent: float = 1.0, name: str = "minnaert"
    ):
        self.k = read_only(k, np.float64)
        if self.k.shape != (3,) or not np.all(np.isfinite(self.k)) or self.k.min() < 0.0:
            raise SimrigError(f"k must be three finite values >= 0 (linear RGB), got {k!r}")
        low, high = EXPONENTS
        if not low <= exponent <= high:
            raise SimrigError(f"exponent must lie in [{low:g}, {high:g}], got {exponent!r}")
        self.exponent, self.name = float(exponent), name

    def data(self) -> Mapping[str, np.ndarray]:
        return {"k": self.k, "exponent": read_only(self.exponent)}

    def look_up(self, wi: Array, wv: Array, tables: Mapping[str, Array]) -> Array:
        z_i, z_v = components(wi)[2], components(wv)[2]
        xp = namespace(z_i)
        log_lobe = tables["exponent"] * xp.log(xp.maximum(z_i * z_v, _TINY))
        return scale(tables["k"], xp.exp(xp.clip(log_lobe, -_LARGEST_LOG, _LARGEST_LOG)))


class MinnaertFit(NamedTuple):
    """What ``fit_minnaert`` found.

    Attributes:
        residual: root mean square of the residuals over that of the values; 0 for no values > 0.
    """

    k: float
    exponent: float
    residual: float


def fit_minnaert(theta_i: np.ndarray, theta_v: np.ndarray, values: np.ndarray) -> MinnaertFit:
    """Fit k and α to values of one channel by least squares.

    The start is the median of the slopes between all pairs of values in logarithms (Theil and
    Sen), so a few outliers cannot send the fit elsewhere. Values that say nothing of α (all zero,
    one polar angle only, one positive value) give α = 0.

    Args:
        theta_i, theta_v: polar angles in radians, (n,), below 90°.
        values: (n,), finite and >= 0.

    Raises:
        SimrigError: values that are negative, not finite, or none.
    """
    from scipy.optimize import least_squares

    values = np.asarray(values, dtype=np.float64)
    if values.size == 0 or not np.all(np.isfinite(values)) or values.min() < 0.0:
        raise SimrigError("the Lafortune model is fitted to finite values >= 0, at least one")
    scale = float(values.max())
    if scale == 0.0:
        return MinnaertFit(0.0, 0.0, 0.0)
    y = values / scale
    x = np.log(np.maximum(np.cos(theta_i) * np.cos(theta_v), _TINY))
    slope = _median_slope(x, y)
    if slope is None:
        k, exponent = float(y.mean()), 0.0
    else:
        lit = y > 0.0
        start = (float(np.median(np.log(y[lit]) - slope * x[lit])), slope)
        low, high = FIT_EXPONENTS
        found = least_squares(
            lambda p: np.exp(p[0] + p[1] * x) - y,
            start,
            jac=lambda p: np.exp(p[0] + p[1] * x)[:, None] * np.stack([np.ones_like(x), x], 1),
            bounds=([-700.0, low], [700.0, high]),
            xtol=1e-15,
            ftol=1e-15,
            gtol=1e-15,
        )
        k, exponent = float(np.exp(found.x[0])), float(found.x[1])
    residual = np.sqrt(np.mean((k * np.exp(exponent * x) - y) ** 2) / np.mean(y**2))
    return MinnaertFit(k * scale, exponent, float(residual))


def _median_slope(x: np.ndarray, y: np.ndarray) -> float | None:
    """Return the median slope of log y over x between positive values, None where there is none."""
    lit = y > 0.0
    x, log_y = x[lit], np.log(y[lit])
    first, second = np.triu_indices(len(x), 1)
    apart = np.abs(x[first] - x[second]) > 1e-9
    if not np.any(apart):
        return None
    first, second = first[apart], second[apart]
    slopes = (log_y[first] - log_y[second]) / (x[first] - x[second])
    inside = np.array(FIT_EXPONENTS) * (1.0 - 1e-6)
    return float(np.clip(np.median(slopes), *inside))

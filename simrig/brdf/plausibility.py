"""Whether a material can be: what it gives back, reciprocity, and what its channels hold."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from simrig.brdf.protocol import Brdf, evaluate
from simrig.core.gamut import KEEP
from simrig.directions.spherical import to_vector

_VIEWS_DEG = (0.0, 30.0, 60.0)
_NODES = (64, 128)  # polar angles and azimuths of an albedo; within a percent for what is plausible
_PAIRS = 4000
_MOST_ALBEDO = 1.0 + 5e-3
_RECIPROCAL = 0.02  # relative, weighted by the cosines; rounding and interpolation stay below
_CHANNELS = ("red", "green", "blue")


@dataclass(frozen=True)
class Plausibility:
    """What a look at a BRDF found.

    Attributes:
        albedo: linear RGB at the view polar angles of ``views_deg``, one row each.
        views_deg: 0, 30 and 60, as far as the data reach.
        reciprocity: mean of |f(i, v) - f(v, i)| over the mean of f, both weighted by the cosines.
        negative_share: part of the stored values that are negative, before they become 0.
        constant_channels: channels that have one value over all directions.
        remarks: what is not plausible or worth knowing, one line each; empty where all is well.
    """

    albedo: tuple[tuple[float, float, float], ...]
    views_deg: tuple[float, ...]
    reciprocity: float
    negative_share: float
    constant_channels: tuple[str, ...]
    remarks: tuple[str, ...]

    def as_dict(self) -> dict[str, Any]:
        """Return it as plain values."""
        return asdict(self)


def plausibility(brdf: Brdf) -> Plausibility:
    """Look at a BRDF: 4,000 pairs of directions, and the albedo of three views."""
    top = min(float(np.degrees(brdf.theta_max)), 89.0)
    views = tuple(view for view in _VIEWS_DEG if view <= top)
    albedo = np.array([brdf.directional_albedo(np.radians(v), 0.0, *_NODES) for v in views])
    rng = np.random.default_rng(0)
    lowest = np.cos(np.radians(top))
    wi, wv = (
        to_vector(
            np.arccos(rng.uniform(lowest, 1.0, _PAIRS)), rng.uniform(0.0, 2.0 * np.pi, _PAIRS)
        )
        for _ in range(2)
    )
    there, back = evaluate(brdf, wi, wv), evaluate(brdf, wv, wi)
    weight = (wi[:, 2] * wv[:, 2])[:, None]
    total = float((weight * there).sum())
    reciprocity = float((weight * np.abs(there - back)).sum()) / total if total > 0.0 else 0.0
    constant = tuple(
        name
        for name, column in zip(_CHANNELS, there.T, strict=True)
        if np.ptp(column) <= 1e-6 * np.abs(column).max()
    )
    negative = _negative_share(brdf)
    remarks = _remarks(albedo, views, reciprocity, negative, constant, there, brdf.gamut)
    rows = tuple((float(r), float(g), float(b)) for r, g, b in albedo)
    return Plausibility(rows, views, reciprocity, negative, constant, tuple(remarks))


def _negative_share(brdf: Brdf) -> float:
    """Return the part of the stored colours that is negative (out of gamut, or noise)."""
    data = brdf.data()
    for name in ("values", "rgb"):
        if name in data and data[name].ndim >= 2:
            return float(np.mean(data[name] < 0.0))
    return 0.0


def _remarks(
    albedo: np.ndarray,
    views: tuple[float, ...],
    reciprocity: float,
    negative: float,
    constant: tuple[str, ...],
    values: np.ndarray,
    gamut: str,
) -> list[str]:
    remarks = []
    worst = np.unravel_index(int(np.argmax(albedo)), albedo.shape)
    if albedo[worst] > _MOST_ALBEDO:
        remarks.append(
            f"albedo {albedo[worst]:.3g} at {views[worst[0]]:g}°: more light than it gets; values "
            "may be in percent, XYZ, or f_r times π (--factor)"
        )
    if albedo.max() <= 0.0:
        remarks.append("black: it gives nothing back")
    if reciprocity > _RECIPROCAL:
        remarks.append(
            f"not reciprocal: light and view swapped differ by {100 * reciprocity:.3g} %"
        )
    kept = ", kept" if gamut == KEEP else " and count as 0"
    if negative > 0.0:
        remarks.append(f"{100 * negative:.3g} % of the stored values are negative{kept}")
    dark = [name for name, column in zip(_CHANNELS, values.T, strict=True) if column.max() <= 0.0]
    if dark and len(dark) < 3:
        remarks.append(f"{' and '.join(dark)} is 0 everywhere")
    elif constant and len(constant) < 3:
        remarks.append(f"{' and '.join(constant)} is the same for all directions")
    elif len(constant) == 3 and albedo.max() > 0.0:
        remarks.append("the same for all directions (Lambertian)")
    if (
        not dark
        and np.array_equal(values[:, 0], values[:, 1])
        and np.array_equal(values[:, 1], values[:, 2])
    ):
        remarks.append("grey: its channels are equal")
    return remarks

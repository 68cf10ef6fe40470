"""How anisotropic a table is, how many highlights it has, and whether they differ in colour."""

from __future__ import annotations

from typing import Any

import numpy as np

from simrig.core.peaks import prominences

STRONG, WEAK = 0.2, 0.06  # of the anisotropy
_RISE = 0.12  # of a highlight over the valley beside it, of the logarithm


def characterised(values: np.ndarray) -> dict[str, Any]:
    """Return what Table A.2 says of a material.

    The anisotropy is the standard deviation of the logarithm of f_r along axial slices (both
    azimuths turn together), root mean square over the slices of all subspaces. Highlights are
    maxima of the mean profile over the half vector's azimuth within half a turn, at polar angles
    from 30° on. Two of them have two colours where their shares of red or blue differ by a tenth.

    Args:
        values: (n_theta, n_theta, n_phi, n_phi, 3) f_r in 1/sr.

    Returns:
        ``anisotropy``, ``strength`` ("strong", "weak", "none"), ``highlights`` (0 to 2),
        ``two_colours``, ``brightness`` (mean of f_r).
    """
    n = values.shape[2]
    floor = max(1e-3 * float(values.mean()), float(np.finfo(np.float32).tiny))
    logs = np.log(values[1:, 1:].astype(np.float64) + floor)
    turns = (np.arange(n)[:, None] + np.arange(n)) % n  # [difference, turn] -> view azimuth
    axial = logs[:, :, np.arange(n)[None, :], turns]  # (i, v, difference, turn, 3)
    strength = float(np.sqrt(axial.mean(axis=-1).var(axis=3).mean()))
    steep = axial[1:, 1:, n // 2 - 4 : n // 2 + 5]  # about the plane of incidence, forwards
    profile = steep.mean(axis=(0, 1, 2))  # (turn, 3)
    half = 0.5 * (profile[: n // 2] + profile[n // 2 :])
    brightness = half.mean(axis=1)
    found = [place for place, rise in prominences(brightness) if rise > _RISE]
    name = "strong" if strength > STRONG else "weak" if strength > WEAK else "none"
    highlights = min(len(found), 2) if name != "none" else 0
    two = False
    if highlights == 2:
        shares = np.exp(half[found[:2]])
        shares /= shares.sum(axis=1, keepdims=True)
        two = bool(np.abs(shares[0] - shares[1]).max() > 0.1)
    return {
        "anisotropy": round(strength, 4),
        "strength": name,
        "highlights": highlights,
        "two_colours": two,
        "brightness": round(float(values.mean()), 6),
    }

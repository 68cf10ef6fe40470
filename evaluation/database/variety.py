"""How varied a database is: what MERL and UTIA are known for, and a sheet as thesis Fig. A.7."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np

from simrig.database.slices import Slices
from simrig.database.store import Database
from simrig.mesostructure.collection import TABLE_A2

_KEPT = (1, 5, 10, 20, 40, 80)  # components of left-out projections
_PEAK = np.log(1e4)  # of the logarithmic PSNR: four decades
_LEFT_OUT = 8  # materials, evenly apart


def variety(slices: Slices) -> dict[str, Any]:
    """Return measures of the variety of a database's slices.

    Returns:
        ``entropy_rank`` (exponential of the entropy of the variances), ``components_95`` and
        ``components_99`` of the variance, ``left_out_psnr`` (20 log10(ln 10⁴ / RMS) of slices of
        materials projected on the first k components of the others, dB), ``nearest`` (least, median
        and largest log-RMS distance of a material's mean slice to the nearest other one).
    """
    basis = slices.basis()
    share = basis.deviations**2
    total = float(share.sum())
    found: dict[str, Any] = {"entropy_rank": 1.0, "components_95": 1, "components_99": 1}
    if total > 0.0:
        share = share / total
        entropy = -float(np.sum(share * np.log(np.maximum(share, 1e-300))))
        summed = np.cumsum(share)
        found = {"entropy_rank": round(float(np.exp(entropy)), 2)} | {
            f"components_{p}": int(np.searchsorted(summed, p / 100.0) + 1) for p in (95, 99)
        }
    if len(slices.names) > 1:
        found["left_out_psnr"] = _left_out(slices)
        apart = np.sqrt(
            np.mean((slices.means[:, None] - slices.means[None]) ** 2, axis=-1, dtype=np.float64)
        )
        nearest = (apart + np.diag(np.full(len(apart), np.inf))).min(axis=1)
        found["nearest"] = [
            round(float(x), 4) for x in (nearest.min(), np.median(nearest), nearest.max())
        ]
    return found


def _left_out(slices: Slices) -> dict[str, float]:
    count = len(slices.names)
    chosen = np.unique(np.linspace(0, count - 1, min(count, _LEFT_OUT)).astype(int))
    errors: dict[int, list[float]] = {k: [] for k in _KEPT}
    for number in chosen:
        basis = slices.basis([int(number)])
        logs = slices.logs(int(number)).reshape(len(basis.mean), -1) - basis.mean[:, None]
        along = basis.components.T @ logs
        for k in _KEPT:
            lost = logs - basis.components[:, :k] @ along[:k]
            rms = max(float(np.sqrt(np.mean(lost**2))), 1e-9)
            errors[k].append(20.0 * float(np.log10(_PEAK / rms)))
    return {str(k): round(float(np.mean(values)), 2) for k, values in errors.items()}


def counted(database: Database) -> list[dict[str, Any]]:
    """Return per category what Table A.2 counts, of the database and of the thesis."""
    rows = []
    for category, of_thesis in TABLE_A2.items():
        own = [e.about for e in database.entries if e.category == category]
        strengths = Counter(one.get("strength") for one in own)
        highlights = Counter(one.get("highlights") for one in own)
        ours = [
            len(own),
            strengths["strong"],
            strengths["weak"],
            highlights[2],
            sum(bool(one.get("two_colours")) for one in own),
        ]
        rows.append({"category": category, "ours": ours, "thesis": list(of_thesis)})
    return rows


def sheet(database: Database, pixels: int = 64, columns: int = 15) -> np.ndarray:
    """Return the materials as one picture, row by row: each BRDF above its sphere (Fig. A.7).

    Returns:
        (rows · 2 · pixels, columns · pixels, 3) uint8 sRGB, each material at its own exposure.
    """
    from PIL import Image

    from simrig.evaluation.metrics.sphere_picture import SpherePicture
    from simrig.files.images import to_srgb8
    from simrig.viewing.brdf.picture import brdf_exposure, brdf_picture

    cells = []
    for entry in database.entries:
        brdf = entry.load()
        flat = brdf_picture(brdf, azimuth_step_deg=15.0)
        stage = SpherePicture(brdf, pixels)
        shown = (
            to_srgb8(flat * brdf_exposure(flat)),
            to_srgb8(stage.image * stage.exposure),
        )
        own = [np.asarray(Image.fromarray(one).resize((pixels, pixels))) for one in shown]
        cells.append(np.concatenate(own))
    columns = min(columns, len(cells))
    cells += [np.full_like(cells[0], 255)] * (-len(cells) % columns)
    lines = [np.concatenate(cells[k : k + columns], axis=1) for k in range(0, len(cells), columns)]
    return np.concatenate(lines)

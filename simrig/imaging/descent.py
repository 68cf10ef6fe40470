"""Going down to the plane that aligns pictures best, and how well it is known then."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from simrig.imaging.alignment import Alignment, Plane, principal

_STEPS = 12  # of Gauss-Newton, at most
_DONE_MM = 2e-5  # change of the heights at the origin and at the borders that ends it
_LEAST_PARALLAX = 0.05  # pixels by which a height of 1 mm moves between views, rms
_CELL = 5  # pixels of a patch's cells, a side


@dataclass(frozen=True, eq=False)
class Descent:
    """Where the descent stands: the error there, the step that would lower it, the uncertainty."""

    plane: Plane
    error: float
    step: np.ndarray
    covariance: np.ndarray
    relief_mm: float


def descend(level: Alignment, start: Plane, height_mm: float) -> Descent:
    """Go down by Gauss-Newton; a step that does not lower the error is halved."""
    here = linearised(level, start)
    edge = float(np.abs(level.patches.x).max())
    for _ in range(_STEPS):
        step, moved = here.step, None
        limit = np.abs(step[0]) + edge * np.abs(step[1:]).sum()
        step = step * min(1.0, 0.5 * height_mm / max(limit, 1e-12))
        for _ in range(3):
            there = linearised(level, Plane(*(float(v) for v in here.plane.numbers + step)))
            if there.error < here.error:
                moved = there
                break
            step = 0.5 * step
        if moved is None:
            break
        here = moved
        if np.abs(step[0]) + edge * np.abs(step[1:]).sum() < _DONE_MM:
            break
    return here


def linearised(level: Alignment, plane: Plane) -> Descent:
    """Return the error of a plane and the Gauss-Newton step from it."""
    x, y = level.patches.x, level.patches.y
    rows = level.matrix(plane).reshape(len(level.weights), -1)
    whole = float(np.sum(rows.astype(np.float64) ** 2))
    slope = level.slope(plane, rows)
    # by the height of the plane, of which slopes change x and y times as much
    by = np.stack([slope, slope * x.astype(np.float32), slope * y.astype(np.float32)])
    jacobian = (by - by.mean(axis=-1, keepdims=True)).reshape(3, *rows.shape)
    centred = rows - rows.mean(axis=0)
    energy, kept = principal(centred.astype(np.float64), level.components)
    strength = np.sqrt(np.maximum(energy, 1e-30 * max(whole, 1e-300)))
    # einsum, which leaves BLAS and its threads alone (see ``alignment.principal``)
    modes, base = kept.astype(np.float32), (kept / strength).astype(np.float32)
    pictures = np.einsum("vk,vp->kp", base, centred)
    residual = centred - np.einsum("vk,kp->vp", modes, np.einsum("vk,vp->kp", modes, centred))
    free = jacobian - jacobian.mean(axis=1, keepdims=True)
    free -= np.einsum("vk,jkp->jvp", modes, np.einsum("vk,jvp->jkp", modes, free))
    free -= np.einsum("jvk,kp->jvp", np.einsum("jvp,kp->jvk", free, pictures), pictures)
    scores = np.sum(free * residual, axis=-1, dtype=np.float64)
    flat = free.reshape(3, -1).astype(np.float64)
    normal = np.einsum("ip,jp->ij", flat, flat)
    error = float(np.sqrt(np.sum(residual.astype(np.float64) ** 2) / whole)) if whole else 0.0
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    scaled = normal / np.outer(scale, scale)
    away = level.views.cameras_mm[:, :2] / level.views.cameras_mm[:, 2:]
    parallax = float(np.sqrt(np.mean(np.sum((away - away.mean(axis=0)) ** 2, axis=1))))
    alike = parallax < _LEAST_PARALLAX * level.views.pitch_mm
    if alike or np.linalg.cond(scaled) > 1e8 or not np.isfinite(scaled).all():
        return Descent(plane, error, np.zeros(3), np.diag([np.inf] * 3), 0.0)
    inverse = np.linalg.inv(scaled) / np.outer(scale, scale)
    step = -inverse @ scores.sum(axis=1)
    count = len(level.weights)
    own = scores - scores.mean(axis=1, keepdims=True)
    by_views = inverse @ (own @ own.T) @ inverse * count / max(count - 3, 1)
    by_patches, relief = _scatter(level, free[0], residual)
    # where noise makes up the error, its smoothing between pixels pulls as well
    covariance = (by_views + by_patches) / max(1.0 - error**2, 1e-6) ** 2
    covariance[0, 0] += relief**2  # the mean height and that of the structure are two things
    return Descent(plane, error, step, covariance, relief)


def _scatter(
    level: Alignment, by_height: np.ndarray, residual: np.ndarray
) -> tuple[np.ndarray, float]:
    """Return how uncertain a plane is by the scatter of the patches' heights, and the relief.

    Args:
        level: the measure.
        by_height: derivative of the residual by the height, (views, pixels of all patches).
        residual: likewise.

    Returns:
        (3, 3), zero for fewer than five patches, and the standard deviation of the cells' heights
        in mm beyond what noise makes of it.
    """
    x, y = level.patches.x, level.patches.y
    side = round(x.shape[1] ** 0.5)
    cells = side // _CELL

    def summed(values: np.ndarray) -> np.ndarray:
        """Return sums over views and the pixels of every cell, (patches, cells, cells)."""
        square = values.reshape(len(x), side, side)[:, : cells * _CELL, : cells * _CELL]
        return square.reshape(len(x), cells, _CELL, cells, _CELL).sum(axis=(2, 4))

    strength, pull, left = (
        summed(np.einsum("vp,vp->p", first, second, dtype=np.float64))
        for first, second in ((by_height, by_height), (by_height, residual), (residual, residual))
    )
    telling = strength > 0.1 * np.median(strength)
    if not telling.any() or not np.median(strength) > 0.0:
        return np.zeros((3, 3)), 0.0
    heights = -pull[telling] / strength[telling]
    noise = left[telling] / (len(level.weights) * _CELL**2) / strength[telling]
    weight = strength[telling] / strength[telling].sum()
    variance = float(np.sum(weight * (heights - np.sum(weight * heights)) ** 2))
    relief = float(np.sqrt(max(variance - float(np.sum(weight * noise)), 0.0)))
    if len(x) < 5:
        return np.zeros((3, 3)), relief
    total = np.maximum(strength.sum(axis=(1, 2)), 1e-300)
    patch_heights = -pull.sum(axis=(1, 2)) / total
    columns = np.stack([np.ones(len(x)), x.mean(axis=1), y.mean(axis=1)], axis=1)
    share = total / total.mean()
    inverse = np.linalg.inv(columns.T @ (share[:, None] * columns))
    off = patch_heights - columns @ (inverse @ columns.T @ (share * patch_heights))
    return inverse * float(np.sum(share * off**2)) / (len(x) - 3), relief

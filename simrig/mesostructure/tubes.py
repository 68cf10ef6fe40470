"""Curves and the tubes that are swept along them, many at a time.

Curves are arrays (k, n, 3): k curves of n points in mm. A curve that repeats with the tile ends
where it began, one period further (``period``): its tube stays open there and meets its copy,
ring on ring. Other tubes are closed by tips.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from simrig.core.errors import SimrigError
from simrig.mesostructure.tile import Part


def unit(vectors: np.ndarray) -> np.ndarray:
    """Return vectors (..., 3) scaled to length 1; a zero vector stays zero."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.maximum(length, 1e-12)


def tangents(curves: np.ndarray, period: np.ndarray | None = None) -> np.ndarray:
    """Return unit tangents (k, n, 3) by central differences, across the seam with ``period``."""
    if period is None:
        return unit(np.gradient(curves, axis=1))
    before = curves[:, -2:-1] - period
    after = curves[:, 1:2] + period
    around = np.concatenate([before, curves, after], axis=1)
    return unit(around[:, 2:] - around[:, :-2])


def frames(
    curves: np.ndarray, reference: np.ndarray, period: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return two unit vectors (k, n, 3) across each curve.

    Args:
        curves: (k, n, 3).
        reference: vectors that broadcast to the curves and are nowhere parallel to them.
        period: see above.

    Returns:
        The reference made perpendicular to the curve, and tangent × that.
    """
    t = tangents(curves, period)
    first = unit(reference - np.sum(reference * t, axis=-1, keepdims=True) * t)
    return first, np.cross(t, first)


def sweep(
    curves: np.ndarray,
    radii: np.ndarray | float | tuple[np.ndarray, np.ndarray],
    sides: int,
    bsdf: dict[str, Any],
    colours: np.ndarray,
    reference: np.ndarray | tuple[float, float, float] = (0.0, 0.0, 1.0),
    period: np.ndarray | None = None,
) -> Part:
    """Return tubes along curves.

    Args:
        curves: (k, n, 3) mm, n >= 2.
        radii: mm, broadcasting to (k, n); a pair for ellipses: along the reference, across it.
        sides: corners of the section, >= 3.
        bsdf: see ``Part``.
        colours: linear RGB albedo, broadcasting to (k, n, 3).
        reference: direction of the first radius, see ``frames``.
        period: see above; None closes both ends by tips.

    Raises:
        SimrigError: fewer than two points or three sides, or a radius that is not positive.
    """
    if curves.ndim != 3 or curves.shape[1] < 2 or sides < 3:
        raise SimrigError(
            f"tubes need curves of 2 points and 3 sides at least, got {curves.shape}, {sides}"
        )
    count, points = curves.shape[:2]
    pair = radii if isinstance(radii, tuple) else (radii, radii)
    a, b = (np.broadcast_to(np.asarray(r, dtype=float), (count, points))[..., None] for r in pair)
    if not min(a.min(), b.min()) > 0.0:
        raise SimrigError("the radius of a tube must be > 0 mm everywhere")
    first, second = (v[:, :, None, :] for v in frames(curves, np.asarray(reference), period))
    angle = 2.0 * np.pi * np.arange(sides) / sides
    cos, sin = np.cos(angle)[:, None], np.sin(angle)[:, None]
    a, b = a[..., None], b[..., None]
    rings = curves[:, :, None, :] + a * cos * first + b * sin * second
    normals = unit(cos / a * first + sin / b * second)
    length = _arc_length(curves)
    around = 2.0 * np.pi * float(a.mean()) * np.arange(sides) / sides
    uv = np.stack(np.broadcast_arrays(around, length[..., None]), axis=-1)
    tint = np.broadcast_to(colours, (count, points, 3))[:, :, None, :]
    tint = np.broadcast_to(tint, rings.shape)
    faces = _wall(count, points, sides)
    arrays = [v.reshape(-1, v.shape[-1]) for v in (rings, normals, tint, uv)]
    if period is None:
        tips, tip_faces = _tips(curves, np.minimum(a, b)[..., 0, 0], tint, length, sides)
        arrays = [np.concatenate(both) for both in zip(arrays, tips, strict=True)]
        faces = np.concatenate([faces, tip_faces])
    return Part(arrays[0], faces, arrays[1], arrays[2], bsdf, arrays[3])


def _arc_length(curves: np.ndarray) -> np.ndarray:
    steps = np.linalg.norm(np.diff(curves, axis=1), axis=-1)
    return np.pad(np.cumsum(steps, axis=1), [(0, 0), (1, 0)])


def _wall(count: int, points: int, sides: int) -> np.ndarray:
    """Return the faces between the rings, corner m of ring i of curve k at (k, i, m)."""
    index = np.arange(count * points * sides).reshape(count, points, sides)
    here, ahead = index[:, :-1], index[:, 1:]
    here_next, ahead_next = np.roll(here, -1, 2), np.roll(ahead, -1, 2)
    lower = np.stack([here, here_next, ahead_next], axis=-1)
    upper = np.stack([here, ahead_next, ahead], axis=-1)
    return np.concatenate([lower.reshape(-1, 3), upper.reshape(-1, 3)])


def _tips(
    curves: np.ndarray, radii: np.ndarray, tint: np.ndarray, length: np.ndarray, sides: int
) -> tuple[list[np.ndarray], np.ndarray]:
    """Return vertices, normals, colours and uv of the tips, and their faces."""
    count, points = curves.shape[:2]
    t = tangents(curves)
    begin = curves[:, 0] - 0.5 * radii[:, 0, None] * t[:, 0]
    end = curves[:, -1] + 0.5 * radii[:, -1, None] * t[:, -1]
    vertices = np.concatenate([begin, end])
    normals = np.concatenate([-t[:, 0], t[:, -1]])
    colours = np.concatenate([tint[:, 0, 0], tint[:, -1, 0]])
    uv = np.stack([np.zeros(2 * count), np.concatenate([length[:, 0], length[:, -1]])], axis=1)
    index = np.arange(count * points * sides).reshape(count, points, sides)
    apex = count * points * sides + np.arange(2 * count)
    first, last = index[:, 0], index[:, -1]
    low = np.broadcast_to(apex[:count, None], first.shape)
    high = np.broadcast_to(apex[count:, None], last.shape)
    faces = [
        np.stack([low, np.roll(first, -1, 1), first], axis=-1),
        np.stack([high, last, np.roll(last, -1, 1)], axis=-1),
    ]
    return [vertices, normals, colours, uv], np.concatenate(faces).reshape(-1, 3)


def periodic_noise(count: int, points: int, harmonics: int, rng: np.random.Generator) -> np.ndarray:
    """Return smooth random functions (count, points) of period points − 1, deviation about 1.

    The last value repeats the first.
    """
    k = np.arange(1, harmonics + 1)
    amplitude = rng.standard_normal((2, count, harmonics)) / np.sqrt(harmonics)
    phase = 2.0 * np.pi * k[:, None] * np.arange(points)[None, :] / (points - 1)
    return amplitude[0] @ np.cos(phase) + amplitude[1] @ np.sin(phase)


def merged(parts: list[Part]) -> Part:
    """Return parts with the same BSDF as one."""
    offsets = np.cumsum([0, *(len(p.vertices) for p in parts)])
    faces = [p.faces.astype(np.int64) + o for p, o in zip(parts, offsets, strict=False)]

    def joined(name: str) -> np.ndarray | None:
        arrays = [getattr(p, name) for p in parts]
        return None if any(a is None for a in arrays) else np.concatenate(arrays)

    vertices = np.concatenate([p.vertices for p in parts])
    return Part(
        vertices,
        np.concatenate(faces),
        joined("normals"),
        joined("colours"),
        parts[0].bsdf,
        joined("uv"),
    )

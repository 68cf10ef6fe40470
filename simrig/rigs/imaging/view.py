"""What every pixel of a view sees of the sample and of the frame around it, exact at edges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from simrig.rigs.imaging.optics import Optics

_FLAT = 1e-3  # least ratio of the slopes of an edge, below which it counts as along the pixels


@dataclass(frozen=True, eq=False)
class View:
    """The pixels of one camera, and where they look on the plane of the frame, z = 0.

    Attributes:
        origin: (3,) the camera's, or the point of its lens, mm.
        pixels: (n,) numbers of the pixels that see any of the sample, row by row.
        points: (n, 3) of them: where the centre of the pixel looks, within the sample.
        steps: (2, n, 2) by how much a pixel's step to the right and down moves its point.
        sample: (n,) share of the pixel that the sample covers.
        frame_pixels, frame_points, frame: the same for the white frame.
        black: (height, width) share that neither covers.
    """

    origin: np.ndarray
    pixels: np.ndarray
    points: np.ndarray
    steps: np.ndarray
    sample: np.ndarray
    frame_pixels: np.ndarray
    frame_points: np.ndarray
    frame: np.ndarray
    black: np.ndarray

    @property
    def towards(self) -> np.ndarray:
        """Unit vectors from the sample's points to the camera, (n, 3)."""
        to_camera = self.origin - self.points
        return np.asarray(to_camera / np.linalg.norm(to_camera, axis=1, keepdims=True))


def view_of(
    optics: Optics,
    camera_to_world: np.ndarray,
    distorted: bool,
    lens: np.ndarray | None = None,
    frame_z_mm: float = 0.0,
) -> View:
    """Return what the pixels of a camera see.

    Edges are straight lines across a pixel, and the area on their one side is exact; at a corner it
    is the product of two.

    Args:
        optics: the instrument.
        camera_to_world: (4, 4).
        distorted: the lens distorts.
        lens: (2,) point of the lens that is looked through, mm from its centre; the lens is
            focused on what is as far as the sample's centre.
        frame_z_mm: of the frame, above the sample.
    """
    at = np.zeros(2) if lens is None else np.asarray(lens)
    origin = camera_to_world[:3, 3] + camera_to_world[:3, :2] @ at

    straight = optics.looks(distorted)
    depth, turn = optics.moves.camera_mm, camera_to_world[:3, :3]
    x, y = straight[..., 0] * depth - at[0], straight[..., 1] * depth - at[1]
    ray = [x * turn[k, 0] + y * turn[k, 1] + depth * turn[k, 2] for k in range(3)]
    # a pixel that looks past the horizon sees no plane
    down = np.where(ray[2] < -1e-12, ray[2], np.nan)
    step = depth / optics.intrinsics[0, 0]

    def plane(z: float) -> tuple[np.ndarray, list[np.ndarray]]:
        """Return where pixels look at a height, and how a step to the right and down moves that."""
        reach = (z - origin[2]) / down
        shown = np.stack([origin[0] + reach * ray[0], origin[1] + reach * ray[1]], axis=-1)
        return shown, [
            (reach * step)[..., None]
            * np.stack([turn[k, c] - ray[k] * (turn[2, c] / down) for k in (0, 1)], axis=-1)
            for c in (0, 1)
        ]

    centre, steps = plane(0.0)
    half = 0.5 * optics.sample_mm
    sample, frame = _square(centre, steps, half), np.zeros(centre.shape[:2])
    framed = centre
    if optics.frame_mm is not None and not np.all(sample == 1.0):
        inner, outer = (0.5 * side for side in optics.frame_mm)
        framed, across = (centre, steps) if frame_z_mm == 0.0 else plane(frame_z_mm)
        frame = _square(framed, across, outer) - _square(framed, across, inner)
    on, around = sample.ravel() > 0.0, frame.ravel() > 0.0
    flat = np.concatenate([centre.reshape(-1, 2), np.zeros((centre[..., 0].size, 1))], axis=1)
    inside = flat[on]
    inside[:, :2] = np.clip(inside[:, :2], -half, half)
    return View(
        origin,
        np.flatnonzero(on),
        inside,
        np.stack([part.reshape(-1, 2)[on] for part in steps]),
        sample.ravel()[on],
        np.flatnonzero(around),
        np.pad(framed.reshape(-1, 2)[around], ((0, 0), (0, 1)), constant_values=frame_z_mm),
        frame.ravel()[around],
        1.0 - sample - frame,
    )


def _square(centre: np.ndarray, steps: list[np.ndarray], half: float) -> np.ndarray:
    """Return the share of pixels that a square around the origin covers, (height, width)."""
    share = np.ones(centre.shape[:2])
    right, down = (np.abs(step) for step in steps)
    if np.all(np.abs(centre) + right + down <= half):
        return share
    for axis in (0, 1):
        for sign in (-1.0, 1.0):
            distance = half - sign * centre[..., axis]
            share = share * _beside(distance, right[..., axis], down[..., axis])
    return np.nan_to_num(share)


def _beside(distance: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the share of unit pixels where distance + a s + b t >= 0 for s, t within ±1/2.

    It is the distribution function of the sum of two uniform numbers of widths a and b.
    """
    wide = np.maximum(a, b)
    narrow = np.maximum(np.minimum(a, b), _FLAT * wide)
    with np.errstate(invalid="ignore", divide="ignore"):
        d, e = distance / wide, narrow / wide
        square = [
            np.maximum(d + 0.5 * (s + t * e), 0.0) ** 2 for s in (1.0, -1.0) for t in (1.0, -1.0)
        ]
        share = (square[0] - square[1] - square[2] + square[3]) / (2.0 * e)
        share = np.where(d >= 1.0, 1.0, np.where(d <= -1.0, 0.0, share))
    return np.clip(share, 0.0, 1.0)

"""Finding the registration frame in pictures: its edges as lines, its corners where they meet.

Thesis sections 4.2 and 6.4 and appendix C.1: a bright frame surrounds the sample, and pictures are
registered by the lines of its edges. Of every edge the steepest place is read along many normals,
by the centroid of the gradient, and a line goes through these places robustly; a corner is where
two lines meet, so it is known far better than a pixel and need not be seen itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy import ndimage

from simrig.core.errors import SimrigError
from simrig.imaging.camera import Camera
from simrig.imaging.checks import finite_array

_NORMALS = 160  # read along an edge, at most
_MARGIN = 0.08  # of an edge at its ends, where another edge is near
_FEWEST = 6  # places that make a line
_REACHES = (10.0, 4.0, 2.5)  # pixels to both sides of where an edge is expected, in turn
_STEPS = 4  # samples per pixel along a normal
_OUTLIER = 3.0  # robust standard deviations


@dataclass(frozen=True, eq=False)
class FoundMarks:
    """The corners of a frame in a picture.

    Attributes:
        pixels: (4, 2), in the order of the corners that were asked for.
        error: standard uncertainty of a corner in pixels, by the scatter about the lines.
        edges: places that were used on every edge.
    """

    pixels: np.ndarray
    error: float
    edges: tuple[int, ...]


def frame_corners(width_mm: float, height_mm: float) -> np.ndarray:
    """Return the corners of a frame around the origin, (4, 2) in mm: from -x +y clockwise."""
    x, y = 0.5 * width_mm, 0.5 * height_mm
    return np.array([[-x, y], [x, y], [x, -y], [-x, -y]])


def expected_frame(camera: Camera, corners_mm: np.ndarray) -> np.ndarray:
    """Return where a camera would see the corners of the reference plane, (4, 2) pixels."""
    flat = np.concatenate([corners_mm, np.zeros((len(corners_mm), 1))], axis=1)
    return camera.project(flat)


def find_frame(
    picture: np.ndarray,
    expected: np.ndarray,
    camera: Camera | None = None,
    reach: float = _REACHES[0],
) -> FoundMarks:
    """Find the outer corners of a bright frame near where they are expected.

    Args:
        picture: (height, width) linear values; bright frame, dark outside.
        expected: (4, 2) pixels, in order around the frame.
        camera: its distortion is undone, so that edges are straight.
        reach: pixels within which the edges are expected.

    Raises:
        SimrigError: an edge that is not there, or leaves the picture.
    """
    grey = finite_array(picture, "the picture", (2,))
    corners = finite_array(expected, "the expected corners", (2,)).astype(np.float64)
    if corners.shape != (4, 2):
        raise SimrigError(f"a frame has four corners of two coordinates, got {corners.shape}")
    if camera is not None:
        corners = camera.straight(corners)
    noise, scatter = _grain(grey), np.zeros(4)
    used = [0, 0, 0, 0]
    for within in _REACHES:
        lines = []
        for side in range(4):
            ends = corners[side], corners[(side + 1) % 4]
            near = min(within, reach)
            places = _edge_places(grey, ends, corners.mean(axis=0), near, noise, camera)
            line, scatter[side], used[side] = _line(places, side)
            lines.append(line)
        corners = np.array([_meeting(lines[side - 1], lines[side]) for side in range(4)])
    error = float(np.sqrt(np.mean(scatter**2 / np.maximum(used, 1))) * 2.0)
    found = corners if camera is None else camera.bent(corners)
    return FoundMarks(found, error, tuple(used))


def search_frame(picture: np.ndarray) -> np.ndarray:
    """Find a bright frame on dark ground without knowing where it is.

    Returns:
        (4, 2) pixels, roughly, clockwise as the picture shows it, from the corner nearest to the
        top left: where the sample is turned by a quarter, nothing tells.

    Raises:
        SimrigError: no frame is seen whole.
    """
    grey = finite_array(picture, "the picture", (2,))
    top = float(np.percentile(grey, 99.5))
    if top <= float(grey.min()):
        raise SimrigError("no frame is seen: the picture is of one brightness")
    scaled = np.clip((grey - grey.min()) / (top - grey.min()) * 255.0, 0.0, 255.0).astype(np.uint8)
    _, bright = cv2.threshold(scaled, 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)
    shapes, _ = cv2.findContours(bright, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    for shape in sorted(shapes, key=cv2.contourArea, reverse=True)[:3]:
        hull = cv2.convexHull(shape)
        for share in (0.01, 0.02, 0.04, 0.06):
            corners = cv2.approxPolyDP(hull, share * cv2.arcLength(hull, True), True)
            if len(corners) == 4 and cv2.contourArea(corners) > 0.01 * grey.size:
                return _ordered(corners[:, 0].astype(np.float64))
    raise SimrigError("no frame is seen whole: its four corners must be in the picture")


def _ordered(corners: np.ndarray) -> np.ndarray:
    middle = corners.mean(axis=0)
    turn = np.arctan2(corners[:, 1] - middle[1], corners[:, 0] - middle[0])
    around = corners[np.argsort(turn)]  # rows go down, so this is clockwise as seen
    return np.roll(around, -int(np.argmin(around.sum(axis=1))), axis=0)


def _grain(grey: np.ndarray) -> float:
    """Return the noise of a picture, by the median of its second differences."""
    second = np.diff(grey[:: max(1, len(grey) // 200)], n=2, axis=1)
    return float(np.median(np.abs(second)) / 0.6745 / np.sqrt(6.0)) if second.size else 0.0


def _edge_places(
    grey: np.ndarray,
    ends: tuple[np.ndarray, np.ndarray],
    middle: np.ndarray,
    reach: float,
    noise: float,
    camera: Camera | None,
) -> np.ndarray:
    """Return the places (n, 2) across an edge where the picture falls off most, outwards."""
    along = ends[1] - ends[0]
    length = float(np.hypot(*along))
    if not length > _FEWEST:
        return np.empty((0, 2))
    normal = np.array([along[1], -along[0]]) / length
    if normal @ (middle - ends[0]) > 0.0:
        normal = -normal
    count = int(np.clip(length, _FEWEST, _NORMALS))
    share = np.linspace(_MARGIN, 1.0 - _MARGIN, count)
    starts = ends[0] + share[:, None] * along
    offsets = np.arange(-reach, reach + 0.5 / _STEPS, 1.0 / _STEPS)
    lines = starts[:, None] + offsets[:, None] * normal
    seen = lines if camera is None else camera.bent(lines.reshape(-1, 2)).reshape(lines.shape)
    height, width = grey.shape
    whole = ((seen >= 0.0) & (seen <= [width - 1.0, height - 1.0])).all(axis=(1, 2))
    if not whole.any():
        return np.empty((0, 2))
    seen = seen[whole]
    profile = ndimage.map_coordinates(grey, (seen[..., 1], seen[..., 0]), order=1, mode="nearest")
    fall = ndimage.gaussian_filter1d(-np.gradient(profile, axis=1), 0.5 * _STEPS, axis=1)
    top = fall.argmax(axis=1)
    rows = np.arange(len(fall))
    steps = np.arange(fall.shape[1])
    window = np.abs(steps - top[:, None]) <= 2 * _STEPS  # of the edge alone, not of its neighbours
    weight = np.where(window, np.maximum(fall - 0.1 * fall[rows, top][:, None], 0.0), 0.0)
    total = weight.sum(axis=1)
    contrast = profile.max(axis=1) - profile.min(axis=1)
    near_end = (top < _STEPS) | (top >= fall.shape[1] - _STEPS)
    good = (total > 0.0) & (contrast > 8.0 * noise) & ~near_end
    position = (weight * offsets).sum(axis=1)[good] / total[good]
    return starts[whole][good] + position[:, None] * normal


def _line(places: np.ndarray, side: int) -> tuple[np.ndarray, float, int]:
    """Return a line (point, direction), the scatter about it in pixels, how many places count."""
    keep = np.ones(len(places), dtype=bool)
    for _ in range(4):
        if keep.sum() < _FEWEST:
            raise SimrigError(
                f"edge {side + 1} of the frame is not seen where it should be: "
                f"{int(keep.sum())} places"
            )
        point = places[keep].mean(axis=0)
        direction = np.linalg.svd(places[keep] - point, full_matrices=False)[2][0]
        off = (places - point) @ np.array([-direction[1], direction[0]])
        spread = 1.4826 * float(np.median(np.abs(off[keep])))
        keep = np.abs(off) <= max(_OUTLIER * spread, 0.02)
    return np.stack([point, direction]), float(np.sqrt(np.mean(off[keep] ** 2))), int(keep.sum())


def _meeting(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return where two lines (point, direction) meet."""
    system = np.stack([first[1], -second[1]], axis=1)
    if abs(np.linalg.det(system)) < 1e-9:
        raise SimrigError("two edges of the frame are parallel in the picture: it is seen edge-on")
    return first[0] + np.linalg.solve(system, second[0] - first[0])[0] * first[1]

"""Photographs of a sample behind a frame, by rays: nothing here knows a homography.

Each pixel is the mean over rays from the camera's centre. A ray meets the frame in the plane z = 0,
or goes through its opening and meets the sample on a plane of its own, whose relief is found by
going along the ray. Light is fixed at the pole; what a point shows is its albedo times the cosine
of its relief, and a highlight (Blinn 1977) that moves over the relief with the view.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from simrig.evaluation.studies.registration.surfaces import SIZE_MM, TEXEL_MM, Surface

DISTANCE_MM = 2000.0  # thesis section 4.1
OPENING_MM, FRAME_MM = 52.0, 64.0  # of the frame: inner and outer side
_FRAME, _DARK = 0.8, 0.02  # albedos
_SHININESS = 30.0
_RELIEF_STEPS = 4


@dataclass(frozen=True)
class Lens:
    """The camera of the photographs.

    Attributes:
        pixels: a side.
        focal: focal length in pixels.
        radial: k1 of the distortion.
    """

    pixels: int = 330
    focal: float = 8700.0
    radial: float = 0.0

    @property
    def matrix(self) -> np.ndarray:
        """Intrinsics (3, 3)."""
        centre = 0.5 * (self.pixels - 1)
        return np.array([[self.focal, 0.0, centre], [0.0, self.focal, centre], [0.0, 0.0, 1.0]])


def view_directions(count: int, theta_max: float) -> np.ndarray:
    """Return polar angles and azimuths (count, 2) that cover a cap of the hemisphere uniformly."""
    number = np.arange(count) + 0.5
    cosine = 1.0 - (1.0 - np.cos(theta_max)) * number / count
    return np.stack([np.arccos(cosine), (number * np.pi * (3.0 - np.sqrt(5.0))) % (2 * np.pi)], 1)


def camera_to_world(theta: float, phi: float, roll: float = 0.0) -> np.ndarray:
    """Return the pose (4, 4) of a camera that looks at the origin, x right, y down, z ahead."""
    out = np.array([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)])
    right = np.array([-np.sin(phi), np.cos(phi), 0.0])
    down = np.cross(-out, right)
    pose = np.eye(4)
    pose[:3, 0] = np.cos(roll) * right + np.sin(roll) * down
    pose[:3, 1] = -np.sin(roll) * right + np.cos(roll) * down
    pose[:3, 2], pose[:3, 3] = -out, DISTANCE_MM * out
    return pose


def photograph(
    surface: Surface,
    normal: np.ndarray,
    z_mm: float,
    pose: np.ndarray,
    lens: Lens,
    noise: float,
    rng: np.random.Generator,
) -> np.ndarray:
    """Return a photograph, (pixels, pixels).

    Args:
        surface: of the sample.
        normal: of the sample's plane, which goes through (0, 0, z_mm).
        z_mm: height of that point over the frame's plane.
        pose: camera_to_world.
        noise: standard deviation relative to the frame's brightness, and of the signal's root.
    """
    foreshortened = abs(pose[2, 2])
    down = int(np.clip(np.ceil(2.0 / foreshortened), 2, 6))
    total = np.zeros((lens.pixels, lens.pixels))
    for i in range(down):
        for j in range(2):
            directions = _rays(pose, lens, ((j + 0.5) / 2.0 - 0.5, (i + 0.5) / down - 0.5))
            total += _radiance(surface, normal, z_mm, pose[:3, 3], directions)
    mean = total / (2 * down)
    return mean + noise * (0.3 + np.sqrt(mean)) * rng.normal(size=mean.shape)


def _rays(pose: np.ndarray, lens: Lens, offset: tuple[float, float]) -> np.ndarray:
    """Return directions (pixels, pixels, 3) through points of every pixel."""
    along = np.arange(lens.pixels) - 0.5 * (lens.pixels - 1)
    x, y = np.meshgrid((along + offset[0]) / lens.focal, (along + offset[1]) / lens.focal)
    if lens.radial:  # the lens bends what comes from straight x, y: undone by iteration
        bent_x, bent_y = x, y
        for _ in range(6):
            factor = 1.0 + lens.radial * (x * x + y * y)
            x, y = bent_x / factor, bent_y / factor
    return x[..., None] * pose[:3, 0] + y[..., None] * pose[:3, 1] + pose[:3, 2]


def _radiance(
    surface: Surface, normal: np.ndarray, z_mm: float, origin: np.ndarray, directions: np.ndarray
) -> np.ndarray:
    reach = -origin[2] / directions[..., 2]
    x, y = origin[0] + reach * directions[..., 0], origin[1] + reach * directions[..., 1]
    away = np.maximum(np.abs(x), np.abs(y))
    seen = np.where((away > 0.5 * OPENING_MM) & (away < 0.5 * FRAME_MM), _FRAME, _DARK)
    through = away < 0.5 * OPENING_MM
    rays = directions[through]
    if not len(rays):
        return seen
    height = np.zeros(len(rays))
    facing = rays @ normal
    base = np.array([0.0, 0.0, z_mm]) - origin
    for _ in range(_RELIEF_STEPS if surface.height_mm.any() else 1):
        at = (base @ normal + height) / facing
        px, py = origin[0] + at * rays[:, 0], origin[1] + at * rays[:, 1]
        height = _read(surface.height_mm, px, py) if surface.height_mm.any() else height
    albedo = _read(surface.albedo, px, py)
    if surface.height_mm.any():
        slope_y, slope_x = np.gradient(surface.height_mm, TEXEL_MM)
        tangent = [_read(slope, px, py) for slope in (slope_x, slope_y)]
        bumps = np.stack([-tangent[0], -tangent[1], np.ones_like(px)], axis=-1)
        bumps /= np.linalg.norm(bumps, axis=-1, keepdims=True)
    else:
        bumps = np.broadcast_to(normal, (len(px), 3))
    view = -rays / np.linalg.norm(rays, axis=-1, keepdims=True)
    half = view + np.array([0.0, 0.0, 1.0])
    half /= np.linalg.norm(half, axis=-1, keepdims=True)
    shine = surface.gloss * np.maximum((bumps * half).sum(axis=-1), 0.0) ** _SHININESS
    seen[through] = albedo * bumps[:, 2] + shine
    return seen


def _read(table: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return a table between its texels, bilinear, repeated."""
    side = len(table)
    column, row = (c / SIZE_MM * side + 0.5 * side - 0.5 for c in (x, y))
    left, below = np.floor(column).astype(np.int64), np.floor(row).astype(np.int64)
    u, v = column - left, row - below
    x0, x1, y0, y1 = left % side, (left + 1) % side, below % side, (below + 1) % side
    lower = table[y0, x0] * (1.0 - u) + table[y0, x1] * u
    upper = table[y1, x0] * (1.0 - u) + table[y1, x1] * u
    return lower * (1.0 - v) + upper * v

"""Pictures of the receding cylinders from the few images that upright cylinders ask for.

Light and view lie in the horizontal plane, so an image of the tile for each angle of the view and
each bearing of the camera is enough: some hundred images instead of 6,561. A column of pixels has
one place around the cylinder, hence one view, one light and one span of the tile; every pixel is
the exact mean of the tile over its area, so nothing aliases however far the cylinder stands. Views
that are up to 6° above or below the horizontal plane are taken as horizontal, and no cylinder has a
seam. ``CylinderStimulus`` renders the same scene from a whole BTF.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from simrig.btf.synthetic import chessboard
from simrig.core.progress import Progress
from simrig.mesostructure.tile import Tile
from simrig.rigs.btf.rig import measure_btf, view_order
from simrig.scenes.cylinder_layout import CylinderRow, columns, cylinder_row, positions_mm
from simrig.scenes.perspective import focal_pixels
from simrig.scenes.receding_cylinders import HALF_HEIGHT, LIGHT_STRENGTHS
from simrig.scenes.stimuli import CYLINDER_RADIUS

LIGHT_DEG = {"right": 60.0, "left": -60.0}
VIEWS_DEG = np.linspace(-80.0, 80.0, 9)  # of the camera from the normal, to the right
BEARINGS_DEG = np.array([-18.0, 0.0, 18.0])  # of the camera from the middle of the picture
_TEXEL_MM = 0.2  # a pixel of the nearest cylinder of experiment B is 0.17 mm wide
_TEXELS = (48, 160)
_STEP_MM = 0.12  # of a tile that is turned by other than right angles
_STEEPEST_DEG = 88.0
_BOUNCES = 2


@dataclass(frozen=True, eq=False)
class UprightTexture:
    """Radiance of an upright tile under both lights.

    Attributes:
        radiance: (views, bearings, height, width, 3), linear RGB; row 0 is at the top.
        texel_mm: width and height of a texel.
    """

    radiance: np.ndarray
    texel_mm: tuple[float, float]

    @cached_property
    def mean(self) -> np.ndarray:
        """What the BRDF shows, (views, bearings, 3)."""
        return self.radiance.mean(axis=(2, 3), dtype=np.float64)


def upright_texture(
    tile: Tile,
    rotation_deg: float = 0.0,
    spp: int = 16,
    progress: Progress | None = None,
) -> UprightTexture:
    """Measure what a tile shows on upright cylinders.

    Args:
        rotation_deg: of the tile on the surface, counter-clockwise.

    Raises:
        SimrigError: what ``measure_btf`` refuses.
    """
    texels = int(np.clip(round(tile.size_mm[0] / _TEXEL_MM), *_TEXELS))
    angles, where, weights = _lit_pairs(rotation_deg)
    stack = measure_btf(tile, angles, texels, spp, bounces=_BOUNCES, progress=progress)
    values = np.empty(stack.values.shape, dtype=np.float32)
    values[view_order(angles)] = stack.values[:]
    radiance = np.zeros((len(VIEWS_DEG), len(BEARINGS_DEG), *values.shape[1:]), dtype=np.float32)
    for (view, bearing), weight, image in zip(where, weights, values, strict=True):
        radiance[view, bearing] += np.float32(weight) * image
    height, width = values.shape[1:3]
    texel = (stack.size_mm[0] / width, stack.size_mm[1] / height)
    return _turned(UprightTexture(radiance, texel), rotation_deg)


def chessboard_texture(square_mm: float) -> UprightTexture:
    """Return a diffuse chessboard under both lights (``simrig.btf.synthetic.chessboard``)."""
    board = chessboard(square_mm)
    height, width = board.resolution
    weights = np.zeros((len(VIEWS_DEG), len(BEARINGS_DEG)))
    for (view, bearing), weight in zip(*_lit_pairs(0.0)[1:], strict=True):
        weights[view, bearing] += weight
    image = np.asarray(board.values[0], dtype=np.float32)
    radiance = weights[..., None, None, None].astype(np.float32) * image
    return UprightTexture(radiance, (board.size_mm[0] / width, board.size_mm[1] / height))


def cylinder_picture(
    texture: UprightTexture,
    experiment: str = "B",
    resolution: int | None = None,
    turn_deg: float = 0.0,
) -> np.ndarray:
    """Return the receding cylinders: the mean of the tile above, the tile below.

    Args:
        experiment: ``"A"`` or ``"B"``.
        resolution: width in pixels; by default the published one.
        turn_deg: of the cylinders about their axes, to the right.

    Returns:
        Linear RGB, shape (height, width, 3), black where no cylinder is.
    """
    row = cylinder_row(experiment)
    width, height = row.picture(resolution)
    image = np.zeros((height, width, 3), dtype=np.float32)
    places = zip(positions_mm(row), row.distances_mm, *columns(row, resolution), strict=True)
    for x, distance, left, right in places:
        span = slice(int(left), min(width, int(right) + 1))
        image[:, span] += _cylinder(texture, row, (width, height), (x, distance), span, turn_deg)
    return image


def _lit_pairs(rotation_deg: float) -> tuple[np.ndarray, list[tuple[int, int]], list[float]]:
    """Return the pairs of directions that are lit, their view and bearing, and their irradiance.

    A normal that the camera at bearing c sees from v points to c − v, so a light from a is seen
    from a − c + v there. All turn about the vertical; on the tile they lie along x, turned back by
    the rotation of the material.
    """
    angles, where, weights = [], [], []
    for (i, view), (j, bearing), side in itertools.product(
        enumerate(VIEWS_DEG), enumerate(BEARINGS_DEG), LIGHT_STRENGTHS
    ):
        light = LIGHT_DEG[side] - bearing + view
        if abs(light) < 90.0:
            seen = [min(abs(light), _STEEPEST_DEG), abs(view)]
            turned = [(180.0 * (a < 0.0) - rotation_deg) % 360.0 for a in (light, view)]
            angles.append([*seen, *turned])
            where.append((i, j))
            weights.append(np.pi * LIGHT_STRENGTHS[side] * np.cos(np.radians(light)))
    return np.radians(angles), where, weights


def _turned(texture: UprightTexture, rotation_deg: float) -> UprightTexture:
    """Return a tile that is rotated on the surface, large enough where it no longer repeats."""
    quarters, rest = divmod(rotation_deg, 90.0)
    if rest == 0.0:
        turned = np.ascontiguousarray(np.rot90(texture.radiance, int(quarters), axes=(2, 3)))
        across, up = texture.texel_mm
        return UprightTexture(turned, (up, across) if quarters % 2 else (across, up))
    step = max(_STEP_MM, *texture.texel_mm)
    wide, high = (math.ceil(side / step) for side in (np.pi * CYLINDER_RADIUS, HALF_HEIGHT))
    x, y = np.meshgrid((np.arange(wide) + 0.5) * step, (high - np.arange(high) - 0.5) * step)
    cosine, sine = np.cos(np.radians(rotation_deg)), np.sin(np.radians(rotation_deg))
    height, width = texture.radiance.shape[2:4]
    # where the tile has what is seen here, in texels from the centre of its first one
    right = (cosine * x + sine * y) / texture.texel_mm[0] - 0.5
    down = height - (cosine * y - sine * x) / texture.texel_mm[1] - 0.5
    where = (np.mod(right, width).astype(np.float32), np.mod(down, height).astype(np.float32))
    found = np.empty((*texture.radiance.shape[:2], high, wide, 3), dtype=np.float32)
    for index in np.ndindex(*found.shape[:2]):
        tile = np.pad(texture.radiance[index], ((0, 1), (0, 1), (0, 0)), mode="wrap")
        found[index] = cv2.remap(tile, *where, cv2.INTER_LINEAR)
    return UprightTexture(found, (step, step))


def _cylinder(
    texture: UprightTexture,
    row: CylinderRow,
    size: tuple[int, int],
    place: tuple[float, float],
    span: slice,
    turn_deg: float,
) -> np.ndarray:
    """Return one cylinder's columns, each as bright as the share of the pixels that it covers."""
    focal = focal_pixels(size[1])
    x, distance = place
    edges = np.arange(span.start, span.stop + 1)
    slopes = (edges - 0.5 * size[0]) / focal
    normal, _ = _surface(slopes, x, distance)
    middle_normal, middle_depth = _surface(0.5 * (slopes[1:] + slopes[:-1]), x, distance)
    bearing = -np.degrees(np.arctan(0.5 * (slopes[1:] + slopes[:-1])))
    front = -np.arctan2(x, distance)
    around = CYLINDER_RADIUS * (normal - front - np.radians(turn_deg) + 0.5 * np.pi)
    view = bearing - np.degrees(middle_normal)
    profile = _mean_columns(texture, around, view, bearing)
    mean = np.einsum("vc,bc,vbk->ck", *_weights(view, bearing), texture.mean)
    outline = np.clip(np.array(columns(row, size[0]))[:, _number(row, distance)], *edges[[0, -1]])
    covered = np.clip(np.minimum(edges[1:], outline[1]) - np.maximum(edges[:-1], outline[0]), 0, 1)
    rows = (0.5 * size[1] - np.arange(size[1] + 1)) / focal
    y = middle_depth * rows[:, None]  # of the edges of the rows, at each column
    above = _share(y, 0.0, HALF_HEIGHT)[..., None] * mean
    low = np.clip(y, -HALF_HEIGHT, 0.0)
    integral = _integral(profile, texture.texel_mm[1], low + HALF_HEIGHT)
    below = (integral[:-1] - integral[1:]) / (y[:-1] - y[1:])[..., None]
    return ((above + below) * covered[:, None]).astype(np.float32)


def _number(row: CylinderRow, distance: float) -> int:
    return int(np.argmin(np.abs(row.distances_mm - distance)))


def _surface(slopes: np.ndarray, x: float, distance: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the azimuth of the normal in radians and the depth in mm where lines of sight hit.

    Lines that pass by are taken to touch the outline.
    """
    along = (x * slopes + distance) / (slopes**2 + 1.0)
    beside = (x**2 + distance**2 - CYLINDER_RADIUS**2) / (slopes**2 + 1.0)
    depth = along - np.sqrt(np.maximum(along**2 - beside, 0.0))
    return np.arctan2(depth * slopes - x, distance - depth), depth


def _mean_columns(
    texture: UprightTexture, around: np.ndarray, view: np.ndarray, bearing: np.ndarray
) -> np.ndarray:
    """Return the mean over each column's span around the cylinder; (rows of the tile, columns, 3).

    Args:
        around: edges of the columns in mm.
        view, bearing: of their middles, in degrees.
    """
    texels = around / texture.texel_mm[0]
    width = texture.radiance.shape[3]
    found = np.zeros((texture.radiance.shape[2], len(view), 3), dtype=np.float64)
    views, bearings = _weights(view, bearing)
    for i, j in itertools.product(range(len(VIEWS_DEG)), range(len(BEARINGS_DEG))):
        weight = views[i] * bearings[j]
        used = np.flatnonzero(weight)
        if used.size:
            sums = _running(texture.radiance[i, j], axis=1)
            ends = [_at(sums, texels[used + k], width, axis=1) for k in (0, 1)]
            spans = (texels[used + 1] - texels[used])[:, None]
            found[:, used] += weight[used, None] * (ends[1] - ends[0]) / spans
    return found


def _weights(view: np.ndarray, bearing: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return _hat(VIEWS_DEG, view), _hat(BEARINGS_DEG, bearing)


def _hat(nodes: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Return the weight of each node at each place, linear between nodes, (nodes, places)."""
    return np.stack([np.interp(places, nodes, one) for one in np.eye(len(nodes))])


def _running(values: np.ndarray, axis: int) -> np.ndarray:
    """Return sums of all texels before each edge, from 0 to the whole."""
    sums = np.cumsum(values, axis=axis, dtype=np.float64)
    return np.concatenate([np.zeros_like(np.take(sums, [0], axis)), sums], axis=axis)


def _at(sums: np.ndarray, places: np.ndarray, period: int, axis: int) -> np.ndarray:
    """Return running sums of a periodic row of texels at places between edges."""
    turns, rest = np.divmod(places, period)
    low = np.minimum(rest.astype(int), period - 1)
    part = (rest - low)[:, None]
    whole = np.take(sums, [period], axis)
    ends = np.take(sums, low, axis), np.take(sums, low + 1, axis)
    return turns[:, None] * whole + (1.0 - part) * ends[0] + part * ends[1]


def _integral(profile: np.ndarray, texel_mm: float, y: np.ndarray) -> np.ndarray:
    """Return the integral over each column of the tile from its foot to y, (rows, columns, 3)."""
    sums = _running(profile[::-1], axis=0)  # from the foot upwards
    period = profile.shape[0]
    turns, rest = np.divmod(y / texel_mm, period)
    low = np.minimum(rest.astype(int), period - 1)
    column = np.arange(profile.shape[1])
    part = (rest - low)[..., None]
    between = (1.0 - part) * sums[low, column] + part * sums[low + 1, column]
    return (turns[..., None] * sums[period][None] + between) * texel_mm


def _share(edges: np.ndarray, low: float, high: float) -> np.ndarray:
    """Return the share of each row between its edges (falling) that lies from low to high."""
    inside = np.clip(edges, low, high)
    return (inside[:-1] - inside[1:]) / (edges[:-1] - edges[1:])

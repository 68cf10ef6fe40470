"""The folded model: every direction from which the mirror lights a point of the picture, solved.

Light enters through the large opening. Where a ray of the flash lands is a function of where it
enters, of closed form (``mirror.follow``); its inverse at a pixel is found by looking up the
triangle of a mesh of that function that covers the pixel, and one Newton step. Irradiance follows
from the determinant of the derivative. All branches are found: the two polar angles 180° apart of
thesis section 3.1, the four inside the caustic that a flash beside the axis makes, and paths with
two or three reflections. Beside them light reaches the sample from the flash itself.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from simrig.brdf.protocol import Brdf
from simrig.core.errors import SimrigError
from simrig.directions.spherical import turned
from simrig.rigs.reflector.mirror import Reflector, follow

_RINGS, _SECTORS = 120, 540  # of the mesh
_PHASE = 0.3819660112501051  # no mesh line through a row of pixel centres
_STEP_MM = 1e-6  # of derivatives by differences: rounding and curvature both below 1e-6
_LONGEST = 0.6  # of the large opening, that lights one pixel
_LEAST_SHARE = (
    0.8  # of the light that the pixels must account for; few large ones meet folds by chance
)
_MOST_BOUNCES = 3
# a disc by seven points, exact for polynomials up to degree 5 (Stroud S2: 5-1)
_DISC = [(0.0, 0.0, 0.25)] + [
    (
        np.sqrt(2.0 / 3.0) * np.cos(k * np.pi / 3.0),
        np.sqrt(2.0 / 3.0) * np.sin(k * np.pi / 3.0),
        0.125,
    )
    for k in range(6)
]


@dataclass(frozen=True, eq=False)
class Folded:
    """How an instrument lights a picture, whatever lies under it.

    Attributes:
        mirror: the instrument.
        pixels: along each side of the picture.
        width_mm: of the picture on the sample.
        pixel: (n,) number of the pixel, row by row.
        towards: (n, 3) where the light comes from.
        irradiance: (n, 3) linear RGB, over that of the flash alone at normal incidence.
        view: (pixels², 3) to the lens.
        bounces: (n,) reflections on the way.
    """

    mirror: Reflector
    pixels: int
    width_mm: float
    pixel: np.ndarray
    towards: np.ndarray
    irradiance: np.ndarray
    view: np.ndarray
    bounces: np.ndarray

    @property
    def positions(self) -> np.ndarray:
        """Of the pixels' centres on the sample, (pixels², 2) mm; x to the right, y upwards."""
        return _positions(self.pixels, self.width_mm)

    @property
    def inside(self) -> np.ndarray:
        """Which pixels see the sample, (pixels, pixels) of bool."""
        return np.asarray(_inside(self.mirror, self.positions)).reshape(self.pixels, -1)

    @property
    def total(self) -> np.ndarray:
        """Irradiance of every pixel, mean of the channels, (pixels, pixels)."""
        whole = np.bincount(self.pixel, self.irradiance.mean(axis=-1), self.pixels**2)
        return whole.reshape(self.pixels, -1)

    def polar_angles(self) -> np.ndarray:
        """Return the mean polar angle of what the mirror sends to each pixel, (pixels²,) radians.

        Every branch counts alike, NaN where there is none.
        """
        kept = self.bounces > 0
        theta = np.arccos(np.clip(self.towards[kept, 2], -1.0, 1.0))
        count = np.bincount(self.pixel[kept], minlength=self.pixels**2)
        total = np.bincount(self.pixel[kept], theta, minlength=self.pixels**2)
        return np.asarray(np.where(count > 0, total / np.maximum(count, 1), np.nan))


def fold(
    mirror: Reflector, pixels: int = 256, *, margin: float = 1.1, flash_points: int = 7
) -> Folded:
    """Solve the mirror for a square picture of the lower opening.

    Args:
        mirror: the instrument.
        pixels: along each side, 8 to 2048.
        margin: width of the picture over the opening's.
        flash_points: 1, or 7 for the flash's extent.

    Raises:
        SimrigError: numbers out of range, or light gathered so closely that pixels miss it (a
            sample in a focus of flash and mirror).
    """
    if not 8 <= pixels <= 2048 or not 0.1 <= margin <= 4.0 or flash_points not in (1, 7):
        raise SimrigError(
            "a folded picture has 8 to 2048 pixels, a margin from 0.1 to 4 and 1 or 7 points of "
            f"the flash, got {pixels}, {margin:g} and {flash_points}"
        )
    return _fold(mirror, int(pixels), float(margin), int(flash_points))


@lru_cache(maxsize=6)
def _fold(mirror: Reflector, pixels: int, margin: float, flash_points: int) -> Folded:
    width = margin * mirror.opening_mm
    positions = _positions(pixels, width)
    view = _towards(mirror.lens, positions)
    parts = []
    spread = _DISC if flash_points == 7 and mirror.flash_diameter_mm > 0.0 else [(0.0, 0.0, 1.0)]
    for x, y, share in spread:
        source = mirror.flash + 0.5 * mirror.flash_diameter_mm * np.array([x, y, 0.0])
        found = [_direct(mirror, source, positions)]
        found += _reflected(mirror, source, pixels, width)
        parts += [(p, w, e * share, k) for p, w, e, k in found]
    if mirror.dust > 0.0:
        parts += _veil(mirror, positions)
    pixel = np.concatenate([p for p, *_ in parts])
    towards = np.concatenate([w for _, w, *_ in parts])
    bounces = np.concatenate([np.full(len(p), k) for p, _, _, k in parts])
    passed = np.array(mirror.reflectance) * (1.0 - mirror.dust)
    factor = np.where(bounces[:, None] > 0, passed ** np.maximum(bounces, 0)[:, None], 1.0)
    irradiance = np.concatenate([e for _, _, e, _ in parts])[:, None] * factor
    return Folded(mirror, pixels, width, pixel, towards, irradiance, view, bounces)


def picture(folded: Folded, material: Brdf, rotation_deg: float = 0.0) -> np.ndarray:
    """Return what the camera sees of a material, (pixels, pixels, 3) radiance, linear RGB.

    One is the radiance of a perfect white diffuser in the flash's light alone, times π.

    Args:
        folded: the instrument, solved.
        material: on the sample; rotated by ``rotation_deg`` about the normal, counter-clockwise.
        rotation_deg: see above.

    Raises:
        SimrigError: a rotation that is not finite, or a material that is not finite or negative.
    """
    if not np.isfinite(rotation_deg):
        raise SimrigError(f"a rotation must be finite, got {rotation_deg}")
    wi, wv = (turned(w, -np.radians(rotation_deg)) for w in (folded.towards, folded.view))
    values = material.eval(wi, wv[folded.pixel])
    if not np.all(np.isfinite(values)):
        raise SimrigError(f"'{material.name}' is not finite in some directions: no picture of it")
    radiance = values * folded.irradiance
    image = [
        np.bincount(folded.pixel, radiance[:, c], minlength=folded.pixels**2) for c in range(3)
    ]
    return np.stack(image, axis=-1).reshape(folded.pixels, folded.pixels, 3)


def _positions(pixels: int, width: float) -> np.ndarray:
    along = ((np.arange(pixels) + 0.5) / pixels - 0.5) * width
    x, y = np.meshgrid(along, -along)
    return np.stack([x.ravel(), y.ravel()], axis=-1)


def _inside(mirror: Reflector, positions: np.ndarray) -> np.ndarray:
    on_plane = np.concatenate([positions, np.zeros((len(positions), 1))], axis=-1)
    local = mirror.in_mirror(on_plane)
    radius = np.hypot(local[:, 0], local[:, 1]) / mirror.across_mm
    height = (local[:, 2] - mirror.centre_mm) / mirror.along_mm
    return np.asarray(radius**2 + height**2 <= 1.0)


def _towards(source: np.ndarray, positions: np.ndarray) -> np.ndarray:
    away = source - np.concatenate([positions, np.zeros((len(positions), 1))], axis=-1)
    return np.asarray(away / np.linalg.norm(away, axis=-1, keepdims=True))


_Part = tuple[np.ndarray, np.ndarray, np.ndarray, int]  # pixels, towards, irradiance, bounces


def _direct(mirror: Reflector, source: np.ndarray, positions: np.ndarray) -> _Part:
    """Return the light that comes without a reflection, through the large opening."""
    pixel = np.flatnonzero(_inside(mirror, positions))
    own = positions[pixel]
    away = source - np.concatenate([own, np.zeros((len(own), 1))], axis=-1)
    squared = np.sum(away * away, axis=-1)
    towards = away / np.sqrt(squared)[:, None]
    local, step = mirror.in_mirror(source - away), towards @ mirror.turn
    through = local + ((mirror.height_mm - local[:, 2]) / step[:, 2])[:, None] * step
    seen = np.hypot(through[:, 0], through[:, 1]) <= 0.5 * mirror.large_opening_mm
    irradiance = mirror.distance_mm**2 * towards[:, 2] / squared
    return pixel[seen], towards[seen], irradiance[seen], 0


def _reflected(mirror: Reflector, source: np.ndarray, pixels: int, width: float) -> list[_Part]:
    """Return the light that comes by one to three reflections."""
    angle = 2.0 * np.pi * (np.arange(_SECTORS) + _PHASE) / _SECTORS
    around = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    rim, positions = 0.5 * mirror.large_opening_mm, _positions(pixels, width)
    parts, flux = [], 0.0
    for bounces in range(1, _MOST_BOUNCES + 1):
        radius = np.linspace(0.02 * rim, rim, 4 * _RINGS)  # where such paths enter, in four sectors
        coarse = radius[:, None, None] * around[:: _SECTORS // 4]
        found = follow(mirror, source, coarse.reshape(-1, 2), bounces).valid
        rings = np.flatnonzero(found.reshape(len(radius), -1).any(axis=1))
        if not len(rings):
            continue
        wide = 0.05 * (radius[rings[-1]] - radius[rings[0]]) + 0.01 * rim
        radius = np.linspace(
            max(radius[rings[0]] - wide, 0.01 * rim),
            min(radius[rings[-1]] + wide, rim + 0.3),
            _RINGS,
        )
        mesh = radius[:, None, None] * around
        corners = mesh.reshape(-1, 2)
        paths = follow(mirror, source, corners, bounces)
        triangles = _triangles(paths.valid.reshape(_RINGS, _SECTORS))
        pixel, own, weights = _covered(triangles, paths.landing, pixels, width)
        inverse, bend = _mesh_derivative(paths.landing.reshape(mesh.shape), radius, angle)
        entry = _mixed(corners, own, weights)
        residual = positions[pixel] - follow(mirror, source, entry, bounces).landing
        step = np.einsum("nij,nj->ni", _mixed(inverse, own, weights), residual)
        entry = entry + np.clip(step, -0.3, 0.3)
        part = _lit(
            mirror, source, pixel, entry, bounces, _mixed(bend, own, weights), width / pixels
        )
        flux += _landing_flux(mirror, source, mesh, paths.valid)
        parts.append(part)
    share = sum(part[2].sum() for part in parts) * (width / pixels) ** 2 / flux if flux else 1.0
    if width >= mirror.opening_mm and not _LEAST_SHARE <= share <= 2.0 - _LEAST_SHARE:
        raise SimrigError(
            f"the pixels find {100.0 * share:.3g} % of the light that falls on the sample: the "
            "mirror gathers it in points smaller than they are; move the sample out of the focus"
        )
    return parts


def _mixed(values: np.ndarray, own: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return values of the mesh's corners between the three of each triangle, (n, ...)."""
    return np.asarray(np.einsum("nk...,nk->n...", values[own], weights))


def _mesh_derivative(
    landing: np.ndarray, radius: np.ndarray, angle: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the inverse of the landing point's derivative by the entry, and how fast that bends.

    Args:
        landing: (rings, sectors, 2) mm.
        radius, angle: of the mesh in the large opening.

    Returns:
        (n, 2, 2), zero near a fold, and (n,) the slope of the determinant in 1/mm.
    """

    def derivative(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        step = angle[1] - angle[0]
        turn = (np.roll(values, -1, 1) - np.roll(values, 1, 1)) / (2.0 * step)
        shape = (-1, 1) + (1,) * (values.ndim - 2)
        return np.gradient(values, radius, axis=0), turn / radius.reshape(shape)

    outward, around = derivative(landing)
    cos, sin = np.cos(angle)[:, None], np.sin(angle)[:, None]
    matrix = np.stack([outward * cos - around * sin, outward * sin + around * cos], axis=-1)
    determinant = matrix[..., 0, 0] * matrix[..., 1, 1] - matrix[..., 0, 1] * matrix[..., 1, 0]
    fold = np.abs(determinant) < 1e-2 * np.median(np.abs(determinant))
    cofactors = np.stack([matrix[..., 1, 1], -matrix[..., 0, 1], -matrix[..., 1, 0],
                          matrix[..., 0, 0]], axis=-1)  # fmt: skip
    inverse = cofactors / np.where(fold, np.inf, determinant)[..., None]
    # what a fold needs: how the determinant changes along the entry that moves the landing least
    squares = np.sum(matrix * matrix, axis=-2)
    turn = 0.5 * np.arctan2(
        2.0 * np.sum(matrix[..., 0] * matrix[..., 1], axis=-1), squares[..., 0] - squares[..., 1]
    )
    least = np.stack([-np.sin(turn), np.cos(turn)], axis=-1)
    outward, around = derivative(determinant)
    cos, sin = cos[:, 0], sin[:, 0]
    gradient = np.stack([outward * cos - around * sin, outward * sin + around * cos], axis=-1)
    bend = np.abs(np.sum(gradient * least, axis=-1))
    return inverse.reshape(-1, 2, 2), bend.ravel()


def _triangles(valid: np.ndarray) -> np.ndarray:
    """Return the mesh's triangles that have a valid corner or a neighbour of one, (n, 3)."""
    rings, sectors = valid.shape
    near = valid | np.roll(valid, 1, 1) | np.roll(valid, -1, 1)
    near[1:] |= valid[:-1]
    near[:-1] |= valid[1:]
    index = np.arange(rings * sectors).reshape(rings, sectors)
    a, b = index[:-1], np.roll(index, -1, 1)[:-1]
    c, d = index[1:], np.roll(index, -1, 1)[1:]
    triangles = np.stack([np.stack([a, b, c], -1), np.stack([d, c, b], -1)]).reshape(-1, 3)
    return np.asarray(triangles[near.ravel()[triangles].any(axis=1)])


def _covered(
    triangles: np.ndarray, landing: np.ndarray, pixels: int, width: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return pixels whose centres triangles cover, the corners (n, 3), and their weights."""
    scale = pixels / width
    x = landing[triangles, 0] * scale + 0.5 * pixels - 0.5  # in pixels, centres at whole numbers
    y = -landing[triangles, 1] * scale + 0.5 * pixels - 0.5
    low_x, high_x = np.ceil(x.min(1)).clip(0), np.floor(x.max(1)).clip(-1, pixels - 1)
    low_y, high_y = np.ceil(y.min(1)).clip(0), np.floor(y.max(1)).clip(-1, pixels - 1)
    wide = (high_x - low_x + 1).clip(0).astype(np.int64)
    count = wide * (high_y - low_y + 1).clip(0).astype(np.int64)
    owner = np.repeat(np.arange(len(triangles)), count)
    order = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
    column = low_x[owner].astype(np.int64) + order % np.maximum(wide[owner], 1)
    row = low_y[owner].astype(np.int64) + order // np.maximum(wide[owner], 1)
    x, y = x[owner], y[owner]
    twice = (x[:, 1] - x[:, 0]) * (y[:, 2] - y[:, 0]) - (x[:, 2] - x[:, 0]) * (y[:, 1] - y[:, 0])
    with np.errstate(divide="ignore", invalid="ignore"):
        second = (
            (column - x[:, 0]) * (y[:, 2] - y[:, 0]) - (x[:, 2] - x[:, 0]) * (row - y[:, 0])
        ) / twice
        third = (
            (x[:, 1] - x[:, 0]) * (row - y[:, 0]) - (column - x[:, 0]) * (y[:, 1] - y[:, 0])
        ) / twice
    inside = (second >= 0.0) & (third >= 0.0) & (second + third <= 1.0)
    second, third = second[inside], third[inside]
    weights = np.stack([1.0 - second - third, second, third], axis=-1)
    return row[inside] * pixels + column[inside], triangles[owner[inside]], weights


def _lit(
    mirror: Reflector,
    source: np.ndarray,
    pixel: np.ndarray,
    entry: np.ndarray,
    bounces: int,
    bend: np.ndarray,
    pixel_mm: float,
) -> _Part:
    """Return the light that enters at points and lands on pixels, with the irradiance of each path.

    At a fold the irradiance of a point is infinite, its mean over a pixel is not. It is held where
    it is that of a point 1/64 of a pixel away, so that a pixel has at most four times its mean.
    """
    paths = follow(mirror, source, entry, bounces)
    pixel, entry, bend = pixel[paths.valid], entry[paths.valid], bend[paths.valid]
    towards, landing = paths.towards[paths.valid], paths.landing[paths.valid]
    x, y = (
        (follow(mirror, source, entry + _STEP_MM * axis, bounces).landing - landing) / _STEP_MM
        for axis in np.eye(2)
    )
    determinant = np.abs(x[:, 0] * y[:, 1] - x[:, 1] * y[:, 0])
    size = np.sqrt(np.sum(x * x + y * y, axis=-1))
    area = np.maximum(determinant, np.sqrt(bend * size * pixel_mm / 32.0))
    # at a cusp it does not even bend: no pixel is lit from more than so much of the opening
    area = np.maximum(area, size * pixel_mm / (_LONGEST * mirror.large_opening_mm))
    irradiance = _flux_density(mirror, source, entry) / np.maximum(area, 1e-9)
    return pixel, towards, irradiance, bounces


def _flux_density(mirror: Reflector, source: np.ndarray, entry: np.ndarray) -> np.ndarray:
    """Return the flux per area of the large opening, over the flash's at the sample, (n,)."""
    away = source - mirror.entrance(entry)
    squared = np.sum(away * away, axis=-1)
    cosine = away @ mirror.turn[:, 2] / np.sqrt(squared)
    return np.asarray(mirror.distance_mm**2 * cosine / squared)


def _landing_flux(
    mirror: Reflector, source: np.ndarray, mesh: np.ndarray, valid: np.ndarray
) -> float:
    """Return the flux of valid cells of a polar mesh of the large opening, in irradiance · mm²."""
    rings, sectors = mesh.shape[:2]
    radius = np.linalg.norm(mesh[:, 0], axis=-1)
    cell = (radius[1] - radius[0]) * radius[:, None] * 2.0 * np.pi / sectors
    density = _flux_density(mirror, source, mesh.reshape(-1, 2)).reshape(rings, sectors)
    return float(np.sum(density * cell * valid.reshape(rings, sectors)))


def _veil(mirror: Reflector, positions: np.ndarray) -> Iterator[_Part]:
    """Return the light that dust scatters from all over the mirror to the sample, evenly."""
    pixel = np.flatnonzero(_inside(mirror, positions))
    lowest = np.arctan2(0.5 * mirror.large_opening_mm, mirror.height_mm)
    cover = np.cos(lowest) ** 2  # of the mirror, of the projected hemisphere
    lower, upper = 0.5 * mirror.opening_mm, 0.5 * mirror.large_opening_mm
    slant = np.pi * (lower + upper) * np.hypot(upper - lower, mirror.height_mm)
    received = np.pi * (upper**2 - lower**2)  # of irradiance 1
    # by reciprocity of form factors
    irradiance = mirror.dust * received * cover / slant
    thetas, azimuths = 4, 8
    for step in range(thetas):
        share = (step + 0.5) / thetas
        sine = np.sqrt(np.sin(lowest) ** 2 + share * cover)
        for k in range(azimuths):
            phi = 2.0 * np.pi * (k + 0.5) / azimuths
            towards = [sine * np.cos(phi), sine * np.sin(phi), np.sqrt(1.0 - sine * sine)]
            even = np.full(len(pixel), irradiance / (thetas * azimuths))
            yield pixel, np.tile(towards, (len(pixel), 1)), even, -1

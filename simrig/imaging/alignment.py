"""How well pictures of one surface are aligned when it is taken for some plane.

Pictures that were registered to the reference plane z = 0 are registered to another plane by
following the rays to the camera: the point (x, y, z) is seen where the ray through it meets z = 0.
The measure of alignment is the thesis's (appendix C.3): the error of the pictures' principal
component analysis with few components, from the eigenvalues of the small matrix of scalar products
of the pictures (Sattler et al. 2003; Koudelka et al. 2003). It is evaluated on patches spread over
the sample, each picture's mean over a patch taken out and its contrast equalised, so that shading
counts for nothing.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy import ndimage
from scipy.linalg import eigh

from simrig.core.errors import SimrigError
from simrig.imaging.checks import finite_array, finite_number

FEWEST_VIEWS = 3
_PRODUCT = 200_000  # multiplications that BLAS does in one thread


@dataclass(frozen=True)
class Plane:
    """A plane near the reference plane, z = z_mm + slope_x x + slope_y y.

    Attributes:
        z_mm: height at the origin.
        slope_x, slope_y: its slopes.
    """

    z_mm: float = 0.0
    slope_x: float = 0.0
    slope_y: float = 0.0

    @classmethod
    def tilted(cls, z_mm: float, theta: float, phi: float) -> Plane:
        """Return a plane by the polar angle and azimuth of its normal, radians."""
        slope = np.tan(theta)
        return cls(z_mm, float(-slope * np.cos(phi)), float(-slope * np.sin(phi)))

    @property
    def theta(self) -> float:
        """Polar angle of the normal, radians."""
        return float(np.arctan(np.hypot(self.slope_x, self.slope_y)))

    @property
    def phi(self) -> float:
        """Azimuth of the normal, radians in [0, 2π)."""
        return float(np.arctan2(-self.slope_y, -self.slope_x) % (2.0 * np.pi))

    @property
    def normal(self) -> np.ndarray:
        """Unit normal, (3,)."""
        n = np.array([-self.slope_x, -self.slope_y, 1.0])
        return n / np.linalg.norm(n)

    @property
    def numbers(self) -> np.ndarray:
        """(3,) z, slope_x, slope_y."""
        return np.array([self.z_mm, self.slope_x, self.slope_y])

    def height(self, x: Any, y: Any) -> Any:
        """Return z at x, y in mm."""
        return self.z_mm + self.slope_x * x + self.slope_y * y

    def tilt_from(self, other: Plane) -> float:
        """Return the angle between two planes, radians."""
        apart = np.linalg.norm(self.normal - other.normal)
        return float(2.0 * np.arcsin(np.minimum(0.5 * apart, 1.0)))


@dataclass(eq=False)
class Views:
    """Pictures of a surface, registered to the reference plane.

    Row 0 is at +y, column 0 at -x, the origin is the middle of the pictures.

    Attributes:
        pictures: (views, height, width), linear.
        pitch_mm: between pixels.
        cameras_mm: (views, 3) where each camera stands.
        evaluations: registrations that were made since the views were made.
        seen: (views, height, width) of bool: which pixels a view has; None is all.

    Raises:
        SimrigError: shapes or numbers that cannot be, fewer than three views, cameras that are not
            above the surface.
    """

    pictures: np.ndarray
    pitch_mm: float
    cameras_mm: np.ndarray
    evaluations: int = 0
    seen: np.ndarray | None = None
    _splines: list[np.ndarray] = field(default_factory=list, repr=False)

    def __post_init__(self) -> None:
        self.pictures = finite_array(self.pictures, "the registered pictures", (3,))
        self.pitch_mm = finite_number(self.pitch_mm, "the pitch in mm", above=0.0)
        self.cameras_mm = finite_array(self.cameras_mm, "the cameras' places", (2,))
        count = len(self.pictures)
        if count < FEWEST_VIEWS:
            raise SimrigError(f"a surface plane needs at least {FEWEST_VIEWS} views, got {count}")
        if self.cameras_mm.shape != (count, 3):
            raise SimrigError(
                f"{count} views need places of cameras ({count}, 3), got {self.cameras_mm.shape}"
            )
        if self.cameras_mm[:, 2].min() <= 0.0:
            raise SimrigError("every camera must stand above the reference plane (z > 0 mm)")
        if min(self.pictures.shape[1:]) < 8:
            raise SimrigError(f"pictures of at least 8 × 8 pixels, got {self.pictures.shape[1:]}")
        if not self._splines:
            self._splines = [
                ndimage.spline_filter(p, 3, output=np.float32, mode="mirror") for p in self.pictures
            ]

    @property
    def half_mm(self) -> np.ndarray:
        """Half of width and height, (2,)."""
        height, width = self.pictures.shape[1:]
        return 0.5 * self.pitch_mm * np.array([width - 1.0, height - 1.0])

    def smoothed(self, sigma_mm: float, every: int) -> Views:
        """Return views that are smoothed by a Gaussian and thinned to every so many pixels."""
        width = sigma_mm / self.pitch_mm
        made = ndimage.gaussian_filter(self.pictures, (0.0, width, width), mode="nearest")
        height, columns = self.pictures.shape[1:]
        rows, across = (slice(((n - 1) % every) // 2, None, every) for n in (height, columns))
        thin = made[:, rows, across]
        return Views(thin, self.pitch_mm * every, self.cameras_mm)

    def at(self, plane: Plane, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return what every view shows of points of a plane, ``(views, *x.shape)`` float32.

        Args:
            plane: the surface.
            x, y: mm.
        """
        height = plane.height(x, y)
        half, rows = self.half_mm, self.pictures.shape[1]
        read = np.empty((len(self.pictures), *x.shape), dtype=np.float32)
        for number, (spline, (cx, cy, cz)) in enumerate(
            zip(self._splines, self.cameras_mm, strict=True)
        ):
            share = height / (cz - height)
            column = (x + (x - cx) * share + half[0]) / self.pitch_mm
            row = (rows - 1.0) - (y + (y - cy) * share + half[1]) / self.pitch_mm
            read[number] = ndimage.map_coordinates(
                spline, (row, column), order=3, mode="mirror", prefilter=False, output=np.float32
            )
        self.evaluations += 1
        return read


@dataclass(frozen=True, eq=False)
class Patches:
    """Where alignment is measured: square patches of pixels.

    Attributes:
        x, y: (patches, pixels) in mm.
    """

    x: np.ndarray
    y: np.ndarray

    @classmethod
    def over(cls, views: Views, margin_mm: float, across: int, side: int) -> Patches:
        """Return patches spread over the pictures.

        Args:
            views: the pictures.
            margin_mm: kept free at the borders, for points of other planes.
            across: patches in a row and in a column.
            side: pixels of a patch, at most.
        """
        room = 2.0 * (views.half_mm - margin_mm)
        if room.min() < 8.0 * views.pitch_mm:
            raise SimrigError(
                f"pictures of {2 * views.half_mm[0]:.3g} × {2 * views.half_mm[1]:.3g} mm are too "
                f"small for planes that shift them by up to {margin_mm:.3g} mm at their borders"
            )
        side = int(np.clip(side, 8, room.min() / views.pitch_mm))
        across = max(1, min(across, int(room.min() / (side * views.pitch_mm))))
        steps = (np.arange(side) - 0.5 * (side - 1)) * views.pitch_mm
        share = np.linspace(-0.5, 0.5, across) if across > 1 else np.zeros(1)
        middle = [share * (size - side * views.pitch_mm) for size in room]
        cy, cx, dy, dx = np.meshgrid(middle[1], middle[0], steps, steps, indexing="ij")
        return cls(*((c + d).reshape(across * across, -1) for c, d in ((cx, dx), (cy, dy))))


@dataclass(frozen=True, eq=False)
class Alignment:
    """The measure of alignment on some patches.

    Attributes:
        views: the pictures.
        patches: where.
        components: principal components that are kept.
        weights: (views,) that equalise their contrast.
    """

    views: Views
    patches: Patches
    components: int
    weights: np.ndarray

    @classmethod
    def of(cls, views: Views, patches: Patches, components: int) -> Alignment:
        """Return the measure, its weights from the pictures as they are registered."""
        shown = _centred(views.at(Plane(), patches.x, patches.y))
        contrast = np.sqrt(np.mean(shown.astype(np.float64) ** 2, axis=(1, 2)))
        middle = float(np.median(contrast))
        if not middle > 1e-6 * float(np.abs(views.pictures).max()):
            raise SimrigError("the sample shows no structure that could be aligned")
        weights = 1.0 / np.maximum(contrast, 0.1 * middle)
        return cls(views, patches, _checked(components, len(views.pictures)), weights)

    def matrix(self, plane: Plane) -> np.ndarray:
        """Return the weighted pictures without their means, (views, patches, pixels)."""
        read = _centred(self.views.at(plane, self.patches.x, self.patches.y))
        return read * self.weights[:, None, None].astype(np.float32)

    def slope(self, plane: Plane, matrix: np.ndarray) -> np.ndarray:
        """Return the derivative of a plane's matrix by its height, mean not taken out.

        A higher plane shows every view further out along the ray to its camera; the difference of
        neighbouring pixels of a patch stands for the derivative.
        """
        x, y, pitch = self.patches.x, self.patches.y, self.views.pitch_mm
        side = round(x.shape[1] ** 0.5)
        square = matrix.reshape(len(self.weights), len(x), side, side)
        by_y, by_x = np.gradient(square, pitch, axis=(2, 3))
        made = np.empty((len(self.weights), *x.shape), dtype=np.float32)
        height = plane.height(x, y)
        for number, (cx, cy, cz) in enumerate(self.views.cameras_mm):
            out_x, out_y = ((c * cz / (cz - height) ** 2) for c in (x - cx, y - cy))
            along = 1.0 + plane.slope_x * out_x + plane.slope_y * out_y
            moved = by_x[number].reshape(x.shape) * out_x + by_y[number].reshape(x.shape) * out_y
            made[number] = moved / along
        return made

    def error(self, plane: Plane) -> float:
        """Return what the kept components leave of the pictures for a plane, 0 to 1."""
        rows = self.matrix(plane).reshape(len(self.weights), -1)
        return relative_error(rows, self.components)

    def errors_of_patches(self, plane: Plane) -> np.ndarray:
        """Return the error of each patch alone, (patches,)."""
        rows = np.moveaxis(self.matrix(plane), 1, 0)
        return np.array([relative_error(patch, self.components) for patch in rows])


def relative_error(rows: np.ndarray, components: int) -> float:
    """Return what some principal components leave of pictures, 0 (nothing) to 1.

    Args:
        rows: (pictures, pixels); the mean picture is taken out.
        components: that are kept.
    """
    centred = (rows - rows.mean(axis=0)).astype(np.float64)
    energy, _ = principal(centred, components)
    whole = float(np.sum(rows.astype(np.float64) ** 2))
    left = max(float(np.sum(centred**2)) - float(energy.sum()), 0.0)
    return float(np.sqrt(left / whole)) if whole > 0.0 else 0.0


def principal(centred: np.ndarray, components: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the largest eigenvalues of the pictures' scalar products, and their vectors.

    Args:
        centred: (pictures, pixels) float64, of mean 0 over the pictures.
        components: how many.

    Returns:
        (components,) ascending and (pictures, components).
    """
    count = len(centred)
    wanted = (count - components, count - 1)
    return eigh(_products(centred), subset_by_index=wanted, check_finite=False)


def _products(rows: np.ndarray) -> np.ndarray:
    """Return the scalar products of rows with each other.

    In slices so small that BLAS spreads none over threads: beside other work, these wait for each
    other four times as long as the product takes.
    """
    count, columns = rows.shape
    width = max(8, _PRODUCT // count**2)
    slices = -(-columns // width)
    padded = np.zeros((count, slices * width))
    padded[:, :columns] = rows
    cut = padded.reshape(count, slices, width).transpose(1, 0, 2)
    return np.matmul(cut, cut.transpose(0, 2, 1)).sum(axis=0)


def pca_error(pictures: Any, components: int) -> float:
    """Return the relative root-mean-square error of pictures from their principal components.

    Args:
        pictures: (pictures, height, width) or with channels.
        components: that are kept, thesis: 50.

    Raises:
        SimrigError: pictures or a number of components that cannot be.
    """
    array = finite_array(pictures, "the pictures", (2, 3, 4)).reshape(len(pictures), -1)
    return relative_error(array.astype(np.float64), _checked(components, len(array)))


def sharpness(picture: np.ndarray) -> float:
    """Return the mean squared gradient of a picture over its variance (1/pixel²)."""
    grey = np.asarray(picture, dtype=np.float64)
    rows, columns = np.gradient(grey)
    return float((rows**2 + columns**2).mean() / max(grey.var(), 1e-300))


def reach_of(cameras_mm: np.ndarray, height_mm: float) -> float:
    """Return how far at most a point at some height is displaced in the reference plane, mm."""
    away = np.hypot(cameras_mm[:, 0], cameras_mm[:, 1]) / cameras_mm[:, 2]
    return float(height_mm * away.max())


def _centred(read: np.ndarray) -> np.ndarray:
    return read - read.mean(axis=-1, keepdims=True)


def _checked(components: int, views: int) -> int:
    if components != int(components) or not 1 <= components <= views - 2:
        raise SimrigError(
            f"{views} views have 1 to {views - 2} components that can be kept, got {components}"
        )
    return int(components)

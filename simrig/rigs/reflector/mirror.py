"""The reflector's numbers, and where its mirror sends light: an exact ellipsoid of revolution.

World frame: the sample's (mm), z its normal, the sample's surface at z = 0 and the middle of the
opening above its origin. Camera and flash stand at z = ``distance_mm``. Source: thesis section 3.1
(110 mm across, 26 mm at the sample, 1.5 m away, flash 75 mm beside the lens, mean polar angle of
illumination 50°). The semi-axes are not printed there; those here give that mean.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import numpy as np

from simrig.core.errors import SimrigError

if TYPE_CHECKING:
    from simrig.instruments.description import ReflectorDescription

_WAVES = 24  # of a field of slope errors


@dataclass(frozen=True)
class Reflector:
    """An ellipsoidal mirror on a sample, its camera and its flash.

    Attributes:
        across_mm, along_mm: semi-axes of the ellipsoid, across and along its axis.
        opening_mm, large_opening_mm: diameters at the sample and at the far end.
        sample_mm: height of the sample's surface above the lower rim.
        distance_mm: of lens and flash from the sample.
        flash_mm, flash_azimuth_deg: of the flash beside the lens, and in which direction.
        flash_diameter_mm, lens_diameter_mm: of their discs; 0 is a point.
        reflectance: of the mirror, linear RGB in [0, 1].
        slope_rms_mrad, slope_length_mm: root mean square of the slope error along each of two
            directions, and its wavelength.
        shift_mm, tilt_mrad: of the mirror along x and y, and about x and y.
        dust: share of the mirror that scatters in place of reflecting.
        seed: of the slope errors.

    Raises:
        SimrigError: numbers that make no such instrument.
    """

    across_mm: float = 66.0
    along_mm: float = 158.7
    opening_mm: float = 26.0
    large_opening_mm: float = 110.0
    sample_mm: float = 0.0
    distance_mm: float = 1500.0
    flash_mm: float = 75.0
    flash_azimuth_deg: float = 0.0
    flash_diameter_mm: float = 10.0
    lens_diameter_mm: float = 10.0
    reflectance: tuple[float, float, float] = (0.85, 0.85, 0.85)
    slope_rms_mrad: float = 0.0
    slope_length_mm: float = 10.0
    shift_mm: tuple[float, float] = (0.0, 0.0)
    tilt_mrad: tuple[float, float] = (0.0, 0.0)
    dust: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = np.asarray(getattr(self, field.name), dtype=np.float64)
            wanted = {"reflectance": (3,), "shift_mm": (2,), "tilt_mrad": (2,)}.get(field.name, ())
            if value.shape != wanted or not np.all(np.isfinite(value)):
                raise SimrigError(
                    f"{field.name} of a reflector must be finite numbers of shape {wanted}, "
                    f"got {getattr(self, field.name)!r}"
                )
        positive = ("across_mm", "along_mm", "opening_mm", "large_opening_mm", "distance_mm")
        for name in (*positive, "slope_length_mm"):
            if not getattr(self, name) > 0.0:
                raise SimrigError(f"{name} of a reflector must be above 0")
        for name in ("flash_diameter_mm", "lens_diameter_mm", "slope_rms_mrad", "flash_mm"):
            if getattr(self, name) < 0.0:
                raise SimrigError(f"{name} of a reflector must not be negative")
        if not self.opening_mm < self.large_opening_mm <= 2.0 * self.across_mm:
            raise SimrigError(
                f"openings of {self.opening_mm:g} and {self.large_opening_mm:g} mm do not fit an "
                f"ellipsoid of {2.0 * self.across_mm:g} mm across: the lower one must be the "
                "smaller, the large one at most that"
            )
        if not 0.0 <= self.sample_mm < self.height_mm:
            raise SimrigError(
                f"the sample must lie inside the mirror, from 0 to {self.height_mm:.4g} mm above "
                f"its lower rim, got {self.sample_mm:g}"
            )
        if self.distance_mm < 2.0 * self.height_mm:
            raise SimrigError(
                f"lens and flash must stand at least {2.0 * self.height_mm:.4g} mm away, "
                f"got {self.distance_mm:g}"
            )
        if max(map(abs, self.tilt_mrad)) > 100.0 or max(map(abs, self.shift_mm)) > 10.0:
            raise SimrigError("a reflector is tilted by at most 100 mrad and shifted by 10 mm")
        if self.slope_rms_mrad > 20.0 or not 0.0 <= self.dust <= 1.0:
            raise SimrigError("slope_rms_mrad must be at most 20, and dust a share from 0 to 1")
        if min(self.reflectance) < 0.0 or max(self.reflectance) > 1.0:
            raise SimrigError(f"reflectance must lie in [0, 1], got {self.reflectance}")
        if self.flash_mm > 0.3 * self.distance_mm:
            raise SimrigError("the flash must stand beside the lens, within 0.3 of its distance")

    @classmethod
    def from_description(cls, description: ReflectorDescription) -> Reflector:
        """Return the instrument of a file (kind ``reflector``).

        Raises:
            SimrigError: numbers that make no such instrument.
        """
        part = description.reflector
        across, along = (float(axis.value) for axis in part.semi_axes_mm)
        opening, (low, high) = float(part.opening_mm.value), part.z_range_mm
        ratio = 0.5 * opening / across
        if low != 0.0 or not 0.0 < ratio < 1.0:
            raise SimrigError(
                "z_range_mm of a reflector starts at 0, where its opening is, and opening_mm is "
                "less than twice the first of semi_axes_mm"
            )
        centre = along * np.sqrt(1.0 - ratio * ratio)
        if not 0.0 < high <= centre + 1e-6:
            raise SimrigError(
                f"z_range_mm of a reflector must end at most where it is widest, {centre:.4g} mm"
            )
        wide = 2.0 * across * np.sqrt(1.0 - ((high - centre) / along) ** 2)
        said = part.reflectance if isinstance(part.reflectance, list) else [part.reflectance] * 3
        red, green, blue = (float(share.value) for share in said)
        (shift_x, shift_y), (tilt_x, tilt_y) = (
            [float(number.value) for number in pair] for pair in (part.shift_mm, part.tilt_mrad)
        )
        return cls(
            across_mm=across,
            along_mm=along,
            opening_mm=opening,
            large_opening_mm=float(wide),
            distance_mm=float(part.distance_mm.value),
            flash_mm=float(part.flash_mm.value),
            flash_diameter_mm=float(part.flash_diameter_mm.value),
            reflectance=(red, green, blue),
            slope_rms_mrad=float(part.slope_rms_mrad.value),
            shift_mm=(shift_x, shift_y),
            tilt_mrad=(tilt_x, tilt_y),
            dust=float(part.dust.value),
        )

    @property
    def centre_mm(self) -> float:
        """Height of the ellipsoid's centre above the lower rim."""
        ratio = 0.5 * self.opening_mm / self.across_mm
        return float(self.along_mm * np.sqrt(1.0 - ratio * ratio))

    @property
    def height_mm(self) -> float:
        """Height of the mirror, from rim to rim."""
        ratio = 0.5 * self.large_opening_mm / self.across_mm
        return float(self.centre_mm - self.along_mm * np.sqrt(max(1.0 - ratio * ratio, 0.0)))

    @property
    def foci_mm(self) -> tuple[float, float]:
        """Heights of the two foci above the lower rim; of an oblate ellipsoid both its centre."""
        offset = np.sqrt(max(self.along_mm**2 - self.across_mm**2, 0.0))
        return float(self.centre_mm - offset), float(self.centre_mm + offset)

    @property
    def lens(self) -> np.ndarray:
        """Where the lens is, (3,) mm."""
        return np.array([0.0, 0.0, self.distance_mm])

    @property
    def flash(self) -> np.ndarray:
        """Where the flash is, (3,) mm."""
        azimuth = np.radians(self.flash_azimuth_deg)
        return self.lens + self.flash_mm * np.array([np.cos(azimuth), np.sin(azimuth), 0.0])

    @cached_property
    def turn(self) -> np.ndarray:
        """Rotation from the mirror's frame to the world, (3, 3)."""
        ax, ay = 1e-3 * self.tilt_mrad[0], 1e-3 * self.tilt_mrad[1]
        cx, sx, cy, sy = np.cos(ax), np.sin(ax), np.cos(ay), np.sin(ay)
        about_x = np.array([[1.0, 0.0, 0.0], [0.0, cx, -sx], [0.0, sx, cx]])
        about_y = np.array([[cy, 0.0, sy], [0.0, 1.0, 0.0], [-sy, 0.0, cy]])
        return np.asarray(about_x @ about_y)

    @property
    def origin(self) -> np.ndarray:
        """Middle of the lower rim in the world, (3,) mm."""
        return np.array([*self.shift_mm, -self.sample_mm])

    def in_mirror(self, points: np.ndarray) -> np.ndarray:
        """Return world points in the mirror's frame (z = 0 its lower rim), (..., 3)."""
        return np.asarray((points - self.origin) @ self.turn)

    def entrance(self, points: np.ndarray) -> np.ndarray:
        """Return world positions of (..., 2) points in the plane of the large opening."""
        height = np.full(points.shape[:-1], self.height_mm)
        return np.asarray(
            np.concatenate([points, height[..., None]], -1) @ self.turn.T + self.origin
        )

    @property
    def perfect(self) -> Reflector:
        """The same instrument without imperfections of the mirror."""
        return replace(
            self,
            reflectance=(1.0, 1.0, 1.0),
            slope_rms_mrad=0.0,
            shift_mm=(0.0, 0.0),
            tilt_mrad=(0.0, 0.0),
            dust=0.0,
        )


# The mirror for sweeping a ray (thesis section 3.1.6): the sample in one focus, camera and
# projector in the other one, 1.5 m away; the openings then fix both semi-axes.
CONJUGATE = Reflector(across_mm=99.17089371, along_mm=756.52816614, flash_mm=0.0)


@lru_cache(maxsize=8)
def _waves(seed: int, length: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the wave vectors (n, 3) in 1/mm and the phases (n,) of a field of slope errors."""
    rng = np.random.default_rng([seed, 1031])
    direction = rng.normal(size=(_WAVES, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return direction * (2.0 * np.pi / length), rng.uniform(0.0, 2.0 * np.pi, _WAVES)


def normals(mirror: Reflector, points: np.ndarray) -> np.ndarray:
    """Return unit normals that point inwards, at points of the mirror in its frame, (n, 3)."""
    squares = np.array([mirror.across_mm, mirror.across_mm, mirror.along_mm]) ** -2.0
    inward = -(points - [0.0, 0.0, mirror.centre_mm]) * squares
    inward /= np.sqrt(_dot(inward, inward))[:, None]
    if mirror.slope_rms_mrad > 0.0:
        vectors, phases = _waves(mirror.seed, mirror.slope_length_mm)
        height = np.sin(points @ vectors.T + phases)
        unit = vectors * (mirror.slope_length_mm / (2.0 * np.pi))
        slope = height @ unit * (1e-3 * mirror.slope_rms_mrad * np.sqrt(6.0 / _WAVES))
        slope -= _dot(slope, inward)[:, None] * inward
        inward = inward - slope
        inward /= np.sqrt(_dot(inward, inward))[:, None]
    return inward


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.asarray(np.einsum("ij,ij->i", a, b))


@dataclass(frozen=True)
class Paths:
    """Where rays through the large opening land on the sample's plane.

    Attributes:
        landing: (n, 2) mm in the world's plane z = 0.
        towards: (n, 3) unit vectors from there to where the light comes from.
        valid: (n,) the ray meets the mirror that often, and then the sample within the opening.
    """

    landing: np.ndarray
    towards: np.ndarray
    valid: np.ndarray


def follow(mirror: Reflector, source: np.ndarray, points: np.ndarray, bounces: int) -> Paths:
    """Follow rays from a source through the large opening, by so many reflections, to the sample.

    Everything has a closed form. Where a path is not valid it is continued on the whole ellipsoid
    and the whole plane, so that landing points are smooth functions of ``points``.

    Args:
        mirror: the instrument.
        source: (3,) world position of the light.
        points: (n, 2) in the plane of the large opening, in the mirror's frame.
        bounces: reflections, 0 or more.
    """
    squares = np.array([mirror.across_mm, mirror.across_mm, mirror.along_mm]) ** -2.0
    centre = np.array([0.0, 0.0, mirror.centre_mm])
    start = mirror.in_mirror(np.asarray(source, dtype=np.float64))
    up, base = mirror.turn[2], mirror.origin[2]  # height above the sample: up · p + base
    at = np.concatenate([points, np.full((len(points), 1), mirror.height_mm)], axis=-1)
    along = at - start
    along /= np.sqrt(_dot(along, along))[:, None]
    valid = _dot(points, points) <= (0.5 * mirror.large_opening_mm) ** 2
    for _ in range(bounces):
        from_centre = at - centre
        a = (along * along) @ squares
        b = (from_centre * along) @ squares
        c = (from_centre * from_centre) @ squares - 1.0
        # the far root; on the mirror itself c is 0 and this is the other meeting point
        far = (-b + np.sqrt(np.maximum(b * b - a * c, 0.0))) / a
        at = at + far[:, None] * along
        valid &= (at[:, 2] >= 0.0) & (at[:, 2] <= mirror.height_mm)
        valid &= at @ up + base > 0.0
        facing = normals(mirror, at)
        along = along - (2.0 * _dot(along, facing))[:, None] * facing
    falling = along @ up
    valid &= falling < -1e-6
    reach = -(at @ up + base) / np.minimum(falling, -1e-6)
    landed = at + reach[:, None] * along
    inside = landed - centre
    valid &= (inside * inside) @ squares <= 1.0 + 1e-12
    world = landed @ mirror.turn.T + mirror.origin
    return Paths(world[:, :2], -along @ mirror.turn.T, valid)

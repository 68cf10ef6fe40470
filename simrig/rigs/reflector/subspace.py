"""Azimuthal subspaces of a BRDF by a swept ray in the reflector (thesis section 3.1.6).

The sample lies in one focus of the mirror, projector and camera stand at the other. What the
projector lights of the mirror sends light to the sample from one direction, and a picture of the
mirror shows the sample in all directions at once, retro-reflection included: one picture for each
azimuth of the ray makes f_r(θ_i, ·, θ_v, ·). Azimuths are lit one by one, or half of them in each
picture (S-matrices of Hadamard patterns: Sloane and Harwit, "Masks for Hadamard transform optics",
1976), which averages what a dim ray loses in read-out noise and in light that leaks past it.

Simulated are where rays land (slope errors, tilt and shift of the mirror), the pupils' overlap on
the sample, the extent of ray and of pixels' bins, light of pixels that are off, photon and read-out
noise and eight bits. A white reference under the same patterns, averaged over a hundred
sweeps that belong to the instrument, takes off what is not the material's.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import lru_cache
from typing import TYPE_CHECKING, Self

import numpy as np

from simrig.brdf.analytic import Lambert
from simrig.brdf.protocol import Brdf
from simrig.core.errors import SimrigError, check_known
from simrig.directions.spherical import to_vector, turned
from simrig.rigs.imaging.sensor import Sensor
from simrig.rigs.reflector.mirror import CONJUGATE, Reflector, follow

if TYPE_CHECKING:
    from simrig.instruments.quantity import Quantity
    from simrig.instruments.reflector_parts import ProjectorPart

PATTERNS = ("ray", "hadamard")
_LUMENS_PER_WATT = 300.0  # of white light
_PHOTON_J = 3.6e-19  # of green light
_EFFICIENCY = 0.17  # electrons of a photon: half, behind a filter that passes a third
_PIXEL_MM = 0.15  # of the camera, on the mirror's opening
_WELL, _READ_E, _BITS = 10_000.0, 5.0, 8  # of a pixel
_BLACK_DN = 1000.0  # of a bin, far below its noise
_FULL = 0.9  # of the well, by the brightest bin
_RAY_MM = 1.2  # along the opening's radius, of ray and bins
_WHITE, _WHITE_SWEEPS = 0.9, 100  # 20 minutes, once for an instrument
_LEAST_LIT = 0.2  # of the usual, by the white reference: pupils that hardly overlap
BLACK_FRAMES = 10
_LEAK_RINGS, _LEAK_SECTORS = 8, 36
_GAUSS = 0.5 / np.sqrt(3.0)  # two points of an interval of width 1
_AT_ONCE = 16  # blocks whose BRDF is evaluated together


@dataclass(frozen=True)
class Projector:
    """The light of the sweep; what the thesis does not print is assumed.

    Attributes:
        lumens: luminous flux of a white frame (AAXA P300).
        frame_mm: its width and height on the mirror.
        contrast: of a white pixel to a black one.
        pupil_mm: diameter of what light leaves by; the mirror images it on the sample.
        beside_mm: from the camera's lens, as a beam splitter shows it.
        fps: pictures in a second.

    Raises:
        SimrigError: numbers that no projector has.
    """

    lumens: float = 300.0
    frame_mm: tuple[float, float] = (1000.0, 625.0)
    contrast: float = 2000.0
    pupil_mm: float = 30.0
    beside_mm: float = 5.0
    fps: float = 30.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = np.asarray(getattr(self, field.name), dtype=np.float64)
            least = 0.0 if field.name == "beside_mm" else np.nextafter(0.0, 1.0)
            if not np.all(np.isfinite(value)) or np.any(value < least):
                raise SimrigError(
                    f"{field.name} of a projector must be finite and above 0, got {value}"
                )

    @classmethod
    def of(cls, said: ProjectorPart, fps: Quantity) -> Self:
        """Return what an instrument file says."""
        numbers = {name: getattr(said, name).value for name in
                   ("lumens", "contrast", "pupil_mm", "beside_mm")}  # fmt: skip
        width, height = (side.value for side in said.frame_mm)
        return cls(frame_mm=(width, height), fps=fps.value, **numbers)


@dataclass(frozen=True, eq=False)
class Subspace:
    """A measured subspace of two azimuths.

    Attributes:
        theta_i, theta_v: radians.
        phi: (n,) azimuths of light and of view alike, radians.
        values: (n, n, 3) f_r in 1/sr by azimuth of light and of view; NaN where the camera sees
            nothing of what the projector lights.
        patterns: of ``PATTERNS``.
        exposure_s: of every picture.
        pictures: that were taken, those without light with them.
        hardware_seconds: that they take.
        leak: light of pixels that are off, over that of the ray, mean.
    """

    theta_i: float
    theta_v: float
    phi: np.ndarray
    values: np.ndarray
    patterns: str
    exposure_s: float
    pictures: int
    hardware_seconds: float
    leak: float


def measure_subspace(
    material: Brdf,
    theta_i: float,
    theta_v: float,
    *,
    mirror: Reflector = CONJUGATE,
    projector: Projector | None = None,
    patterns: str = "ray",
    step_deg: float = 1.0,
    rotation_deg: float = 0.0,
    noise: bool = True,
    seed: int = 0,
) -> Subspace:
    """Sweep the ray about the mirror's axis and return what the pictures say of f_r.

    Args:
        material: on the sample, turned by ``rotation_deg`` counter-clockwise.
        theta_i, theta_v: polar angles in radians, within what the mirror covers.
        mirror: with camera and projector in its far focus.
        projector: the thesis's unless given.
        patterns: ``ray``, or ``hadamard``: then the number of azimuths is the next prime below
            that is 3 mod 4 (359 for steps of 1°).
        step_deg: of the azimuths, 0.5 to 30.
        rotation_deg: see above.
        noise: False takes pictures without noise, and without rounding.
        seed: of the noise.

    Raises:
        SimrigError: angles that the mirror does not cover, a mirror whose far focus is elsewhere,
            or a material that is not finite.
    """
    check_known("kind of pattern", patterns, PATTERNS)
    if not 0.5 <= step_deg <= 30.0 or not np.isfinite(rotation_deg):
        raise SimrigError(
            "azimuths are stepped by 0.5 to 30 degrees and rotations are finite, got "
            f"{step_deg:g} and {rotation_deg:g}"
        )
    if abs(mirror.foci_mm[1] - mirror.sample_mm - mirror.distance_mm) > 0.01 * mirror.distance_mm:
        raise SimrigError(
            f"a ray is swept from the mirror's far focus, {mirror.foci_mm[1]:.4g} mm away, but "
            f"camera and projector are {mirror.distance_mm:g} mm away: take the mirror CONJUGATE"
        )
    stage = _stage(mirror, projector or Projector(), theta_i, theta_v, patterns, step_deg)
    seen, exposure, leak = _recorded(stage, material, rotation_deg, noise, seed, 1)
    white, _, _ = _white(stage, noise)
    lit = white > _LEAST_LIT * np.median(white)
    values = np.divide(seen, white, out=np.full_like(seen, np.nan), where=lit) * (_WHITE / np.pi)
    pictures = len(stage.lit) + BLACK_FRAMES
    return Subspace(
        theta_i, theta_v, stage.phi, values, patterns, exposure, pictures,
        pictures / stage.projector.fps, leak,
    )  # fmt: skip


def true_subspace(
    material: Brdf, theta_i: float, theta_v: float, phi: np.ndarray, rotation_deg: float = 0.0
) -> np.ndarray:
    """Return f_r itself at azimuths of light and view, (n, n, 3)."""
    own = phi - np.radians(rotation_deg)
    wi, wv = (to_vector(np.full(len(phi), theta), own) for theta in (theta_i, theta_v))
    return np.asarray(material.eval(*np.broadcast_arrays(wi[:, None], wv[None])))


def light_patterns(kind: str, step_deg: float) -> np.ndarray:
    """Return which azimuths each picture lights, (pictures, azimuths) of 0 and 1, invertible.

    The S-matrix is cyclic: its first row are the quadratic residues of a prime that is 3 mod 4.
    """
    count = round(360.0 / step_deg)
    if kind == "ray":
        return np.eye(count)
    while count % 4 != 3 or any(count % k == 0 for k in range(3, int(count**0.5) + 1, 2)):
        count -= 1
    row = np.zeros(count)
    row[np.unique(np.arange(count) ** 2 % count)] = 1.0  # (n + 1) / 2 of them, 0 included
    return np.asarray(row[(np.arange(count)[:, None] + np.arange(count)) % count])


@dataclass(frozen=True)
class _Rays:
    """Patches of the mirror: where they are, and where light of a point of the far focus lands."""

    area: np.ndarray  # (n,) mm² of the opening
    landing: np.ndarray  # (n, 2)
    at: np.ndarray  # (n, 4, 3) points of each patch in the world
    spread: np.ndarray  # (n, 2, 2) of the landing by the point in the pupil's plane


@dataclass(frozen=True, eq=False)
class _Stage:
    """An instrument for two polar angles."""

    projector: Projector
    mirror: Reflector
    phi: np.ndarray
    lit: np.ndarray
    light: _Rays
    view: _Rays
    leak: _Rays


@lru_cache(maxsize=8)
def _stage(
    mirror: Reflector,
    projector: Projector,
    theta_i: float,
    theta_v: float,
    patterns: str,
    step_deg: float,
) -> _Stage:
    lit = light_patterns(patterns, step_deg)
    phi = 2.0 * np.pi * np.arange(lit.shape[1]) / lit.shape[1]
    width = 2.0 * np.pi / len(phi)
    source = mirror.lens + np.array([projector.beside_mm, 0.0, 0.0])

    def ring(theta: float, seen_from: np.ndarray) -> _Rays:
        return _rays(mirror, seen_from, _radius(mirror, theta), phi, _RAY_MM, width)

    high = 0.5 * mirror.large_opening_mm
    low = 0.5 * mirror.opening_mm
    deep = (high - low) / _LEAK_RINGS
    sector = 2.0 * np.pi / _LEAK_SECTORS
    around = np.arange(_LEAK_SECTORS) * sector
    leaks = [
        _rays(mirror, source, low + (k + 0.5) * deep, around, deep, sector)
        for k in range(_LEAK_RINGS)
    ]
    names = ("area", "landing", "at", "spread")
    leak = _Rays(*(np.concatenate([getattr(own, name) for own in leaks]) for name in names))
    return _Stage(
        projector, mirror, phi, lit, ring(theta_i, source), ring(theta_v, mirror.lens), leak
    )


@lru_cache(maxsize=8)
def _polar_angles(mirror: Reflector) -> tuple[np.ndarray, np.ndarray]:
    """Return ascending polar angles and where on the opening they lie, without imperfections."""
    radius = np.linspace(0.5, 0.5 * mirror.large_opening_mm - 0.5 * _RAY_MM, 4000)
    paths = follow(mirror.perfect, mirror.lens, np.stack([radius, 0.0 * radius], -1), 1)
    if not paths.valid.any():
        raise SimrigError("the mirror sends no ray from its far focus to the sample")
    polar = np.arctan2(np.hypot(*paths.towards[:, :2].T), paths.towards[:, 2])[paths.valid]
    order = np.argsort(polar)
    return polar[order], radius[paths.valid][order]


def covered(mirror: Reflector) -> tuple[float, float]:
    """Return the smallest and the largest polar angle that a ray reaches, radians."""
    polar, _ = _polar_angles(mirror)
    return float(polar[0]), float(polar[-1])


def _radius(mirror: Reflector, theta: float) -> float:
    """Return where on the opening the direction lies, mm."""
    polar, radius = _polar_angles(mirror)
    if not polar[0] <= theta <= polar[-1]:
        raise SimrigError(
            f"the mirror covers polar angles from {np.degrees(polar[0]):.1f} to "
            f"{np.degrees(polar[-1]):.1f} degrees, got {np.degrees(theta):g}"
        )
    return float(np.interp(theta, polar, radius))


def _rays(
    mirror: Reflector,
    source: np.ndarray,
    radius: float,
    phi: np.ndarray,
    deep: float,
    wide: float,
) -> _Rays:
    def placed(out: float, about: float) -> np.ndarray:
        own = phi + about * wide
        return (radius + out * deep) * np.stack([np.cos(own), np.sin(own)], axis=-1)

    middle = placed(0.0, 0.0)
    landing = follow(mirror, source, middle, 1).landing
    beside = [follow(mirror, source + axis, middle, 1).landing - landing for axis in np.eye(3)[:2]]
    corners = [placed(o, a) for o in (-_GAUSS, _GAUSS) for a in (-_GAUSS, _GAUSS)]
    at = np.stack([_on_mirror(mirror, source, own) for own in corners], axis=1)
    area = np.full(len(phi), radius * deep * wide)
    return _Rays(area, landing, at, np.stack(beside, axis=-1))


def _on_mirror(mirror: Reflector, source: np.ndarray, entry: np.ndarray) -> np.ndarray:
    """Return where rays through the opening meet the mirror, (n, 3) in the world."""
    through = mirror.entrance(entry)
    squares = np.array([mirror.across_mm, mirror.across_mm, mirror.along_mm]) ** -2.0
    start = mirror.in_mirror(through) - [0.0, 0.0, mirror.centre_mm]
    along = (through - source) @ mirror.turn
    a, b, c = (along**2) @ squares, (start * along) @ squares, (start**2) @ squares - 1.0
    reach = (-b + np.sqrt(np.maximum(b * b - a * c, 0.0))) / a
    return np.asarray(through + reach[:, None] * (along @ mirror.turn.T))


def _irradiance(stage: _Stage, light: _Rays) -> np.ndarray:
    """Return W/mm² on the sample where each bin looks, in a white frame's light, (n, views)."""
    own, mirror = stage.projector, stage.mirror
    flux = own.lumens / _LUMENS_PER_WATT / np.prod(own.frame_mm) * light.area
    apart = stage.view.landing[None] - light.landing[:, None]
    on_pupil = np.einsum("nij,nvj->nvi", np.linalg.inv(light.spread), apart)
    off = np.hypot(on_pupil[..., 0], on_pupil[..., 1])
    edge = max(mirror.lens_diameter_mm, 1e-3)  # two discs' overlap
    inside = np.clip((0.5 * own.pupil_mm - off) / edge + 0.5, 0.0, 1.0)
    spot = np.abs(np.linalg.det(light.spread)) * (0.25 * np.pi * own.pupil_mm**2)
    return np.asarray((flux / spot)[:, None] * inside)


def _seen(stage: _Stage, light: _Rays, material: Brdf, rotation_deg: float) -> np.ndarray:
    """Return electrons per second and pixel that each patch of light makes, (n, views, 3)."""
    mirror, angle = stage.mirror, -np.radians(rotation_deg)
    irradiance = _irradiance(stage, light)
    spot = np.concatenate([stage.view.landing, np.zeros((len(stage.view.landing), 1))], axis=-1)

    def directions(at: np.ndarray) -> np.ndarray:
        away = at - spot[:, None]
        return turned(away / np.linalg.norm(away, axis=-1, keepdims=True), angle)

    wv = directions(stage.view.at)[None, :, None]  # (1, views, 1, 4, 3)
    found = np.empty((*irradiance.shape, 3))
    for first in range(0, len(found), _AT_ONCE):
        own = slice(first, first + _AT_ONCE)
        wi = np.stack([directions(at[None]) for at in light.at[own]])[:, :, :, None]
        values = np.asarray(material.eval(*np.broadcast_arrays(wi, wv)))
        found[own] = values.mean(axis=(2, 3))
    if not np.all(np.isfinite(found)) or found.min() < 0.0:
        raise SimrigError(f"'{material.name}' is not finite and >= 0 in some directions")
    lens = 0.25 * np.pi * mirror.lens_diameter_mm**2 / mirror.distance_mm**2
    passed = np.array(mirror.reflectance) * (1.0 - mirror.dust)
    rate = _PIXEL_MM**2 * lens * _EFFICIENCY / _PHOTON_J
    return np.asarray(found * irradiance[..., None] * passed**2 * rate)


def _recorded(
    stage: _Stage, material: Brdf, rotation_deg: float, noise: bool, seed: int, sweeps: int
) -> tuple[np.ndarray, float, float]:
    """Return decoded electrons per second and pixel (n, views, 3), the exposure and the leak."""
    rays = _seen(stage, stage.light, material, rotation_deg)
    dark = _seen(stage, stage.leak, material, rotation_deg).sum(axis=0) / stage.projector.contrast
    shape = (len(stage.lit), *rays.shape[1:])
    rates = (stage.lit @ rays.reshape(len(rays), -1)).reshape(shape) + dark
    if not rates.max() > 0.0:
        raise SimrigError(f"'{material.name}' is black: the pictures show nothing")
    exposure = float(min(1.0 / stage.projector.fps, _FULL * _WELL / rates.max()))
    leak = float(dark.mean() / max(rays.mean(), 1e-300))
    if noise:
        shown = _exposed(stage, rates, exposure, (seed, 0), sweeps)
        dark = _exposed(stage, dark[None], exposure, (seed, 1), BLACK_FRAMES * sweeps)[0]
    else:
        shown = rates
    decoded = np.linalg.solve(stage.lit, (shown - dark).reshape(len(shown), -1))
    return decoded.reshape(rays.shape), exposure, leak


@lru_cache(maxsize=4)
def _white(stage: _Stage, noise: bool) -> tuple[np.ndarray, float, float]:
    return _recorded(stage, Lambert((_WHITE,) * 3), 0.0, noise, 1, _WHITE_SWEEPS)


def _exposed(
    stage: _Stage, rates: np.ndarray, exposure: float, numbers: tuple[int, int], sweeps: int
) -> np.ndarray:
    """Return the mean rates that a sensor shows in so many sweeps.

    All pixels of a bin in all sweeps, added up, are one pixel here, and their rounding is noise of
    its own: neighbours see other rates.
    """
    count = max(float(stage.view.area[0]) / _PIXEL_MM**2, 1.0) * sweeps
    noise = np.sqrt(count * (_READ_E**2 + (_WELL / 2.0**_BITS) ** 2 / 12.0))
    gain = (2.0**16 - 1.0 - _BLACK_DN) / (count * _WELL)
    sensor = Sensor(rates.shape[1::-1], 16, _BLACK_DN, gain, float(noise), count * _WELL)
    shown = np.empty(rates.shape)
    seed, picture = numbers
    for c in range(3):
        raw = sensor.expose(rates[..., c] * count, exposure, picture, frame=c, seed=seed)
        shown[..., c] = (raw.astype(np.float64) - _BLACK_DN) / (gain * count * exposure)
    return shown

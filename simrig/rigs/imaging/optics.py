"""Lens, light and sensor of an instrument at work: which pixel sees what, and how much light.

What a pixel records is stated as its radiance over the irradiance that the light brings, at level
1, to the sample's centre where it faces the light (1/sr): a white diffuser there shows 1/pi.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np

from simrig.core.errors import SimrigError
from simrig.core.kept import kept
from simrig.imaging.marks import frame_corners
from simrig.instruments.description import Description, GonioreflectometerDescription
from simrig.instruments.kinematics import Kinematics, kinematics_of
from simrig.instruments.parts import needs
from simrig.instruments.pictured import pictured
from simrig.rigs.imaging.sensor import Sensor

_AROUND = 1.04  # of the frame's picture, so that its edges are seen
_FILLS = 0.05  # EV by which exposures and levels may miss the stated range
_MOST_PIXELS = 1 << 26
_MOST_BENT = 0.5  # of the picture's half side, by which a lens may bend
_MOST_BLUR = 0.25  # of the sensor's shorter side


@dataclass(frozen=True, eq=False)
class Optics:
    """An instrument that takes pictures of a flat sample, in numbers.

    Attributes:
        description: the instrument.
        moves: its kinematics.
        sensor: the part of it that is read out.
        sample_mm: side of the square sample.
        frame_mm: inner and outer side of the white frame around it; None without one.
    """

    description: GonioreflectometerDescription
    moves: Kinematics
    sensor: Sensor
    sample_mm: float
    frame_mm: tuple[float, float] | None

    @classmethod
    def of(
        cls,
        description: Description,
        sample_mm: float | None = None,
        pixels: tuple[int, int] | None = None,
        seed: int = 0,
    ) -> Optics:
        """Return the optics of an instrument file.

        Args:
            description: with the tables and keys that pictures need.
            sample_mm: side of the sample; the instrument's diameter unless given.
            pixels: (width, height) that are read out around the optical axis; what the frame needs
                unless given.
            seed: of the sensor's pattern and defects.

        Raises:
            SimrigError: another kind, missing keys, numbers that contradict each other.
        """
        d = pictured(description)
        needs("camera", d.camera, "pixels", "pitch_um", "exposures_s")
        assert d.camera.pixels and d.camera.pitch_um and d.camera.exposures_s
        _check_exposures(d)
        side = d.sample.diameter_mm.value if sample_mm is None else float(sample_mm)
        if not 0.0 < side < float("inf"):
            raise SimrigError(f"the sample must be larger than 0 mm, got {side:g}")
        largest = d.lens.largest_sample_mm
        if largest is not None and side > largest.value:
            raise SimrigError(
                f"the lens of {d.lens.f_mm.value:g} mm sees samples up to {largest.value:g} mm, "
                f"got {side:g}: choose another lens or a smaller sample"
            )
        frame = None
        if d.registration is not None:
            inner = side + 2.0 * d.registration.gap_mm.value
            frame = (inner, inner + 2.0 * d.registration.border_mm.value)
        if 2.0 * max(side, d.light.diameter_mm.value) > d.light.distance_mm.value:
            raise SimrigError("the light must be farther away than twice its and the sample's size")
        whole = (d.camera.pixels[0], d.camera.pixels[1])
        if pixels is None:
            # the stage turns the sample's diagonal to any side of the picture
            seen = np.sqrt(2.0) * (frame[1] if frame else side) * 1000.0 * _AROUND / _sample_um(d)
            pixels = (min(int(np.ceil(seen)) + 2, whole[0]), min(int(np.ceil(seen)) + 2, whole[1]))
        if not all(1 <= asked <= there for asked, there in zip(pixels, whole, strict=True)):
            raise SimrigError(
                f"the sensor has {whole[0]} x {whole[1]} pixels, asked for are "
                f"{pixels[0]} x {pixels[1]}"
            )
        if pixels[0] * pixels[1] > _MOST_PIXELS:
            raise SimrigError(f"a picture has at most {_MOST_PIXELS} pixels: read out fewer")
        camera = d.camera
        gain = camera.K_DN_e.value if camera.K_DN_e else _filling_gain(d)
        sensor = Sensor(
            pixels,
            camera.bits,
            camera.black_DN.value,
            gain,
            camera.sigma_d_e.value,
            camera.mu_sat_e.value,
            camera.mu_I_e_s.value,
            camera.DSNU_e.value,
            camera.PRNU_pct.value,
            camera.defects.value,
            camera.cfa,
            seed,
        )
        _check_sensor(d, sensor)
        moves = kinematics_of(description).of_sample(0.5 * side)
        return cls(d, moves, sensor, side, frame)

    # -- pixels ----------------------------------------------------------------------------------

    @cached_property
    def intrinsics(self) -> np.ndarray:
        """(3, 3) in pixels; the centre of the first pixel is (0, 0), as in OpenCV."""
        width, height = self.sensor.pixels
        focal = self.description.camera.distance_mm.value * 1000.0 / _sample_um(self.description)
        return np.array(
            [[focal, 0.0, 0.5 * (width - 1)], [0.0, focal, 0.5 * (height - 1)], [0.0, 0.0, 1.0]]
        )

    @property
    def window_mm(self) -> tuple[float, float]:
        """Width and height of what a picture shows at the sample's centre, facing the camera."""
        width, height = self.sensor.pixels
        pitch = self.moves.camera_mm / float(self.intrinsics[0, 0])
        return width * pitch, height * pitch

    @property
    def spot_mm(self) -> float:
        """Diameter of the area over which a value is averaged, on the sample."""
        return min(self.description.sample.spot_diameter_mm.value, self.sample_mm)

    @cached_property
    def distortion(self) -> np.ndarray:
        """(5,) k1, k2, p1, p2, k3 of OpenCV."""
        given = self.description.lens.distortion
        return np.zeros(5) if given is None else np.array([number.value for number in given])

    def rays(self, u: np.ndarray, v: np.ndarray, distorted: bool) -> np.ndarray:
        """Return where pixels look, (..., 2): x and y over depth in the camera's frame."""
        matrix = self.intrinsics
        straight = np.stack(
            [(u - matrix[0, 2]) / matrix[0, 0], (v - matrix[1, 2]) / matrix[1, 1]], axis=-1
        )
        if not distorted or not np.any(self.distortion):
            return straight
        exact = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 50, 1e-13)
        flat = np.ascontiguousarray(straight.reshape(-1, 1, 2))
        undistort: Any = cv2.undistortPointsIter
        found: np.ndarray = undistort(flat, np.eye(3), self.distortion, None, None, exact)
        bent = _bent(found, self.distortion)
        if not np.all(np.abs(bent - flat) * matrix[0, 0] < 0.01):  # also of NaN
            raise SimrigError(
                "the lens's distortion folds the picture over: lower k1 to k3, p1 and p2"
            )
        if np.abs(found - flat).max() > _MOST_BENT * np.abs(flat).max():
            raise SimrigError(
                "the lens's distortion moves pixels by more than half the picture: k1 to k3, p1 "
                "and p2 are those of OpenCV, for x and y over depth"
            )
        return found.reshape(straight.shape)

    def bent_rim(self, diameter_mm: float) -> tuple[float, float]:
        """Return how far off the axis the rim of a spot is seen, and how far the lens bends there.

        Both in radians, for a spot that faces the camera and the pixels around it.
        """
        rim = 0.5 * diameter_mm / self.moves.camera_mm + 2.0 / self.intrinsics[0, 0]
        turn = np.linspace(0.0, 2.0 * np.pi, 32, endpoint=False)
        matrix = self.intrinsics
        u = matrix[0, 2] + rim * matrix[0, 0] * np.cos(turn)
        v = matrix[1, 2] + rim * matrix[1, 1] * np.sin(turn)
        off = self.rays(u, v, True) - self.rays(u, v, False)
        return rim, float(np.linalg.norm(off, axis=-1).max())

    def looks(self, distorted: bool) -> np.ndarray:
        """Return ``rays`` of the centres of all pixels, (height, width, 2); made once."""
        bent = distorted and bool(np.any(self.distortion))
        return np.asarray(kept(self, ("looks", bent), lambda: self.rays(*self.pixel_grid(), bent)))

    def pixel_grid(self) -> tuple[np.ndarray, np.ndarray]:
        """Return u and v of the centres of all pixels, each (height, width)."""
        width, height = self.sensor.pixels
        u, v = np.meshgrid(np.arange(width, dtype=float), np.arange(height, dtype=float))
        return u, v

    @cached_property
    def vignetting(self) -> np.ndarray:
        """What reaches the pixels of what a pinhole would give them, (height, width)."""
        square = np.sum(self.looks(False) ** 2, axis=-1)
        whole = np.array(self.description.camera.pixels) / self.intrinsics[0, 0]
        corner = 0.25 * float(whole @ whole)
        return (1.0 - self.description.lens.vignetting.value * square / corner) / (
            1.0 + square
        ) ** 2

    @property
    def blur_pixels(self) -> float:
        """Standard deviation of a point's picture, in pixels."""
        pitch = self.description.camera.pitch_um
        return self.description.lens.psf_um.value / pitch.value if pitch else 0.0

    # -- light -----------------------------------------------------------------------------------

    def irradiance(
        self, points: np.ndarray, light: np.ndarray, fall_off: bool, beam: bool
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return how much light reaches points, and from where.

        Args:
            points: (n, 3) in mm.
            light: (3,) where it stands, facing the centre.
            fall_off, beam: count the distance; the beam's profile.

        Returns:
            Irradiance of areas that face the light over that at the centre, (n,), and unit vectors
            towards the light, (n, 3).
        """
        to_light = light - points
        distance = np.linalg.norm(to_light, axis=1)
        towards = to_light / distance[:, None]
        whole = float(np.linalg.norm(light))
        factor = (whole / distance) ** 2 if fall_off else np.ones(len(points))
        half = self.description.light.beam_deg
        if beam and half is not None:
            power = np.log(0.5) / np.log(np.cos(np.radians(half.value)))
            factor = factor * np.maximum(towards @ light / whole, 0.0) ** power
        return factor, towards

    # -- exposure --------------------------------------------------------------------------------

    @property
    def shortest(self) -> float:
        """Shortest exposure, seconds times the level of the light."""
        assert self.description.camera.exposures_s
        return self.description.camera.exposures_s[0].value * self.description.light.levels[0]

    @property
    def electrons_per_second(self) -> float:
        """Of a pixel that shows 1/sr, at light level 1."""
        camera = self.description.camera
        return camera.mu_sat_e.value / (camera.saturation_per_sr.value * self.shortest)

    def exposures(self, rate: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray]:
        """Return a series of exposures for a picture, from the shortest on.

        The first does not saturate any pixel where the instrument can avoid that; each further one
        is sixteen times as long, until the darkest hundredth of the pixels fill an eighth of the
        converter.

        Args:
            rate: electrons per second of the pixels.
            most: exposures.

        Returns:
            Seconds times light level, and seconds, both (m,).
        """
        assert self.description.camera.exposures_s
        full = self.sensor.saturation_e
        longest = self.description.camera.exposures_s[1].value
        steps = round(float(np.log2(longest / self.shortest)))
        ladder = self.shortest * 2.0 ** np.arange(steps + 1)
        brightest = float(rate.max())
        fits = np.flatnonzero(ladder * brightest <= 0.8 * full)
        first = int(fits[-1]) if len(fits) else 0
        # the darkest that there is anything to see of: what is black stays black
        lit = rate[rate > 1e-6 * brightest] if brightest > 0.0 else rate
        dark = float(np.percentile(lit, 1.0)) if lit.size else 0.0
        chosen = [first]
        while len(chosen) < most and chosen[-1] < steps and ladder[chosen[-1]] * dark < full / 8.0:
            chosen.append(min(chosen[-1] + 4, steps))
        exposure = ladder[chosen]
        return exposure, np.maximum(exposure, self.description.camera.exposures_s[0].value)

    # -- target ----------------------------------------------------------------------------------

    def marks_mm(self) -> np.ndarray:
        """Return the outer corners of the frame, from -x +y clockwise, (4, 3); (0, 3) without."""
        if self.frame_mm is None:
            return np.zeros((0, 3))
        return np.pad(frame_corners(self.frame_mm[1], self.frame_mm[1]), ((0, 0), (0, 1)))

    def facts(self) -> dict[str, Any]:
        """Return what a recording says of the instrument, as plain values."""
        return {
            "instrument": self.description.model_dump(mode="json", exclude_none=True),
            "sensor": self.sensor.as_dict() | {"electrons_per_second": self.electrons_per_second},
            "sample": {
                "size_mm": self.sample_mm,
                "frame_mm": None if self.frame_mm is None else list(self.frame_mm),
                "marks_mm": self.marks_mm().tolist(),
            },
        }


def _bent(straight: np.ndarray, distortion: np.ndarray) -> np.ndarray:
    """Return where a lens shows what it would show at (n, 1, 2) without distortion, by OpenCV."""
    ahead = np.concatenate([straight, np.ones((*straight.shape[:2], 1))], axis=-1)
    shown: Any = cv2.projectPoints(ahead, np.zeros(3), np.zeros(3), np.eye(3), distortion)[0]
    return np.asarray(shown)


def _sample_um(d: GonioreflectometerDescription) -> float:
    """Return micrometres on the sample per pixel, as stated or by a thin lens."""
    if d.lens.sample_um is not None:
        return d.lens.sample_um.value
    assert d.camera.pitch_um
    distance, focal = d.camera.distance_mm.value, d.lens.f_mm.value
    if distance <= focal:
        raise SimrigError("the camera stands within the focal length of its lens: move it away")
    return d.camera.pitch_um.value * (distance - focal) / focal


def _filling_gain(d: GonioreflectometerDescription) -> float:
    room = 2.0**d.camera.bits - 1.0 - d.camera.black_DN.value
    if room <= 0.0:
        raise SimrigError(
            f"black_DN of {d.camera.black_DN.value:g} leaves no room in {d.camera.bits} bits"
        )
    return float(room / d.camera.mu_sat_e.value)


def _check_sensor(d: GonioreflectometerDescription, sensor: Sensor) -> None:
    """Refuse a sensor whose dark signal is as large as its well, and a lens that shows nothing."""
    assert d.camera.pixels and d.camera.pitch_um and d.camera.exposures_s
    spread = float(np.hypot(sensor.sigma_d_e, sensor.DSNU_e))
    dark = sensor.mu_I_e_s * d.camera.exposures_s[0].value
    for name, level, share in (
        ("sigma_d_e and DSNU_e", spread, 0.1),
        ("mu_I_e_s over the shortest exposure", dark, 0.5),
    ):
        if level > share * sensor.saturation_e:
            raise SimrigError(
                f"{name} in [camera]: {level:.3g} electrons of {sensor.saturation_e:.3g} that a "
                "pixel holds leave no room for light: they are in electrons"
            )
    wide = d.lens.psf_um.value / d.camera.pitch_um.value
    if wide > _MOST_BLUR * min(d.camera.pixels):
        raise SimrigError(
            f"psf_um in [lens]: a point is {wide:.3g} pixels wide, more than a quarter of the "
            "sensor: it is in micrometres"
        )


def _check_exposures(d: GonioreflectometerDescription) -> None:
    assert d.camera.exposures_s
    low, high = (seconds.value for seconds in d.camera.exposures_s)
    if low >= high:
        raise SimrigError(f"'exposures_s' in [camera]: must ascend, got {low:g} and {high:g}")
    span = float(np.log2(high / (low * d.light.levels[0])))
    stated = d.camera.exposure_range_ev.value
    if abs(span - stated) > _FILLS:
        raise SimrigError(
            f"exposures_s and levels span {span:.2f} EV, exposure_range_ev says {stated:g}: change "
            "one of them"
        )

"""Frames of a film: what the gantry's camera makes of a sample while both arms move.

A frame that processing may choose is rendered as the pictures of a recording are, every instant of
the shutter from its own place of camera and light, and goes through sensor, colour filters and the
camera's own encoding. All others are made of small pictures of the sample at steps along the slice,
at a quarter of the size: they have the brightness and the place of everything, and are never the
sharpest.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from scipy import ndimage

from simrig.brdf.protocol import evaluate
from simrig.core.colour import encode_srgb
from simrig.imaging.camera import Camera, from_pose
from simrig.imaging.registration import Area
from simrig.instruments.kinematics import ArmKinematics
from simrig.rigs.film.motion import Motion
from simrig.rigs.film.setup import COARSE, Setup
from simrig.rigs.imaging.sensor import SENSOR_EFFECTS
from simrig.rigs.imaging.surface import Surface
from simrig.rigs.imaging.view import View, view_of

SMALL = 4  # pixels of a frame that is to be chosen in one of another
GRID = 32  # points across the sample of a small picture
_DARK = 0.01  # f_r of what hides the view: painted arms, 1/sr
_BAYER = {"RGGB": "BG", "BGGR": "RG", "GRBG": "GB", "GBRG": "GR"}  # OpenCV names the second row
_NEAR, _FAR_OUT = 20.0, 1e4  # mm before the camera, and pixels, within which an arm is drawn
_STEP_PX = 0.5  # that anything moves between two instants of a frame


@dataclass(frozen=True, eq=False)
class FilmCamera:
    """The camera of one film.

    Attributes:
        setup: the instrument.
        surface: the sample.
        effects: that are simulated.
        seed: of all chance.
    """

    setup: Setup
    surface: Surface
    effects: frozenset[str]
    seed: int

    def motion(self, number: int, one: Any, thetas: tuple[float, float]) -> Motion:
        """Return how the arms move during a slice."""
        setup, moves = self.setup, self.setup.optics.moves
        assert isinstance(moves, ArmKinematics)
        off = setup.off if "positioning" in self.effects else (0.0, 0.0)
        shake = setup.film.vibration_deg.value if "vibration" in self.effects else 0.0
        return Motion(
            moves,
            one,
            number,
            thetas,
            setup.seconds,
            off,
            np.radians(shake),
            setup.film.vibration_hz.value,
            self.seed,
        )

    # -- what is seen ----------------------------------------------------------------------------

    def instants(self, motion: Motion, time: float) -> np.ndarray:
        """Return the instants of a frame's shutter: as many as its movement calls for."""
        setup = self.setup
        if "motion-blur" not in self.effects:
            return np.array([time])
        half = 0.5 * setup.film.shutter_s.value
        ends = self.moved_pixels(motion, np.array([time - half, time, time + half]))
        count = int(np.clip(np.ceil(ends.sum() / _STEP_PX), 2, 16))
        return time + setup.film.shutter_s.value * ((np.arange(count) + 0.5) / count - 0.5)

    def moved_pixels(self, motion: Motion, times: np.ndarray) -> np.ndarray:
        """Return how far the sample's corners move in the picture from time to time, (n - 1,)."""
        half = 0.5 * self.setup.optics.sample_mm
        corners = np.array([[x, y, 0.0] for x in (-half, half) for y in (-half, half)])
        poses, _ = motion.placed(times)
        seen = np.array([self._camera(pose).project(corners) for pose in poses])
        return np.linalg.norm(np.diff(seen, axis=0), axis=-1).max(axis=-1)

    def _camera(self, pose: np.ndarray) -> Camera:
        distortion = self.setup.optics.distortion if self._on("distortion") else np.zeros(5)
        return from_pose(self.setup.optics.intrinsics, distortion, pose)

    def _on(self, effect: str) -> bool:
        return effect in self.effects

    def _light(self, points: np.ndarray, light: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        fall_off, beam = self._on("fall-off"), self._on("beam-profile")
        return self.setup.optics.irradiance(points, light, fall_off, beam)

    @cached_property
    def _rays(self) -> np.ndarray:
        """Where coarse pixels of the whole picture look, (rows, columns, 2)."""
        width, height = self.setup.whole.sensor.pixels
        middle = [(np.arange(side // COARSE) + 0.5) * COARSE - 0.5 for side in (width, height)]
        u, v = np.meshgrid(*middle)
        return self.setup.whole.rays(u, v, self._on("distortion"))

    def _black(self, pose: np.ndarray, light: np.ndarray) -> np.ndarray:
        """Return what the black material around shows, coarse, (rows, columns)."""
        turn, origin = pose[:3, :3], pose[:3, 3]
        ray = np.concatenate([self._rays, np.ones((*self._rays.shape[:2], 1))], axis=-1) @ turn.T
        reach = -origin[2] / np.minimum(ray[..., 2], -0.02)  # beyond the horizon: far away
        points = (origin + reach[..., None] * ray).reshape(-1, 3)
        points[:, 2] = 0.0
        factor, wi = self._light(points, light)
        wv = origin - points
        wv /= np.linalg.norm(wv, axis=1, keepdims=True)
        shown = evaluate(self.setup.black, wi, wv)[:, 0] * factor * np.maximum(wi[:, 2], 0.0)
        return np.asarray(shown.reshape(self._rays.shape[:2]))

    def _around(self, pose: np.ndarray, light: np.ndarray) -> np.ndarray:
        """Return the black material and the light's arm before it, coarse."""
        coarse = self._black(pose, light)
        shape = (coarse.shape[0], coarse.shape[1])
        hidden = self._arm(self._camera(pose), light, 1.0 / COARSE, self.setup.corner, shape)
        return np.asarray(coarse + hidden * (self._painted(light) - coarse))

    def _crop(self, coarse: np.ndarray) -> np.ndarray:
        """Return the window's part of a coarse picture, at full size."""
        (x, y), (w, h) = self.setup.corner, self.setup.optics.sensor.pixels
        width, height = self.setup.whole.sensor.pixels
        full = cv2.resize(coarse.astype(np.float32), (width, height))
        return np.asarray(full[y : y + h, x : x + w])

    def radiance(self, pose: np.ndarray, light: np.ndarray, number: int) -> np.ndarray:
        """Return what the window shows at one instant, (height, width, 3) in 1/sr."""
        setup, optics = self.setup, self.setup.optics
        width, height = optics.sensor.pixels
        sunk = setup.film.sunk_mm.value
        view = view_of(optics, pose, self._on("distortion"), frame_z_mm=sunk)
        picture = np.zeros((height * width, 3))
        picture += (view.black * self._crop(self._black(pose, light))).reshape(-1, 1)
        factor, _ = self._light(view.points, light)
        shown = self.surface.reflected(view, light[None], number)[0]
        picture[view.pixels] += (view.sample * factor)[:, None] * shown
        factor, towards = self._light(view.frame_points, light)
        white = self.white * factor * np.maximum(towards[:, 2], 0.0)
        picture[view.frame_pixels] += (view.frame * white)[:, None]
        return self._covered(picture.reshape(height, width, 3), pose, light)

    @property
    def white(self) -> float:
        """f_r of border and dot, 1/sr."""
        registration = self.setup.optics.description.registration
        assert registration is not None
        return registration.albedo.value / np.pi

    def _covered(self, picture: np.ndarray, pose: np.ndarray, light: np.ndarray) -> np.ndarray:
        """Return a picture (of any size of the window) with the dot and what hides the view."""
        film, camera = self.setup.film, self._camera(pose)
        scale = picture.shape[1] / self.setup.optics.sensor.pixels[0]
        around = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
        rim = np.stack([np.cos(around), np.sin(around), np.zeros(48)], axis=1)
        dot = np.array([*film.dot_mm, film.sunk_mm.value])
        factor, towards = self._light(dot[None], light)
        white = self.white * float(factor[0] * max(towards[0, 2], 0.0))
        mask = _polygon(
            camera.project(dot + 0.5 * film.dot_diameter_mm.value * rim), scale, picture
        )
        picture = picture + mask[..., None] * (white - picture)
        hidden = self._arm(camera, light, scale, (0, 0), (picture.shape[0], picture.shape[1]))
        return picture + hidden[..., None] * (self._painted(light) - picture)

    @staticmethod
    def _painted(light: np.ndarray) -> float:
        return _DARK * float(max(light[2], 0.0) / np.linalg.norm(light))

    def _arm(
        self,
        camera: Camera,
        light: np.ndarray,
        scale: float,
        corner: tuple[int, int],
        shape: tuple[int, int],
    ) -> np.ndarray:
        """Return what of a picture the light's arm hides, 0 to 1, (height, width).

        Args:
            camera, light: at one instant.
            scale: of the picture.
            corner: of the window in the picture, before it is scaled.
            shape: of the picture.
        """
        moves, mask = self.setup.optics.moves, np.zeros(shape, np.uint8)
        assert isinstance(moves, ArmKinematics)
        bow, away = moves.light, float(np.linalg.norm(light))
        theta = np.linspace(np.arccos(light[2] / away), 0.5 * np.pi, 24)
        phi = np.arctan2(light[1], light[0])
        points = bow.distance * np.stack(
            [np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=1
        )
        depth = points @ camera.world_to_camera[2, :3] + camera.world_to_camera[2, 3]
        ahead = (depth > _NEAR) & (depth < np.linalg.norm(camera.centre_mm))
        at = (camera.project(points) + corner + 0.5) * scale - 0.5
        ahead &= np.abs(np.nan_to_num(at, nan=np.inf)).max(axis=1) < _FAR_OUT
        if not (self._on("occlusion") and ahead.any()):
            return np.asarray(mask / 255.0)
        focal, drawn = float(camera.matrix[0, 0]) * scale, np.rint(at[ahead]).astype(np.int32)
        thick = max(1, round(bow.width * focal / float(depth[ahead].mean())))
        cv2.polylines(mask, [drawn], False, 255, thick, cv2.LINE_AA)
        if ahead[0]:
            radius = max(1, round(0.5 * bow.head * focal / float(depth[0])))
            cv2.circle(mask, (int(drawn[0, 0]), int(drawn[0, 1])), radius, 255, -1, cv2.LINE_AA)
        return np.asarray(mask / 255.0)

    # -- frames ----------------------------------------------------------------------------------

    def frame(self, motion: Motion, index: int, gain: float) -> np.ndarray:
        """Return a frame that may be chosen, (height, width, 3) uint8, blue first."""
        time = index / self.setup.fps
        instants = self.instants(motion, time)
        poses, lights = motion.placed(instants)
        number = motion.number * (1 << 20) + index
        picture = np.mean(
            [self.radiance(p, q, number) for p, q in zip(poses, lights, strict=True)], axis=0
        )
        around = self._around(*(part[len(instants) // 2] for part in (poses, lights)))
        return self._pasted(self._encoded(picture, number, gain), around, gain)

    def _encoded(self, picture: np.ndarray, number: int, gain: float) -> np.ndarray:
        """Return what the camera makes of radiances, (height, width, 3) uint8, red first."""
        optics = self.setup.optics
        picture = self._through(picture)
        if self._on("blur") and optics.blur_pixels > 0.0:
            wide = (optics.blur_pixels, optics.blur_pixels, 0.0)
            picture = ndimage.gaussian_filter(picture, wide, mode="nearest")
        if self._on("vignetting"):
            picture = picture * optics.vignetting[..., None]
        sensor = optics.sensor
        on = [name for name in SENSOR_EFFECTS if name in self.effects] + ["quantisation"]
        raw = sensor.expose(
            sensor.mosaic(picture) * sensor.saturation_e, gain, number, effects=on, seed=self.seed
        )
        code = getattr(cv2, f"COLOR_Bayer{_BAYER[str(sensor.cfa)]}2RGB_EA")
        rgb = cv2.demosaicing(raw, code).astype(np.float64) - sensor.black_DN
        return _coded(rgb / (sensor.K_DN_e * sensor.saturation_e))

    def _through(self, picture: np.ndarray) -> np.ndarray:
        """Return radiances with stray light, in the camera's colours."""
        if self._on("stray-light"):
            picture = picture + self.setup.optics.description.light.stray.value / np.pi
        return picture @ self.setup.colours().T if self._on("camera-colours") else picture

    def _pasted(self, window: np.ndarray, coarse: np.ndarray, gain: float) -> np.ndarray:
        """Return the whole frame around its window."""
        setup = self.setup
        width, height = setup.whole.sensor.pixels
        around = self._through(np.repeat(coarse[..., None], 3, axis=-1))
        if self._on("vignetting"):
            around = around * cv2.resize(setup.whole.vignetting, coarse.shape[::-1])[..., None]
        frame = cv2.resize(_coded(around * gain), (width, height))
        (x, y), (w, h) = setup.corner, setup.optics.sensor.pixels
        frame[y : y + h, x : x + w] = window
        return np.ascontiguousarray(frame[..., ::-1])

    def samples(self, motion: Motion, indices: np.ndarray) -> np.ndarray:
        """Return small pictures of the sample, (n, GRID, GRID, 3) radiances, row 0 at +y."""
        optics = self.setup.optics
        x, y = Area((optics.sample_mm,) * 2, (GRID, GRID)).points()
        points = np.stack([x.ravel(), y.ravel(), np.zeros(GRID**2)], axis=1)
        pitch = optics.sample_mm / GRID
        steps = np.zeros((2, len(points), 2))
        steps[0, :, 0], steps[1, :, 1] = pitch, -pitch
        all_of, none = np.ones(len(points)), np.zeros(0)
        poses, lights = motion.placed(indices / self.setup.fps)
        made = []
        for pose, light in zip(poses, lights, strict=True):
            view = View(
                pose[:3, 3],
                np.arange(len(points)),
                points,
                steps,
                all_of,
                none.astype(int),
                np.zeros((0, 3)),
                none,
                none,
            )
            factor, _ = self._light(points, light)
            made.append(self.surface.reflected(view, light[None], 0)[0] * factor[:, None])
        return np.array(made, dtype=np.float32).reshape(-1, GRID, GRID, 3)

    def small_frame(
        self, motion: Motion, index: int, sample: np.ndarray, gain: float
    ) -> np.ndarray:
        """Return a frame that will not be chosen, from a small picture of the sample."""
        optics = self.setup.optics
        poses, lights = motion.placed(np.array([index / self.setup.fps]))
        pose, light = poses[0], lights[0]
        camera, coarse = self._camera(pose), self._black(pose, light)
        (w, h), scale = optics.sensor.pixels, 1.0 / SMALL
        picture = cv2.resize(self._crop(coarse), (w // SMALL, h // SMALL))
        picture = np.repeat(picture[..., None], 3, axis=-1).astype(np.float64)
        assert optics.frame_mm is not None
        white = self.white * float(max(light[2], 0.0) / np.linalg.norm(light))
        for side, shown in zip(optics.frame_mm[::-1], (white, 0.0), strict=True):
            mask = _polygon(camera.project(_square(side)), scale, picture)
            picture += mask[..., None] * (shown - picture)
        ends = np.array([[0, 0], [GRID, 0], [GRID, GRID], [0, GRID]], dtype=np.float32) - 0.5
        corners = (camera.project(_square(optics.sample_mm)) + 0.5) * scale - 0.5
        matrix = cv2.getPerspectiveTransform(ends, corners.astype(np.float32))
        size = (w // SMALL, h // SMALL)
        put = cv2.warpPerspective(sample, matrix, size, borderMode=cv2.BORDER_REPLICATE)
        mask = _polygon(camera.project(_square(optics.sample_mm)), scale, picture)
        picture += mask[..., None] * (put - picture)
        picture = self._through(self._covered(picture, pose, light)) * gain
        if self._on("vignetting"):
            picture *= cv2.resize(optics.vignetting, (w // SMALL, h // SMALL))[..., None]
        window = cv2.resize(_coded(picture), (w, h))
        return self._pasted(window, self._around(pose, light), gain)

    def gains(self, motion: Motion, bright: np.ndarray) -> np.ndarray:
        """Return the exposure of every frame, from how bright its bright parts are, (n,)."""
        film = self.setup.film
        if "auto-exposure" not in self.effects:
            return np.full(len(bright), film.target.value / float(bright.max()))
        late = ndimage.gaussian_filter1d(np.log2(bright), 0.4 * self.setup.fps, mode="nearest")
        time = np.arange(len(bright)) / self.setup.fps
        drift = film.drift_ev.value * motion.strayed(time)
        return np.asarray(film.target.value * 2.0 ** (drift - late))

    def still(self, motion: Motion, surface: Surface) -> np.ndarray:
        """Return a frame of another sample after an eighth of a slice, arms apart: of the chart."""
        index = self.setup.frames // 8
        light = motion.placed(np.array([index / self.setup.fps]))[1][0]
        bright = self.white * float(light[2] / np.linalg.norm(light))
        gain = self.setup.film.target.value / bright
        return replace(self, surface=surface).frame(motion, index, gain)


def _square(side: float) -> np.ndarray:
    """Return the corners of a square around the origin, (4, 3) mm, from -x +y clockwise."""
    half = 0.5 * side
    return np.array([[-half, half, 0.0], [half, half, 0.0], [half, -half, 0.0], [-half, -half, 0]])


def _polygon(corners: np.ndarray, scale: float, picture: np.ndarray) -> np.ndarray:
    """Return what of pixels a polygon covers, 0 to 1, (height, width)."""
    mask = np.zeros(picture.shape[:2], np.uint8)
    at = np.rint(((corners + 0.5) * scale - 0.5) * 256.0).astype(np.int32)
    cv2.fillPoly(mask, [at], 255, cv2.LINE_AA, 8)
    return np.asarray(mask / 255.0)


def _coded(linear: np.ndarray) -> np.ndarray:
    """Return linear values in eight bits by the curve of sRGB."""
    codes = encode_srgb(np.clip(linear, 0.0, 1.0))
    return np.rint(255.0 * codes).astype(np.uint8)

"""Exposure and light of a frame, by the black material around the border (thesis section 6.2.3).

The camera adapts its exposure and says nothing of it, and a near LED lights no two places alike.
The black material's f_r is known, so what it shows is the light. Divided by what distance and
cosine make of a point, this is nearly constant: a polynomial through it is the exposure times what
is left of the light's unevenness and the lens's vignetting, everywhere on the sample. (The thesis
interpolates what the black shows itself.) Light of the room adds to both black and border, which
differ fifty-fold: their ratio tells it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from simrig.brdf.protocol import evaluate
from simrig.core.errors import SimrigError
from simrig.imaging.alignment import Plane
from simrig.imaging.camera import Camera
from simrig.imaging.flat import Illumination
from simrig.imaging.resampling import inside
from simrig.rigs.film.setup import Setup

_BESIDE_MM, _WIDE_MM = 1.5, 9.0  # of the black from the border that is read
_CLIPPED = 0.95  # of full scale
_MOST_ROOM = 0.3  # of what the black shows
_FEWEST = 40  # readings of the black
DEGREE = 2


@dataclass(frozen=True, eq=False)
class Light:
    """What makes f_r of a frame's linear values.

    Attributes:
        place_mm: (3,) where the light stands.
        field: exposure times what is uneven beyond distance and cosine.
        room: light of the room over that which the centre faces, 1/sr; NaN where it is not told.
    """

    place_mm: np.ndarray
    field: Illumination
    room: float = 0.0

    @classmethod
    def read(
        cls, grey: np.ndarray, corner: np.ndarray, camera: Camera, setup: Setup, light: np.ndarray
    ) -> Light:
        """Return the light of a frame.

        Args:
            grey: (height, width) linear, the mean of the colours; cut from the frame at ``corner``.
            camera: of the frame, border at z = 0.
            setup: the instrument.
            light: (3,) where the light stands, mm.

        Raises:
            SimrigError: the black is not seen, or clipped.
        """
        smooth = cv2.blur(grey, (3, 3))
        black, dark = _shown(smooth, corner, camera, _ring(setup))
        wi, reached = _lit(black, light)
        wv = camera.centre_mm - black
        wv /= np.linalg.norm(wv, axis=1, keepdims=True)
        scale = evaluate(setup.black, wi, wv)[:, 0] * reached
        good = (dark < _CLIPPED) & (dark > 0.0) & (scale > 0.0)
        if good.sum() < _FEWEST:
            raise SimrigError("the black material around the border is not seen, or over-exposed")
        black, dark, scale = black[good], dark[good], scale[good]
        field = Illumination.fitted(black[:, 0], black[:, 1], dark / scale, DEGREE)
        border, bright = _shown(smooth, corner, camera, _border(setup))
        white = _white(setup) * _lit(border, light)[1]
        room = np.nan
        if len(border) >= _FEWEST and bright.max() < _CLIPPED:
            # G + S / f of both, robustly: S is the room's light, G the exposure
            of_black, of_white = np.median(dark / scale), np.median(bright / white)
            slope = np.median(1.0 / scale) - np.median(1.0 / white)
            added = (of_black - of_white) / slope
            room = float(added / max(of_white - added * np.median(1.0 / white), 1e-12))
            if added > _MOST_ROOM * np.median(dark):  # no room is so bright: a blurred border
                room = np.nan
        return cls(light, field, room)

    def without_room(self, room: float, grey: np.ndarray, corner: np.ndarray,
                     camera: Camera, setup: Setup) -> Light:  # fmt: skip
        """Return the light with that of the room, over the exposure, taken off the black."""
        if not room > 0.0:
            return replace(self, room=0.0)
        exposure = float(self.field.at(0.0, 0.0))
        for _ in range(3):
            found = Light.read(grey - room * exposure, corner, camera, setup, self.place_mm)
            exposure = float(found.field.at(0.0, 0.0))
        return replace(found, room=room)

    def f_r(self, values: np.ndarray, x: np.ndarray, y: np.ndarray, plane: Plane) -> np.ndarray:
        """Return f_r in 1/sr, before colours are corrected.

        Args:
            values: (..., 3) linear, at points of the surface.
            x, y: (...) of them, mm.
            plane: of the surface.
        """
        points = np.stack([x, y, plane.height(x, y)], axis=-1)
        _, reached = _lit(points.reshape(-1, 3), self.place_mm)
        light = self.field.at(x, y) * reached.reshape(x.shape)
        room = self.room * float(self.field.at(0.0, 0.0))
        return np.asarray((values - room) / light[..., None])


def _lit(points: np.ndarray, light: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return directions to the light, and cosine and distance over that of the centre, (n,)."""
    to_light = light - points
    distance = np.linalg.norm(to_light, axis=1)
    wi = to_light / distance[:, None]
    return wi, np.maximum(wi[:, 2], 0.0) * (np.linalg.norm(light) / distance) ** 2


def _white(setup: Setup) -> float:
    registration = setup.optics.description.registration
    assert registration is not None
    return registration.albedo.value / np.pi


def _ring(setup: Setup) -> np.ndarray:
    """Return points of the black material around the border, without the dot, (n, 3) mm."""
    half = 0.5 * setup.outer_mm
    points = _grid(half + _WIDE_MM, 0.7)
    out = np.abs(points[:, :2]).max(axis=1) > half + _BESIDE_MM
    dot = np.hypot(*(points[:, :2] - setup.film.dot_mm).T)
    return points[out & (dot > 0.5 * setup.film.dot_diameter_mm.value + _BESIDE_MM)]


def _border(setup: Setup) -> np.ndarray:
    """Return points in the middle of the white border, (n, 3) mm."""
    assert setup.optics.frame_mm is not None
    inner, outer = (0.5 * side for side in setup.optics.frame_mm)
    wide = 0.3 * (outer - inner)
    points = _grid(outer, 0.5)
    far = np.abs(points[:, :2]).max(axis=1)
    return points[(far > inner + wide) & (far < outer - wide)]


def _grid(half: float, pitch: float) -> np.ndarray:
    side = np.arange(-half, half + 0.5 * pitch, pitch)
    x, y = np.meshgrid(side, side)
    return np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)


def _shown(
    grey: np.ndarray, corner: np.ndarray, camera: Camera, points: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return points that are in a picture, and what it shows there."""
    at = camera.project(points) - corner
    there = inside(np.nan_to_num(at, nan=-1.0), grey.shape)
    column, row = np.rint(at[there]).astype(int).T
    return points[there], grey[row, column]

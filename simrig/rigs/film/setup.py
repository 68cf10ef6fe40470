"""A gantry that films, in numbers: which part of its pictures shows what."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from simrig.brdf.minnaert import Minnaert
from simrig.core.errors import SimrigError
from simrig.instruments.description import Description, GantryDescription
from simrig.instruments.filming import Film
from simrig.rigs.film.effects import checked
from simrig.rigs.imaging.optics import Optics

COARSE = 16  # pixels of the full picture between those where the black material is evaluated


@dataclass(frozen=True, eq=False)
class Setup:
    """A gantry that films, in numbers.

    Attributes:
        optics: of the middle of the picture, which holds border and dot whichever way they turn.
        whole: of the whole picture.
        film: what the instrument file says of filming.
        seconds, fps: of a slice, and frames per second.
        off: largest error of azimuths and polar angles, of light and camera, radians.
    """

    optics: Optics
    whole: Optics
    film: Film
    seconds: float
    fps: float
    off: tuple[float, float]

    @classmethod
    def of(
        cls, description: Description, sample_mm: float | None, seed: int, theta_v: float = 0.0
    ) -> Setup:
        """Return an instrument that films, with its camera at a polar angle in radians.

        Raises:
            SimrigError: one that does not, or numbers that contradict each other.
        """
        name = description.instrument.name
        if not isinstance(description, GantryDescription) or description.film is None:
            raise SimrigError(f"'{name}' does not film: its file needs kind 'gantry' and [film]")
        parts = (description.camera, description.light, description.registration)
        if any(part is None for part in parts) or description.timing.fps is None:
            raise SimrigError(f"'{name}': films need [camera], [light], [registration] and fps")
        camera, light = description.camera, description.light
        assert camera is not None and light is not None
        if camera.pixels is None or camera.cfa is None:
            raise SimrigError(f"'{name}': films need 'pixels' and 'cfa' in [camera]")
        size = (camera.pixels[0], camera.pixels[1])
        raw = checked(description)
        whole = Optics.of(raw, sample_mm, size, seed)
        assert whole.frame_mm is not None
        pitch = whole.moves.camera_mm / float(whole.intrinsics[0, 0])
        if min(size) * pitch < 1.05 * np.sqrt(2.0) * whole.frame_mm[1]:
            raise SimrigError(
                f"the border of {whole.frame_mm[1]:g} mm does not fit into a picture of "
                f"{min(size) * pitch:.0f} mm: choose a smaller sample or another lens"
            )
        window = _window(whole, description.film, theta_v)
        off = np.radians([light.repeatability_deg.value, camera.repeatability_deg.value])
        return cls(
            Optics.of(raw, sample_mm, window, seed),
            whole,
            description.film,
            description.timing.slice_s.value,
            description.timing.fps.value,
            (float(off[0]), float(off[1])),
        )

    def window(self, theta_v: float) -> tuple[int, int]:
        """Return width and height of the middle of the picture that holds border and dot."""
        return _window(self.whole, self.film, theta_v)

    @property
    def frames(self) -> int:
        """Of a slice."""
        return round(self.seconds * self.fps)

    @cached_property
    def black(self) -> Minnaert:
        """The material around the border, whose f_r is known."""
        k = self.film.black_per_sr.value
        return Minnaert((k, k, k), self.film.black_exponent.value, "black")

    @cached_property
    def outer_mm(self) -> float:
        """Outer side of the border."""
        assert self.optics.frame_mm is not None
        return self.optics.frame_mm[1]

    @property
    def corner(self) -> tuple[int, int]:
        """Column and row of the window in the whole picture."""
        (w, h), (inner_w, inner_h) = self.whole.sensor.pixels, self.optics.sensor.pixels
        return (w - inner_w) // 2, (h - inner_h) // 2

    def colours(self) -> np.ndarray:
        """Return what the camera's colours have of linear sRGB, (3, 3)."""
        mixed = self.film.crosstalk.value
        return np.eye(3) * (1.0 - 3.0 * mixed) + mixed


def _window(whole: Optics, film: Film, theta_v: float) -> tuple[int, int]:
    """Return the part of the picture that holds border and dot whichever way they turn."""
    assert whole.frame_mm is not None
    x, y = film.dot_mm
    dot = float(np.hypot(x, y)) + film.dot_diameter_mm.value
    radius = max(whole.frame_mm[1] / np.sqrt(2.0), dot)
    away = whole.moves.camera_mm
    # what is nearer to the camera is seen larger; 4 pixels for what vibrates and is off
    larger = float(whole.intrinsics[0, 0]) / (away - radius * np.sin(theta_v))
    shares, step = (1.0, np.cos(theta_v) + np.sin(np.radians(1.0))), 2 * COARSE
    width, height = (
        min(step * int(np.ceil(2.0 * (radius * share * larger + 4.0) / step)), side // step * step)
        for share, side in zip(shares, whole.sensor.pixels, strict=True)
    )
    return width, height

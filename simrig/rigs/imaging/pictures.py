"""From poses to the rates at which pixels collect electrons: optics, light and sample together."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy import ndimage

from simrig.core.counter_rng import uniforms
from simrig.instruments.instrument import AXES, Instrument
from simrig.instruments.kinematics import Placement
from simrig.rigs.direct.recording import quadrature
from simrig.rigs.imaging.optics import Optics
from simrig.rigs.imaging.surface import Surface
from simrig.rigs.imaging.view import View, view_of

NODE_PAIRS = 8  # of points of light and lens, on opposite sides
_POSITION_STREAM = 1  # as at the direct level: the same axes stop at the same places
_MOST_VALUES = 1 << 25  # of pictures that are made together


@dataclass(frozen=True, eq=False)
class Poses:
    """Where an instrument is sent, and where it stops.

    Attributes:
        commanded: as asked for; a recording states these.
        actual: with what the axes do, which no one knows.
        hours: since the first picture, (n,).
    """

    commanded: Placement
    actual: Placement
    hours: np.ndarray

    def __len__(self) -> int:
        return len(self.hours)

    def views(self) -> list[np.ndarray]:
        """Return the numbers of the poses of each place of the camera, in order of the first."""
        seen: dict[bytes, list[int]] = {}
        for number, pose in enumerate(self.actual.camera_to_world):
            seen.setdefault(pose.tobytes(), []).append(number)
        return [np.array(numbers) for numbers in seen.values()]


def poses_of(optics: Optics, angles: np.ndarray, moving: bool, seed: int) -> Poses:
    """Return the poses of directions in the order in which they are taken.

    Args:
        optics: the instrument.
        angles: (n, 4) theta_i, theta_v, phi_i, phi_v in radians.
        moving: axes stop beside where they should, and their zeros are off.
        seed: of the errors.
    """
    moves, description = optics.moves, optics.description
    commanded = moves.placed(angles)
    seconds = description.timing.per_sample_s.value
    hours = np.arange(len(angles)) * seconds / 3600.0
    if not moving:
        return Poses(commanded, commanded, hours)
    four = {str(axis.name): axis for axis in description.axis}
    largest = np.radians([four[name].repeatability_deg.value for name in AXES])
    offset = np.radians([four[name].offset_deg.value for name in AXES])
    actual = moves.missed(
        commanded,
        largest,
        offset,
        lambda rows, count: 2.0 * uniforms(rows, seed, _POSITION_STREAM, count) - 1.0,
    )
    return Poses(commanded, replace(actual, fault=commanded.fault), hours)


@dataclass(frozen=True, eq=False)
class Renderer:
    """What pixels collect.

    Attributes:
        optics: the instrument.
        surface: the sample.
        effects: names of those that are simulated (``simrig.rigs.imaging.effects``).
    """

    optics: Optics
    surface: Surface
    effects: frozenset[str]

    def rates(self, poses: Poses, numbers: np.ndarray) -> Iterator[np.ndarray]:
        """Yield electrons per second of the pixels at light level 1, (height, width), pose by pose.

        Args:
            poses: of a recording.
            numbers: some of one view (``Poses.views``).
        """
        width, height = self.optics.sensor.pixels
        together = max(1, _MOST_VALUES // (width * height * 3 * len(self._nodes)))
        cameras = poses.actual.camera_to_world
        camera = cameras[numbers[0]]
        view = int((cameras == camera).all(axis=(1, 2)).argmax())  # the same for any part of it
        for first in range(0, len(numbers), together):
            part = numbers[first : first + together]
            shown = self._shown(camera, poses.actual.light_mm[part], view)
            for picture, hours in zip(shown, poses.hours[part], strict=True):
                yield self._collected(picture, float(hours))

    @cached_property
    def _nodes(self) -> list[tuple[np.ndarray | None, np.ndarray | None]]:
        """Points of the lens and of the light, mm across their axes; one of each is a pair."""
        if not self.effects & {"light-size", "aperture-size"}:
            return [(None, None)]
        nodes = quadrature(Instrument.of(self.optics.description), self.effects, NODE_PAIRS)
        return list(zip(nodes.lens, nodes.light, strict=True))

    def _shown(self, camera: np.ndarray, lights: np.ndarray, number: int) -> Iterator[np.ndarray]:
        """Yield radiances over the centre's irradiance, (height, width, 3), light by light."""
        width, height = self.optics.sensor.pixels
        views: dict[bytes, View] = {}
        parts = []
        for lens, lamp in self._nodes:
            key = b"" if lens is None else lens.tobytes()
            if key not in views:
                views = {key: view_of(self.optics, camera, "distortion" in self.effects, lens)}
            places = (
                lights if lamp is None else lights + np.array([_across(p, lamp) for p in lights])
            )
            parts.append((views[key], places, self.surface.reflected(views[key], places, number)))
        for k in range(len(lights)):
            picture = np.zeros((height * width, 3))
            for view, places, reflected in parts:
                self._add(picture, view, places[k], reflected[k])
            yield picture.reshape(height, width, 3) / len(parts)

    def _add(self, picture: np.ndarray, view: View, light: np.ndarray, shown: np.ndarray) -> None:
        description = self.optics.description
        fall_off, beam = "fall-off" in self.effects, "beam-profile" in self.effects
        white = 0.0 if description.registration is None else description.registration.albedo.value
        black = description.sample.border_albedo.value / np.pi
        factor, _ = self.optics.irradiance(view.points, light, fall_off, beam)
        picture[view.pixels] += (view.sample * factor)[:, None] * shown
        factor, towards = self.optics.irradiance(view.frame_points, light, fall_off, beam)
        cosine = np.maximum(towards[:, 2], 0.0)
        picture[view.frame_pixels] += (view.frame * factor * cosine * white / np.pi)[:, None]
        rest = view.black.ravel() * (black * max(light[2], 0.0) / np.linalg.norm(light))
        picture += rest[:, None]

    def _collected(self, picture: np.ndarray, hours: float) -> np.ndarray:
        """Return what the sensor collects of radiances (height, width, 3)."""
        optics, on = self.optics, self.effects
        light = optics.description.light
        if "drift" in on:
            picture = picture * max(1.0 + 0.01 * light.drift_pct_h.value * hours, 0.0)
        if "stray-light" in on:
            picture = picture + light.stray.value / np.pi
        if "blur" in on and optics.blur_pixels > 0.0:
            wide = (optics.blur_pixels, optics.blur_pixels, 0.0)
            picture = ndimage.gaussian_filter(picture, wide, mode="nearest")
        seen: Any = optics.sensor.mosaic(picture)
        if "vignetting" in on:
            seen = seen * optics.vignetting
        return np.asarray(seen * optics.electrons_per_second)


def _across(place: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Return a point of a disc that faces the centre, relative to its middle, (3,)."""
    axis = place / np.linalg.norm(place)
    helper = np.array([0.0, 1.0, 0.0]) if abs(axis[2]) > 0.9 else np.array([0.0, 0.0, 1.0])
    right = np.cross(helper, axis)
    right /= np.linalg.norm(right)
    return np.asarray(point[0] * right + point[1] * np.cross(axis, right))

"""From directions to what the axes are set to, to where camera and light stand, and back.

The frame is the sample's: its centre is the origin, z its normal, lengths in mm. An arm is a bow
around the centre that carries its head, the camera or the light, and rises to it from the horizon;
one that may come over the pole has a second configuration for every direction (theta < 0, the
azimuth turned by 180°). What an arm hides follows from the angles between the bow, the head and the
other direction, without a search.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from simrig.core.errors import SimrigError
from simrig.instruments.description import (
    Description,
    DomeDescription,
    GantryDescription,
    GonioreflectometerDescription,
)
from simrig.instruments.instrument import AXES
from simrig.instruments.parts import Arm

REACHED, BEYOND, OCCLUDED, COLLIDES = "", "beyond the axes", "hidden by an arm", "arms collide"
_TOLERANCE = 1e-6  # radians
_TURN = 2.0 * np.pi
Draw = Callable[[np.ndarray, int], np.ndarray]


@dataclass(frozen=True, eq=False)
class Placement:
    """Where an instrument stands for directions.

    Attributes:
        angles: (n, 4) theta_i, theta_v, phi_i, phi_v in radians.
        settings: (n, 4) of the axes in the same order, radians; theta < 0 is over the pole.
        camera_to_world: (n, 4, 4) of the camera's frame, OpenCV's (x right, y down, z ahead).
        light_mm: (n, 3).
        fault: (n,) of text: why a direction is not reached, ``REACHED`` where it is.
    """

    angles: np.ndarray
    settings: np.ndarray
    camera_to_world: np.ndarray
    light_mm: np.ndarray
    fault: np.ndarray

    @property
    def reached(self) -> np.ndarray:
        """(n,) of bool."""
        return np.asarray(self.fault == REACHED)


@dataclass(frozen=True)
class Bow:
    """An arm with what it carries.

    Attributes:
        distance: of the head from the centre, mm.
        width: of the bow, mm.
        head, depth: of the head, across and along, mm.
        over: it may come over the pole.
    """

    distance: float
    width: float
    head: float
    depth: float
    over: bool

    @classmethod
    def of(cls, arm: Arm, distance: float) -> Bow:
        """Return an arm of an instrument file."""
        width, head, depth = arm.arm_width_mm, arm.head_diameter_mm, arm.head_depth_mm
        return cls(distance, width.value, head.value, depth.value, arm.over_the_pole)

    def hides(self, theta: np.ndarray, phi: np.ndarray, ray: np.ndarray, beam: float) -> np.ndarray:
        """Return whether the bow stands in rays from the centre, (n,) of bool.

        Args:
            theta, phi: (n,) settings of the bow.
            ray: (n, 3) unit vectors.
            beam: radius of the rays' bundle where they pass the bow, mm.
        """
        across = -np.sin(phi) * ray[:, 0] + np.cos(phi) * ray[:, 1]
        along = np.cos(phi) * ray[:, 0] + np.sin(phi) * ray[:, 1]
        polar = np.arctan2(along, ray[:, 2])  # in the bow's plane; it is from theta to the horizon
        aside = np.arcsin(np.clip(np.abs(across), 0.0, 1.0))
        bow = (
            (self.width > 0.0)
            & (polar >= theta)
            & (aside * self.distance <= 0.5 * self.width + beam)
        )
        head = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)])
        apart = 2.0 * np.arcsin(np.clip(0.5 * np.linalg.norm(head.T - ray, axis=1), 0.0, 1.0))
        near = (self.head > 0.0) & (apart * self.distance <= 0.5 * self.head + beam)
        return np.asarray(bow | near)


@dataclass(frozen=True, eq=False)
class ArmKinematics:
    """Light and camera on two bows, the sample on a stage that turns under them.

    Attributes:
        light, camera: the bows.
        ranges: (4, 2) of the axes in radians.
        coupling: (4, 4): settings = coupling · motors; the identity where every axis turns alone.
        sample_mm, lens_mm: radii of the bundle of rays at its ends, for what is hidden.
        polar: polar angles of light and of camera where they are fixed, radians.
    """

    light: Bow
    camera: Bow
    ranges: np.ndarray
    coupling: np.ndarray
    sample_mm: float
    lens_mm: float
    polar: tuple[np.ndarray, np.ndarray] | None = None

    @property
    def camera_mm(self) -> float:
        """Distance of the camera."""
        return self.camera.distance

    @property
    def light_mm(self) -> float:
        """Distance of the light."""
        return self.light.distance

    def placed(self, angles: np.ndarray) -> Placement:
        """Return how directions are reached, each by the first configuration that is free.

        Args:
            angles: (n, 4) theta_i, theta_v, phi_i, phi_v in radians.
        """
        angles = np.asarray(angles, dtype=np.float64)
        chosen = angles.copy()
        fault = np.full(len(angles), "", dtype=object)
        left = np.arange(len(angles))
        for number, over in enumerate(self._configurations()):
            settings, inside = self._within(self._turned(angles[left], over))
            said = np.where(inside, self._fault(settings), BEYOND)
            better = (said == REACHED) | (number == 0)
            better |= (fault[left] == BEYOND) & (said != BEYOND)
            chosen[left[better]], fault[left[better]] = settings[better], said[better]
            left = left[said != REACHED]
        return _placement(self, angles, chosen, fault)

    def stopped(self, settings: np.ndarray) -> Placement:
        """Return where camera and light stand when the axes have stopped at (n, 4) settings."""
        settings = np.asarray(settings, dtype=np.float64)
        over = settings[:, :2] < 0.0
        phi = np.mod(settings[:, 2:] + np.pi * over, _TURN)
        angles = np.concatenate([np.abs(settings[:, :2]), phi], axis=1)
        return _placement(self, angles, settings, self._fault(settings))

    def missed(
        self, commanded: Placement, most: np.ndarray, offset: np.ndarray, draw: Draw
    ) -> Placement:
        """Return where camera and light stop instead, in the order in which they are sent.

        An axis that stays where it is keeps its error; one that moves draws another, which belongs
        to the direction that it moves for. A coupled axis is taken along.

        Args:
            commanded: where they are sent.
            most: (4,) largest error of a move, radians.
            offset: (4,) of the axes' zeros, radians.
            draw: numbers within ±1 of rows of angles, so many a row.
        """
        motors = commanded.settings @ np.linalg.inv(self.coupling).T
        moved = np.ones(motors.shape, dtype=bool)
        moved[1:] = np.abs(np.diff(motors, axis=0)) > 1e-9
        last = np.maximum.accumulate(np.where(moved, np.arange(len(motors))[:, None], 0), axis=0)
        errors = np.take_along_axis(most * draw(commanded.angles, 4), last, axis=0) + offset
        return self.stopped(commanded.settings + errors @ self.coupling.T)

    def of_sample(self, radius_mm: float) -> ArmKinematics:
        """Return the same over a sample of another size."""
        return replace(self, sample_mm=radius_mm)

    def _configurations(self) -> list[np.ndarray]:
        lights = (False, True) if self.light.over else (False,)
        cameras = (False, True) if self.camera.over else (False,)
        return [np.array([one, two]) for two in cameras for one in lights]

    @staticmethod
    def _turned(angles: np.ndarray, over: np.ndarray) -> np.ndarray:
        theta = np.where(over, -angles[:, :2], angles[:, :2])
        return np.concatenate([theta, angles[:, 2:] + np.pi * over], axis=1)

    def _within(self, settings: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return settings with azimuths in their range, and whether all are within reach."""
        low, high = self.ranges.T
        phi = low[2:] + np.mod(settings[:, 2:] - low[2:] + _TOLERANCE, _TURN) - _TOLERANCE
        settings = np.concatenate([settings[:, :2], phi], axis=1)
        size = np.concatenate([np.abs(settings[:, :2]), phi], axis=1)
        inside = np.all((size >= low - _TOLERANCE) & (size <= high + _TOLERANCE), axis=1)
        for theta, fixed in zip(size.T, self.polar or (), strict=False):
            inside &= np.min(np.abs(theta[:, None] - fixed), axis=1) <= _TOLERANCE
        return settings, inside

    def _fault(self, settings: np.ndarray) -> np.ndarray:
        towards = [_direction(settings[:, k], settings[:, k + 2]) for k in (0, 1)]
        fault = np.full(len(settings), REACHED, dtype=object)
        near, far = (0, 1) if self.light.distance <= self.camera.distance else (1, 0)
        bows = (self.light, self.camera)
        share = bows[near].distance / bows[far].distance
        beam = self.sample_mm * (1.0 - share) + self.lens_mm * share
        hidden = bows[near].hides(settings[:, near], settings[:, near + 2], towards[far], beam)
        fault[hidden] = OCCLUDED
        if abs(bows[0].distance - bows[1].distance) < 0.5 * (bows[0].depth + bows[1].depth):
            for one, two in ((0, 1), (1, 0)):
                size = 0.5 * bows[two].head
                fault[
                    bows[one].hides(settings[:, one], settings[:, one + 2], towards[two], size)
                ] = COLLIDES
        return fault


@dataclass(frozen=True, eq=False)
class DomeKinematics:
    """Cameras and lights that never move; settings are the directions themselves.

    Attributes:
        directions: (k, 2) theta, phi of every camera and light in radians.
        camera_mm, light_mm: their distances.
    """

    directions: np.ndarray
    camera_mm: float
    light_mm: float

    def placed(self, angles: np.ndarray) -> Placement:
        """Return the cameras and lights of directions; others than theirs are beyond."""
        angles = np.asarray(angles, dtype=np.float64)
        known = _direction(*self.directions.T)
        fault = np.full(len(angles), REACHED, dtype=object)
        for k in (0, 1):
            asked = _direction(angles[:, k], angles[:, k + 2])
            apart = np.linalg.norm(asked[:, None] - known[None], axis=-1).min(axis=1)
            fault[apart > 10.0 * _TOLERANCE] = BEYOND
        return _placement(self, angles, angles, fault)

    def missed(
        self, commanded: Placement, most: np.ndarray, offset: np.ndarray, draw: Draw
    ) -> Placement:
        """Return where cameras and lights stand instead, each in all its pictures."""
        errors = np.zeros(commanded.angles.shape)
        for k in (0, 1):
            errors[:, k::2] = draw(commanded.angles[:, k::2], 4)[:, 2 * k : 2 * k + 2]
        settings = commanded.settings + most * errors + offset
        return _placement(self, commanded.angles, settings, commanded.fault)

    def of_sample(self, _: float) -> DomeKinematics:
        """Return the same: nothing is hidden, however large the sample."""
        return self


Kinematics = ArmKinematics | DomeKinematics


def kinematics_of(description: Description) -> Kinematics:
    """Return how an instrument moves.

    Raises:
        SimrigError: a kind that has no geometry in its file, or none that moves.
    """
    if isinstance(description, GonioreflectometerDescription):
        moves = {str(axis.name): axis for axis in description.axis}
        ranges = np.radians([moves[name].range_deg for name in AXES])
        coupling = np.eye(4)
        for axis in description.axis:
            if axis.coupled_to is not None:
                place = AXES.index(axis.name), AXES.index(axis.coupled_to)
                coupling[place] = axis.ratio.value
        lens = description.lens
        return ArmKinematics(
            Bow.of(description.light, description.light.distance_mm.value),
            Bow.of(description.camera, description.camera.distance_mm.value),
            ranges,
            coupling,
            0.5 * description.sample.diameter_mm.value,
            0.5 * lens.f_mm.value / lens.f_number.value,
        )
    if isinstance(description, GantryDescription):
        camera, light = description.camera, description.light
        if camera is None or light is None:
            raise SimrigError(
                f"'{description.instrument.name}' says nothing of arms: add [camera] and [light]"
            )
        polar = (np.radians(light.theta_deg), np.radians(camera.theta_deg))
        free = np.array([[0.0, 0.5 * np.pi]] * 2 + [[0.0, _TURN]] * 2)
        sample = 0.5 * description.sample.diameter_mm.value if description.sample else 0.0
        lamp, eye = (Bow.of(part, part.distance_mm.value) for part in (light, camera))
        return ArmKinematics(lamp, eye, free, np.eye(4), sample, 0.0, polar)
    if isinstance(description, DomeDescription):
        dome = description.dome
        directions = np.radians(dome.directions_deg)
        return DomeKinematics(directions, dome.camera_mm.value, dome.light_mm.value)
    raise SimrigError(
        f"an instrument of kind '{description.instrument.kind}' has no arms that move: "
        "gonioreflectometers, gantries and domes have"
    )


def _placement(
    moves: Kinematics, angles: np.ndarray, settings: np.ndarray, fault: np.ndarray
) -> Placement:
    """Return where camera and light stand at settings."""
    phi = settings[:, 3]
    x = np.stack([-np.sin(phi), np.cos(phi), np.zeros_like(phi)], axis=1)
    z = -_direction(settings[:, 1], phi)
    pose = np.zeros((len(settings), 4, 4))
    pose[:, :3, 0], pose[:, :3, 1], pose[:, :3, 2] = x, np.cross(z, x), z
    pose[:, :3, 3], pose[:, 3, 3] = -moves.camera_mm * z, 1.0
    light = moves.light_mm * _direction(settings[:, 0], settings[:, 2])
    return Placement(angles, settings, pose, light, fault)


def _direction(theta: np.ndarray, phi: np.ndarray) -> np.ndarray:
    """Return unit vectors (n, 3); theta may be below 0."""
    sine = np.sin(theta)
    return np.stack([sine * np.cos(phi), sine * np.sin(phi), np.cos(theta)], axis=-1)

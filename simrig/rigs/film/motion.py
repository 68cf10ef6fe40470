"""How a gantry's arms move while a slice is filmed (thesis sections 6.2.1 and 6.4.3)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from simrig.core.counter_rng import hashed
from simrig.directions.spherical import TWO_PI
from simrig.instruments.kinematics import ArmKinematics
from simrig.plans.gantry import GantrySlice
from simrig.plans.slices import AXIAL

_WAVES = 3  # sines that a motion is made of
_POSITION, _VIBRATION, _EXPOSURE, _POLAR = range(21, 25)  # streams


@dataclass(frozen=True, eq=False)
class Motion:
    """The arms during one slice: a full turn at constant speed, and what is off.

    Attributes:
        moves: the instrument's kinematics.
        one: the slice.
        number: of the slice, from 0; chance belongs to it.
        thetas: polar angles of illumination and view, radians.
        seconds: of a turn.
        off: largest error of azimuths and polar angles, of light and camera, radians.
        shake: largest turn of the camera, radians; ``hz`` of it.
        seed: of all chance.
    """

    moves: ArmKinematics
    one: GantrySlice
    number: int
    thetas: tuple[float, float]
    seconds: float
    off: tuple[float, float]
    shake: float
    hz: float
    seed: int

    def turned(self, time: np.ndarray) -> np.ndarray:
        """Return φ_v where the camera's arm should be at times in seconds, radians."""
        return np.asarray(TWO_PI * time / self.seconds)

    def angles(self, time: np.ndarray) -> np.ndarray:
        """Return commanded theta_i, theta_v, phi_i, phi_v at times, (n, 4) radians."""
        phi_v = self.turned(time)
        theta = np.broadcast_to(self.thetas, (len(time), 2))
        return np.concatenate([theta, coupled(self.one, phi_v)[:, None], phi_v[:, None]], axis=1)

    def placed(self, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return camera_to_world (n, 4, 4) and the light's place (n, 3) at times, as they are."""
        settings = self.angles(time)
        for k, most in enumerate(self.off):
            settings[:, 2 + k] += most * self._waves(time, 0.3, _POSITION, k)
            settings[:, k] += most * (2.0 * self._uniforms(_POLAR, k)[0] - 1.0)
        stopped = self.moves.stopped(settings)
        poses = stopped.camera_to_world.copy()
        tilt = [self.shake * self._waves(time, self.hz, _VIBRATION, k) for k in (0, 1)]
        poses[:, :3, :3] = poses[:, :3, :3] @ _turns(*tilt)
        return poses, stopped.light_mm

    def strayed(self, time: np.ndarray) -> np.ndarray:
        """Return by how much of its largest drift the automatic exposure is off, -1 to 1."""
        return self._waves(time, 0.08, _EXPOSURE, 0)

    def _uniforms(self, stream: int, which: int) -> np.ndarray:
        bits = hashed((self.seed, self.number, which, stream), 3 * _WAVES)
        return (bits >> np.uint64(11)).astype(np.float64) * 2.0**-53

    def _waves(self, time: np.ndarray, hz: float, stream: int, which: int) -> np.ndarray:
        """Return a smooth random motion within ±1, (n,)."""
        chance = self._uniforms(stream, which).reshape(3, _WAVES)
        rates = hz * (0.6 + 0.8 * chance[0])
        weights = 0.2 + chance[1]
        phase = TWO_PI * (np.outer(time, rates) + chance[2])
        return np.asarray(np.sin(phase) @ (weights / weights.sum()))


def coupled(one: GantrySlice, phi_v: np.ndarray) -> np.ndarray:
    """Return φ_i that the gear gives for φ_v (thesis section 6.2.3)."""
    return np.asarray(phi_v - one.offset if one.kind == AXIAL else one.offset - phi_v)


def _turns(about_x: np.ndarray, about_y: np.ndarray) -> np.ndarray:
    """Return small rotations about a camera's x and y, (n, 3, 3)."""
    one, zero = np.ones_like(about_x), np.zeros_like(about_x)
    cx, sx, cy, sy = np.cos(about_x), np.sin(about_x), np.cos(about_y), np.sin(about_y)
    x = np.array([[one, zero, zero], [zero, cx, -sx], [zero, sx, cx]])
    y = np.array([[cy, zero, sy], [zero, one, zero], [-sy, zero, cy]])
    return np.einsum("abn,bcn->nac", x, y)

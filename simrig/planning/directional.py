"""A scene's environment as N directional lights, whatever its emitter, size and rotation."""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np

from simrig.planning import rays
from simrig.scenes import DirectionalLights, median_cut
from simrig.scenes.latlong import latlong_directions, solid_angles

MOST_ROWS = 128  # of the map that is cut; finer ones are averaged
_PLAIN_ROWS = 128  # for emitters that are no map


class Environment:
    """The radiance of an environment emitter, in its own frame and about its own pixels.

    The emitter is asked, at about one place per pixel: bilinear pixels then keep what they send,
    however bright one of them is.

    Attributes:
        radiance: (height, width, 3) linear RGB >= 0, latitude-longitude as in ``scenes.latlong``.
        known: whether its pixels say all: it is a map or the same everywhere.
        brightest: (height, width) largest value that was found in any channel.
        turn: the (3, 3) rotation from that frame into the world.
    """

    def __init__(self, emitter: Any) -> None:
        """Ask an emitter of a loaded scene, in a variant that is not spectral."""
        matrix = np.array(emitter.world_transform().matrix, dtype=np.float64).reshape(4, 4, -1)
        left, _, right = np.linalg.svd(matrix[:3, :3, 0])
        self.turn = left @ right  # without a scale and the rounding of float32
        rows, columns = _size(emitter)
        constant = emitter.class_name() == "ConstantBackgroundEmitter"
        self.known = not mi.is_spectral and (constant or "data" in mi.traverse(emitter))
        fold = -(-rows // MOST_ROWS)
        height, width = -(-rows // fold), -(-columns // fold)
        directions = latlong_directions(fold * height, fold * width).reshape(-1, 3)
        facing = -directions @ self.turn.T
        si = rays.interaction(np.zeros_like(directions), facing)
        seen = rays.rows(rays.three_channels(emitter.eval(si)))
        seen = np.broadcast_to(seen, directions.shape)
        weights = solid_angles(fold * height, fold * width).reshape(height, fold)
        weights /= fold * weights.sum(axis=1, keepdims=True)
        fine = np.maximum(seen, 0.0).reshape(height, fold, width, fold, 3)
        self.radiance = np.einsum("hawbc,ha->hwc", fine, weights)
        self.brightest = fine.max(axis=(1, 3, 4))

    def lights(self, count: int) -> DirectionalLights:
        """Return directional lights in world space that stand for it, by median cut.

        Args:
            count: number of lights; there are fewer when the map has fewer pixels.

        Raises:
            SimrigError: an environment that is black.
        """
        height, width = self.radiance.shape[:2]
        lights = median_cut(self.radiance, min(count, height * width))
        return DirectionalLights(lights.directions @ self.turn.T, lights.irradiance)


def _size(emitter: Any) -> tuple[int, int]:
    """Return the rows and columns of a map; Mitsuba stores two columns twice, as a margin."""
    found = mi.traverse(emitter)
    if "data" not in found:
        return _PLAIN_ROWS, 2 * _PLAIN_ROWS
    return int(found["data"].shape[0]), int(found["data"].shape[1]) - 2


def as_tensor(lights: DirectionalLights) -> Any:
    """Return lights as the (N, 6) tensor that ``simrig_all_lights`` takes."""
    return mi.TensorXf(np.hstack([lights.directions, lights.irradiance]).astype(np.float32))

"""A tile with structure under a camera and a light that are near: traced by Mitsuba.

The camera's rays meet the endless material once per view; all lights of the view then ask the
same hits. Lanes are (light, pixel) and loop over the samples, so the same kernels serve all poses
and the same bits come out however the work is divided.
"""

from __future__ import annotations

from typing import Any

import drjit
import mitsuba
import numpy as np

from simrig.core import backend
from simrig.core.arrays import aligned
from simrig.mesostructure.tile import Tile
from simrig.rigs.btf.camera import TileCamera
from simrig.rigs.imaging.view import View

dr: Any = drjit
mi: Any = mitsuba

_GOLDEN = 0.6180339887498949


class TracedSurface:
    """A tile as a surface (see ``simrig.rigs.imaging.surface.Surface``).

    Args:
        tile: the material; its middle lies at the sample's centre.
        theta_max_deg: largest polar angle of any view or light.
        spp: samples per pixel, a lattice that is the same in all pixels.
        bounces: reflections on the way, 1 for direct light.
        seed: of the paths of more than one reflection.
    """

    def __init__(self, tile: Tile, theta_max_deg: float, spp: int, bounces: int, seed: int):
        backend.select("auto")
        steepest = min(theta_max_deg + 2.0, 89.0)  # at the sample's corners
        above = np.array([[0.0, 0.0, 1.0]])
        self._camera = _NearCamera(tile, above, steepest, (1, 1), spp, seed, grid=False)
        self.bounces = bounces

    def reflected(self, view: View, lights: np.ndarray, number: int) -> np.ndarray:
        """Return f_r times the cosine (see ``Surface``), float32."""
        if not len(view.pixels):
            return np.zeros((len(lights), 0, 3), dtype=np.float32)
        return self._camera.picture(view, lights, self.bounces, number)


class _NearCamera(TileCamera):
    """The tile's scene, with rays that come from a point and go to a point."""

    def picture(self, view: View, lights: np.ndarray, bounces: int, number: int) -> np.ndarray:
        """Return what pixels show under lights, (m, n, 3)."""
        count = len(view.pixels)
        self.resolution = (1, count)
        origin, direction = self._rays(view)
        at: Any = mi.Point3f(*[mi.Float(aligned(c)) for c in origin.T])
        along: Any = mi.Vector3f(*[mi.Float(aligned(c)) for c in direction.T])
        si = self._hit(at, along, mi.Bool(True))
        # where it is in the sample's frame, in which no period was taken off
        start = np.tile(view.points[:, :2], (self.spp, 1)) + self._offsets(view)
        low: Any = si.p.z / along.z
        x, y = (mi.Float(aligned(np.asarray(c, dtype=np.float32))) for c in start.T)
        self._place = mi.Point3f(x + low * along.x, y + low * along.y, si.p.z)
        dr.eval(self._place)
        self._spots = [mi.Float(aligned(np.asarray(c, dtype=np.float32))) for c in lights.T]
        weight: Any = None
        total = np.zeros((len(lights), count, 3), dtype=np.float32)
        for order in range(bounces):
            if order:
                si, weight = self._bounced(si, weight, number, order, 0, count)
            even, odd = self._lit(si, weight, np.arange(len(lights)), count)
            total += (even + odd) * np.float32(1.0 / self.spp)
        return total

    def _offsets(self, view: View) -> np.ndarray:
        """Return where the samples of pixels look beside their points, (spp · n, 2) in mm."""
        sample = np.arange(self.spp)
        s = (sample + 0.5) / self.spp - 0.5
        t = np.mod(0.5 + sample * _GOLDEN, 1.0) - 0.5
        right, down = view.steps
        moved = s[:, None, None] * right + t[:, None, None] * down
        return np.asarray(moved.reshape(-1, 2))

    def _rays(self, view: View) -> tuple[np.ndarray, np.ndarray]:
        """Return the camera's rays from just above the material on, in the tile's frame."""
        points = np.zeros((self.spp * len(view.points), 3))
        points[:, :2] = np.tile(view.points[:, :2], (self.spp, 1)) + self._offsets(view)
        towards = view.origin - points
        towards /= np.linalg.norm(towards, axis=1, keepdims=True)
        top = max(self.tile.height_mm[1], 0.0) + 0.01 * max(self.tile.size_mm)
        points += towards * (top / towards[:, 2:])
        points[:, :2] = np.mod(points[:, :2] + 0.5 * np.array(self.tile.size_mm), self.tile.size_mm)
        return points.astype(np.float32), -towards.astype(np.float32)

    @dr.syntax
    def _shade(self, si: Any, weight: Any, light: Any, texel: Any, texels: Any) -> tuple[Any, Any]:
        """Return the sums of one light's f_r cos over the even and the odd samples of pixels."""
        spot = mi.Point3f(*[dr.gather(mi.Float, c, light) for c in self._spots])
        even, odd = mi.Color3f(0.0), mi.Color3f(0.0)
        sample, count = mi.UInt32(0), dr.opaque(mi.UInt32, self.spp)
        while sample < count:
            index = texel + sample * texels
            at = dr.gather(mi.SurfaceInteraction3f, si, index)
            towards = dr.normalize(spot - dr.gather(mi.Point3f, self._place, index))
            doubtful = at.is_valid()
            lit = doubtful & ~self._shadowed(at, towards, doubtful)
            value = at.bsdf().eval(mi.BSDFContext(), at, at.to_local(towards), lit)
            if dr.hint(weight is not None, mode="scalar"):
                value *= dr.gather(mi.Color3f, weight, index)
            value = dr.select(lit, value, 0.0)
            is_even = (sample & 1) == 0
            even += dr.select(is_even, value, 0.0)
            odd += dr.select(is_even, 0.0, value)
            sample += 1
        return even, odd

"""What a camera sees of a periodic tile under many lights, registered on the plane z = 0.

The camera's rays are traced once per view. Each hit, and each further vertex of a path that
starts there, becomes a record; every light then asks every record: one shadow ray (or a look at
the grid of shadows) and one evaluation of the BSDF. Lanes are (light, texel) and loop over the
samples, so sums have a fixed order and the same bits come out however the work is divided.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit
import mitsuba
import numpy as np

from simrig.core.arrays import aligned
from simrig.core.errors import SimrigError
from simrig.mesostructure.tile import Tile
from simrig.rigs.btf.shadows import clearance, leaving, shadow_grid, shadowed_lights
from simrig.scenes.tile import periods_for, tile_shapes

# the overloads of their stubs would keep mypy busy for minutes, in the loops below
dr: Any = drjit
mi: Any = mitsuba

MOST_SAMPLES = 4096  # per texel
_RECORDS = 1 << 19  # of one block of rows
_LANES = 1 << 22  # of one launch: lights times texels
_GOLDEN = 0.6180339887498949
_MOST_STEPS = 64  # of a ray from period to period; what is left then is within 0.3° of level


@dataclass(frozen=True, eq=False)
class ViewImages:
    """Images of one view.

    Attributes:
        values: f_r in 1/sr, (orders, lights, H, W, 3) float32: what each order adds.
        standard_error: of the sum of all orders, root mean square over texels and channels,
            (lights,), from the two halves of the samples; NaN with one sample.
    """

    values: np.ndarray
    standard_error: np.ndarray


class TileCamera:
    """A tile in its scene, seen by an orthographic camera under directional lights.

    Args:
        lights: (n, 3) unit vectors towards all lights that will be asked for.
        theta_max_deg: largest polar angle of any view or light.
        resolution: (height, width) in texels.
        seed: of the positions of the samples and of the paths.
        views: how many views will be asked for; with many a grid of shadows pays.
        grid: use a grid of shadows where it pays; otherwise trace every shadow ray.

    Raises:
        SimrigError: no variant that renders RGB arrays is set, or numbers out of range.
    """

    def __init__(
        self,
        tile: Tile,
        lights: np.ndarray,
        theta_max_deg: float,
        resolution: tuple[int, int],
        spp: int,
        seed: int = 0,
        views: int = 1,
        grid: bool = True,
    ):
        if not mi.is_rgb or not dr.is_jit_v(mi.Float):
            raise SimrigError(
                f"a BTF is measured in RGB on arrays, not in the variant '{mi.variant()}': choose "
                "llvm_ad_rgb or cuda_ad_rgb"
            )
        if not 1 <= spp <= MOST_SAMPLES or spp != int(spp):
            raise SimrigError(f"samples per texel must be 1 to {MOST_SAMPLES}, got {spp}")
        self.tile, self.resolution, self.spp, self.seed = tile, resolution, int(spp), int(seed)
        around = periods_for(tile, tile.size_mm, theta_max_deg)
        self.periods = (max(around[0], 2), max(around[1], 2))
        self.scene = mi.load_dict({"type": "scene", **tile_shapes(tile, self.periods)})
        self.shadowed = shadowed_lights(tile, lights)
        self._off = clearance(tile)
        rays = float(len(lights)) * views * resolution[0] * resolution[1] * spp
        self.grid = shadow_grid(tile, self.scene, lights, self.shadowed, rays) if grid else None
        self._lights = [mi.Float(aligned(np.asarray(c, dtype=np.float32))) for c in lights.T]
        self._casts = mi.Bool(self.shadowed)
        self._reach = min(
            (p - 1) * side for p, side in zip(self.periods, tile.size_mm, strict=True)
        )

    def view(
        self, omega_v: np.ndarray, lights: np.ndarray, bounces: int = 1, number: int = 0
    ) -> ViewImages:
        """Return the images of one view.

        Args:
            omega_v: (3,) unit vector towards the camera.
            lights: numbers of the lights, among those the camera was made with.
            bounces: reflections on the way, 1 for direct light.
            number: of the view; views of different numbers have other samples.
        """
        height, width = self.resolution
        rows = max(1, min(height, _RECORDS // (width * self.spp)))
        blocks = [
            self._rows(omega_v, lights, bounces, number, first, min(rows, height - first))
            for first in range(0, height, rows)
        ]
        values = np.concatenate([values for values, _ in blocks], axis=2)
        apart = np.concatenate([apart for _, apart in blocks], axis=1)
        if self.spp == 1:
            return ViewImages(values, np.full(len(lights), np.nan))
        error = 0.5 * np.sqrt(np.mean(apart.astype(np.float64) ** 2, axis=(1, 2, 3)))
        return ViewImages(values, error)

    def _rows(
        self, omega_v: np.ndarray, lights: np.ndarray, bounces: int, number: int, first: int, n: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return values (orders, lights, n, W, 3) and the difference of the halves of rows."""
        width = self.resolution[1]
        texels = n * width
        si = self._seen(omega_v, number, first * width, texels)
        weight: Any = None
        values: list[np.ndarray] = []
        apart: np.ndarray = np.zeros((len(lights), n, width, 3), dtype=np.float32)
        for order in range(bounces):
            if order:
                si, weight = self._bounced(si, weight, number, order, first * width, texels)
            halves = self._lit(si, weight, lights, texels)
            even, odd = (h.reshape(len(lights), n, width, 3) for h in halves)
            values.append((even + odd) * np.float32(1.0 / self.spp))
            evens = (self.spp + 1) // 2
            apart = apart + even / np.float32(evens) - odd / np.float32(max(self.spp - evens, 1))
        return np.stack(values), apart

    def _seen(self, omega_v: np.ndarray, number: int, first: int, texels: int) -> Any:
        """Return the hits of the camera's rays, sample by sample, texels fastest.

        The samples of a texel are a lattice (golden ratio) that is shifted at random.
        """
        height, width = self.resolution
        index = dr.arange(mi.UInt32, texels * self.spp)
        texel = index % texels + dr.opaque(mi.UInt32, first)
        sample = mi.Float(index // texels)
        shift = self._uniforms(texel, number, 0)
        u = _fraction(shift[0] + sample * (1.0 / self.spp))
        v = _fraction(shift[1] + sample * _GOLDEN)
        x = (mi.Float(texel % width) + u) * (self.tile.size_mm[0] / width)
        y = self.tile.size_mm[1] - (mi.Float(texel // width) + v) * (self.tile.size_mm[1] / height)
        towards = mi.Vector3f(*[dr.opaque(mi.Float, float(c)) for c in omega_v])
        top = max(self.tile.height_mm[1], 0.0) + 0.01 * max(self.tile.size_mm)
        origin = mi.Point3f(x, y, 0.0) + towards * (top / towards.z)
        return self._hit(origin, -towards, mi.Bool(True))

    def _hit(self, origin: Any, direction: Any, active: Any) -> Any:
        """Return what rays meet in the endless material, moved into the middle tile."""
        level = dr.sqrt(dr.square(direction.x) + dr.square(direction.y))
        step = self._reach / dr.maximum(level, 1e-6)
        low, high = self.tile.height_mm
        found = dr.zeros(mi.SurfaceInteraction3f, dr.width(origin))
        found.t = dr.inf
        active = mi.Bool(active)
        for _ in range(_MOST_STEPS):
            origin = self._in_tile(origin)
            ray = mi.Ray3f(origin, direction, step, 0.0, [])
            si = self.scene.ray_intersect(ray, active)
            met = active & si.is_valid()
            found = dr.select(met, si, found)
            origin = origin + direction * step
            inside = ((direction.z <= 0.0) | (origin.z < high)) & (
                origin.z > 2.0 * low - high - 1.0
            )
            active &= ~met & inside
            dr.eval(found, origin, active)
            if dr.none(active):
                break
        found.p = self._in_tile(found.p)
        dr.eval(found)
        return found

    def _in_tile(self, p: Any) -> Any:
        width, height = self.tile.size_mm
        return mi.Point3f(
            p.x - width * dr.floor(p.x / width), p.y - height * dr.floor(p.y / height), p.z
        )

    def _bounced(
        self, si: Any, weight: Any, number: int, order: int, first: int, texels: int
    ) -> tuple[Any, Any]:
        """Return the next vertices of the paths and what light from there is worth."""
        lane = dr.arange(mi.UInt32, texels * self.spp)
        height, width = self.resolution
        # the number of a path does not depend on the block that it is in
        index = lane // texels * (height * width) + lane % texels + dr.opaque(mi.UInt32, first)
        one, two = (self._uniforms(index, number, 2 * order + k) for k in (0, 1))
        active = si.is_valid()
        drawn, value = si.bsdf().sample(mi.BSDFContext(), si, one[0], mi.Point2f(*two), active)
        ray = leaving(si, si.to_world(drawn.wo), self._off)
        active &= dr.any(value > 0.0)
        weight = value if weight is None else weight * value
        following = self._hit(ray.o, ray.d, active)
        weight = dr.select(following.is_valid(), weight, 0.0)
        dr.eval(weight)
        return following, weight

    def _uniforms(self, index: Any, number: int, stream: int) -> tuple[Any, Any]:
        """Return two random numbers in [0, 1) per index."""
        key = dr.opaque(mi.UInt32, _key(self.seed, number, stream))
        words = mi.sample_tea_32(index, key, 8)
        return tuple(mi.Float(word >> 8) * 2.0**-24 for word in words)

    def _lit(self, si: Any, weight: Any, lights: np.ndarray, texels: int) -> list[np.ndarray]:
        """Return sums of f_r over even and odd samples, each (lights, texels, 3)."""
        numbers = mi.UInt32(aligned(np.asarray(lights, dtype=np.uint32)))
        together = max(1, _LANES // texels)
        parts = []
        for first in range(0, len(lights), together):
            count = min(together, len(lights) - first)
            lane = dr.arange(mi.UInt32, count * texels)
            size = dr.opaque(mi.UInt32, texels)
            light = dr.gather(mi.UInt32, numbers, lane // size + dr.opaque(mi.UInt32, first))
            sums = self._shade(si, weight, light, lane % size, size)
            dr.eval(sums)
            parts.append([np.array(s).T.reshape(count, texels, 3) for s in sums])
        return [np.concatenate(halves) for halves in zip(*parts, strict=True)]

    @dr.syntax
    def _shade(self, si: Any, weight: Any, light: Any, texel: Any, texels: Any) -> tuple[Any, Any]:
        """Return the sums of one light's f_r over the even and the odd samples of texels."""
        towards = mi.Vector3f(*[dr.gather(mi.Float, c, light) for c in self._lights])
        casts = dr.gather(mi.Bool, self._casts, light)
        even, odd = mi.Color3f(0.0), mi.Color3f(0.0)
        sample, count = mi.UInt32(0), dr.opaque(mi.UInt32, self.spp)
        while sample < count:
            index = texel + sample * texels
            at = dr.gather(mi.SurfaceInteraction3f, si, index)
            lit = at.is_valid() & self._reached(at, towards, light, casts)
            value = at.bsdf().eval(mi.BSDFContext(), at, at.to_local(towards), lit)
            if dr.hint(weight is not None, mode="scalar"):
                value *= dr.gather(mi.Color3f, weight, index)
            value = dr.select(lit, value, 0.0)
            is_even = (sample & 1) == 0
            even += dr.select(is_even, value, 0.0)
            odd += dr.select(is_even, 0.0, value)
            sample += 1
        return even / towards.z, odd / towards.z

    def _reached(self, at: Any, towards: Any, light: Any, casts: Any) -> Any:
        """Return whether lights reach points."""
        if self.grid is None:
            doubtful = at.is_valid() & casts
            return ~doubtful | ~self._shadowed(at, towards, doubtful)
        lit, doubtful = self.grid.at(self.tile, at.p, light)
        doubtful &= at.is_valid() & casts
        return lit | (doubtful & ~self._shadowed(at, towards, doubtful))

    def _shadowed(self, at: Any, towards: Any, active: Any) -> Any:
        return self.scene.ray_test(leaving(at, towards, self._off), active)


def _fraction(value: Any) -> Any:
    return value - dr.floor(value)


def _key(seed: int, number: int, stream: int) -> int:
    """Return 32 bits that differ between seeds, views and uses."""
    words = np.random.SeedSequence([seed, number, stream]).generate_state(1, dtype=np.uint32)
    return int(words[0])

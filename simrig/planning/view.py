"""What a sensor sees: the pixels that are looked at, each through the footprint of its filter."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from simrig.planning import rays
from simrig.planning.integrators import hides_emitters
from simrig.rendering.multijitter import multijitter
from simrig.rendering.sampled_pass import takes_colours

PIXELS = 1024  # looked at, at most
SEED = 20_240_607  # plans are reproducible
GROUPS = 4  # into which the samples of a pixel fall
_CANDIDATES, _TRIES = 16 * PIXELS, 16  # pixels of which those are chosen, and rays through each
_REACHED = 0.02  # of what a filter takes from its own pixel
_STEPS = 256  # of the half of a reconstruction filter


@dataclass(frozen=True, eq=False)
class View:
    """A sensor of a loaded scene.

    Attributes:
        scene: the loaded scene.
        index: of the sensor in ``scene.sensors()``.
    """

    scene: Any
    index: int = 0

    @cached_property
    def sensor(self) -> Any:
        """The sensor."""
        return self.scene.sensors()[self.index]

    @cached_property
    def size(self) -> tuple[int, int]:
        """Width and height of the picture."""
        width, height = (int(n) for n in self.sensor.film().crop_size())
        return width, height

    @property
    def pixels(self) -> int:
        """How many pixels the picture has."""
        return self.size[0] * self.size[1]

    @property
    def stratified(self) -> bool:
        """Whether a planned picture of it is drawn by ``SAMPLER``; one of spectral bands is not."""
        return takes_colours(self.sensor.film())

    @cached_property
    def chosen(self) -> np.ndarray:
        """The pixels that are looked at, (n, 2) columns and rows; all of them when there are few.

        Changes are means over pixels that are not black, so those that see something come first.
        """
        candidates, hit = self._candidates
        seeing, others = candidates[hit], candidates[~hit]
        return np.concatenate([_some(seeing, PIXELS), _some(others, max(PIXELS - len(seeing), 0))])

    def parts(self, along: int) -> np.ndarray:
        """Return the part of the picture, of some along either side, in which each of them lies."""
        column, row = (self.chosen * along // np.array(self.size)).T
        return np.asarray(np.unique(row * along + column, return_inverse=True)[1].ravel())

    @cached_property
    def filled(self) -> float:
        """The share of the picture's pixels that see something, about."""
        return float(self._candidates[1].mean())

    @cached_property
    def _candidates(self) -> tuple[np.ndarray, np.ndarray]:
        """Pixels of which some are chosen, and which of them see something."""
        if self.pixels <= PIXELS or self._sees_surroundings:
            pixels = self._spread_out(min(PIXELS, self.pixels))
            return pixels, np.ones(len(pixels), dtype=bool)
        pixels = self._spread_out(min(_CANDIDATES, self.pixels))
        return pixels, self._hit(pixels)

    @property
    def _sees_surroundings(self) -> bool:
        return self.scene.environment() is not None and not hides_emitters(self.scene)

    def _spread_out(self, count: int) -> np.ndarray:
        """Return pixels, one at random in each of ``count`` equal runs of them."""
        rng = np.random.default_rng(SEED)
        index = ((np.arange(count) + rng.random(count)) * self.pixels / count).astype(np.int64)
        index = np.minimum(index, self.pixels - 1)
        return np.stack([index % self.size[0], index // self.size[0]], axis=-1)

    def _hit(self, pixels: np.ndarray) -> np.ndarray:
        """Return which pixels see a surface along one of a few rays.

        Four go through the corners of a footprint, which random ones seldom come near: there a
        silhouette enters.
        """
        count = len(pixels) * _TRIES
        drawn = multijitter(_TRIES, SEED + 7, count)
        index = dr.arange(mi.UInt32, count) // dr.opaque(mi.UInt32, _TRIES)
        corner = [dr.gather(mi.Float, rays.on_device(axis), index) for axis in pixels.T]
        number = dr.arange(mi.UInt32, count) % dr.opaque(mi.UInt32, _TRIES)
        corners = mi.Point2f(mi.Float(number & 1), mi.Float((number >> 1) & 1))
        inside = dr.select(number < 4, corners, drawn.next_2d())
        found, _ = self._through(corner, drawn, count, inside)
        met = np.array(self.scene.ray_test(found) & dr.full(mi.Bool, True, count))
        return np.asarray(met.reshape(len(pixels), _TRIES).any(axis=1))

    @cached_property
    def _filter(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Distances from a pixel's centre and the filter there; None of a box of one pixel."""
        chosen = self.sensor.film().rfilter()
        radius = float(chosen.radius())
        if chosen.class_name() == "BoxFilter" and radius <= 0.5 + 1e-3:
            return None
        distance = (np.arange(_STEPS) + 0.5) * radius / _STEPS
        value = np.array(chosen.eval(rays.on_device(distance)), dtype=np.float64).ravel()
        return distance, np.broadcast_to(value, distance.shape)

    @cached_property
    def averaging(self) -> float:
        """How many samples per pixel a pixel averages, over those that are drawn in it.

        A filter wider than a pixel uses each sample in several pixels: the variance of a mean of
        independent samples falls by ∫f² / (∫f)² in each of two axes.
        """
        if self._filter is None:
            return 1.0
        distance, value = self._filter
        step = distance[1] - distance[0]
        along = 2.0 * (value**2).sum() * step / max(2.0 * value.sum() * step, 1e-12) ** 2
        return float(max(1.0 / along**2, 1.0))

    @cached_property
    def neighbours(self) -> np.ndarray:
        """Which pixels around one its filter reaches with more than a little, (k, 2) offsets."""
        if self._filter is None:
            return np.zeros((1, 2), dtype=np.int64)
        distance, value = self._filter
        sums = np.bincount(np.floor(distance + 0.5).astype(np.int64), value)
        sums[0] *= 2.0
        reach = np.flatnonzero(sums > _REACHED * sums[0]).max()
        along = np.arange(-reach, reach + 1)
        return np.stack(np.meshgrid(along, along), axis=-1).reshape(-1, 2)

    @cached_property
    def evenness(self) -> float:
        """How much of the squared weight of samples is that of their pixels' mean weights.

        The samples of each pixel are stratified; what their weights vary by within it is not.
        """
        if self._filter is None:
            return 1.0
        distance, value = self._filter
        pixel = np.floor(distance + 0.5).astype(np.int64)  # that of the centre is half of one
        sums, squares = (np.bincount(pixel, value**power) for power in (1, 2))
        steps = np.where(np.arange(len(sums)) == 0, 0.5, 1.0) / (distance[1] - distance[0])
        along = float((sums**2 / steps).sum() / max(squares.sum(), 1e-12))
        return min(along, 1.0) ** 2

    @cached_property
    def _spread(self) -> tuple[Any, Any, float] | None:
        """The filter's distribution over distances and its inverse as tables, and the longest."""
        if self._filter is None:
            return None
        distance, value = self._filter
        edges = np.concatenate([[0.0], distance + 0.5 * (distance[1] - distance[0])])
        share = np.cumsum(np.concatenate([[0.0], np.maximum(value, 0.0)]))
        share /= share[-1]
        table = np.interp(np.linspace(0.0, 1.0, _STEPS), share, edges)
        within = np.interp(np.linspace(0.0, edges[-1], _STEPS), edges, share)
        return rays.on_device(table), rays.on_device(within), float(edges[-1])

    def _offset(self, uniform: Any, corner: Any, size: int) -> Any:
        """Return distances from a pixel's corner for numbers in [0, 1), by the filter.

        Films draw nothing beyond their border unless they say so: footprints end there.
        """
        if self._spread is None:
            return uniform
        table, within, longest = self._spread
        least, most = mi.Float(-1.0), mi.Float(1.0)
        if not self.sensor.film().sample_border():
            least = -_tabulated(within, (corner + 0.5) / longest)
            most = _tabulated(within, (size - corner - 0.5) / longest)
        signed = dr.lerp(least, most, uniform)
        return 0.5 + dr.copysign(_tabulated(table, dr.abs(signed)), signed)

    def rays(self, samples: int, groups: int = GROUPS, seed: int = SEED) -> tuple[Any, Any, Any]:
        """Return camera rays through each looked-at pixel, spread as its filter weighs them.

        The samples of a pixel fall into groups, one after the other, each of which is stratified
        as a picture of that many samples per pixel would be.

        Args:
            samples: of each pixel, a multiple of the groups.
            groups: independent of each other.
            seed: of the random numbers.

        Returns:
            The sampler, for what is drawn along the rays; the rays; and what they weigh.
        """
        each = samples // groups
        if each * groups != samples:
            raise ValueError(f"{samples} samples do not fall into {groups} equal groups")
        count = len(self.chosen) * samples
        drawn = multijitter(each, seed, count)
        pixel = dr.arange(mi.UInt32, count) // dr.opaque(mi.UInt32, samples)
        corner = [dr.gather(mi.Float, rays.on_device(axis), pixel) for axis in self.chosen.T]
        return (drawn, *self._through(corner, drawn, count))

    def blocks(self, along: int) -> np.ndarray:
        """Return the picture in blocks, (m, 4): column, row, width and height of each.

        Args:
            along: how many there are along the longer side, at most.
        """
        side = max(-(-max(self.size) // along), 1)
        width, height = self.size
        columns, rows = range(0, width, side), range(0, height, side)
        return np.array(
            [(x, y, min(side, width - x), min(side, height - y)) for y in rows for x in columns]
        )

    def radiance_of_blocks(
        self, blocks: np.ndarray, integrator: Any, samples: int, seed: int
    ) -> np.ndarray:
        """Return what an integrator finds in random pixels of blocks, (m · samples, 3)."""
        count = len(blocks) * samples
        drawn = multijitter(samples, seed, count)
        block = dr.arange(mi.UInt32, count) // dr.opaque(mi.UInt32, samples)
        low_x, low_y, width, height = (
            dr.gather(mi.Float, rays.on_device(axis), block) for axis in blocks.T
        )
        where = drawn.next_2d()
        corner = [dr.floor(low_x + where.x * width), dr.floor(low_y + where.y * height)]
        found, weight = self._through(corner, drawn, count)
        value, _, _ = integrator.sample(self.scene, drawn, found)
        return np.broadcast_to(rays.rows(rays.to_rgb(value * weight, found)), (count, 3))

    def as_filmed(self, pixels: np.ndarray, integrator: Any, samples: int, seed: int) -> np.ndarray:
        """Return pixels (m, 3) as the film makes them of samples in each pixel around."""
        near = (pixels[:, None] + self.neighbours).reshape(-1, 2)
        count = len(near) * samples
        drawn = multijitter(samples, seed, count)
        index = dr.arange(mi.UInt32, count) // dr.opaque(mi.UInt32, samples)
        centre = np.repeat(pixels, len(self.neighbours), axis=0) + 0.5
        corner, middle = (
            mi.Point2f(*(dr.gather(mi.Float, rays.on_device(axis), index) for axis in both.T))
            for both in (near, centre)
        )
        place = corner + drawn.next_2d()
        found, weight = self._at(place, drawn, count)
        value, _, _ = integrator.sample(self.scene, drawn, found)
        colour = rays.to_rgb(value * weight, found)
        share = dr.full(mi.Float, 1.0, count)
        if self._filter is not None:
            chosen, off = self.sensor.film().rfilter(), place - middle
            share = chosen.eval(off.x) * chosen.eval(off.y)
        sums = [dr.block_sum(one * share, samples) for one in (*colour, mi.Float(1.0))]
        parts = np.array(sums, dtype=np.float64) * ((near >= 0) & (near < self.size)).all(axis=1)
        whole = parts.reshape(4, len(pixels), -1).sum(axis=2)
        return np.asarray((whole[:3] / whole[3]).T)

    def _through(
        self, corner: list[Any], drawn: Any, count: int, inside: Any = None
    ) -> tuple[Any, Any]:
        """Return rays through pixels, spread as the filter weighs them, and their weights.

        Args:
            corner: columns and rows.
            drawn: the sampler.
            count: of rays.
            inside: numbers in [0, 1] that tell where in a footprint; drawn by default.
        """
        inside = drawn.next_2d() if inside is None else inside
        axes = zip(corner, (inside.x, inside.y), self.size, strict=True)
        place = mi.Point2f(*(first + self._offset(u, first, size) for first, u, size in axes))
        return self._at(place, drawn, count)

    def _at(self, place: Any, drawn: Any, count: int) -> tuple[Any, Any]:
        """Return ``count`` rays through places of the film, in pixels, and their weights."""
        place = dr.clip(place / mi.Point2f(*self.size), 0.0, 1.0 - 1e-6)
        aperture = drawn.next_2d() if self.sensor.needs_aperture_sample() else mi.Point2f(0.5)
        time = self.sensor.shutter_open()
        if self.sensor.shutter_open_time() > 0.0:
            time = time + drawn.next_1d() * self.sensor.shutter_open_time()
        wavelength = drawn.next_1d() if mi.is_spectral else mi.Float(0.0)
        found, weight = self.sensor.sample_ray_differential(time, wavelength, place, aperture)
        weight = mi.Spectrum(weight) + dr.zeros(mi.Spectrum, count)
        return rays.wide(found, count), weight


def _tabulated(table: Any, place: Any) -> Any:
    """Return what lies in a table, over [0, 1], at places; its ends beyond them."""
    last = _STEPS - 1.0
    at = dr.clip(place * last, 0.0, last - 1e-3)
    index = mi.UInt32(at)
    low, high = dr.gather(mi.Float, table, index), dr.gather(mi.Float, table, index + 1)
    return low + (high - low) * (at - index)


def _some(pixels: np.ndarray, most: int) -> np.ndarray:
    """Return as many pixels as may be, evenly spread over them."""
    if len(pixels) <= most:
        return pixels
    return pixels[(np.arange(most) * len(pixels) / max(most, 1)).astype(np.int64)]

"""BTFs of a material that changes with time: measured at a few times, interpolated between them.

``linear`` blends the two times around. ``displacement`` moves their values across the tile, along
rows and along columns, by optimal transport on the circle that the periodic tile is, and takes the
mean of both (Bonneel et al. 2011). ``staf`` gives every texel the same course in time, a logistic
function, but a moment of its own at which it changes (space-time factorisation, Gu et al. 2006);
what that leaves at the measured times is interpolated linearly, so all methods give back what was
measured.

Source: thesis appendix E.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy import ndimage

from simrig.btf.stack import BtfStack
from simrig.core.errors import SimrigError, check_known
from simrig.core.transport.circle import circle_displacement

_OFFSETS, _WIDTHS = 61, (0.02, 0.05, 0.1, 0.2, 0.4)  # of the course, widths in spans of time
_STILL, _AT_ONCE = 0.15, 0.7  # of the largest change: hardly any; of its own: between two times
_GRAIN = 2.0  # texels over which the surface's own texture is evened out
_TOUCHES = 3.0  # texels from what lies beside
_BLOCK = 1 << 22  # values of one block of images
_LINES = 1 << 14  # lines that are transported at once


@dataclass(frozen=True, eq=False)
class VaryingBtf:
    """A BTF at some times.

    Attributes:
        times: (k,) ascending, any unit.
        stacks: the BTF at each of them: the same pairs, texels and size.
        name: what reports call it.

    Raises:
        SimrigError: fewer than two times, times that do not ascend, or BTFs that differ.
    """

    times: tuple[float, ...]
    stacks: Sequence[BtfStack]
    name: str = "varying"
    _courses: list[_Course] = field(default_factory=list, repr=False)

    def __post_init__(self) -> None:
        times = np.asarray(self.times, dtype=np.float64)
        if len(times) != len(self.stacks) or len(times) < 2:
            raise SimrigError(
                f"a BTF that changes needs two times or more, one for each BTF, got {len(times)} "
                f"for {len(self.stacks)}"
            )
        if not np.all(np.isfinite(times)) or not np.all(np.diff(times) > 0.0):
            raise SimrigError(f"the times of '{self.name}' must ascend, got {list(self.times)}")
        first = self.stacks[0]
        for one in self.stacks[1:]:
            same = one.resolution == first.resolution and len(one) == len(first)
            same = same and bool(np.allclose(one.size_mm, first.size_mm, rtol=1e-6))
            if not same or not np.allclose(one.angles, first.angles, atol=1e-6):
                raise SimrigError(
                    f"'{one.name}' and '{first.name}' differ in pairs, texels or size: a BTF that "
                    "changes is measured at the same ones"
                )

    def at(self, time: float, method: str = "linear") -> BtfStack:
        """Return the BTF at a time.

        Args:
            time: within the measured ones.
            method: of ``METHODS``.

        Raises:
            SimrigError: an unknown method, or a time outside: nothing is extrapolated.
        """
        check_known("interpolation in time", method, METHODS)
        low, high = self.times[0], self.times[-1]
        if not low <= time <= high:
            raise SimrigError(
                f"'{self.name}' was measured from {low:g} to {high:g}, asked for is {time:g}"
            )
        after = int(np.clip(np.searchsorted(self.times, time), 1, len(self.times) - 1))
        before = after - 1
        share = (time - self.times[before]) / (self.times[after] - self.times[before])
        if share in (0.0, 1.0):
            return self.stacks[before if share == 0.0 else after]
        first, height, width = self.stacks[0], *self.stacks[0].resolution
        kinds = [stack.values.dtype for stack in self.stacks]
        made = np.empty((len(first), height, width, 3), dtype=np.result_type(*kinds))
        step = max(1, _BLOCK // (3 * height * width))
        for start in range(0, len(first), step):
            part = slice(start, start + step)
            made[part] = np.maximum(METHODS[method](self, part, before, share), 0.0)
        about = {"time": time, "interpolation": method, "times": list(self.times)}
        return BtfStack(made, first.angles, first.size_mm, f"{self.name} at {time:g}", about)

    def images(self, part: slice, number: int) -> np.ndarray:
        """Return some images at a measured time, float32."""
        return np.asarray(self.stacks[number].values[part], dtype=np.float32)

    def course(self) -> _Course:
        """Return how texels change (``staf``), found once."""
        if not self._courses:
            self._courses.append(_Course.of(self))
        return self._courses[0]


@dataclass(frozen=True, eq=False)
class _Course:
    """How far every texel has changed.

    Attributes:
        moment: (height, width) at which it is half way.
        width: (height, width) of the change: that of all texels, or of those that switch.
        known: (k, height, width) how far it is at the measured times.
    """

    moment: np.ndarray
    width: np.ndarray
    known: np.ndarray

    @classmethod
    def of(cls, btf: VaryingBtf) -> _Course:
        """Fit the moments of texels to their means over all pairs, and the width to all of them."""
        height, width = btf.stacks[0].resolution
        total = np.zeros((len(btf.times), height, width))
        for k in range(len(btf.times)):
            step = max(1, _BLOCK // (3 * height * width))
            for start in range(0, len(btf.stacks[0]), step):
                images = btf.images(slice(start, start + step), k)
                total[k] += images.sum(axis=(0, 3), dtype=np.float64)
        times = np.array(btf.times)
        curves = total.reshape(len(times), -1)
        curves = curves - curves.mean(axis=0)
        span = times[-1] - times[0]
        moments = np.linspace(times[0] - 0.1 * span, times[-1] + 0.1 * span, _OFFSETS)
        best: tuple[float, np.ndarray, float] | None = None
        for share in _WIDTHS:
            shapes = _logistic(times[:, None], moments, share * span)
            shapes = shapes - shapes.mean(axis=0)
            power = np.sum(shapes**2, axis=0)
            # of curves that hardly move nothing is told: the gain of a shape is its projection
            gain = np.where(power > 1e-6, (shapes.T @ curves).T ** 2 / np.maximum(power, 1e-6), 0.0)
            found = gain.argmax(axis=1)
            left = float(np.sum(curves**2) - np.sum(gain.max(axis=1)))
            if best is None or left < best[0] * (1.0 - 1e-9):
                best = left, moments[found].reshape(height, width), share * span
        assert best is not None
        moment, switches = _continued(best[1], curves, times)
        wide = np.where(switches, _WIDTHS[0] * span, best[2])
        return cls(moment, wide, _logistic(times[:, None, None], moment, wide))


def _continued(
    moment: np.ndarray, curves: np.ndarray, times: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the moments of texels, those that switch by where they lie, and which switch.

    Such a texel says only between which times it changed. A front passes it the later, the farther
    it is from what changed before, and the nearer to what changes after: distances on the tile
    share out the time between. Texels that never change bound the first or the last to change,
    whichever they touch.
    """
    steps = np.abs(np.diff(curves, axis=0)).reshape(len(times) - 1, *moment.shape)
    own = steps.max(axis=0) > _AT_ONCE * steps.sum(axis=0)
    # a crease or a glint goes with what is around it
    steps = ndimage.gaussian_filter(steps, (0, _GRAIN, _GRAIN), mode="wrap")
    total = steps.sum(axis=0)
    moves = total > _STILL * total.max()
    switches = moves & (own | (steps.max(axis=0) > _AT_ONCE * total))
    interval = np.where(moves, steps.argmax(axis=0), -1)
    made = moment.copy()
    for k in range(len(times) - 1):
        own = switches & (interval == k)
        if not own.any():
            continue
        before, after = (interval >= 0) & (interval < k), interval > k
        touches = float(_distance(~moves)[own].min()) < _TOUCHES
        if touches and not before.any():
            before = ~moves
        elif touches and not after.any():
            after = ~moves
        passed, ahead = _distance(before)[own], _distance(after)[own]
        if not after.any():
            ahead = passed.max() - passed if before.any() else np.ones_like(passed)
        if not before.any():
            passed = ahead.max() - ahead if after.any() else np.ones_like(ahead)
        share = passed / np.maximum(passed + ahead, 1e-9)
        made[own] = times[k] + share * (times[k + 1] - times[k])
    return made, switches


def _distance(mask: np.ndarray) -> np.ndarray:
    """Return the distance to the nearest texel of a mask, on the periodic tile, in texels."""
    if not mask.any():
        return np.full(mask.shape, np.inf)
    height, width = mask.shape
    around = ndimage.distance_transform_edt(~np.tile(mask, (3, 3)))
    return np.asarray(around[height : 2 * height, width : 2 * width])


def _logistic(
    time: np.ndarray | float, moment: np.ndarray, width: np.ndarray | float
) -> np.ndarray:
    return np.asarray(1.0 / (1.0 + np.exp(-np.clip((time - moment) / width, -40.0, 40.0))))


def _linear(btf: VaryingBtf, part: slice, before: int, share: float) -> np.ndarray:
    return (1.0 - share) * btf.images(part, before) + share * btf.images(part, before + 1)


def _staf(btf: VaryingBtf, part: slice, before: int, share: float) -> np.ndarray:
    course = btf.course()
    time = (1.0 - share) * btf.times[before] + share * btf.times[before + 1]
    values = np.stack([btf.images(part, k) for k in range(len(btf.times))])
    shape = (course.known - course.known.mean(axis=0))[:, None, :, :, None]
    power = np.maximum(np.sum(shape**2, axis=0), 1e-6)
    mean = values.mean(axis=0)
    gain = np.sum(shape * (values - mean), axis=0) / power

    def fitted(how_far: np.ndarray) -> np.ndarray:
        return mean + gain * (how_far - course.known.mean(axis=0))[None, :, :, None]

    left = [values[k] - fitted(course.known[k]) for k in (before, before + 1)]
    made = fitted(_logistic(time, course.moment, course.width))
    made = made + (1.0 - share) * left[0] + share * left[1]
    # no further than what was measured at any time
    return np.clip(made, values.min(axis=0), values.max(axis=0))


def _displacement(btf: VaryingBtf, part: slice, before: int, share: float) -> np.ndarray:
    ends = [btf.images(part, before + k).astype(np.float64) for k in (0, 1)]
    made = np.zeros(ends[0].shape)
    for axis in (1, 2):
        lines = [np.moveaxis(end, axis, -1) for end in ends]
        shape = lines[0].shape
        flat = [np.ascontiguousarray(line).reshape(-1, shape[-1]) for line in lines]
        moved = np.empty(flat[0].shape)
        for start in range(0, len(moved), _LINES):
            own = slice(start, start + _LINES)
            weights = np.full((len(flat[0][own]), 1), share)
            moved[own] = circle_displacement(flat[0][own], flat[1][own], weights)[:, 0]
        made += 0.5 * np.moveaxis(moved.reshape(shape), -1, axis)
    return made


Interpolation = Callable[[VaryingBtf, slice, int, float], np.ndarray]
METHODS: dict[str, Interpolation] = {
    "linear": _linear,
    "staf": _staf,
    "displacement": _displacement,
}

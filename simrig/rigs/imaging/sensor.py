"""A camera's sensor in the terms of EMVA 1288 (release 4.0): from electrons to digital numbers.

Chance belongs to the picture, the frame and the pixel alone: a counter is hashed (SplitMix64), so
frames come out with the same bits in whatever order, portions or processes they are taken.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, fields
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.special import ndtri

from simrig.core.counter_rng import hashed
from simrig.core.errors import SimrigError, check_known
from simrig.imaging.mosaic import PATTERNS, channels_of

SENSOR_EFFECTS = ("photon-noise", "dark-noise", "dark-current", "fixed-pattern", "defects",
                  "quantisation")  # fmt: skip
_PATTERN, _CHANCE = 11, 12  # streams
_FEW = 24.0  # electrons up to which a Poisson variate is inverted term by term
_LARGEST_SIDE = 1 << 16


@dataclass(frozen=True)
class Sensor:
    """The pixels of a camera, and the converter behind them.

    Attributes:
        pixels: (width, height).
        bits: of the analogue-to-digital converter.
        black_DN: digital number of a dark pixel.
        K_DN_e: overall system gain in DN per electron.
        sigma_d_e: temporal dark (read-out) noise in electrons.
        mu_sat_e: electrons at which a pixel is full.
        mu_I_e_s: dark current in electrons per second.
        DSNU_e, PRNU_pct: standard deviation over the pixels of the dark signal in electrons, and
            of the response in per cent.
        defects: share of the pixels that see nothing (one half) or are always full.
        cfa: colour filter array, its first two rows from the left (``PATTERNS``); None is a
            monochrome sensor.
        seed: of what is fixed in the sensor, its pattern and defects.

    Raises:
        SimrigError: numbers that no sensor has.
    """

    pixels: tuple[int, int]
    bits: int
    black_DN: float
    K_DN_e: float
    sigma_d_e: float
    mu_sat_e: float
    mu_I_e_s: float = 0.0
    DSNU_e: float = 0.0
    PRNU_pct: float = 0.0
    defects: float = 0.0
    cfa: str | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        object.__setattr__(self, "pixels", tuple(int(side) for side in self.pixels))
        if len(self.pixels) != 2 or not all(1 <= side <= _LARGEST_SIDE for side in self.pixels):
            raise SimrigError(
                f"a sensor has 1 to {_LARGEST_SIDE} pixels a side, got {list(self.pixels)}"
            )
        if self.cfa is not None:
            check_known("colour filter array", self.cfa, PATTERNS)
        for field in fields(self)[1:10]:
            value = getattr(self, field.name)
            if not 0.0 <= value < float("inf"):
                raise SimrigError(
                    f"{field.name} of a sensor must be finite and >= 0, got {value:g}"
                )
        if not 1 <= self.bits <= 16 or self.bits != int(self.bits):
            raise SimrigError(f"a sensor that takes pictures has 1 to 16 bits, got {self.bits}")
        if self.K_DN_e == 0.0 or self.mu_sat_e < 1.0:
            raise SimrigError("a sensor needs a gain above 0 and at least one electron")
        if self.black_DN >= self.largest_DN:
            raise SimrigError(
                f"black_DN must be below {self.largest_DN}, the largest number of {self.bits} "
                f"bits, got {self.black_DN:g}"
            )
        if self.defects > 1.0:
            raise SimrigError(f"defects of a sensor is a share, 0 to 1, got {self.defects:g}")

    @property
    def largest_DN(self) -> int:
        """The largest digital number."""
        return int(2**self.bits - 1)

    @property
    def saturation_e(self) -> float:
        """Electrons above the black level at which a pixel or the converter is full."""
        return float(min(self.mu_sat_e, (self.largest_DN - self.black_DN) / self.K_DN_e))

    def as_dict(self) -> dict[str, Any]:
        """Return the numbers as plain values."""
        return {f.name: getattr(self, f.name) for f in fields(self)} | {"pixels": [*self.pixels]}

    def channels(self) -> np.ndarray:
        """Return which of red, green, blue (0, 1, 2) every pixel sees, (height, width).

        Raises:
            SimrigError: a monochrome sensor.
        """
        if self.cfa is None:
            raise SimrigError("a sensor without colour filter array has no channels")
        width, height = self.pixels
        return channels_of(self.cfa, (height, width))

    def mosaic(self, rgb: np.ndarray) -> np.ndarray:
        """Return what of a colour picture (height, width, 3) each pixel sees, (height, width).

        A monochrome sensor sees the mean of the channels.
        """
        if self.cfa is None:
            return np.asarray(rgb.mean(axis=-1))
        return np.take_along_axis(rgb, self.channels()[..., None], axis=-1)[..., 0]

    def expose(
        self,
        electrons_per_second: np.ndarray,
        exposure: float,
        picture: int,
        *,
        frame: int = 0,
        seconds: float | None = None,
        effects: Collection[str] = SENSOR_EFFECTS,
        seed: int = 0,
    ) -> np.ndarray:
        """Return one raw frame.

        Args:
            electrons_per_second: (height, width) mean rate of photo-electrons at light level 1.
            exposure: seconds times the level of the light.
            picture, frame: numbers that chance belongs to, with ``seed`` and the pixel.
            seconds: the shutter is open, for the dark current; ``exposure`` unless given.
            effects: of ``SENSOR_EFFECTS``, those that are simulated.
            seed: of the chance.

        Returns:
            (height, width) DN: uint16; float64 without ``quantisation``, which is not clipped
            either.

        Raises:
            SimrigError: rates of another shape, negative or not finite; a negative exposure.
        """
        rate = np.asarray(electrons_per_second, dtype=np.float64)
        if rate.shape != self.pixels[::-1]:
            raise SimrigError(f"a frame of this sensor is {self.pixels[::-1]}, got {rate.shape}")
        if not np.all(np.isfinite(rate)) or rate.min() < 0.0:
            raise SimrigError("rates of electrons must be finite and >= 0")
        if not 0.0 <= exposure < float("inf"):
            raise SimrigError(f"an exposure must be finite and >= 0 seconds, got {exposure:g}")
        gain, offset, broken = _fixed_pattern(self)
        mean = rate * exposure
        if "fixed-pattern" in effects:
            mean = mean * gain
        if "dark-current" in effects:
            mean = mean + self.mu_I_e_s * (exposure if seconds is None else seconds)
        charge, read = self._drawn(mean, effects, (seed, picture, frame))
        if "defects" in effects and len(broken[0]):
            charge.flat[broken[0]] = 0.0
            charge.flat[broken[1]] = self.mu_sat_e
        if "quantisation" in effects:
            charge = np.minimum(charge, self.mu_sat_e)
        if read is not None:
            charge = charge + self.sigma_d_e * read
        if "fixed-pattern" in effects:
            charge = charge + offset
        number = self.K_DN_e * charge + self.black_DN
        if "quantisation" not in effects:
            return number
        return np.clip(np.rint(number), 0, self.largest_DN).astype(np.uint16)

    def _drawn(
        self, mean: np.ndarray, effects: Collection[str], counter: tuple[int, int, int]
    ) -> tuple[np.ndarray, np.ndarray | None]:
        """Return the charge with its photon noise, and normal numbers for the read-out."""
        photon, dark = "photon-noise" in effects, "dark-noise" in effects and self.sigma_d_e > 0.0
        if not photon and not dark:
            return mean.copy(), None
        bits = hashed((*counter, _CHANCE), mean.size).reshape(mean.shape)
        read = ndtri(_upper(bits)) if dark else None
        return poisson(mean, _lower(bits)) if photon else mean.copy(), read


def poisson(mean: np.ndarray, uniform: np.ndarray) -> np.ndarray:
    """Return Poisson variates by inversion, float64 of whole numbers.

    Few electrons are inverted term by term; many by the Cornish–Fisher expansion to the order of
    1 / mean, whose distribution function is within 1e-4 of Poisson's (Johnson, Kemp and Kotz,
    "Univariate discrete distributions", 2005, section 4.7).

    Args:
        mean: >= 0.
        uniform: in (0, 1), of the same shape.
    """
    root, z = np.sqrt(mean), ndtri(uniform)
    safe = np.maximum(root, 1.0)
    square = z * z
    step = z + (square - 1.0) / (6.0 * safe) - (z * (2.0 + square)) / (72.0 * safe * safe)
    drawn = np.maximum(np.rint(mean + root * step), 0.0)
    few = np.flatnonzero(mean.ravel() <= _FEW)
    if len(few):
        drawn.flat[few] = _inverted(mean.flat[few], uniform.flat[few])
    return drawn


def _inverted(mean: np.ndarray, uniform: np.ndarray) -> np.ndarray:
    term = np.exp(-mean)
    drawn, total, going = np.zeros_like(mean), term.copy(), np.arange(len(mean))
    count = 0
    while len(going := going[uniform[going] > total[going]]):
        count += 1
        drawn[going] = count
        term[going] *= mean[going] / count
        total[going] += term[going]
        if count > 100:  # beyond what 32 bits of chance tell apart
            break
    return drawn


@lru_cache(maxsize=4)
def _fixed_pattern(sensor: Sensor) -> tuple[np.ndarray, np.ndarray, tuple[np.ndarray, np.ndarray]]:
    """Return response and dark signal of every pixel, and the numbers of dead and of hot ones."""
    width, height = sensor.pixels
    bits = hashed((sensor.seed, 0, 0, _PATTERN), width * height).reshape(height, width)
    gain = np.maximum(1.0 + 0.01 * sensor.PRNU_pct * ndtri(_upper(bits)), 0.0)
    offset = sensor.DSNU_e * ndtri(_lower(bits))
    fate = _upper(hashed((sensor.seed, 1, 0, _PATTERN), width * height))
    dead = np.flatnonzero(fate < 0.5 * sensor.defects)
    hot = np.flatnonzero((fate >= 0.5 * sensor.defects) & (fate < sensor.defects))
    return gain, offset, (dead, hot)


def _upper(bits: np.ndarray) -> np.ndarray:
    return ((bits >> np.uint64(32)).astype(np.float64) + 0.5) * 2.0**-32


def _lower(bits: np.ndarray) -> np.ndarray:
    return ((bits & np.uint64(0xFFFFFFFF)).astype(np.float64) + 0.5) * 2.0**-32

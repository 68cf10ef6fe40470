"""Virtual instruments, built from points in space and electrons: what a budget is judged by.

Nothing of the measurement equation is used: light, camera and surface have places, the axis of view
is cut with the surface, points of light, lens and spot are joined by rays, photons are counted.
Errors are drawn by NumPy's own samplers.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import qmc

from simrig.brdf.protocol import Brdf, evaluate
from simrig.instruments.instrument import AXES
from simrig.instruments.quantity import Quantity

POINTS = 256  # of light, lens and spot together
_REFERENCE_POLAR = np.radians(45.0)


@dataclass(frozen=True)
class VirtualInstrument:
    """One instrument with its own errors.

    Attributes:
        numbers: what its numbers really are, by path; the tilt about y and each element of bands
            and matrix have a suffix.
        stated: what its file says.
        bits, pixels: of the sensor; pixels are those averaged in a value.
        exposure_range_ev: of the sensor.
        number: of the instrument; chance of its values belongs to it.
        seed: of the study.
    """

    numbers: Mapping[str, float]
    stated: Mapping[str, Quantity]
    bits: int
    pixels: int
    exposure_range_ev: float
    number: int
    seed: int

    @classmethod
    def drawn(
        cls, stated: Mapping[str, Quantity], bits: int, pixels: int, number: int, seed: int = 0
    ) -> VirtualInstrument:
        """Draw one.

        Args:
            stated: numbers of the file.
            bits, pixels: of the sensor.
            number: of the instrument.
            seed: of the study.
        """
        chance = np.random.default_rng([seed, number, 0])
        groups: dict[str, float] = {}
        numbers: dict[str, float] = {}
        parts = {
            "sample.tilt_deg": ["", " y"],
            "calibration.spectral_mismatch": ["", " g", " b"],
            "calibration.colour_matrix": ["", *(f" {k}" for k in range(1, 9))],
        }
        for path, quantity in stated.items():
            for part in parts.get(path, [""]):
                error = _standard(chance, quantity.dist)
                if quantity.group is not None and not part:
                    error = groups.setdefault(quantity.group, error)
                value = 0.0 if part == " y" else quantity.value
                numbers[path + part] = value + quantity.u * error
        steps = stated["camera.exposure_range_ev"].value
        return cls(numbers, stated, bits, pixels, steps, number, seed)

    def measure(self, brdf: Brdf, angles: np.ndarray) -> np.ndarray:
        """Return what it states as f_r at (n, 4) directions in radians, (n, 3) in 1/sr."""
        chance = np.random.default_rng([self.seed, self.number, 1])
        own = self.numbers
        offset = np.radians([own[f"axis.{axis}.offset_deg"] for axis in AXES])
        reach = np.radians([own[f"axis.{axis}.repeatability_deg"] for axis in AXES])
        reached = angles + offset + chance.uniform(-1.0, 1.0, angles.shape) * reach
        light = np.stack(
            [self._radiance(brdf, one, asked) for one, asked in zip(reached, angles, strict=True)]
        )
        hours = chance.uniform(0.0, self._value("calibration.interval_h"), len(angles))
        light = light * (1.0 + own["light.drift_pct_h"] / 100.0 * hours)[:, None]
        light = light * (1.0 + own["calibration.flat_field"])
        light = light + (own["light.stray"] / np.pi / np.cos(angles[:, 0]))[:, None]
        values = self._read(light, np.cos(angles[:, 0]), chance)
        elements = [
            own["calibration.colour_matrix" + part]
            for part in ("", *(f" {k}" for k in range(1, 9)))
        ]
        off = np.reshape(elements, (3, 3))
        off = np.sqrt(1.5) * (off - off.mean(axis=1, keepdims=True))
        values = values @ (np.eye(3) + off).T
        if "calibration.reference_f_r_per_sr" not in self.stated:
            return values
        true = np.full((1, 3), own["calibration.reference_f_r_per_sr"])
        reading = self._read(true, np.ones(1), chance, steady=True)
        return values * (self._value("calibration.reference_f_r_per_sr") / reading)

    def _value(self, path: str) -> float:
        return self.stated[path].value if path in self.stated else 0.0

    def _radiance(self, brdf: Brdf, reached: np.ndarray, asked: np.ndarray) -> np.ndarray:
        """Return radiance over the irradiance that the instrument assumes, (3,)."""
        own = self.numbers
        on_light, on_lens, on_spot = _points()
        tilt = [own["sample.tilt_deg"], own["sample.tilt_deg y"], 0.0]
        surface = Rotation.from_euler("xyz", tilt, degrees=True)
        origin, normal = np.array([0.0, 0.0, own["sample.height_mm"]]), surface.apply([0, 0, 1])
        aperture = own["lens.f_mm"] / own["lens.f_number"]
        places = []
        for theta, phi, distance, diameter, disc in (
            (reached[0], reached[2], own["light.distance_mm"], own["light.diameter_mm"], on_light),
            (reached[1], reached[3], own["camera.distance_mm"], aperture, on_lens),
        ):
            arm = Rotation.from_euler("ZY", [phi, theta])
            flat = np.column_stack([0.5 * diameter * disc, np.full(POINTS, distance)])
            places.append((arm.apply([0.0, 0.0, distance]), arm.apply(flat)))
        camera = places[1][0]
        # the axis of view runs from the camera through the centre of the axes
        seen = camera - camera * ((camera - origin) @ normal) / (camera @ normal)
        spot = np.column_stack([0.5 * own["sample.spot_diameter_mm"] * on_spot, np.zeros(POINTS)])
        spot = seen + surface.apply(spot)
        rays = [surface.inv().apply(points - spot) for _, points in places]
        lengths = [np.linalg.norm(ray, axis=1, keepdims=True) for ray in rays]
        wi, wv = (ray / length for ray, length in zip(rays, lengths, strict=True))
        profile = 1.0 + own["light.non_uniformity"] * np.sum(on_spot**2, axis=1)
        irradiance = np.maximum(wi[:, 2], 0.0) / lengths[0][:, 0] ** 2 * profile
        radiance = np.asarray((evaluate(brdf, wi, wv) * irradiance[:, None]).mean(axis=0))
        standard = "calibration.reference_f_r_per_sr" in self.stated
        at = own["light.distance_mm"] if standard else self._value("light.distance_mm")
        return radiance * at**2 / np.cos(asked[0])

    def _read(
        self,
        light: np.ndarray,
        cosine: np.ndarray,
        chance: np.random.Generator,
        steady: bool = False,
    ) -> np.ndarray:
        """Return what the sensor counts of light, in its scale, (n, 3)."""
        own = self.numbers
        if not steady:
            share = [own["calibration.spectral_mismatch" + part] for part in ("", " g", " b")]
            light = light + np.array(share) * (light.mean(axis=1, keepdims=True) - light)
            prnu = own["camera.PRNU_pct"] / 100.0 / np.sqrt(self.pixels)
            light = light * (1.0 + prnu * chance.standard_normal((len(light), 1)))
        full, top = self._value("camera.mu_sat_e"), 2.0**self.bits
        brightest = light.max(axis=1) * cosine / self._value("camera.saturation_per_sr")
        longer = np.zeros(len(light))
        for step in range(1, int(self.exposure_range_ev) + 1):
            longer[brightest * 2.0**step <= 1.0] = step
        per_unit = full * (cosine * 2.0**longer / self._value("camera.saturation_per_sr"))[:, None]
        electrons = np.minimum(light * per_unit, full * 2.0 ** longer[:, None])
        electrons = np.minimum(electrons, full)
        # the sum over the pixels of a Poisson variate each is one of the summed mean
        noise = chance.standard_normal((2, *light.shape)) / np.sqrt(self.pixels)
        counted = chance.poisson(np.maximum(electrons, 0.0) * self.pixels) / self.pixels
        counted = counted + self._value("camera.sigma_d_e") * noise[0]
        counted = counted * (1.0 + own["calibration.linearity"] * (electrons / full - 0.5))
        digital = counted * top / full + own["calibration.black_DN"]
        if not steady:
            digital = digital + noise[1] / np.sqrt(12.0)
        return np.asarray(digital * full / top / per_unit)


def _standard(chance: np.random.Generator, dist: str) -> float:
    """Return a number with mean 0 and deviation 1."""
    if dist == "uniform":
        return float(chance.uniform(-(3.0**0.5), 3.0**0.5))
    if dist == "triangular":
        return float(chance.triangular(-(6.0**0.5), 0.0, 6.0**0.5))
    return float(chance.standard_normal())


@lru_cache(maxsize=1)
def _points() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return points of three unit discs, (POINTS, 2) each, even in all six dimensions."""
    even = qmc.Sobol(6, rng=np.random.default_rng(1)).random(POINTS)
    discs = []
    for first in (0, 2, 4):
        radius, angle = np.sqrt(even[:, first]), 2.0 * np.pi * even[:, first + 1]
        discs.append(np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1))
    return discs[0], discs[1], discs[2]

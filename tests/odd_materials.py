"""BRDFs that are hard to measure, for tests of the automatic plan."""

from __future__ import annotations

import numpy as np

from simrig.brdf.protocol import Brdf
from simrig.core.arrays import components, scale, vector
from simrig.directions.half_difference import to_half_difference


class OneWay(Brdf):
    """Brighter when light comes in flat than when it leaves flat; isotropic."""

    name, reciprocal = "one_way", False

    def data(self):
        return {"colour": np.array([0.3, 0.2, 0.1])}

    def look_up(self, wi, wv, tables):
        return np.array([0.3, 0.2, 0.1]) * (2.0 - components(wi)[2])[..., None]


class Turned(Brdf):
    """Another BRDF, turned about the normal."""

    name = "turned"

    def __init__(self, brdf: Brdf, angle: float):
        self.brdf, self.cosine, self.sine = brdf, np.cos(angle), np.sin(angle)

    def data(self):
        return self.brdf.data()

    def look_up(self, wi, wv, tables):
        return self.brdf.eval(self._back(wi), self._back(wv))

    def _back(self, v):
        x, y, z = components(v)
        return vector(self.cosine * x + self.sine * y, self.cosine * y - self.sine * x, z)


class Noisy(Brdf):
    """Another BRDF with relative noise that belongs to the directions."""

    name = "noisy"

    def __init__(self, brdf: Brdf, noise: float):
        self.brdf, self.noise = brdf, noise

    def data(self):
        return self.brdf.data()

    def look_up(self, wi, wv, tables):
        seed = np.sin(1e4 * (wi @ [1.0, 2.3, 3.1] + wv @ [4.7, 5.9, 6.1])) * 43758.5453
        uniform = seed - np.floor(seed)
        return scale(self.brdf.eval(wi, wv), 1.0 + self.noise * np.sqrt(12.0) * (uniform - 0.5))


class Tape(Brdf):
    """Sends light back within two degrees."""

    name, width = "tape", np.radians(1.5)

    def data(self):
        return {"colour": np.array([0.05, 0.05, 0.05])}

    def look_up(self, wi, wv, tables):
        back = to_half_difference(wi, wv).theta_d
        lobe = 20.0 * np.exp(-((back / self.width) ** 2))
        return 0.05 + scale(np.ones_like(wi), lobe)


class HalfAngle(Brdf):
    """A lobe over theta_h that rises with theta_d: phi_d does not matter."""

    name = "half_angle"

    def data(self):
        return {"colour": np.array([1.0, 0.8, 0.6])}

    def look_up(self, wi, wv, tables):
        at = to_half_difference(wi, wv)
        lobe = np.exp(-((at.theta_h / 0.2) ** 2)) * (1.0 + at.theta_d**2)
        return np.array([1.0, 0.8, 0.6]) * (0.1 + lobe)[..., None]


class Rim(Brdf):
    """Isotropic and reciprocal, and phi_d matters."""

    name = "rim"

    def data(self):
        return {"colour": np.array([0.3, 0.2, 0.1])}

    def look_up(self, wi, wv, tables):
        both = components(wi)[2] * components(wv)[2]
        return np.array([0.3, 0.2, 0.1]) * (0.2 + both)[..., None]


class Lacquer(Brdf):
    """A highlight whose colour turns from green to red as light comes in flatter."""

    name = "lacquer"

    def data(self):
        return {"colour": np.ones(3)}

    def look_up(self, wi, wv, tables):
        at = to_half_difference(wi, wv)
        lobe = np.exp(-((at.theta_h / 0.12) ** 2))
        part = np.sin(at.theta_d) ** 2
        colour = np.stack([0.2 + 2.0 * part, 1.5 - 1.2 * part, 0.3 + 0.0 * part], axis=-1)
        return 0.03 + colour * lobe[..., None]


class Flakes(Brdf):
    """Steps of theta_h of six degrees, as flakes at a few tilts make them."""

    name = "flakes"

    def data(self):
        return {"colour": np.array([0.6, 0.5, 0.4])}

    def look_up(self, wi, wv, tables):
        theta_h = to_half_difference(wi, wv).theta_h
        ring = 1.0 + 0.6 * np.sin(2.0 * np.pi * theta_h / np.radians(6.0))
        return 0.02 + (np.exp(-theta_h / 0.25) * ring)[..., None] * np.array([0.6, 0.5, 0.4])

"""What is off in virtual instruments: one draw of every error for each trial (JCGM 101, 6.4).

A quantity is drawn from its own stream of random numbers, that of its group where it has one, so
that ablations, alternatives and repeated calls see the same instruments.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from zlib import crc32

import numpy as np
from scipy.special import ndtri

from simrig.instruments.instrument import AXES
from simrig.instruments.quantity import Quantity

ROOT3, ROOT6 = np.sqrt(3.0), np.sqrt(6.0)


@dataclass(frozen=True)
class Draws:
    """Errors of ``trials`` instruments at ``values`` directions; those left out are neutral.

    Arrays broadcast to (trials, values) and, where they say so, a last axis.

    Attributes:
        offset, moves: of the four axes, in radians, (…, 4).
        height: in mm. tilt: about x and y, in radians, (…, 2).
        light_distance, camera_distance: in mm.
        light, lens, spot: diameters in mm.
        flat, linearity, prnu, drift, reference, reference_noise: relative.
        mismatch: share of each channel's band, (…, 3). matrix: (…, 3, 3).
        black: in steps of the converter.
        stray: radiance over that of a white diffuser.
        noise, steps: standard normal numbers, (…, 3); 0 without noise.
    """

    offset: np.ndarray
    moves: np.ndarray
    height: np.ndarray
    tilt: np.ndarray
    light_distance: np.ndarray
    camera_distance: np.ndarray
    light: np.ndarray
    lens: np.ndarray
    spot: np.ndarray
    flat: np.ndarray
    linearity: np.ndarray
    prnu: np.ndarray
    drift: np.ndarray
    reference: np.ndarray
    reference_noise: np.ndarray
    mismatch: np.ndarray
    matrix: np.ndarray
    black: np.ndarray
    stray: np.ndarray
    noise: np.ndarray
    steps: np.ndarray

    def at_rest(self, quantities: Mapping[str, Quantity]) -> Draws:
        """Return them with areas of their stated sizes, and all else that moves the light exact."""
        none, zero = np.zeros((1, 1)), np.zeros((1, 1, 4))
        sizes = {
            "light": quantities["light.diameter_mm"].value,
            "lens": quantities["lens.f_mm"].value / quantities["lens.f_number"].value,
            "spot": quantities["sample.spot_diameter_mm"].value,
            "light_distance": quantities["light.distance_mm"].value,
            "camera_distance": quantities["camera.distance_mm"].value,
        }
        one = {name: np.full((1, 1), value) for name, value in sizes.items()}
        return replace(self, offset=zero, moves=zero, height=none, tilt=zero[..., :2], **one)


def standard(dist: str, uniform: np.ndarray) -> np.ndarray:
    """Return numbers of a distribution with mean 0 and deviation 1, by its inverse."""
    if dist == "uniform":
        return np.asarray(ROOT3 * (2.0 * uniform - 1.0))
    if dist == "triangular":
        low = np.sqrt(2.0 * np.minimum(uniform, 0.5)) - 1.0
        return np.asarray(
            ROOT6 * np.where(uniform < 0.5, low, 1.0 - np.sqrt(2.0 * (1.0 - uniform)))
        )
    return np.asarray(ndtri(uniform))


class Drawing:
    """Draws quantities for a number of trials.

    Args:
        quantities: of the instrument.
        trials: how many instruments.
        seed: of the streams.
        on: names of the sources that count; a quantity of another one has its value.
    """

    def __init__(
        self,
        quantities: Mapping[str, Quantity],
        trials: int,
        seed: int,
        on: Collection[str],
    ) -> None:
        self.quantities, self.trials, self.seed, self.on = quantities, trials, seed, on

    def uniforms(self, stream: str, *shape: int) -> np.ndarray:
        """Return numbers in (0, 1) of a stream, (trials, …)."""
        numbers = np.random.default_rng([self.seed, crc32(stream.encode())])
        size = (self.trials, *shape)
        return np.asarray(np.clip(numbers.random(size), 1e-16, 1.0 - 1e-16))

    def normals(self, source: str, *shape: int) -> np.ndarray:
        """Return standard normal numbers for a source; zeros where it does not count."""
        if source not in self.on:
            return np.zeros((1, *shape))
        return np.asarray(ndtri(self.uniforms(source, *shape)))

    def error(self, path: str, source: str, part: str = "") -> np.ndarray:
        """Return how far a number is off from 0, (trials, 1): value and uncertainty."""
        if source not in self.on or path not in self.quantities:
            return np.zeros((1, 1))
        return self.drawn(path, source, part)

    def drawn(self, path: str, source: str, part: str = "") -> np.ndarray:
        """Return what a number really is, (trials, 1); its value where its source is left out."""
        quantity = self.quantities[path]
        if source not in self.on or quantity.u == 0.0:
            return np.full((1, 1), quantity.value)
        stream = path if quantity.group is None else f"group {quantity.group}"
        uniform = self.uniforms(stream + part)[:, None]
        return np.asarray(quantity.value + quantity.u * standard(quantity.dist, uniform))


def draw(
    quantities: Mapping[str, Quantity],
    values: int,
    trials: int,
    seed: int,
    on: Collection[str],
    pixels: int,
) -> Draws:
    """Draw the errors of virtual instruments.

    Args:
        quantities: of the instrument (``simrig.instruments.quantity.quantities_of``).
        values: how many each measures.
        trials: how many instruments.
        seed: of the streams.
        on: names of the sources that count.
        pixels: averaged in a value.
    """
    off = Drawing(quantities, trials, seed, on)

    def axes(key: str, source: str) -> np.ndarray:
        four = [off.error(f"axis.{axis}.{key}", source) for axis in AXES]
        return np.radians(np.stack(np.broadcast_arrays(*four), axis=-1))

    moves = axes("repeatability_deg", "repeatability")
    if np.any(moves):
        moves = moves * (2.0 * off.uniforms("moves", values, 4) - 1.0)
    tilt = [off.error("sample.tilt_deg", "plane", part) for part in ("", " y")]
    tilt[1] = tilt[1] - _value(quantities, "sample.tilt_deg", "plane" in on)  # a value tilts in x
    apertures = off.drawn("lens.f_mm", "extent") / off.drawn("lens.f_number", "extent")
    extent = 1.0 if "extent" in on else 0.0
    bands = [
        off.error("calibration.spectral_mismatch", "spectral mismatch", p) for p in ("", " g", " b")
    ]
    drift = off.error("light.drift_pct_h", "drift") / 100.0
    if np.any(drift):
        interval = quantities.get("calibration.interval_h", Quantity(value=0.0)).value
        drift = drift * interval * off.uniforms("time", values)
    prnu = off.error("camera.PRNU_pct", "PRNU") / 100.0 / np.sqrt(pixels)
    noise = off.normals("noise", 1 + values, 3)
    reference = np.zeros((1, 1))
    if "calibration.reference_f_r_per_sr" in quantities:
        path = "calibration.reference_f_r_per_sr"
        reference = off.drawn(path, "reference") / quantities[path].value - 1.0
    profile = 0.5 * off.error("light.non_uniformity", "flat field")  # its mean over the spot
    return Draws(
        offset=axes("offset_deg", "axis offset"),
        moves=moves,
        height=off.error("sample.height_mm", "plane"),
        tilt=np.stack(np.broadcast_arrays(*np.radians(tilt)), axis=-1),
        light_distance=off.drawn("light.distance_mm", "distance"),
        camera_distance=off.drawn("camera.distance_mm", "distance"),
        light=extent * off.drawn("light.diameter_mm", "extent"),
        lens=extent * apertures,
        spot=extent * off.drawn("sample.spot_diameter_mm", "extent"),
        flat=off.error("calibration.flat_field", "flat field") + profile,
        linearity=off.error("calibration.linearity", "linearity"),
        prnu=prnu * off.normals("PRNU", values),
        drift=drift,
        reference=reference,
        reference_noise=noise[:, :1],
        mismatch=np.stack(np.broadcast_arrays(*bands), axis=-1),
        matrix=_matrix(off),
        black=off.error("calibration.black_DN", "black level"),
        stray=off.error("light.stray", "stray light"),
        noise=noise[:, 1:],
        steps=off.normals("quantisation", values, 3),
    )


def _value(quantities: Mapping[str, Quantity], path: str, counts: bool) -> float:
    return quantities[path].value if counts and path in quantities else 0.0


def _matrix(off: Drawing) -> np.ndarray:
    """Return the errors of colour matrices, (trials, 1, 3, 3); rows sum to 0, so white stays."""
    path = "calibration.colour_matrix"
    each = [off.error(path, "colour matrix", f" {k}" if k else "") for k in range(9)]
    errors = np.stack(np.broadcast_arrays(*each), axis=-1).reshape(-1, 1, 3, 3)
    free = errors - errors.mean(axis=-1, keepdims=True)
    return np.asarray(np.sqrt(1.5) * free)  # so that each element has the stated uncertainty

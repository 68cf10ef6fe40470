"""From raw frames of a flat sample to one value: what a gonioreflectometer's camera measures.

The frames are merged (``simrig.imaging.merging``), each pixel is divided by what a white diffuser
would show there, and the value at the sample's centre is read from the pixels of the spot, each
channel from the pixels of its own colour: by a plane through them, so that the first order of what
changes over the spot cancels.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from simrig.brdf.protocol import Brdf
from simrig.imaging.merging import SensorModel, merge
from simrig.instruments.instrument import Instrument
from simrig.rigs.direct import recording
from simrig.rigs.imaging.optics import Optics
from simrig.rigs.imaging.view import View, view_of

_ENDLESS_DN = 1e300
MOST_WEIGHT = 1.5  # sum of weights without signs, above which a plane is extrapolated


@dataclass(frozen=True, eq=False)
class Spot:
    """The pixels of one view that a value is read from.

    Attributes:
        pixels: (n,) numbers, row by row.
        points: (n, 3) where they look, mm.
        gain: (n,) what the lens lets through.
        channels: (n,) 0, 1, 2; all 0 of a monochrome sensor.
    """

    pixels: np.ndarray
    points: np.ndarray
    gain: np.ndarray
    channels: np.ndarray

    @classmethod
    def of(
        cls,
        optics: Optics,
        camera_to_world: np.ndarray,
        effects: Collection[str],
        diameter_mm: float,
    ) -> Spot:
        """Return the spot of a camera that stands where it was sent."""
        view: View = view_of(optics, camera_to_world, "distortion" in effects)
        radius = np.linalg.norm(view.points, axis=1)
        whole = view.sample > 0.999
        inside = whole & (radius <= 0.5 * diameter_mm)
        colours = optics.sensor.channels().ravel() if optics.sensor.cfa else None
        channels = (
            np.zeros(len(view.pixels), dtype=int) if colours is None else colours[view.pixels]
        )
        for channel in np.unique(channels):  # a spot smaller than the mosaic: the nearest pixels
            mine = channels == channel
            if not np.any(inside & mine):
                usable = np.flatnonzero(mine & (view.sample > 0.0))
                nearest = usable[np.argsort(radius[usable], kind="stable")[:1]]
                inside[nearest] = True
        pixels = view.pixels[inside]
        gain = np.ones(len(pixels))
        if "vignetting" in effects:
            gain = optics.vignetting.ravel()[pixels]
        return cls(pixels, view.points[inside], gain, channels[inside])


def value_of(
    optics: Optics,
    taken: Mapping[str, np.ndarray],
    spot: Spot,
    effects: Collection[str],
) -> tuple[np.ndarray, np.ndarray]:
    """Return f_r and its standard uncertainty by noise, each (3,) in 1/sr.

    A channel of which no pixel is usable has an infinite uncertainty.

    Args:
        optics: the instrument.
        taken: one picture of a recording (``frames``, ``exposures``, ``seconds``, ``light_mm``).
        spot: where to read.
        effects: that were simulated, of which the instrument is calibrated for the geometric ones.
    """
    sensor = optics.sensor
    model = SensorModel.of(sensor.as_dict())
    if "quantisation" not in effects:
        model = replace(model, saturation_DN=_ENDLESS_DN)
    if "dark-current" not in effects:
        model = replace(model, dark_e_s=0.0)
    frames = taken["frames"].reshape(len(taken["frames"]), 1, -1)[:, :, spot.pixels]
    merged = merge(frames, taken["exposures"], model, seconds=taken["seconds"])
    on = (name in effects for name in ("fall-off", "beam-profile"))
    factor, towards = optics.irradiance(spot.points, taken["light_mm"], *on)
    expected = spot.gain * factor * np.maximum(towards[:, 2], 1e-12) * optics.electrons_per_second
    value, noise = merged.value[0] / expected, merged.uncertainty[0] / expected
    if "fixed-pattern" in effects:
        noise = np.hypot(noise, 0.01 * sensor.PRNU_pct * value)
    usable = np.isfinite(noise) & ~merged.saturated[0]
    if "defects" in effects:
        usable &= _believable(value, noise, spot.channels)
    values, sure = np.zeros(3), np.full(3, np.inf)
    for channel in range(3):
        mine = usable & (spot.channels == (channel if sensor.cfa else 0))
        if np.any(mine):
            values[channel], sure[channel] = _at_centre(
                value[mine], noise[mine], spot.points[mine, :2]
            )
    return values, sure


def not_repeated(
    brdf: Brdf, optics: Optics, angles: np.ndarray, values: np.ndarray, effects: Collection[str]
) -> np.ndarray:
    """Return the standard uncertainty by what no picture tells, (n, 3) in 1/sr.

    Of axes that stop anywhere within their repeatability (uniform, JCGM 100 4.3.7), by how much
    f_r and the light's cosine change there; of zeros that are off and of stray light, all that
    they change.

    Args:
        brdf: the material.
        optics: the instrument.
        angles: (n, 4) that were commanded, radians.
        values: (n, 3) measured.
        effects: that were simulated.
    """
    square = np.zeros_like(values)
    instrument = Instrument.of(optics.description)
    if "stray-light" in effects:
        square += recording.stray_light(angles, instrument)[:, None] ** 2
    if "positioning" in effects:

        def shown(degrees: Any) -> np.ndarray:
            there = recording.within_reach(angles + np.radians(degrees))
            cosine = np.cos(there[:, :1]) / np.cos(recording.within_reach(angles)[:, :1])
            return recording.at(brdf, there) * cosine

        truth = shown(0.0)

        def off(degrees: Any) -> np.ndarray:
            return np.abs(shown(degrees) - truth)

        for axis in np.diag(instrument.positioning_deg):
            square += np.maximum(off(axis), off(-axis)) ** 2 / 3.0
        if any(instrument.offset_deg):
            square += off(instrument.offset_deg) ** 2
    return np.sqrt(square)


def _believable(value: np.ndarray, noise: np.ndarray, channels: np.ndarray) -> np.ndarray:
    """Return which pixels are not far from the others of their channel, as defects are."""
    good = np.ones(len(value), dtype=bool)
    for channel in np.unique(channels):
        mine = channels == channel
        middle = np.median(value[mine])
        scatter = 1.4826 * np.median(np.abs(value[mine] - middle))
        good[mine] = np.abs(value[mine] - middle) <= 8.0 * np.hypot(scatter, noise[mine])
    return good


def _at_centre(value: np.ndarray, noise: np.ndarray, at: np.ndarray) -> tuple[float, float]:
    """Return what a plane through values has at the origin, and its standard uncertainty."""
    matrix = np.column_stack([np.ones(len(at)), at])
    weights = np.linalg.pinv(matrix)[0]
    if np.abs(weights).sum() > MOST_WEIGHT:  # pixels on one side, or in one line
        weights = np.full(len(at), 1.0 / len(at))
    return float(weights @ value), float(np.sqrt(np.sum((weights * noise) ** 2)))

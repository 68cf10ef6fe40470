"""What a gonioreflectometer records: f_r as optics, mechanics and sensor change it.

Directions come first: the axes stop beside where they should, and light, lens and spot are not
points, so that f_r is averaged over a cone of illumination and a cone of view. The average is one
quadrature over all three areas, whose nodes come in pairs on opposite sides: what changes
linearly over them cancels exactly. Values come after: the light's fall-off, blur over the
sample's rim, a mirror, stray light, and last the exposure with its noise and its steps.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from simrig.brdf.protocol import Brdf, evaluate
from simrig.core.counter_rng import normals, uniforms
from simrig.directions import to_vector
from simrig.instruments.instrument import Instrument

NODE_PAIRS = 32
_POSITION_STREAM, _NOISE_STREAM = 1, 2
_LARGEST_BLOCK = 2**20  # evaluations at a time
_HORIZON = np.pi / 2 - 1e-9


@dataclass(frozen=True)
class Nodes:
    """Points on the light, the lens and the spot, in pairs on opposite sides, equal weights.

    Attributes:
        light, lens, spot: (2·pairs, 2) in mm, across the axis of each; all zero for what is
            taken for a point. Node p and node p + pairs are opposite.
    """

    light: np.ndarray
    lens: np.ndarray
    spot: np.ndarray


def quadrature(instrument: Instrument, effects: Collection[str], pairs: int = NODE_PAIRS) -> Nodes:
    """Return the nodes over the areas that the effects let count.

    Args:
        effects: ``"light-size"``, ``"aperture-size"``, ``"spot-size"`` and ``"fall-off"`` count.
        pairs: of opposite nodes; an additive recurrence fills all six dimensions evenly.
    """
    ratio = 1.0
    for _ in range(30):  # the root of x^7 = x + 1 (the R sequence of M. Roberts, 2018)
        ratio = (1.0 + ratio) ** (1.0 / 7.0)
    steps = ratio ** -np.arange(1.0, 7.0)
    uniform = np.mod(0.5 + np.arange(1, pairs + 1)[:, None] * steps, 1.0)
    sizes = {
        "light": instrument.light_diameter if "light-size" in effects else 0.0,
        "lens": instrument.aperture_diameter if "aperture-size" in effects else 0.0,
        "spot": instrument.spot_diameter if {"spot-size", "fall-off"} & set(effects) else 0.0,
    }
    discs = {}
    for number, (name, diameter) in enumerate(sizes.items()):
        radius = 0.5 * diameter * np.sqrt(uniform[:, 2 * number])
        angle = 2.0 * np.pi * uniform[:, 2 * number + 1]
        half = radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        discs[name] = np.concatenate([half, -half])
    return Nodes(**discs)


def record(
    brdf: Brdf,
    angles: np.ndarray,
    instrument: Instrument,
    effects: Collection[str],
    pairs: int = NODE_PAIRS,
) -> np.ndarray:
    """Return what is recorded where the rig was asked to look.

    Args:
        angles: (n, 4) theta_i, theta_v, phi_i, phi_v that were asked for, in radians.
        effects: names of those that are simulated (see ``simrig.rigs.direct.effects``).

    Returns:
        (n, 3) linear RGB in 1/sr, >= 0.
    """
    on = set(effects)
    reached = angles + positioning_errors(angles, instrument) if "positioning" in on else angles
    reached = within_reach(reached)
    if on & {"light-size", "aperture-size", "spot-size", "fall-off"}:
        values = averaged(brdf, reached, instrument, on, pairs)
    else:
        values = at(brdf, reached)
    if "lens-blur" in on:
        leak = border_share(angles, instrument)[:, None]
        values = values + leak * (instrument.border_reflectance / np.pi - values)
    if "mirror" in on:
        values = values + mirror_gain(brdf, angles, instrument)
    if "stray-light" in on:
        values = values + stray_light(angles, instrument)[:, None]
    if on & {"quantisation", "noise"}:
        values = exposed(values, angles, instrument, on)
    return values


def at(brdf: Brdf, angles: np.ndarray) -> np.ndarray:
    """Return f_r, (n, 3), at (n, 4) theta_i, theta_v, phi_i, phi_v in radians."""
    wi, wv = to_vector(angles[:, 0], angles[:, 2]), to_vector(angles[:, 1], angles[:, 3])
    return evaluate(brdf, wi, wv)


def within_reach(angles: np.ndarray) -> np.ndarray:
    """Return the angles with the polar angles kept above the horizon."""
    reached = angles.copy()
    reached[:, :2] = np.minimum(reached[:, :2], _HORIZON)
    return reached


def positioning_errors(angles: np.ndarray, instrument: Instrument) -> np.ndarray:
    """Return where the axes stop beside the angles that were asked for, (n, 4) in radians."""
    numbers = uniforms(angles, instrument.seed, _POSITION_STREAM, 4)
    moves = np.radians(instrument.positioning_deg) * (2.0 * numbers - 1.0)
    return moves + np.radians(instrument.offset_deg)


def averaged(
    brdf: Brdf,
    angles: np.ndarray,
    instrument: Instrument,
    effects: Collection[str],
    pairs: int = NODE_PAIRS,
) -> np.ndarray:
    """Return f_r averaged over light, lens and spot, (n, 3).

    Args:
        angles: (n, 4) theta_i, theta_v, phi_i, phi_v in radians.
        instrument: whose light, lens and spot have an area.
        effects: names of those that count; the others are points.
        pairs: of nodes of the quadrature.
    """
    size = max(_LARGEST_BLOCK // (2 * pairs), 1)
    parts = [
        at_nodes(brdf, angles[first : first + size], instrument, effects, pairs).mean(axis=1)
        for first in range(0, len(angles), size)
    ]
    return np.concatenate(parts) if parts else np.zeros((0, 3))


def at_nodes(
    brdf: Brdf,
    angles: np.ndarray,
    instrument: Instrument,
    effects: Collection[str],
    pairs: int = NODE_PAIRS,
) -> np.ndarray:
    """Return what every node of the quadrature contributes, (n, 2·pairs, 3).

    A point of the spot sees the light in another direction and at another distance than the
    centre. The rig divides by the irradiance at the centre, so the fall-off stays in the value;
    what calibration leaves of the light's profile grows with the square of the distance from
    the centre.

    Args: as ``averaged``.
    """
    nodes = quadrature(instrument, effects, pairs)
    spread = "spot-size" in effects
    at_spot = np.concatenate([nodes.spot, np.zeros((2 * pairs, 1))], axis=1)[None]
    to_light = _towards(angles[:, 0], angles[:, 2], instrument.light_distance, nodes.light)
    to_lens = _towards(angles[:, 1], angles[:, 3], instrument.sensor_distance, nodes.lens)
    wi, wv = (_unit(v - at_spot if spread else v) for v in (to_light, to_lens))
    cosine = np.maximum(_unit(to_light)[..., 2:], 0.0)  # of each part of the light
    values = evaluate(brdf, wi, wv) * (cosine / cosine.mean(axis=1, keepdims=True))
    if "fall-off" in effects:
        values = values * _irradiance(angles, instrument, at_spot)[..., None]
    return values


def _towards(theta: np.ndarray, phi: np.ndarray, distance: float, across: np.ndarray) -> np.ndarray:
    """Return vectors (n, nodes, 3) from the centre to points of a disc that faces it, in mm."""
    axis = to_vector(theta, phi)[:, None, :]
    up = to_vector(theta - 0.5 * np.pi, phi)[:, None, :]
    aside = np.stack([-np.sin(phi), np.cos(phi), np.zeros_like(phi)], axis=-1)[:, None, :]
    return distance * axis + across[None, :, :1] * up + across[None, :, 1:] * aside


def _unit(v: np.ndarray) -> np.ndarray:
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def _irradiance(angles: np.ndarray, instrument: Instrument, at_spot: np.ndarray) -> np.ndarray:
    """Return the irradiance at points of the spot over that at its centre, (n, nodes)."""
    centre = instrument.light_distance * to_vector(angles[:, 0], angles[:, 2])[:, None, :]
    ray = centre - at_spot
    distance = np.linalg.norm(ray, axis=-1)
    # cosine over squared distance; the height of the light above the plane is the same
    relative = (instrument.light_distance / distance) ** 3
    radius = 2.0 * np.linalg.norm(at_spot, axis=-1) / instrument.spot_diameter
    return relative * (1.0 + instrument.non_uniformity * radius**2)


def border_share(angles: np.ndarray, instrument: Instrument) -> np.ndarray:
    """Return the part of the recorded light that blur brings from the border, (n,).

    At a slant the spot's near and far rim are out of focus, and the blur is stretched along the
    sample. The part is that of a blurred point at the spot's rim, the largest of all points.
    """
    radius, rim = 0.5 * instrument.spot_diameter, 0.5 * instrument.sample_diameter
    theta_v = np.minimum(angles[:, 1], _HORIZON)
    defocus = instrument.aperture_diameter * radius * np.sin(theta_v) / instrument.sensor_distance
    blur = 0.5 * (instrument.blur_diameter + defocus) / np.cos(theta_v)
    beyond = np.clip(radius + blur - rim, 0.0, None)
    reach = np.divide(beyond, blur, out=np.zeros_like(blur), where=blur > 0.0)
    reach = np.minimum(reach, 2.0)
    # the segment of a disc that lies beyond a chord (the rim is nearly straight there)
    angle = np.arccos(1.0 - reach)
    return (angle - np.sin(angle) * np.cos(angle)) / np.pi


def mirror_gain(brdf: Brdf, angles: np.ndarray, instrument: Instrument) -> np.ndarray:
    """Return what light adds that a mirror sends back to the sample, all orders, (n, 3).

    Light that the sample sends to the mirror comes back spread over the mirror's solid angle.

    Args:
        angles: (n, 4) theta_i, theta_v, phi_i, phi_v in radians.
    """
    share = instrument.mirror_reflectance * instrument.mirror_coverage
    if share == 0.0:
        return np.zeros((len(angles), 3))
    theta = np.radians(np.arange(0.0, 90.0, 10.0))
    table = np.stack([brdf.directional_albedo(t, 0.0, 32, 64) for t in theta])
    albedo = [
        np.stack([np.interp(angles[:, k], theta, channel) for channel in table.T], axis=-1)
        for k in (0, 1)
    ]
    again = np.minimum(share * table.max(axis=0), 0.999)
    return share * albedo[0] * albedo[1] / np.pi / (1.0 - again)


def stray_light(angles: np.ndarray, instrument: Instrument) -> np.ndarray:
    """Return what stray light adds to f_r, (n,): its radiance over the sample's irradiance."""
    cos_theta = np.cos(np.minimum(angles[:, 0], _HORIZON))
    return instrument.stray_light / (np.pi * cos_theta)


@dataclass(frozen=True)
class Exposure:
    """How a sample is exposed.

    Attributes:
        electrons: per pixel and unit of f_r, (n, 1).
        step: one step of the converter in f_r, (n, 1).
        saturation: f_r above which the shortest exposure clips, (n, 1).
    """

    electrons: np.ndarray
    step: np.ndarray
    saturation: np.ndarray


def exposure(values: np.ndarray, angles: np.ndarray, instrument: Instrument) -> Exposure:
    """Return the exposure of each sample: the longest that does not saturate any channel.

    Exposures double from one to the next; all channels share one.

    Args:
        values: (n, 3) f_r in 1/sr that reaches the sensor.
        angles: (n, 4) theta_i, theta_v, phi_i, phi_v in radians.
    """
    cos_theta = np.cos(np.minimum(angles[:, 0], _HORIZON))
    radiance = np.max(values, axis=1) * cos_theta
    with np.errstate(divide="ignore", over="ignore"):
        longer = np.floor(np.log2(instrument.saturation / radiance))
    longer = np.clip(longer, 0.0, np.floor(instrument.exposure_range_ev))
    saturation = (instrument.saturation * 2.0**-longer / cos_theta)[:, None]
    return Exposure(
        electrons=instrument.full_well / saturation,
        step=saturation / 2.0**instrument.bits,
        saturation=(instrument.saturation / cos_theta)[:, None],
    )


def noise_deviation(values: np.ndarray, shot: Exposure, instrument: Instrument) -> np.ndarray:
    """Return the standard deviation of one pixel's noise in f_r, (n, 3): photons and read-out."""
    variance = values * shot.electrons + instrument.read_noise**2
    return np.sqrt(variance) / shot.electrons


def recorded_uncertainty(
    values: np.ndarray, angles: np.ndarray, instrument: Instrument, effects: Collection[str]
) -> np.ndarray | None:
    """Return the standard uncertainty by noise of recorded values, (n, 3) in 1/sr.

    It is what the sensor itself can tell: photons and read-out, and the converter's steps as one
    more source of each pixel, from the values that were recorded (EMVA 1288). None where noise is
    not simulated.

    Args:
        values: (n, 3) recorded.
        angles: (n, 4) that were asked for, in radians.
    """
    if "noise" not in effects:
        return None
    shot = exposure(values, angles, instrument)
    variance = noise_deviation(values, shot, instrument) ** 2
    if "quantisation" in effects:
        variance = variance + shot.step**2 / 12.0
    return np.sqrt(variance / instrument.pixels)


def exposed(
    values: np.ndarray, angles: np.ndarray, instrument: Instrument, effects: Collection[str]
) -> np.ndarray:
    """Return values after exposure, noise and conversion, as the mean of all pixels, (n, 3).

    Args:
        values: (n, 3) f_r in 1/sr that reaches the sensor.
        angles: (n, 4) that were asked for, in radians; chance belongs to them.
        effects: of these ``noise`` and ``quantisation`` count.
    """
    shot = exposure(values, angles, instrument)
    if "quantisation" in effects:
        values = np.minimum(values, shot.saturation)
    deviation = np.zeros_like(values)
    if "noise" in effects:
        deviation = noise_deviation(values, shot, instrument)
        numbers = normals(angles, instrument.seed, _NOISE_STREAM, 3)
        values = values + numbers * deviation / np.sqrt(instrument.pixels)
    if "quantisation" in effects:
        values = shot.step * _mean_of_steps(values / shot.step, deviation / shot.step)
    return np.maximum(values, 0.0)


def _mean_of_steps(signal: np.ndarray, deviation: np.ndarray) -> np.ndarray:
    """Return the expectation of a signal rounded to whole steps, with noise before the rounding.

    Noise of half a step and more hides the steps in the mean of many pixels. The Fourier series
    of the saw-tooth of the rounding error, damped by the noise, gives the expectation.
    """
    order = np.arange(1, 9).reshape(-1, *([1] * signal.ndim))
    damping = np.exp(-2.0 * (np.pi * order * deviation) ** 2)
    series = (-1.0) ** order / (np.pi * order) * np.sin(2.0 * np.pi * order * signal) * damping
    return np.where(deviation < 0.1, np.round(signal), signal + series.sum(axis=0))

"""The measurement equation of an imaging gonioreflectometer: what it states as f_r when it is off.

    f = f_ref · M B (g · L(ω_i', ω_v') · flat · drift · prnu + stray) · linearity / reading(f_ref)

L is f_r times the irradiance at the spot over the one that the instrument assumes, averaged over
light, aperture and spot; M is the colour matrix and B the bands of the channels. Dark level, noise
and steps are added in the sensor's scale. Without a standard the irradiance and the aperture are
those that the file states.

Source: JCGM 100 and 101 for the propagation; thesis section 4.1 for the instrument; EMVA 1288 for
the sensor.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from simrig.brdf.protocol import Brdf, evaluate
from simrig.directions import to_vector
from simrig.evaluation.uncertainty.draws import Draws
from simrig.instruments.description import GonioreflectometerDescription
from simrig.instruments.instrument import Instrument
from simrig.instruments.quantity import Quantity
from simrig.rigs.direct.recording import exposure, noise_deviation, quadrature

REFERENCE = np.radians([[0.0, 45.0, 0.0, 0.0]])  # geometry 0:45 in which the standard is read
PAIRS, FINE_PAIRS = 8, 1024  # of nodes over light, aperture and spot: per trial, and once
_LARGEST_BLOCK = 2**20  # evaluations of f_r at a time


@dataclass(frozen=True)
class Bench:
    """What the equation reads of an instrument beside its errors.

    Attributes:
        instrument: optics and sensor.
        quantities: all its numbers, by path.
        reference: f_r of the standard as stated, in 1/sr; None measures absolutely.
        exposures: taken of every value and averaged.
    """

    instrument: Instrument
    quantities: Mapping[str, Quantity]
    reference: float | None
    exposures: int = 1

    @classmethod
    def of(
        cls,
        description: GonioreflectometerDescription,
        quantities: Mapping[str, Quantity],
        exposures: int = 1,
    ) -> Bench:
        """Return the bench of an instrument file, some of whose numbers may be replaced."""
        standard = quantities.get("calibration.reference_f_r_per_sr")
        sensor = replace(
            Instrument.of(description),
            full_well=quantities["camera.mu_sat_e"].value,
            read_noise=quantities["camera.sigma_d_e"].value,
            saturation=quantities["camera.saturation_per_sr"].value,
        )
        return cls(sensor, quantities, None if standard is None else standard.value, exposures)


def seen(brdf: Brdf, angles: np.ndarray, bench: Bench, draws: Draws) -> np.ndarray:
    """Return what reaches the sensor over the irradiance that is assumed, (trials, n, 3) in 1/sr.

    The few nodes by which a trial averages over the areas are corrected by what many nodes give
    where nothing else is off.

    Args:
        brdf: the material.
        angles: (n, 4) theta_i, theta_v, phi_i, phi_v that are asked for, in radians.
        bench: the instrument.
        draws: its errors.
    """
    values = _averaged(brdf, angles, bench, draws, PAIRS)
    if not np.any(draws.light) and not np.any(draws.lens) and not np.any(draws.spot):
        return values
    still = draws.at_rest(bench.quantities)
    few, many = (_averaged(brdf, angles, bench, still, pairs) for pairs in (PAIRS, FINE_PAIRS))
    return np.maximum(values + (many - few), 0.0)


def _averaged(brdf: Brdf, angles: np.ndarray, bench: Bench, draws: Draws, pairs: int) -> np.ndarray:
    """Return ``seen`` by an average over so many pairs of nodes."""
    reached = angles[None] + draws.offset + draws.moves
    geometry = (draws.tilt[..., 0], draws.height, draws.light_distance, draws.light, draws.lens)
    trials = max(len(a) for a in (reached, draws.camera_distance, draws.spot, *geometry))
    size = max(_LARGEST_BLOCK // (2 * pairs * len(angles)), 1)
    blocks = []
    for first in range(0, trials, size):
        part = slice(first, min(first + size, trials))
        blocks.append(_seen(brdf, angles, reached, bench, draws, pairs, part))
    return np.concatenate(blocks)


def _seen(
    brdf: Brdf,
    angles: np.ndarray,
    reached: np.ndarray,
    bench: Bench,
    draws: Draws,
    pairs: int,
    part: slice,
) -> np.ndarray:
    def of(array: np.ndarray) -> np.ndarray:
        """Return a block of trials with axes for nodes and components at the end."""
        own = array if len(array) == 1 else array[part]
        return own[..., None, None]

    reached = reached if len(reached) == 1 else reached[part]
    tilt = draws.tilt if len(draws.tilt) == 1 else draws.tilt[part]
    wi, wv = (
        _tilted(to_vector(reached[..., k], reached[..., k + 2]), tilt)[..., None, :] for k in (0, 1)
    )
    across_light, across_lens, on_spot = _nodes(bench, draws, pairs, of)
    up = (of(draws.height) / np.maximum(wv[..., 2:], 1e-9)) * wv  # where the axis of view ends
    spot = up + on_spot
    to_light = of(draws.light_distance) * wi + _across(wi, across_light) - spot
    to_lens = of(draws.camera_distance) * wv + _across(wv, across_lens) - spot
    distance = np.linalg.norm(to_light, axis=-1, keepdims=True)
    to_light = to_light / distance
    to_lens = to_lens / np.linalg.norm(to_lens, axis=-1, keepdims=True)
    assumed = of(draws.light_distance)  # cancels where the standard stood at the same distance
    if bench.reference is None:
        assumed = np.asarray(bench.instrument.light_distance)
    nominal = np.cos(angles[:, 0])[None, :, None, None]
    irradiance = np.maximum(to_light[..., 2:], 0.0) / nominal * (assumed / distance) ** 2
    values: np.ndarray = (evaluate(brdf, to_light, to_lens) * irradiance).mean(axis=-2)
    return values


def _tilted(w: np.ndarray, tilt: np.ndarray) -> np.ndarray:
    """Return directions as a surface sees them that was turned about x and then about y."""
    (sin_x, sin_y), (cos_x, cos_y) = (np.moveaxis(f(tilt), -1, 0) for f in (np.sin, np.cos))
    x, z = cos_y * w[..., 0] - sin_y * w[..., 2], sin_y * w[..., 0] + cos_y * w[..., 2]
    y, z = cos_x * w[..., 1] + sin_x * z, cos_x * z - sin_x * w[..., 1]
    return np.stack([x, y, z], axis=-1)


def _nodes(
    bench: Bench, draws: Draws, pairs: int, of: Callable[[np.ndarray], np.ndarray]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return points across light, aperture and spot in mm, (…, nodes, 2 or 3); one if points."""
    sizes = (draws.light, draws.lens, draws.spot)
    if not any(np.any(size) for size in sizes):
        return np.zeros((1, 2)), np.zeros((1, 2)), np.zeros((1, 3))
    unit = replace(bench.instrument, light_diameter=1.0, aperture_diameter=1.0, spot_diameter=1.0)
    nodes = quadrature(unit, {"light-size", "aperture-size", "spot-size"}, pairs)
    flat = np.concatenate([nodes.spot, np.zeros((2 * pairs, 1))], axis=1)
    made = [
        of(size) * where for size, where in zip(sizes, (nodes.light, nodes.lens, flat), strict=True)
    ]
    return made[0], made[1], made[2]


def _across(w: np.ndarray, where: np.ndarray) -> np.ndarray:
    """Return points of a disc that faces a direction; which way round does not matter."""
    helper = np.where(np.abs(w[..., 2:]) < 0.9, [0.0, 0.0, 1.0], [1.0, 0.0, 0.0])
    first = np.cross(helper, w)
    first /= np.linalg.norm(first, axis=-1, keepdims=True)
    return where[..., :1] * first + where[..., 1:] * np.cross(w, first)


def stated(values: np.ndarray, angles: np.ndarray, bench: Bench, draws: Draws) -> np.ndarray:
    """Return what the instrument states as f_r for what it sees, (trials, n, 3) in 1/sr.

    Args:
        values: (trials or 1, n, 3) of ``seen``.
        angles: (n, 4) that are asked for, in radians.
        bench: the instrument.
        draws: its errors.
    """
    scale = (1.0 + draws.flat) * (1.0 + draws.drift) * (1.0 + draws.prnu)
    cosine = np.cos(np.minimum(angles[:, 0], np.pi / 2 - 1e-9))
    values = values * scale[..., None] + (draws.stray / (np.pi * cosine))[..., None]
    mean = values.mean(axis=-1, keepdims=True)
    values = values + draws.mismatch * (mean - values)
    values = _read(values, angles, bench, draws, draws.noise)
    if np.any(draws.matrix):
        values = values + np.einsum("tnij,tnj->tni", *_together(draws.matrix, values))
    if bench.reference is None:
        focal = bench.quantities["lens.f_mm"].value / bench.quantities["lens.f_number"].value
        area = (draws.lens / focal) ** 2 if np.any(draws.lens) else np.ones((1, 1))
        return values * area[..., None]
    true = bench.reference * (1.0 + draws.reference)[..., None] * np.ones(3)
    steady = replace(draws, steps=np.zeros((1, 1, 3)))
    reading = _read(true, REFERENCE, bench, steady, draws.reference_noise)
    return np.asarray(values * (bench.reference / reading))


def _read(
    values: np.ndarray, angles: np.ndarray, bench: Bench, draws: Draws, normal: np.ndarray
) -> np.ndarray:
    """Return values after saturation, the sensor's response, noise and steps."""
    flat = np.reshape(values, (-1, 3))
    every = np.broadcast_to(angles, (*values.shape[:-1], 4)).reshape(-1, 4)
    shot = exposure(np.maximum(flat, 0.0), every, bench.instrument)
    step, top, most = (
        np.broadcast_to(part, (len(flat), 1)).reshape(*values.shape[:-1], 1)
        for part in (shot.step, shot.step * 2.0**bench.instrument.bits, shot.saturation)
    )
    values = np.minimum(values, most)
    deviation = np.zeros(1)
    if np.any(normal):
        deviation = noise_deviation(np.maximum(flat, 0.0), shot, bench.instrument)
        deviation = deviation.reshape(values.shape) / np.sqrt(bench.instrument.pixels)
    level = values / top - 0.5  # of full, beside the middle at which the response is adjusted
    values = values * (1.0 + draws.linearity[..., None] * level)
    dither = step * draws.steps / np.sqrt(12.0 * bench.instrument.pixels)
    chance = (deviation * normal + dither) / np.sqrt(bench.exposures)
    return np.asarray(values + draws.black[..., None] * step + chance)


def _together(matrix: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    trials = max(len(matrix), len(values))
    shape = (trials, values.shape[1])
    return np.broadcast_to(matrix, (*shape, 3, 3)), np.broadcast_to(values, (*shape, 3))

"""Largest values from data: of textures, lights, maps and matte surfaces.

A maximum over samples is no bound: four burning lamps of a panel of a quarter million are missed by
any few thousand places. Where the numbers themselves are at hand the largest of them is one.
Interpolation between texels never goes above them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mitsuba as mi
import numpy as np

from simrig.planning import rays

# textures none of whose places is brighter than the largest number they hold
_CONVEX = {
    "UniformSpectrum",
    "SRGBReflectanceSpectrum",
    "SRGBEmitterSpectrum",
    "RawConstantTexture",
    "D65Spectrum",
    "Checkerboard",
    "VolumeAdapter",
    "ConstVolume",
}
_BITMAP = "BitmapTexture"
_NUMBERS = ("value", "data")
_SAMPLED_PLACES = 4096


@dataclass(frozen=True, eq=False)
class Maximum:
    """A largest value.

    Attributes:
        value: (3,) red, green and blue.
        proved: whether it comes from the data; else it is the largest of samples.
    """

    value: np.ndarray
    proved: bool


def brightest_of(emitter: Any) -> Maximum:
    """Return the largest radiance of an area or environment light."""
    found = None
    if not mi.is_spectral:
        found = _of_map(emitter) if emitter.is_environment() else None
        found = _of_texture(emitter, "radiance") if found is None else found
    if found is not None:
        return Maximum(found, True)
    return Maximum(_sampled(emitter), False)


def matte_albedo(bsdf: Any) -> np.ndarray | None:
    """Return the largest albedo (3,) of a diffuse BSDF, one-sided or not; None of any other.

    Its f_r · cos θ is at most this over π.
    """
    if mi.is_spectral:
        return None
    kinds = [node.class_name() for node in mi.traverse(bsdf).hierarchy if isinstance(node, mi.BSDF)]
    if not set(kinds) <= {"SmoothDiffuse", "TwoSidedBRDF"} or "SmoothDiffuse" not in kinds:
        return None
    return _of_texture(bsdf, "reflectance")


def _of_map(emitter: Any) -> np.ndarray | None:
    found = mi.traverse(emitter)
    if "data" not in found:
        return None
    image = np.array(found["data"], dtype=np.float64)[..., :3]
    scale = float(np.max(np.array(found["scale"]))) if "scale" in found else 1.0
    return np.asarray(image.reshape(-1, image.shape[-1]).max(axis=0) * scale)


def _of_texture(owner: Any, name: str) -> np.ndarray | None:
    """Return the largest number of the textures of a name, None where they cannot be read."""
    found = mi.traverse(owner)
    textures = [node for node in found.hierarchy if isinstance(node, mi.Texture | mi.Volume)]
    for texture in textures:
        kind = texture.class_name()
        if kind not in _CONVEX and not kind.startswith(_BITMAP):
            return None
    largest = np.zeros(3)
    read = False
    for key, held in found.items():
        parts = key.split(".")
        if name not in parts or parts[-1] not in _NUMBERS:
            continue
        numbers = np.array(held, dtype=np.float64)
        channels = numbers.shape[-1] if numbers.ndim else 1
        if parts[-1] == "value" and numbers.size == 3:
            channels = 3
        rows = numbers.reshape(-1, channels) if channels == 3 else numbers.reshape(-1, 1)
        largest = np.maximum(largest, rows.max(axis=0))
        read = True
    return largest if read else None


def _sampled(emitter: Any) -> np.ndarray:
    rng = np.random.default_rng(1)
    z = rng.random(_SAMPLED_PLACES)
    side, turn = np.sqrt(1.0 - z**2), 2.0 * np.pi * rng.random(_SAMPLED_PLACES)
    facing = np.stack([side * np.cos(turn), side * np.sin(turn), z], axis=1)
    si = rays.interaction(np.zeros_like(facing), facing, rng.random((_SAMPLED_PLACES, 2)))
    with np.errstate(all="ignore"):
        seen = rays.rows(rays.three_channels(emitter.eval(si)))
    seen = seen[np.isfinite(seen).all(axis=1)]
    return np.asarray(seen.max(axis=0)) if len(seen) else np.full(3, np.inf)

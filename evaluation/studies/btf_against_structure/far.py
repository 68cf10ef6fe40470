"""The averaged far field: the mean of a BTF's picture, the ABRDF, and the structure's own mean.

Everything is averaged over exactly one period, so that the mean has no remainder of the texture:

- the **ABRDF**, the mean of a measured image; from several measurements of independent samples;
- the **BTF's picture** in parallel projection, one sample in the middle of each texel, with
  footprints of a point, of two texels and of the whole tile. Filtering may not change the mean, so
  each differs by no more than the 12 bits of the packed table. A perspective picture from where a
  pixel is two tiles wide stands beside it;
- the **structure's picture** in parallel projection, path-traced several times.

Standard errors come from the spread of the measurements and of the pictures.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from simrig.btf.full import FullBtf
from simrig.btf.stack import BtfStack
from simrig.directions.schemes import HemisphereScheme
from simrig.mesostructure.tile import Tile
from simrig.rigs.btf.rig import btf_angles, measure_btf
from simrig.viewing.structure.patch import (
    PIXEL_ANGLE,
    Sight,
    btf_scene,
    period_sensor,
    picture,
    sensor,
    structure_scene,
)

_TILES_PER_PIXEL = 2.0  # of the perspective picture: surely the last level
_PERSPECTIVE = {"pixels": 2, "spp": 64}  # more pixels would see other directions


def far_rows(tile: Tile, settings: Mapping[str, Any], bounces: int) -> list[dict[str, Any]]:
    """Return a row per pair of directions.

    Args:
        settings: ``rings``, ``texels``, ``spp`` and ``repeats`` of the measurement; ``pixels``,
            ``picture_spp`` and ``renders`` of the structure's pictures; ``angles_deg``, measured
            pairs.
        bounces: how often light is reflected at most.
    """
    scheme = HemisphereScheme.from_rings("far", settings["rings"])
    stack, means = _measured(tile, scheme, settings, bounces)
    btf = FullBtf.from_stack(stack)
    return [
        _far(tile, stack, means, btf, tuple(angles), settings, bounces)
        for angles in settings["angles_deg"]
    ]


def _measured(
    tile: Tile, scheme: HemisphereScheme, settings: Mapping[str, Any], bounces: int
) -> tuple[BtfStack, np.ndarray]:
    """Return the mean of independent measurements, and each one's means, (repeats, pairs)."""
    values: Any = 0.0
    means = []
    for seed in range(settings["repeats"]):
        stack = measure_btf(
            tile,
            btf_angles(scheme),
            settings["texels"],
            settings["spp"],
            bounces=bounces,
            seed=seed,
            dtype=np.float32,
        )
        images = np.asarray(stack.values, dtype=np.float64)
        means.append(images.mean(axis=(1, 2, 3)))
        values = values + images / settings["repeats"]
    return BtfStack(values.astype(np.float32), stack.angles, stack.size_mm, stack.name), np.array(
        means
    )


def _far(
    tile: Tile,
    stack: BtfStack,
    means: np.ndarray,
    btf: FullBtf,
    angles_deg: tuple[float, ...],
    settings: Mapping[str, Any],
    bounces: int,
) -> dict[str, Any]:
    sight = Sight(angles_deg, pixels=1)
    wi, wv = sight.directions
    light, view = stack.directions
    pair = int(np.argmax(light @ wi + view @ wv))
    # radiance under an irradiance of 1 at normal incidence
    measured = means[:, pair] * float(wi[2])
    abrdf = float(measured.mean())
    size = (settings["pixels"], round(settings["pixels"] * tile.size_mm[1] / tile.size_mm[0]))
    scene, camera = structure_scene(tile, sight), period_sensor(tile, sight, size)
    depth, spp = bounces + 1, settings["picture_spp"]
    truths = np.array(
        [picture(scene, camera, depth, spp, seed).mean() for seed in range(settings["renders"])]
    )
    error = float(np.hypot(_standard_error(truths), _standard_error(measured)))
    return {
        "kind": "far",
        "angles_deg": list(angles_deg),
        "abrdf": abrdf,
        "btf_off": _btf_off(tile, stack, btf, sight, abrdf),
        "perspective_off": _perspective_off(tile, btf, angles_deg, abrdf),
        "structure_off": float(truths.mean()) / abrdf - 1.0,
        "standard_error": error / abrdf,
        "structure_off_errors": (float(truths.mean()) - abrdf) / error,
    }


def _standard_error(values: np.ndarray) -> float:
    return float(values.std(ddof=1) / np.sqrt(len(values)))


def _btf_off(tile: Tile, stack: BtfStack, btf: FullBtf, sight: Sight, abrdf: float) -> float:
    """Return by how much the mean of a period differs at most, over the footprints."""
    height, width = stack.resolution
    camera = period_sensor(tile, sight, (width, height), pixel_centres=True)
    texel = max(tile.size_mm[0] / width, tile.size_mm[1] / height)
    means = [
        picture(btf_scene(tile, btf, sight, pixel_mm), camera, 2, 1).mean(dtype=np.float64)
        for pixel_mm in (0.0, 2.0 * texel, max(tile.size_mm))
    ]
    return float(max((mean / abrdf - 1.0 for mean in means), key=abs))


def _perspective_off(
    tile: Tile, btf: FullBtf, angles_deg: tuple[float, ...], abrdf: float
) -> float:
    """Return by how much the mean of a perspective picture from far away differs."""
    distance = 1e-3 * _TILES_PER_PIXEL * max(tile.size_mm) / PIXEL_ANGLE
    sight = Sight(angles_deg, distance, _PERSPECTIVE["pixels"])
    found = picture(btf_scene(tile, btf, sight), sensor(tile, sight), 2, _PERSPECTIVE["spp"])
    return float(found.mean(dtype=np.float64)) / abrdf - 1.0

"""Environments from files as directional lights."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from simrig.core.errors import SimrigError
from simrig.files.pictures import read_picture
from simrig.scenes import DirectionalLights, builtin_environment, median_cut

BUILTIN = "builtin"


def read_environment(source: str | Path = BUILTIN) -> np.ndarray:
    """Return a latitude-longitude environment as (height, width, 3) linear radiance.

    Args:
        source: an EXR or HDR file, or ``"builtin"`` for the environment that needs none.

    Raises:
        SimrigError: an unreadable file, or one that is not twice as wide as high.
    """
    return _read(source)[0]


def _read(source: str | Path) -> tuple[np.ndarray, str]:
    """Return an environment, and what it is and was made of."""
    if str(source) == BUILTIN:
        radiance = builtin_environment()
        return radiance, f"built in, {radiance.shape[1]} × {radiance.shape[0]} pixels"
    picture = read_picture(source)
    height, width = picture.pixels.shape[:2]
    if width != 2 * height:
        raise SimrigError(
            f"'{source}' is {width} x {height} pixels, but a latitude-longitude environment is "
            "twice as wide as high: convert it first"
        )
    return picture.pixels, "; ".join((f"{picture.format}, {picture.size}", *picture.made))


def environment_lights(
    source: str | Path = BUILTIN, count: int = 256, exposed: bool = True
) -> DirectionalLights:
    """Return an environment as directional lights, by median cut.

    Args:
        source: see ``read_environment``.
        count: number of lights; the thesis uses 256 and 512.
        exposed: scale the lights so that the brightest white diffuser has radiance 1 (files
            come in arbitrary units); otherwise their energy is that of the map.

    Raises:
        SimrigError: an unreadable or unusable environment, or a bad count.
    """
    return described_lights(source, count, exposed)[0]


def described_lights(
    source: str | Path = BUILTIN, count: int = 256, exposed: bool = True
) -> tuple[DirectionalLights, str]:
    """Return an environment as directional lights, and in one line what was made of it.

    Args:
        source, count, exposed: see ``environment_lights``.

    Raises:
        SimrigError: as ``environment_lights``.
    """
    radiance, said = _read(source)
    lights = median_cut(radiance, count)
    said = f"{said}; {len(lights)} directional lights by median cut"
    if not exposed:
        return lights, said
    factor = lights.white_exposure()
    bright = "so that the brightest white diffuser has radiance 1"
    return lights.scaled(factor), f"{said}, times {factor:.4g} {bright}"

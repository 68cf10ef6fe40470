"""Environments from files as directional lights."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from simrig.core.errors import SimrigError
from simrig.files.images import read_image
from simrig.scenes import DirectionalLights, builtin_environment, median_cut

BUILTIN = "builtin"


def read_environment(source: str | Path = BUILTIN) -> np.ndarray:
    """Return a latitude-longitude environment as (height, width, 3) linear radiance.

    Args:
        source: an EXR or HDR file, or ``"builtin"`` for the environment that needs none.

    Raises:
        SimrigError: an unreadable file, or one that is not twice as wide as high.
    """
    if str(source) == BUILTIN:
        return builtin_environment()
    radiance = read_image(source)
    height, width = radiance.shape[:2]
    if width != 2 * height:
        raise SimrigError(
            f"'{source}' is {width} x {height} pixels, but a latitude-longitude environment is "
            "twice as wide as high: convert it first"
        )
    return radiance


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
    lights = median_cut(read_environment(source), count)
    return lights.scaled(lights.white_exposure()) if exposed else lights

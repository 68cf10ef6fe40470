"""What the analysis of a picture needs to know of the reflector: half vectors and irradiance."""

from __future__ import annotations

import numpy as np

from simrig.core.kept import kept
from simrig.imaging.anisotropy import Lighting
from simrig.rigs.reflector.folded import Folded


def lighting_of(folded: Folded) -> Lighting:
    """Return the half vectors that light each pixel of a picture, found once and kept with it."""
    made: Lighting = kept(folded, "lighting", lambda: _lighting(folded))
    return made


def _lighting(folded: Folded) -> Lighting:
    view = folded.view[folded.pixel]
    half = folded.towards + view
    across = np.hypot(half[:, 0], half[:, 1])
    cos, sin = (np.divide(half[:, k], across, where=across > 0.0, out=1.0 - k + 0.0 * across)
                for k in range(2))  # fmt: skip
    along = view[:, 0] * cos + view[:, 1] * sin
    return Lighting(
        pixels=folded.pixels,
        pixel=folded.pixel,
        theta_h=np.arctan2(across, half[:, 2]),
        phi_h=np.arctan2(half[:, 1], half[:, 0]),
        view=np.stack([along, view[:, 1] * cos - view[:, 0] * sin], axis=-1),
        irradiance=folded.irradiance.mean(axis=-1),
        mirrored=folded.bounces > 0,
    )

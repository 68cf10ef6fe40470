"""Pictures of a material that changes with time (thesis Figure E.2)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from simrig.btf.full import FullBtf
from simrig.btf.varying import VaryingBtf
from simrig.core import backend
from simrig.core.colour import encode_srgb
from simrig.core.errors import SimrigError
from simrig.core.progress import Progress, tracked

_GAP = 4  # pixels between the pictures of a strip
_WHITE = 0.98  # quantile of all pictures that is shown white


def rendered_times(
    btf: VaryingBtf,
    count: int,
    method: str,
    size: int,
    tiles: float,
    light_deg: float,
    spp: int,
    progress: Progress | None = None,
) -> list[tuple[float, np.ndarray]]:
    """Render a sheet, seen from above under a distant light, at even times.

    Args:
        btf: the material.
        count: of pictures, the first and the last time among them.
        method: of interpolation.
        size: pixels, a side.
        tiles: of the material across the sheet.
        light_deg: polar angle of the light, from +x.
        spp: samples per pixel.
        progress: called with pictures done and in total.

    Returns:
        Time and linear picture (size, size, 3) of each.

    Raises:
        SimrigError: numbers that cannot be; what ``VaryingBtf.at`` refuses.
    """
    if not (np.isfinite(tiles) and tiles > 0.0 and 0.0 <= light_deg < 90.0):
        raise SimrigError(f"tiles > 0 and a light of 0 to 90°, got {tiles:g} and {light_deg:g}")
    backend.select("auto")
    import mitsuba

    from simrig.plugins.make import make_btf

    mi: Any = mitsuba
    across, theta = tiles * btf.stacks[0].size_mm[0], np.radians(light_deg)
    made = []
    for time in tracked(np.linspace(btf.times[0], btf.times[-1], count).tolist(), progress):
        material = make_btf(FullBtf.from_stack(btf.at(time, method), missing="fill"), scale=across)
        direction = [-float(np.sin(theta)), 0.0, -float(np.cos(theta))]
        above = mi.ScalarTransform4f().look_at(origin=[0, 0, 10], target=[0, 0, 0], up=[0, 1, 0])
        scene = {
            "type": "scene",
            "integrator": {"type": "direct"},
            "sheet": {"type": "rectangle", "bsdf": material},
            "light": {"type": "directional", "direction": direction, "irradiance": np.pi},
            "sensor": {
                "type": "orthographic",
                "to_world": above,
                "film": {
                    "type": "hdrfilm",
                    "width": size,
                    "height": size,
                    "rfilter": {"type": "box"},
                    "component_format": "float32",
                },
                "sampler": {"type": "independent", "sample_count": spp},
            },
        }
        made.append((time, np.array(mi.render(mi.load_dict(scene)))[..., :3]))
    return made


def written_strip(folder: Path, pictures: list[tuple[float, np.ndarray]]) -> None:
    """Write the pictures side by side (strip.png), and each alone, all with one white."""
    from PIL import Image

    white = float(np.quantile(np.stack([picture for _, picture in pictures]), _WHITE)) or 1.0
    shown = [np.round(255 * encode_srgb(p / white)).astype(np.uint8) for _, p in pictures]
    for number, picture in enumerate(shown):
        Image.fromarray(picture).save(folder / f"{number:04d}.png")
    gap = np.full((shown[0].shape[0], _GAP, 3), 255, np.uint8)
    row = [part for picture in shown for part in (picture, gap)][:-1]
    Image.fromarray(np.concatenate(row, axis=1)).save(folder / "strip.png")

"""The receding cylinders of thesis section B.2 as pictures and frames, and their calibration."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np

from simrig.core.errors import SimrigError
from simrig.core.progress import Progress
from simrig.files.images import write_exr, write_png
from simrig.rendering.render import RenderResult, load, render
from simrig.scenes.cylinder_layout import columns, covered, cylinder_row
from simrig.scenes.perspective import focal_pixels, pixel_angle_deg
from simrig.scenes.receding_cylinders import (
    CIRCUMFERENCE,
    HALF_HEIGHT,
    patched,
    placements,
    receding_cylinders,
)
from simrig.scenes.stimuli import CYLINDER_RADIUS
from simrig.viewing.stimuli.materials import StimulusMaterial

FRAMES_PER_SECOND = 30
SPEED_DEG = 36.0  # per second; the thesis does not say how fast its cylinders turn
_WHITE = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 1.0}}


@dataclass(frozen=True)
class CylinderStimulus:
    """One stimulus: a material on the receding cylinders, its BRDF above and its BTF below.

    Attributes:
        experiment: ``"A"`` or ``"B"``; C shows the cylinders of B.
        resolution: width of the picture in pixels; by default the published one.
        spp: samples per pixel; each looks up 1/√spp of a pixel's width.
        rotation_deg: of the material on the cylinders; the thesis has 0°, 45° and 90°.
        patch_mm: width of the strip over the seam; 0 for none.
    """

    material: StimulusMaterial
    experiment: str = "A"
    resolution: int | None = None
    spp: int = 16
    rotation_deg: float = 0.0
    patch_mm: float = 0.0

    def scene(self, turn_deg: float = 0.0) -> dict[str, Any]:
        """Return the scene with the cylinders turned about their axes.

        Args:
            turn_deg: to the right.

        Raises:
            SimrigError: no samples, or a scene that ``receding_cylinders`` or ``patched`` refuse.
        """
        if self.spp < 1:
            raise SimrigError(f"spp must be at least 1, got {self.spp}")
        height = cylinder_row(self.experiment).picture(self.resolution)[1]
        options = {
            "scale": CIRCUMFERENCE,
            "scale_v": HALF_HEIGHT,
            "rotation": self.rotation_deg,
            "pixel_angle": pixel_angle_deg(height) / float(np.sqrt(self.spp)),
        }
        halves = {
            "upper": self.material.brdf(self.rotation_deg),
            "lower": self.material.btf(**options),
        }
        if self.patch_mm:
            halves = {half: patched(bsdf, self.patch_mm) for half, bsdf in halves.items()}
        return receding_cylinders(halves, self.experiment, self.resolution, turn_deg=turn_deg)

    def picture(self, seed: int = 0, progress: Progress | None = None) -> RenderResult:
        """Render the stimulus; see ``simrig.rendering.render.render``."""
        return render(self.scene(), self.spp, seed, progress=progress)

    def frames(
        self, count: int, first: int = 0, speed_deg: float = SPEED_DEG
    ) -> Iterator[tuple[int, RenderResult]]:
        """Yield frames of the rotating cylinders: the camera rests, the texture moves.

        Only the placements change between frames, so nothing is compiled after the first. A
        frame does not depend on those before it.

        Args:
            count: number of the last frame plus one.
            first: number of the first frame to render.
            speed_deg: degrees per second, to the right.

        Yields:
            The number of a frame and its picture.

        Raises:
            SimrigError: as ``scene``; no frames, a rate that is not above 0, or no finite speed.
        """
        if count < 1 or first < 0 or not np.isfinite(speed_deg):
            raise SimrigError(
                f"frames need a count >= 1 and a finite speed, got {count} and {speed_deg:g}"
            )
        scene = load(self.scene())
        parameters = mi.traverse(scene)
        for number in range(first, count):
            turn = speed_deg * number / FRAMES_PER_SECOND
            for name, to_world in placements(self.experiment, turn).items():
                parameters[f"{name}.to_world"] = to_world
            parameters.update()
            yield number, render(scene, self.spp, seed=number)


def write_frames(
    stimulus: CylinderStimulus,
    folder: Path,
    count: int,
    speed_deg: float = SPEED_DEG,
    suffix: str = ".png",
    progress: Progress | None = None,
) -> int:
    """Write frames that a folder lacks as ``frame_0000.png`` and so on.

    All PNGs have one exposure, that of a white diffuser. Frames stand under their names only when
    they are complete, so an interrupted call goes on with the first that is missing.

    Args:
        folder: exists.
        speed_deg: degrees per second.
        suffix: ``".png"`` or ``".exr"``.

    Returns:
        How many were rendered now.
    """
    path = lambda number: folder / f"frame_{number:04d}{suffix}"  # noqa: E731
    first = next((n for n in range(count) if not path(n).exists()), count)
    for number, result in stimulus.frames(count, first, speed_deg):
        if suffix == ".exr":
            write_exr(path(number), result.image, {"frame": number, "unit": "radiance"})
        else:
            write_png(path(number), result.image)
        if progress is not None:
            progress(number + 1, count)
    return count - first


def cylinder_widths(experiment: str = "A", resolution: int | None = None) -> list[dict[str, Any]]:
    """Return how wide every cylinder is in the rendered picture, beside the perspective formula.

    Every pixel is looked at through its centre, in the rows just above and below the middle.

    Args:
        experiment: ``"A"`` or ``"B"``.
        resolution: width of the picture; by default the published one.

    Returns:
        One row per cylinder: ``distance_mm``, ``width_px`` (exact), ``diameter_px`` (the diameter
        over the distance, which is less), ``counted_px`` and ``expected_px`` (whole pixels in the
        picture and by the formula), ``wrong_px`` (columns in either row that disagree).
    """
    row = cylinder_row(experiment)
    image = render(receding_cylinders(_WHITE, experiment, resolution, pixel_centres=True)).image
    middle = image.shape[0] // 2
    seen = image[middle - 1 : middle + 1].max(axis=-1) > 0.0
    expected = covered(row, resolution)
    left, right = columns(row, resolution)
    gaps = 0.5 * (np.append(0.0, right) + np.append(left, image.shape[1]))  # between neighbours
    focal = focal_pixels(image.shape[0])
    found = []
    for number, distance in enumerate(row.distances_mm.tolist()):
        part = slice(int(gaps[number]), int(gaps[number + 1]))
        here = expected[part] == number
        found.append(
            {
                "distance_mm": distance,
                "width_px": float(right[number] - left[number]),
                "diameter_px": 2.0 * CYLINDER_RADIUS / distance * focal,
                "counted_px": int(seen[1, part].sum()),
                "expected_px": int(here.sum()),
                "wrong_px": int((seen[:, part] != here).sum()),
            }
        )
    return found

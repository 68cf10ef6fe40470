"""Recording pictures and processing them: pictures per second, beside a scene for every pose.

``flat``: pictures of a BRDF, one pose a view. ``tile``: pictures of a displaced, self-shadowing,
inter-reflecting surface, 81 lights to a view. ``mitsuba``: the same pictures of the tile by Mitsuba
alone, without a sensor: a scene (camera, point light, path of as many bounces) made anew for every
pose. First call and steady state are apart. ``chain`` records the 6,561 pictures of 81 × 81
directions on disk, 128 × 128 pixels of the sample, and processes them to a BTF that is registered
to the plane found, by the clock and by processor seconds. Where an arm would hide the sample the
light stands 10° beside.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np

from simrig.brdf import kurt_material
from simrig.core import backend
from simrig.core.cost import stopwatch
from simrig.core.progress import Progress, tracked
from simrig.core.tables import text_table
from simrig.directions.schemes import hemisphere_81
from simrig.evaluation.studies.engine.distributed import run_on_workers
from simrig.instruments.description import described, shipped
from simrig.mesostructure import build_tile
from simrig.plans.listed import Directions
from simrig.rigs.btf.rig import view_order
from simrig.rigs.imaging.chain import Settings
from simrig.rigs.imaging.optics import Optics
from simrig.rigs.imaging.pictures import Poses
from simrig.rigs.imaging.processing import process_recording
from simrig.rigs.imaging.recorder import Camera
from simrig.rigs.imaging.request import request_of
from simrig.scenes.parts import transform
from simrig.scenes.tile import periods_for, tile_shapes

MATERIAL, PIXELS, SPP, BOUNCES = "leather_tan", 128, 4, 3
SAMPLE_MM = PIXELS * 0.0719
_BESIDE = np.radians(10.0)
WHOLE = 81 * 81
EFFECTS = (
    "positioning", "fall-off", "beam-profile", "vignetting", "distortion", "blur", "stray-light",
    "photon-noise", "dark-noise", "dark-current", "fixed-pattern", "defects", "quantisation",
)  # fmt: skip


def run(
    progress: Progress | None = None,
    views: int = 2,
    alone: int = 5,
    whole: int = 81,
) -> dict[str, Any]:
    """Run the benchmark.

    Args:
        views: of what is timed alone, 81 lights each.
        alone: pictures by Mitsuba alone.
        whole: views of the chain.

    Returns:
        ``rows`` with first and steady seconds per picture, and ``chain``.
    """
    backend.select("auto")
    angles = _angles(views)
    steps: dict[str, Callable[[], Any]] = {
        "flat": lambda: _flat(angles),
        "tile": lambda: _tile(angles),
        "mitsuba": lambda: _alone(angles[:alone]),
        "chain": lambda: _chain(_angles(whole)),
    }
    found = {name: steps[name]() for name in tracked([*steps], progress, str)}
    chain = found.pop("chain")
    rows = [
        {
            "name": name,
            "first_seconds": first,
            "seconds_per_picture": steady,
            "pictures_per_second": 1.0 / steady,
            "pictures": count,
        }
        for name, (first, steady, count) in found.items()
    ]
    seconds = {row["name"]: float(row["seconds_per_picture"]) for row in rows}
    return {
        "benchmark": "recording",
        "material": MATERIAL,
        "rows": rows,
        "ratio_to_mitsuba": seconds["mitsuba"] / seconds["tile"],
        "chain": chain,
    }


def _angles(views: int) -> np.ndarray:
    """Return pairs of the 81 directions, of some views over all polar angles."""
    pairs = hemisphere_81().pair_angles(reciprocal=False)
    hidden = ~_optics().moves.placed(pairs).reached
    beside = np.where(pairs[:, 0] > np.pi / 4.0, -_BESIDE, _BESIDE)
    pairs[hidden, 0] += beside[hidden]
    pairs = pairs[view_order(pairs)]
    _, which = np.unique(pairs[:, [1, 3]], axis=0, return_inverse=True)
    chosen = np.linspace(0, which.max(), views + 2)[1:-1].round() if views < 81 else which
    return np.asarray(pairs[np.isin(which.ravel(), chosen)])


def _description() -> dict[str, Any]:
    """Return the UTIA gonioreflectometer with a narrow frame, so that few pixels are read out."""
    table = shipped("utia").model_dump(mode="json", exclude_none=True)
    table["registration"] |= {"gap_mm": 0.5, "border_mm": 1.5}
    return table


def _optics() -> Optics:
    return Optics.of(described(_description()), SAMPLE_MM)


def _timed(camera: Camera, poses: Poses) -> tuple[float, float, int]:
    """Return the seconds of the first picture, those of each further one, and their number."""
    seconds: list[float] = []
    count = 0
    for numbers in poses.views():
        elapsed = stopwatch()
        taken = list(camera.take(poses, numbers, numbers.tolist()))
        seconds.append(elapsed())
        count += len(taken)
    again = stopwatch()
    numbers = poses.views()[-1]
    steady = [len(list(camera.take(poses, numbers, numbers.tolist()))) for _ in range(2)]
    return seconds[0], again() / sum(steady), count


def _flat(angles: np.ndarray) -> tuple[float, float, int]:
    one = np.unique(angles[:, [1, 3]], axis=0, return_index=True)[1]
    camera = Camera(_optics(), kurt_material("yellow_satin"), EFFECTS)
    return _timed(camera, camera.poses(angles[one]))


def _tile(angles: np.ndarray) -> tuple[float, float, int]:
    steepest = float(angles[:, :2].max())
    camera = Camera(
        _optics(), build_tile(MATERIAL), EFFECTS, spp=SPP, bounces=BOUNCES, steepest=steepest
    )
    return _timed(camera, camera.poses(angles))


def _alone(angles: np.ndarray) -> tuple[float, float, int]:
    """Return the seconds of a scene, a camera and a light for every pose."""
    tile, optics = build_tile(MATERIAL), _optics()
    width = max(optics.sensor.pixels)
    placed = optics.moves.placed(angles)
    middle = np.array([0.5 * tile.size_mm[0], 0.5 * tile.size_mm[1], 0.0])
    periods = periods_for(tile, tile.size_mm, float(np.degrees(angles[:, :2].max())) + 2.0)
    seconds = []
    for pose, light in zip(placed.camera_to_world, placed.light_mm, strict=True):
        elapsed = stopwatch()
        field = 2.0 * np.arctan(0.5 * width / optics.intrinsics[0, 0])
        places = (pose[:3, 3] + middle, middle, -pose[:3, 1])
        scene = mi.load_dict(
            {
                "type": "scene",
                **tile_shapes(tile, periods),
                "light": {"type": "point", "position": (light + middle).tolist()},
                "sensor": {
                    "type": "perspective",
                    "fov": float(np.degrees(field)),
                    "near_clip": 100.0,
                    "to_world": transform().look_at(*(place.tolist() for place in places)),
                    "film": {
                        "type": "hdrfilm", "width": width, "height": width,
                        "rfilter": {"type": "box"}, "component_format": "float32",
                    },
                },
                "integrator": {"type": "path", "max_depth": BOUNCES + 1},
            }
        )  # fmt: skip
        np.array(mi.render(scene, spp=SPP))
        seconds.append(elapsed())
    return seconds[0], float(np.median(seconds[1:])), len(seconds)


def _chain(angles: np.ndarray) -> dict[str, Any]:
    """Record pictures on disk and process them; return what that took, and what all would take."""
    description: Any = described(_description())
    plan = Directions(angles, "81 x 81")
    request = request_of(MATERIAL, description, plan, sample_mm=SAMPLE_MM, spp=SPP)
    with tempfile.TemporaryDirectory() as place:
        folder, output = Path(place) / "recording", Path(place) / "btf.h5"
        recording = replace(request, effects=EFFECTS, bounces=BOUNCES).recording()
        recorded = _both(lambda: recording.run(folder))
        found: dict[str, Any] = {}
        processed = _both(
            lambda: found.update(
                process_recording(folder, output, Settings(PIXELS), spread=_two_processes)
            )
        )
        size = sum(file.stat().st_size for file in folder.rglob("*.npz"))
    share = WHOLE / len(angles)
    return {
        "pictures": len(angles),
        "sensor_pixels": list(recording.camera.optics.sensor.pixels),
        "recording_seconds": recorded[0],
        "processing_seconds": processed[0],
        "recording_cpu_seconds": recorded[1],
        "processing_cpu_seconds": processed[1],
        "bytes": size,
        "marks_found": found["marks_found"],
        "plane": found["plane"]["taken"],
        "whole_seconds": share * (recorded[0] + processed[0]),
        "whole_cpu_seconds": share * (recorded[1] + processed[1]),
        "whole_pictures": WHOLE,
    }


def _two_processes(work: Any, config: Any, cells: Any) -> Any:
    return (rows for _, rows, _ in run_on_workers(work, config, cells, None, 2))


def _both(work: Callable[[], Any]) -> tuple[float, float]:
    """Return the seconds of work by the clock, and of the processor with processes that ended."""
    elapsed, before = stopwatch(), sum(os.times()[:4])
    work()
    return elapsed(), sum(os.times()[:4]) - before


def table(results: dict[str, Any]) -> Any:
    """Return the results as a table for the terminal."""
    rows = [
        (
            row["name"],
            row["pictures"],
            f"{row['first_seconds']:.2f}",
            f"{1000.0 * row['seconds_per_picture']:.1f}",
            f"{row['pictures_per_second']:.1f}",
        )
        for row in results["rows"]
    ]
    chain = results["chain"]
    width, height = chain["sensor_pixels"]
    title = (
        f"{results['material']}, {width} × {height} pixels; Mitsuba alone takes "
        f"{results['ratio_to_mitsuba']:.1f} times as long; chain: {chain['pictures']} pictures "
        f"recorded in {chain['recording_seconds']:.1f} s, processed in "
        f"{chain['processing_seconds']:.1f} s, so {chain['whole_pictures']:,} in "
        f"{chain['whole_seconds'] / 60.0:.1f} min ({chain['whole_cpu_seconds'] / 60.0:.1f} min of "
        "processor time)"
    )
    columns = ("pictures of", "number", "first view [s]", "each then [ms]", "a second")
    return text_table(title, columns, rows)

"""A recording: raw pictures of a sample on disk, pose by pose, and those of the calibration.

A folder holds ``recording.json`` and, each a file of its own, ``poses/000012.npz`` and
``calibration/white.npz``, ``dark.npz``, ``chart.npz`` (``numpy.load`` opens them). Each is written
under a temporary name and renamed, and carries checksums, so a kill damages nothing, any number of
processes write side by side, and the same command goes on with the same bits.
"""

from __future__ import annotations

import hashlib
import json
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from simrig.brdf import Lambert
from simrig.btf.stack import BtfStack
from simrig.core.counter_rng import hashed
from simrig.files.checkpoint import Checkpoint
from simrig.files.recorded import FORMAT, NAME, VERSION, begin_folder, read_about
from simrig.mesostructure.tile import Tile
from simrig.rigs.fingerprint import fingerprint
from simrig.rigs.imaging.effects import EFFECT_NAMES
from simrig.rigs.imaging.optics import Optics
from simrig.rigs.imaging.pictures import Poses, Renderer, poses_of
from simrig.rigs.imaging.sensor import SENSOR_EFFECTS
from simrig.rigs.imaging.surface import Surface, surface_of

WHITE_ALBEDO = 0.95
CALIBRATION = ("white", "dark", "chart")
_CALIBRATION_DEG = (45.0, 0.0, 0.0, 0.0)  # 45:0, theta_i, theta_v, phi_i, phi_v
_DARK_FRAMES = 8
_TOGETHER = 96  # poses of a portion at most: all lights of a view ask the same rays
_WRITERS = 4
_CHART = 0.9  # of the picture's shorter side, at most


@dataclass(frozen=True, eq=False)
class Camera:
    """An instrument at work on one sample: from poses to raw frames.

    Attributes:
        optics: the instrument.
        material: under it, or a ``Surface``.
        effects: that are simulated.
        seed: of all chance but the sensor's pattern.
        spp, bounces: of a tile with structure.
        most_frames: exposures of a picture, at most.
        steepest: polar angle of any view or light, radians.
    """

    optics: Optics
    material: Any
    effects: tuple[str, ...] = ()
    seed: int = 0
    spp: int = 4
    bounces: int = 1
    most_frames: int = 6
    steepest: float = 1.5

    @cached_property
    def surface(self) -> Surface:
        """The sample, made ready once."""
        return surface_of(
            self.material,
            spp=self.spp,
            bounces=self.bounces,
            seed=self.seed,
            steepest=self.steepest,
        )

    def poses(self, angles: np.ndarray) -> Poses:
        """Return the poses of directions (n, 4) in radians, in the order of taking them."""
        return poses_of(self.optics, angles, "positioning" in self.effects, self.seed)

    def take(
        self, poses: Poses, numbers: np.ndarray, pictures: Sequence[int]
    ) -> Iterable[tuple[int, dict[str, np.ndarray]]]:
        """Yield (number, arrays) of poses of one view: what a recording keeps of them.

        Args:
            poses: of the recording.
            numbers: some of one view.
            pictures: that chance belongs to, for each of them.
        """
        renderer = Renderer(self.optics, self.surface, frozenset(self.effects))
        for number, picture, rate in zip(
            numbers, pictures, renderer.rates(poses, numbers), strict=True
        ):
            frames = self._exposed(rate, int(picture))
            yield int(number), frames | self._stated(poses, int(number))

    def _exposed(self, rate: np.ndarray, picture: int) -> dict[str, np.ndarray]:
        return self._frames(rate, picture, *self.optics.exposures(rate, self.most_frames))

    def _frames(
        self, rate: np.ndarray, picture: int, exposures: np.ndarray, seconds: np.ndarray
    ) -> dict[str, np.ndarray]:
        sensor = self.optics.sensor
        on = tuple(name for name in SENSOR_EFFECTS if name in self.effects)
        frames = [
            sensor.expose(rate, t, picture, frame=k, seconds=s, effects=on, seed=self.seed)
            for k, (t, s) in enumerate(zip(exposures, seconds, strict=True))
        ]
        return {"frames": np.stack(frames), "exposures": exposures, "seconds": seconds}

    def _stated(self, poses: Poses, number: int) -> dict[str, np.ndarray]:
        said = poses.commanded
        return {
            "angles": said.angles[number],
            "camera_to_world": said.camera_to_world[number],
            "light_mm": said.light_mm[number],
            "intrinsics": self.optics.intrinsics,
            "distortion": self.optics.distortion if "distortion" in self.effects else np.zeros(5),
        }

    # -- calibration -----------------------------------------------------------------------------

    def calibration(self, name: str) -> dict[str, np.ndarray]:
        """Return a calibration picture: a white sheet, the dark, or a chart in the sample's place.

        Raises:
            SimrigError: another name.
        """
        angles = np.radians([_CALIBRATION_DEG])
        picture = (-1 - CALIBRATION.index(name)) % 2**32
        if name == "dark":
            camera = self.optics.description.camera
            assert camera.exposures_s
            seconds = np.full(_DARK_FRAMES, camera.exposures_s[1].value)
            black = np.zeros(self.optics.sensor.pixels[::-1])
            taken = self._frames(black, picture, seconds, seconds)
            return taken | self._stated(self.poses(angles), 0)
        if name == "white":  # larger than the frame, and in front of it
            side = 1.5 * max(self.optics.window_mm)
            optics = replace(self.optics, sample_mm=side, frame_mm=None)
            sheet = replace(self, material=Lambert((WHITE_ALBEDO,) * 3), optics=optics)
        else:
            optics = replace(self.optics, sample_mm=self.chart_mm)
            sheet = replace(self, material=Chart(self.chart_mm), optics=optics)
        ((_, taken),) = sheet.take(sheet.poses(angles), np.array([0]), [picture])
        return taken

    @property
    def chart_mm(self) -> float:
        """Side of the chart: the sample's, or what a smaller picture shows of it."""
        return min(self.optics.sample_mm, _CHART * min(self.optics.window_mm))


class Chart:
    """Twenty-four diffuse patches, 6 × 4, with the albedos of a colour chart (``Surface``).

    Args:
        side_mm: of all together.
    """

    def __init__(self, side_mm: float) -> None:
        self.half = 0.5 * side_mm
        self.albedos = chart_albedos()

    def reflected(self, view: Any, lights: np.ndarray, number: int) -> np.ndarray:
        """Return f_r times the cosine (see ``Surface``)."""
        x, y = view.points[:, 0], view.points[:, 1]
        column = np.clip(((x / self.half + 1.0) * 3.0).astype(int), 0, 5)
        row = np.clip(((1.0 - y / self.half) * 2.0).astype(int), 0, 3)
        colour = self.albedos[row * 6 + column] / np.pi
        to_light = lights[:, None] - view.points
        cosine = to_light[..., 2:] / np.linalg.norm(to_light, axis=-1, keepdims=True)
        return np.asarray(colour * np.maximum(cosine, 0.0))


def chart_albedos() -> np.ndarray:
    """Return linear sRGB of the ColorChecker's patches (X-Rite, after November 2014), (24, 3)."""
    import colour

    chart = colour.CCS_COLOURCHECKERS["ColorChecker24 - After November 2014"]
    xyz = colour.xyY_to_XYZ(np.array(list(chart.data.values())))
    return np.clip(colour.XYZ_to_RGB(xyz, "sRGB", chart.illuminant, "CAT02"), 0.0, 1.0)


def picture_numbers(angles: np.ndarray) -> np.ndarray:
    """Return whole numbers that name directions (n, 4): what chance in a picture belongs to."""
    words = np.ascontiguousarray(angles + 0.0, dtype=np.float64).view(np.uint64)
    return np.array(
        [int(hashed(tuple(int(w) for w in row), 1)[0] >> np.uint64(1)) for row in words]
    )


@dataclass(frozen=True, eq=False)
class Recording:
    """What is recorded where.

    Attributes:
        camera: instrument, sample, effects.
        angles: (n, 4) of the poses that are reached, in their order.
        plan: what it is called.
        hidden: text of why a pose of the plan was not reached, and how many, by reason.
    """

    camera: Camera
    angles: np.ndarray
    plan: str
    hidden: Mapping[str, int]

    @cached_property
    def poses(self) -> Poses:
        """The poses of the recording."""
        return self.camera.poses(self.angles)

    def about(self) -> dict[str, Any]:
        """Return what ``recording.json`` says."""
        camera, description = self.camera, self.camera.optics.description
        seconds = description.timing.set_up_s.value
        seconds += description.timing.per_sample_s.value * len(self.angles)
        return json.loads(
            json.dumps(
                {
                    "format": FORMAT,
                    "version": VERSION,
                    "material": camera.material.name,
                    "fingerprint": identity_of(camera.material),
                    "plan": self.plan,
                    "seed": camera.seed,
                    "effects": {name: name in camera.effects for name in EFFECT_NAMES},
                    "poses": len(self.angles),
                    "directions": str(hashed(tuple(picture_numbers(self.angles).tolist()), 1)[0]),
                    "not_reached": dict(self.hidden),
                    "spp": camera.spp,
                    "bounces": camera.bounces,
                    "frames": camera.most_frames,
                    **camera.optics.facts(),
                    "calibration": {
                        "angles_deg": _CALIBRATION_DEG,
                        "white_albedo": WHITE_ALBEDO,
                        "chart_mm": camera.chart_mm,
                        "chart_albedo": chart_albedos().tolist(),
                    },
                    "seconds": seconds,
                }
            )
        )

    def begin(self, folder: Path) -> None:
        """Write ``recording.json``, or find that it is there and says the same.

        Raises:
            SimrigError: a folder of something else, or of another recording.
        """
        begin_folder(folder, NAME, self.about(), read_about)

    def missing(self, folder: Path) -> list[np.ndarray]:
        """Return the numbers of the poses that are not there yet, in portions of one view."""
        pieces = kept(folder, "poses")  # reads what is there: damage is named and set aside
        views = (
            np.array([n for n in view if pieces.get(f"{n:06d}") is None])
            for view in self.poses.views()
        )
        return [
            part
            for view in views
            if len(view)
            for part in np.array_split(view, -(-len(view) // _TOGETHER))
        ]

    def take(self, folder: Path, numbers: np.ndarray) -> int:
        """Record poses of one view; return how many."""
        pieces = kept(folder, "poses")
        with ThreadPoolExecutor(_WRITERS) as writers:  # the disk is slower than a picture
            written: deque[Future[Any]] = deque()
            for number, arrays in self.camera.take(self.poses, numbers, numbers.tolist()):
                written.append(writers.submit(pieces.put, f"{number:06d}", arrays=arrays))
                if len(written) > _WRITERS:
                    written.popleft().result()
            for each in written:
                each.result()
        return len(numbers)

    def run(
        self,
        folder: Path,
        progress: Callable[..., None] | None = None,
        spread: Callable[[list[np.ndarray]], Iterable[int]] | None = None,
    ) -> None:
        """Record what is missing: calibration first, then view by view.

        Args:
            folder: of the recording.
            progress: called with poses done and in total.
            spread: takes portions (``missing``) elsewhere, and yields how many poses were taken.

        Raises:
            SimrigError: as ``begin``; no room, an unwritable folder.
        """
        self.begin(folder)
        calibrate(self.camera, folder)
        todo = self.missing(folder)
        done = len(self.angles) - sum(len(part) for part in todo)
        report = progress or (lambda *_: None)
        report(done, len(self.angles))
        here = (self.take(folder, part) for part in todo)
        for taken in spread(todo) if spread and todo else here:
            done += taken
            report(done, len(self.angles))


def calibrate(camera: Camera, folder: Path) -> None:
    """Take the calibration pictures that are not there yet."""
    pieces = kept(folder, "calibration")
    for name in CALIBRATION:
        if pieces.get(name) is None:
            pieces.put(name, arrays=camera.calibration(name))


def kept(folder: Path, part: str) -> Checkpoint:
    """Return the pieces of a recording: ``"poses"`` or ``"calibration"``."""
    return Checkpoint(folder / part, {"recording": part})


def identity_of(material: Any) -> str:
    """Return a short text by which a recording knows its material again."""
    if isinstance(material, BtfStack):
        ends = [np.asarray(material.values[k]) for k in (0, -1)]
        parts = [material.angles, *ends]
        digest = hashlib.sha256(b"".join(np.ascontiguousarray(part).tobytes() for part in parts))
        return digest.hexdigest()[:16]
    if isinstance(material, Tile):
        about = {"name": material.name, "triangles": material.triangles, **material.origin}
        text = json.dumps(about, sort_keys=True, default=str)
        return hashlib.sha256(text.encode()).hexdigest()[:16]
    return fingerprint(material)

"""A film on disk: ``film.json``, a video for every slice, and a still of the colour chart.

Every video is written under a temporary name and renamed, so a kill loses at most the slice that
was being filmed, and the same command goes on with the others.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from simrig.core.progress import Progress
from simrig.directions.spherical import TWO_PI
from simrig.files.atomic import atomic_write
from simrig.files.recorded import begin_folder, read_facts
from simrig.files.video import written_video
from simrig.imaging.frames import candidates
from simrig.instruments.description import Description
from simrig.plans.gantry import GantryPlan
from simrig.plans.slices import AXIAL, DIAGONAL
from simrig.rigs.film.camera import FilmCamera
from simrig.rigs.film.motion import Motion
from simrig.rigs.film.setup import Setup
from simrig.rigs.imaging.recorder import Chart, chart_albedos, identity_of
from simrig.rigs.imaging.surface import Surface, surface_of
from simrig.rigs.timing import GantryTiming

NAME, FORMAT, VERSION, CHART = "film.json", "simrig film", 1, "chart.png"
STEP = np.radians(15.0)  # thesis section 6.2.3
BESIDE = np.radians(1.0)
_EVERY = 10  # frames between small pictures of the sample
_NEAR_DEG = 3.0  # of a specular highlight: a small picture for every other frame
_SHARPEST = 3  # frames near a step that are rendered whole
_PERCENTILE = 98.0  # of the sample, which the exposure is set by


@dataclass(frozen=True, eq=False)
class Film:
    """What is filmed.

    Attributes:
        material: a BRDF, a BTF or a tile.
        description: of the instrument.
        plan: the slices.
        effects: that are simulated.
        sample_mm: side of the sample; the instrument's diameter where None.
        spp, bounces: of a tile with structure.
        seed: of all chance.
    """

    material: Any
    description: Description
    plan: GantryPlan
    effects: tuple[str, ...]
    sample_mm: float | None = None
    spp: int = 4
    bounces: int = 1
    seed: int = 0

    @cached_property
    def surface(self) -> Surface:
        """The sample, made ready once."""
        return surface_of(
            self.material,
            spp=self.spp,
            bounces=self.bounces,
            seed=self.seed,
            steepest=self.plan.theta_max + 0.1,
        )

    def camera(self, number: int) -> tuple[FilmCamera, Motion]:
        """Return the camera of a slice, and how the arms move."""
        one = self.plan.slices[number]
        thetas = (self.plan.thetas[one.pair[0]], self.plan.thetas[one.pair[1]])
        setup = Setup.of(self.description, self.sample_mm, self.seed, thetas[1])
        camera = FilmCamera(setup, self.surface, frozenset(self.effects), self.seed)
        return camera, camera.motion(number, one, thetas)

    def about(self) -> dict[str, Any]:
        """Return what ``film.json`` says."""
        timing = GantryTiming.of(self.description.timing)  # type: ignore[attr-defined]
        optics = self.camera(0)[0].setup.optics
        said = {
            "format": FORMAT,
            "version": VERSION,
            "material": self.material.name,
            "fingerprint": identity_of(self.material),
            "plan": asdict(self.plan),
            "seed": self.seed,
            "spp": self.spp,
            "bounces": self.bounces,
            "effects": sorted(self.effects),
            "instrument": self.description.model_dump(mode="json", exclude_none=True),
            "sample_mm": optics.sample_mm,
            "chart_mm": optics.sample_mm,
            "chart_albedo": chart_albedos().tolist(),
            "seconds": timing.seconds(len(self.plan.thetas), self.plan.axial + self.plan.diagonal),
        }
        return dict(json.loads(json.dumps(said)))

    def begin(self, folder: Path) -> None:
        """Write ``film.json``, or find that it is there and says the same.

        Raises:
            SimrigError: a folder of something else, or of another film.
        """
        begin_folder(folder, NAME, self.about(), read_film)

    def run(self, folder: Path, progress: Progress | None = None) -> None:
        """Film what is missing, slice by slice; progress has frames done and in total.

        Raises:
            SimrigError: as ``begin``; no room, an unwritable folder.
        """
        self.begin(folder)
        report = progress or (lambda *_: None)
        slices = len(self.plan.slices)
        frames = self.camera(0)[0].setup.frames
        if not (folder / CHART).is_file():
            self._still(folder / CHART)
        for number, name in enumerate(video_names(self.plan)):
            if not (folder / name).is_file():

                def done(k: int, before: int = number * frames) -> None:
                    report(before + k, slices * frames)

                self.film_slice(folder / name, number, done)
            report((number + 1) * frames, slices * frames)

    def _still(self, path: Path) -> None:
        camera, motion = self.camera(0)
        frame = camera.still(motion, Chart(camera.setup.optics.sample_mm))
        with atomic_write(path) as temporary:
            cv2.imwrite(str(temporary), frame)

    def film_slice(
        self, path: Path, number: int, report: Callable[[int], None] = lambda _: None
    ) -> None:
        """Film one slice into a video; ``report`` is called with frames done."""
        camera, motion = self.camera(number)
        setup = camera.setup
        keys, samples, mean, bright = self._sampled(camera, motion)
        gains = camera.gains(motion, bright)
        whole = self.rendered_whole(camera, motion, mean)
        quality = setup.film.quality if "compression" in self.effects else 100
        size = setup.whole.sensor.pixels
        with written_video(path, setup.fps, size, quality) as video:
            for index in range(setup.frames):
                if index in whole:
                    frame = camera.frame(motion, index, float(gains[index]))
                else:
                    sample = _between(keys, samples, index)
                    frame = camera.small_frame(motion, index, sample, float(gains[index]))
                video.add(frame)
                report(index + 1)

    def _sampled(
        self, camera: FilmCamera, motion: Motion
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return small pictures of the sample, and how bright it is in every frame.

        Returns:
            Frames of the pictures (k,), the pictures (k, rows, columns, 3), the mean of the sample
            (frames,), and of the bright parts of sample and border (frames,).
        """
        frames = np.arange(camera.setup.frames)
        angles = motion.angles(frames / camera.setup.fps)
        lag = np.abs(np.mod(angles[:, 3] - angles[:, 2], TWO_PI) - np.pi)
        near = (lag < 2.0 * np.radians(_NEAR_DEG)) & (frames % 2 == 0)
        near &= motion.one.kind == DIAGONAL
        keys = np.flatnonzero((frames % _EVERY == 0) | near | (frames == frames[-1]))
        samples = camera.samples(motion, keys)
        grey = samples.mean(axis=-1).reshape(len(keys), -1)
        white = camera.white * float(np.cos(motion.thetas[0]))
        bright = np.maximum(np.percentile(grey, _PERCENTILE, axis=1), white)
        return (
            keys,
            samples,
            np.interp(frames, keys, grey.mean(axis=1)),
            np.interp(frames, keys, bright),
        )

    def rendered_whole(self, camera: FilmCamera, motion: Motion, bright: np.ndarray) -> set[int]:
        """Return the frames that processing may choose: the others are rendered small."""
        setup = camera.setup
        time = np.arange(setup.frames) / setup.fps
        poses, _ = motion.placed(time)
        phi = np.arctan2(poses[:, 1, 3], poses[:, 0, 3])
        half = 0.5 * setup.film.shutter_s.value
        ends = np.stack([time - half, time + half], axis=1).ravel()
        moved = camera.moved_pixels(motion, ends)[::2]
        steps, beside = targets(self.plan, motion.number)
        chosen: set[int] = set()
        for near in candidates(phi, steps, 5):
            chosen |= set(near[np.argsort(moved[near], kind="stable")[:_SHARPEST]].tolist())
        for near in candidates(phi, beside, 1):
            chosen |= set(near.tolist())
        for top in np.argsort(bright)[::-1][:2]:
            chosen |= {int(k) for k in (top - 1, top, top + 1) if 0 <= k < setup.frames}
        return chosen


def targets(plan: GantryPlan, number: int) -> tuple[np.ndarray, np.ndarray]:
    """Return φ_v of a slice's even steps, and beside its specular highlights, radians."""
    one = plan.slices[number]
    steps = np.arange(round(TWO_PI / STEP)) * STEP
    if one.kind == AXIAL:
        return steps, np.zeros(0)
    highlights = 0.5 * (np.pi + one.offset) + np.array([0.0, np.pi])
    beside = np.concatenate([highlights - BESIDE, highlights, highlights + BESIDE])
    return steps + highlights[0] % STEP, np.mod(beside, TWO_PI)


def filming_plan(plan: GantryPlan) -> GantryPlan:
    """Return a plan as it is filmed: every 15° at all polar angles, and beside highlights."""
    count = round(TWO_PI / STEP)
    return GantryPlan(
        plan.thetas, plan.axial, plan.diagonal, count, lowest_samples=count, highlights=True
    )


def video_names(plan: GantryPlan) -> list[str]:
    """Return the names of the videos of a plan's slices, in their order."""
    return [f"slice-{number + 1:02d}.avi" for number in range(len(plan.slices))]


def read_film(folder: str | Path) -> dict[str, Any]:
    """Return what a film's ``film.json`` says.

    Raises:
        SimrigError: there is none, it is damaged, or of another version.
    """
    return read_facts(Path(folder), NAME, FORMAT, VERSION, ("plan", "instrument"))


def _between(keys: np.ndarray, samples: np.ndarray, index: int) -> np.ndarray:
    after = int(np.clip(np.searchsorted(keys, index), 1, len(keys) - 1))
    share = (index - keys[after - 1]) / (keys[after] - keys[after - 1])
    return np.asarray((1.0 - share) * samples[after - 1] + share * samples[after])

"""From a video to the frames of a slice that are taken (thesis section 6.2.3).

The border, with its dot, says in every frame where the camera stands: so neither dropped frames nor
a late start nor another length matter, as long as the arm comes by.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from simrig.core.colour import decode_srgb
from simrig.core.errors import SimrigError
from simrig.core.progress import Progress
from simrig.files.checkpoint import Piece
from simrig.files.video import read_frames
from simrig.imaging.camera import Camera
from simrig.imaging.frames import blur_metric, candidates, chosen_frames, steady
from simrig.imaging.marks import frame_corners, search_frame
from simrig.rigs.film.setup import Setup

REDUCED = 4  # pixels in one where the border is looked for first
FEWEST = 12  # frames that a slice has to have
_BESIDE_PX = 64  # around the border: the black material
_BRIGHT = 8.0  # times the black material: the border at least
_CODES = decode_srgb(np.arange(256) / 255.0)


@dataclass(frozen=True, eq=False)
class Selected:
    """The frames of one slice that are taken, cut to what is needed of them.

    Attributes:
        numbers: (n,) in the video.
        frames: (n, height, width, 3) uint8, red first.
        corner: column and row of the cut in the frame.
        marks: (n, 4, 2) the border's outer corners, roughly, in pixels of the whole frame.
        count: frames of the video.
        notes: what is worth saying.
    """

    numbers: np.ndarray
    frames: np.ndarray
    corner: np.ndarray
    marks: np.ndarray
    count: int
    notes: list[str] = field(default_factory=list)

    def as_piece(self) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        """Return plain values and arrays that a checkpoint keeps."""
        names = ("numbers", "frames", "corner", "marks")
        return {"count": self.count, "notes": self.notes}, {n: getattr(self, n) for n in names}

    @classmethod
    def of_piece(cls, piece: Piece) -> Selected:
        """Return what a checkpoint kept."""
        numbers, frames, corner, marks = (
            piece.arrays[name] for name in ("numbers", "frames", "corner", "marks")
        )
        said = piece.record
        return cls(numbers, frames, corner, marks, int(said["count"]), list(said["notes"]))


@dataclass(frozen=True, eq=False)
class _Seen:
    """What all frames of a video show, at reduced size.

    Attributes:
        phi: (n,) azimuth of the camera, NaN where the border is not seen.
        bright: (n,) of the sample over the black material.
        marks: (n, 4, 2) outer corners of the border in pixels, from -x +y of the sample clockwise.
    """

    phi: np.ndarray
    bright: np.ndarray
    marks: np.ndarray


def select_frames(
    path: Path,
    setup: Setup,
    steps: np.ndarray,
    beside: np.ndarray,
    theta_v: float,
    progress: Progress | None = None,
) -> Selected:
    """Return the frames of a video that are taken.

    Args:
        path: of the video of one slice.
        setup: the instrument.
        steps, beside: azimuths of the camera that are wanted, radians (``recorder.targets``).
        theta_v: polar angle of the camera, radians.
        progress: called with frames looked at and the expected number.

    Raises:
        SimrigError: no video, frames of another size, or too few that show the border whole.
    """
    report = progress or (lambda *_: None)
    seen = _looked(path, setup, theta_v, report)
    whole = np.isfinite(seen.phi)
    if whole.sum() < FEWEST:
        raise SimrigError(
            f"'{path.name}' shows the border whole in {int(whole.sum())} of {len(whole)} frames, "
            f"{FEWEST} are needed: film the slice again with the border in the picture"
        )
    wanted = {int(k) for near in candidates(seen.phi, steps) for k in near}
    wanted |= {int(k) for near in candidates(seen.phi, beside, 0) for k in near}
    wanted |= {int(k) for k in np.argsort(np.where(whole, seen.bright, -np.inf))[::-1][:2]}
    low, high = _cut(seen.marks[sorted(wanted)], setup)
    frames, blur = {}, {}
    for number, frame in read_frames(path, wanted):
        part = frame[low[1] : high[1], low[0] : high[0], ::-1]
        frames[number] = part
        blur[number] = blur_metric(_sample(part, seen.marks[number] - low))
    taken, missed = chosen_frames(seen.phi, steps, beside, seen.bright, blur)
    notes = []
    if len(whole) < 0.98 * setup.frames:
        notes.append(f"{path.name}: {len(whole)} of {setup.frames} frames")
    if not whole.all():
        notes.append(f"{path.name}: the border is not seen whole in {int((~whole).sum())} frames")
    if missed:
        notes.append(f"{path.name}: no frame near {missed} of {len(steps)} steps of azimuth")
    if len(taken) < FEWEST:
        raise SimrigError(
            f"'{path.name}' has {len(taken)} frames near the steps of azimuth, {FEWEST} are "
            "needed: film the whole slice again"
        )
    return Selected(
        np.array(taken),
        np.array([frames[k] for k in taken]),
        low,
        seen.marks[taken],
        len(whole),
        notes,
    )


def linear(frame: np.ndarray) -> np.ndarray:
    """Return the linear values of eight bits by the curve of sRGB."""
    return np.asarray(_CODES[frame])


def located(
    frame: np.ndarray, setup: Setup, corners: np.ndarray, theta_v: float
) -> np.ndarray | None:
    """Return the border's outer corners in a frame, roughly, (4, 2) pixels in the sample's order.

    Args:
        frame: (height, width, 3) uint8, blue first.
        setup: the instrument.
        corners: (4, 2) mm.
        theta_v: polar angle of the camera, radians, about.

    Returns:
        None where border and dot are not seen whole.

    Raises:
        SimrigError: a frame of another size than the camera's.
    """
    size = np.array(setup.whole.sensor.pixels)
    if frame.shape[:2] != (size[1], size[0]):
        raise SimrigError(
            f"frames of {frame.shape[1]} × {frame.shape[0]} pixels, the instrument's camera has "
            f"{size[0]} × {size[1]}"
        )
    window = np.minimum(1.2 * np.array(setup.window(theta_v)), size) // (2 * REDUCED)
    low = ((size // (2 * REDUCED) - window) * REDUCED).astype(int)
    grey = _reduced(frame[low[1] : size[1] - low[1], low[0] : size[0] - low[0]])
    shown = _CODES[grey]
    # most of it is the black material; what is bright counts no more than the border
    shown = np.minimum(shown / max(float(np.percentile(shown, 30.0)), 1e-6), _BRIGHT)
    try:
        found = _oriented(search_frame(shown), shown, setup, corners)
    except SimrigError:
        return None
    return (found + 0.5) * REDUCED - 0.5 + low


def _reduced(frame: np.ndarray) -> np.ndarray:
    size = (frame.shape[1] // REDUCED, frame.shape[0] // REDUCED)
    small = cv2.resize(frame, size, interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.cvtColor(small, cv2.COLOR_BGR2GRAY))


def _looked(path: Path, setup: Setup, theta_v: float, report: Progress) -> _Seen:
    """Look at all frames of a video, reduced."""
    nominal = Camera(setup.whole.intrinsics, np.zeros(5), np.eye(4))
    corners = frame_corners(setup.outer_mm, setup.outer_mm)
    rolls, views, bright, marks = [], [], [], []
    for number, frame in read_frames(path):
        try:
            found = located(frame, setup, corners, theta_v)
        except SimrigError as error:
            raise SimrigError(f"'{path.name}' has {error}") from error
        pose, seen = np.full((4, 4), np.nan), np.full((4, 2), np.nan)
        if found is not None:
            try:
                pose = np.linalg.inv(nominal.posed(corners, found).world_to_camera)
                seen = found
            except SimrigError:
                pass  # no pose explains what was taken for the border
        marks.append(seen)
        rolls.append(np.arctan2(-pose[0, 0], pose[1, 0]))
        views.append(np.arctan2(pose[1, 3], pose[0, 3]))
        bright.append(_brightness(_reduced(frame), (seen + 0.5) / REDUCED - 0.5))
        report(number + 1, setup.frames)
    # the camera keeps its turn about its own axis, which pictures tell far better than its azimuth
    offset = np.exp(1j * (np.array(views) - np.array(rolls)))
    mounted = float(np.angle(_median(offset.real) + 1j * _median(offset.imag)))
    return _Seen(steady(np.array(rolls) + mounted), np.array(bright), np.array(marks))


def _median(values: np.ndarray) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else 0.0


def _oriented(found: np.ndarray, grey: np.ndarray, setup: Setup, corners: np.ndarray) -> np.ndarray:
    """Return corners in the sample's order: the one of four turns whose dot is brightest."""
    dot = np.array(setup.film.dot_mm, dtype=np.float64)
    best, brightest = found, -1.0
    for turn in range(4):
        rolled = np.roll(found, turn, axis=0)
        matrix = cv2.getPerspectiveTransform(corners.astype(np.float32), rolled.astype(np.float32))
        at = cv2.perspectiveTransform(dot.reshape(1, 1, 2), matrix).ravel()
        column, row = np.rint(at).astype(int)
        if not (1 <= column < grey.shape[1] - 1 and 1 <= row < grey.shape[0] - 1):
            continue
        shown = float(grey[row - 1 : row + 2, column - 1 : column + 2].mean())
        if shown > brightest:
            best, brightest = rolled, shown
    if brightest < 0.0:
        raise SimrigError("the dot is not in the picture")
    return best


def _brightness(grey: np.ndarray, found: np.ndarray) -> float:
    """Return how bright the sample is over the border, linear: exposures cancel."""
    if not np.isfinite(found).all():
        return float("nan")
    values = []
    for share in ((0.0, 0.7), (0.84, 0.96)):  # of the way from the centre to the outer corners
        mask = np.zeros(grey.shape, np.uint8)
        for part, shown in zip(share[::-1], (1, 0), strict=True):
            at = found.mean(axis=0) + part * (found - found.mean(axis=0))
            cv2.fillConvexPoly(mask, np.rint(at).astype(np.int32), shown)
        values.append(float(_CODES[grey[mask > 0]].mean()) if mask.any() else np.nan)
    return values[0] / max(values[1], 1e-6)


def _cut(marks: np.ndarray, setup: Setup) -> tuple[np.ndarray, np.ndarray]:
    """Return the first column and row, and those after the last, that frames are cut to."""
    size = np.array(setup.whole.sensor.pixels)
    low = np.floor(marks.min(axis=(0, 1))).astype(int) - _BESIDE_PX
    high = np.ceil(marks.max(axis=(0, 1))).astype(int) + _BESIDE_PX
    return np.maximum(low, 0), np.minimum(high, size)


def _sample(frame: np.ndarray, marks: np.ndarray) -> np.ndarray:
    """Return the part of a frame with border and sample, grey."""
    low = np.maximum(np.floor(marks.min(axis=0)).astype(int) - 8, 0)
    high = np.ceil(marks.max(axis=0)).astype(int) + 8
    return np.asarray(frame[low[1] : high[1], low[0] : high[0]].mean(axis=-1))


def fingerprint_of(path: Path) -> dict[str, Any]:
    """Return what tells a video from another of its name.

    Raises:
        SimrigError: there is none.
    """
    try:
        about = os.stat(path)
    except OSError as error:
        raise SimrigError(f"there is no video '{path}'") from error
    return {"name": path.name, "bytes": about.st_size, "changed": about.st_mtime_ns}

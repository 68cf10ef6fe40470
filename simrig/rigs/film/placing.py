"""Where camera and light stand in the frames of a slice (thesis section 6.2.3).

The camera's place follows from the border's corners and the lens; the light's azimuth from the
camera's, since a gear couples the arms.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from simrig.core.errors import SimrigError
from simrig.directions.spherical import TWO_PI, to_vector
from simrig.imaging.camera import Camera, calibrate
from simrig.imaging.frames import apart
from simrig.imaging.marks import find_frame, frame_corners
from simrig.plans.gantry import GantryPlan
from simrig.rigs.film.compensation import Light
from simrig.rigs.film.motion import coupled
from simrig.rigs.film.selection import FEWEST, Selected, linear
from simrig.rigs.film.setup import Setup

_BRIGHTER = 1.3  # than the middles of its edges, no place of the border is
_IN_BORDER = 0.9  # of the way from the centre to the outer edge
_REACH = 5.0  # pixels of the border from where it is found roughly
_EXPLAINED = 0.5  # pixels of the corners from where a pose has them
_CALIBRATED_BY = 96  # frames
_ROUNDS, _OUTLIER = 4, 4.0  # of a calibration; times the median error
_OFF_DEG = 4.0  # of the camera from where a slice has it
_LEAST_STEP = 1e-4  # radians between frames of a slice


@dataclass(frozen=True, eq=False)
class Frame:
    """A frame whose directions are known.

    Attributes:
        number: of the slice.
        index: of the frame among those selected of the slice.
        camera: in the frame of the border, z = 0.
        phi_v: azimuth of the camera, radians in [0, 2π).
        light_mm: where the light stands.
        light: exposure and light; None until they are read.
    """

    number: int
    index: int
    camera: Camera
    phi_v: float
    light_mm: np.ndarray
    light: Light | None = None


def calibrated(selected: Sequence[Selected], setup: Setup) -> tuple[Camera, float]:
    """Return the camera without its place, and the error of its calibration in pixels.

    Raises:
        SimrigError: too few frames in which the border is found.
    """
    corners = frame_corners(setup.outer_mm, setup.outer_mm)
    places = [(s, k) for s in selected for k in range(len(s.numbers))]
    step = max(1, len(places) // _CALIBRATED_BY)
    lens = nominal = Camera(setup.whole.intrinsics, np.zeros(5), np.eye(4))
    error = np.nan
    for _ in range(2):  # edges are straight once the lens is known
        found = [m for s, k in places[::step] if (m := marks_of(s, k, lens)) is not None]
        off = np.array([_unexplained(lens, corners, marks) for marks in found])
        # arms before the border and blurred frames are no views of it
        most = max(_EXPLAINED, 3.0 * float(np.median(off))) if len(off) else 0.0
        marks = [m for m, o in zip(found, off, strict=True) if o <= most]
        if len(marks) < FEWEST:
            raise SimrigError(f"the border is found in {len(marks)} frames, {FEWEST} are needed")
        size = setup.whole.sensor.pixels
        for _ in range(_ROUNDS):
            cameras, error = calibrate(corners, marks, size, nominal, distorted=True)
            lens = Camera(cameras[0].matrix, cameras[0].distortion, np.eye(4))
            off = np.array([_unexplained(lens, corners, own) for own in marks])
            keep = off <= _OUTLIER * float(np.median(off))
            if keep.all() or keep.sum() < FEWEST:
                break
            marks = [own for own, good in zip(marks, keep, strict=True) if good]
    return lens, float(error)


def marks_of(one: Selected, index: int, lens: Camera) -> np.ndarray | None:
    """Return the border's corners in a frame, (4, 2) pixels; None where it is not found."""
    grey, rough = linear(one.frames[index]).mean(axis=-1), one.marks[index] - one.corner
    # in a highlight the sample outshines the border, and its edges would be taken for the border's
    middle = rough.mean(axis=0) + _IN_BORDER * (rough - rough.mean(axis=0))
    column, row = np.rint(0.5 * (middle + np.roll(middle, 1, axis=0))).astype(int).T
    try:
        level = _BRIGHTER * float(grey[row, column].max())
        found = find_frame(np.minimum(grey, level), rough, shifted(lens, one.corner), _REACH)
    except (SimrigError, IndexError):
        return None
    return found.pixels + one.corner


def _unexplained(lens: Camera, corners: np.ndarray, marks: np.ndarray) -> float:
    """Return by how many pixels a pose leaves the corners off, at most."""
    try:
        seen = lens.posed(corners, marks).project(np.pad(corners, ((0, 0), (0, 1))))
    except SimrigError:
        return np.inf
    return float(np.linalg.norm(seen - marks, axis=1).max())


def shifted(camera: Camera, corner: np.ndarray) -> Camera:
    """Return a camera whose pixels count from a cut's corner."""
    matrix = camera.matrix.copy()
    matrix[:2, 2] -= corner
    return Camera(matrix, camera.distortion, camera.world_to_camera)


def placed(
    chosen: Selected,
    plan: GantryPlan,
    number: int,
    lens: Camera,
    setup: Setup,
    name: str,
    notes: list[str],
) -> list[Frame]:
    """Return the frames of a slice with their directions, ascending by the camera's azimuth.

    Args:
        chosen: frames of the slice.
        plan, number: which slice it is.
        lens: the camera without its place.
        setup: the instrument.
        name: of the video, for messages.
        notes: what is worth saying is added.

    Raises:
        SimrigError: another polar angle than the slice's.
    """
    one, thetas, lost = plan.slices[number], [plan.thetas[k] for k in plan.slices[number].pair], 0
    corners = frame_corners(setup.outer_mm, setup.outer_mm)
    cameras: list[tuple[int, Camera]] = []
    for index in range(len(chosen.numbers)):
        marks = marks_of(chosen, index, lens)
        if marks is None or _unexplained(lens, corners, marks) > _EXPLAINED:
            lost += 1
        else:
            cameras.append((index, lens.posed(corners, marks)))
    if lost:
        notes.append(f"{name}: the border is not found in {lost} chosen frames")
    if not cameras:
        return []
    centres = np.array([camera.centre_mm for _, camera in cameras])
    theta = np.arctan2(np.hypot(*centres[:, :2].T), centres[:, 2])
    off = float(np.degrees(np.median(theta) - thetas[1]))
    if abs(off) > _OFF_DEG:
        raise SimrigError(
            f"'{name}' shows the camera at {np.degrees(np.median(theta)):.0f}°, slice "
            f"{number + 1} has it at {np.degrees(thetas[1]):.0f}°: give the videos in the "
            "order of the plan"
        )
    phi = np.mod(np.arctan2(centres[:, 1], centres[:, 0]), TWO_PI)
    phi_i = np.mod(coupled(one, phi), TWO_PI)
    angles = np.stack([*(np.full(len(phi), t) for t in thetas), phi_i, phi], axis=1)
    free = setup.optics.moves.placed(angles).reached
    lights = setup.optics.moves.light_mm * to_vector(angles[:, 0], phi_i)
    hidden = int((~free).sum())
    if hidden:
        notes.append(f"{name}: the light's arm hides the view in {hidden} frames")
    found: list[Frame] = []
    for k in np.argsort(phi):
        index, camera = cameras[k]
        near = found and abs(float(apart(phi[k : k + 1], found[-1].phi_v)[0])) < _LEAST_STEP
        if free[k] and not near:
            found.append(Frame(number, index, camera, float(phi[k]), lights[k]))
    return found

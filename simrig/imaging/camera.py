"""A camera: where points of the sample's frame fall in its pictures, and how that is found.

Lengths are mm, z is the normal of the reference plane. Pixels are counted as OpenCV does: the
centre of the first is (0, 0). The camera looks along its own z, x to the right and y down;
distortion is OpenCV's (k1, k2, p1, p2, k3), from undistorted to distorted.

Source: thesis appendix C.2; Zhang, A flexible new technique for camera calibration, 2000.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from simrig.core.errors import SimrigError
from simrig.imaging.checks import finite_array

_FEWEST_MARKS, _FEWEST_VIEWS = 4, 3
_UNTOLD = 0.2  # relative uncertainty of a focal length that is no knowledge
_EXACT = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 200, 1e-12)


@dataclass(frozen=True, eq=False)
class Camera:
    """One view.

    Attributes:
        matrix: intrinsics A of equation (C.1), (3, 3), pixels.
        distortion: (5,) k1, k2, p1, p2, k3.
        world_to_camera: (4, 4), rotation and translation in mm.

    Raises:
        SimrigError: shapes or numbers that are no camera's.
    """

    matrix: np.ndarray
    distortion: np.ndarray
    world_to_camera: np.ndarray

    def __post_init__(self) -> None:
        for name, shape in (("matrix", (3, 3)), ("distortion", (5,)), ("world_to_camera", (4, 4))):
            given = finite_array(getattr(self, name), f"the camera's {name}", (len(shape),))
            if given.shape != shape:
                raise SimrigError(f"the camera's {name} must be {shape}, got {given.shape}")
            object.__setattr__(self, name, given.astype(np.float64))
        turn = self.world_to_camera[:3, :3]
        if not np.allclose(turn @ turn.T, np.eye(3), atol=1e-5) or np.linalg.det(turn) < 0.0:
            raise SimrigError("the camera's world_to_camera must hold a rotation")
        if self.matrix[0, 0] <= 0.0 or self.matrix[1, 1] <= 0.0:
            raise SimrigError("the camera's focal lengths must be above 0")

    @property
    def centre_mm(self) -> np.ndarray:
        """Where it stands, (3,)."""
        return -self.world_to_camera[:3, :3].T @ self.world_to_camera[:3, 3]

    def project(self, points_mm: np.ndarray) -> np.ndarray:
        """Return where points fall, pixels.

        Args:
            points_mm: (..., 3).

        Returns:
            (..., 2); NaN of points behind the camera.
        """
        seen = points_mm @ self.world_to_camera[:3, :3].T + self.world_to_camera[:3, 3]
        depth = np.where(seen[..., 2] > 0.0, seen[..., 2], np.nan)
        x, y = seen[..., 0] / depth, seen[..., 1] / depth
        if np.any(self.distortion):
            x, y = _distorted(x, y, self.distortion)
        m = self.matrix
        return np.stack([m[0, 0] * x + m[0, 1] * y + m[0, 2], m[1, 1] * y + m[1, 2]], axis=-1)

    def straight(self, pixels: np.ndarray) -> np.ndarray:
        """Return pixels (n, 2) as a lens without distortion would have them."""
        shaped = np.asarray(pixels, dtype=np.float64).reshape(-1, 1, 2)
        if not np.any(self.distortion):
            return shaped[:, 0]
        return cv2.undistortPointsIter(
            shaped, self.matrix, self.distortion, np.eye(3), self.matrix, _EXACT
        )[:, 0]

    def bent(self, pixels: np.ndarray) -> np.ndarray:
        """Undo ``straight``."""
        x, y, _ = np.linalg.solve(self.matrix, _homogeneous(pixels).T)
        x, y = _distorted(x, y, self.distortion)
        return _dehomogenised(self.matrix @ np.stack([x, y, np.ones_like(x)])).T

    def posed(self, marks_mm: np.ndarray, pixels: np.ndarray) -> Camera:
        """Return the camera where it sees marks as it does.

        Args:
            marks_mm: (n, 3) or, on the reference plane, (n, 2); at least four.
            pixels: (n, 2) of them.

        Raises:
            SimrigError: too few marks, or marks that no pose explains.
        """
        marks = _marks(marks_mm)
        if len(marks) < _FEWEST_MARKS or len(marks) != len(pixels):
            raise SimrigError(f"a pose needs at least four marks, got {len(marks)}")
        flat = np.ptp(marks[:, 2]) == 0.0
        method = cv2.SOLVEPNP_IPPE if flat else cv2.SOLVEPNP_SQPNP
        shaped = np.asarray(pixels, dtype=np.float64).reshape(-1, 1, 2)
        lens = self.matrix, self.distortion
        _, turns, shifts, _ = cv2.solvePnPGeneric(marks, shaped, *lens, flags=method)
        starts = list(zip(turns, shifts, strict=True))
        stands = self.world_to_camera  # near it where a rig says so
        if np.all(marks @ stands[2, :3] + stands[2, 3] > 0.0):
            starts.append((cv2.Rodrigues(stands[:3, :3])[0], stands[:3, 3:].copy()))
        refined = [cv2.solvePnPRefineLM(marks, shaped, *lens, *start, _EXACT) for start in starts]
        if not refined:
            raise SimrigError("no pose of the camera explains where the marks are seen")

        def off(camera: Camera) -> tuple[bool, float]:
            # a plane has two poses that look much alike; nobody sees its marks from below
            distance = np.linalg.norm(camera.project(marks) - shaped[:, 0])
            below = flat and bool(camera.centre_mm[2] < marks[0, 2])
            return below, float(np.nan_to_num(distance, nan=np.inf))

        return min((Camera(*lens, _pose(*pose)) for pose in refined), key=off)


def calibrate(
    marks_mm: Any,
    pixels: Sequence[np.ndarray],
    size: tuple[int, int],
    guess: Camera | None = None,
    distorted: bool = False,
) -> tuple[list[Camera], float]:
    """Find a camera from the marks of several views of them.

    Args:
        marks_mm: (n, 2) on the reference plane, at least four.
        pixels: of every view, (n, 2) of the marks.
        size: width and height of the pictures.
        guess: starts the search, and stays what it is where the views cannot tell: the principal
            point always, since views from afar leave it undetermined.
        distorted: also find k1.

    Returns:
        The camera in every view, and the root-mean-square distance in pixels between marks and
        where the camera would see them.

    Raises:
        SimrigError: too few marks or views, or a search that fails.
    """
    marks = _marks(marks_mm)
    if len(marks) < _FEWEST_MARKS or len(pixels) < _FEWEST_VIEWS:
        raise SimrigError(
            f"calibration needs at least {_FEWEST_MARKS} marks in {_FEWEST_VIEWS} views, got "
            f"{len(marks)} in {len(pixels)}"
        )
    seen = [finite_array(view, "the marks of a view", (2,)) for view in pixels]
    if any(view.shape != (len(marks), 2) for view in seen):
        raise SimrigError(f"every view needs {len(marks)} marks of two coordinates")
    flags = cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST
    flags |= 0 if distorted else cv2.CALIB_FIX_K1
    flags |= cv2.CALIB_FIX_ASPECT_RATIO | cv2.CALIB_FIX_PRINCIPAL_POINT
    points = [marks.astype(np.float32)] * len(seen)
    flags |= cv2.CALIB_USE_INTRINSIC_GUESS
    if guess is not None:  # its tangential distortion stays
        matrix, bend = guess.matrix.copy(), guess.distortion.copy()
        flags = (flags & ~cv2.CALIB_ZERO_TANGENT_DIST) | cv2.CALIB_FIX_TANGENT_DIST
    else:
        narrow = [view.astype(np.float32) for view in seen]
        matrix = np.asarray(cv2.initCameraMatrix2D(points, narrow, size, 1.0), dtype=np.float64)
        bend = np.zeros(5)
    try:
        error, fitted, bends, turns, shifts = cv2.calibrateCamera(
            points,
            [view.astype(np.float32)[:, None] for view in seen],
            size,
            matrix,
            bend,
            flags=flags,
            criteria=_EXACT,
        )
    except cv2.error as failed:
        raise SimrigError(
            "calibration failed: the marks must be seen from different directions, and belong to "
            f"one plane ({failed.err})"
        ) from failed
    told = guess is not None or _focal_uncertainty(points, turns, shifts, fitted) < _UNTOLD
    if not (told and np.all(np.isfinite(fitted)) and min(fitted[0, 0], fitted[1, 1]) > 0.0):
        raise SimrigError(
            "the views do not tell the camera's focal length: see the marks from more different "
            "directions (a turn in the picture's plane tells nothing)"
        )
    # OpenCV takes marks in float32: poses are found again in float64
    lens = np.asarray(fitted), np.ravel(bends)[:5]
    placed = [Camera(*lens, _pose(*pose)) for pose in zip(turns, shifts, strict=True)]
    return [one.posed(marks, view) for one, view in zip(placed, seen, strict=True)], float(error)


def _focal_uncertainty(
    points: list[np.ndarray], turns: Any, shifts: Any, matrix: np.ndarray
) -> float:
    """Return the relative uncertainty of the focal length for marks known to 0.1 pixels."""
    information = np.zeros((1 + 6 * len(points), 1 + 6 * len(points)))
    for number, (marks, turn, shift) in enumerate(zip(points, turns, shifts, strict=True)):
        _, slopes = cv2.projectPoints(marks, turn, shift, matrix, np.zeros(5))
        own = np.zeros((len(slopes), len(information)))
        own[:, 0] = slopes[:, 6] + slopes[:, 7]
        own[:, 1 + 6 * number : 7 + 6 * number] = slopes[:, :6]
        information += own.T @ own
    scale = 1.0 / np.sqrt(np.maximum(np.diag(information), 1e-30))  # units of poses and pixels
    sizes, axes = np.linalg.eigh(information * np.outer(scale, scale))
    variance = np.sum(axes[0] ** 2 / np.maximum(sizes, 1e-15))  # never none where nothing is told
    return float(0.1 * np.sqrt(variance) * scale[0] / abs(matrix[0, 0]))


def from_pose(matrix: Any, distortion: Any, camera_to_world: Any) -> Camera:
    """Return the camera of a recording's pose: intrinsics, distortion, camera_to_world in mm."""
    placed = finite_array(camera_to_world, "camera_to_world", (2,))
    if placed.shape != (4, 4):
        raise SimrigError(f"camera_to_world must be (4, 4), got {placed.shape}")
    return Camera(matrix, distortion, np.linalg.inv(placed))


def homography(source: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Return the projective transformation (3, 3) that takes points to others, in float64.

    Args:
        source, target: (n, 2), n >= 4; the least squares of equation (C.2) where n > 4.

    Raises:
        SimrigError: fewer points, or points on a line.
    """
    source, target = (np.asarray(p, dtype=np.float64) for p in (source, target))
    if source.shape != target.shape or source.shape[0] < _FEWEST_MARKS or source.shape[1] != 2:
        raise SimrigError(f"a homography needs four pairs of points, got {source.shape}")
    found, _ = cv2.findHomography(source, target)
    if found is None or not np.isfinite(found).all() or abs(np.linalg.det(found)) < 1e-15:
        raise SimrigError("no homography: the points are on a line")
    return found


def transformed(matrix: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return points (n, 2) under a projective transformation (3, 3)."""
    return _dehomogenised(matrix @ _homogeneous(points).T).T


def _homogeneous(points: np.ndarray) -> np.ndarray:
    return np.concatenate([points, np.ones((len(points), 1))], axis=1)


def _dehomogenised(points: np.ndarray) -> np.ndarray:
    return points[:2] / points[2]


def _distorted(x: np.ndarray, y: np.ndarray, k: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    r = x * x + y * y
    radial = 1.0 + r * (k[0] + r * (k[1] + r * k[4]))
    bent_x = x * radial + 2.0 * k[2] * x * y + k[3] * (r + 2.0 * x * x)
    bent_y = y * radial + k[2] * (r + 2.0 * y * y) + 2.0 * k[3] * x * y
    return bent_x, bent_y


def _marks(marks_mm: Any) -> np.ndarray:
    marks = finite_array(marks_mm, "the marks", (2,)).astype(np.float64)
    if marks.shape[1] == 2:
        marks = np.concatenate([marks, np.zeros((len(marks), 1))], axis=1)
    if marks.shape[1] != 3:
        raise SimrigError(f"marks have two or three coordinates, got {marks.shape[1]}")
    if np.linalg.matrix_rank(marks[:, :2] - marks[:, :2].mean(axis=0)) < 2:
        raise SimrigError("the marks are on a line")
    return marks


def _pose(turn: np.ndarray, shift: np.ndarray) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = cv2.Rodrigues(turn)[0], np.ravel(shift)
    return pose

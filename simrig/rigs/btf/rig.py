"""A virtual BTF measurement: registered images of a periodic tile for every pair of directions.

Thesis sections 1.1.1 and A.1. For each pair the camera looks along omega_v from afar, and a
directional light shines along omega_i. Texel (r, c) collects the rays through its area of the
plane z = 0; f_r is the radiance over the irradiance of that plane. A flat diffuser of albedo a
measures a / π. What stands above the plane moves with the view (parallax), as in real BTFs.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np

import simrig
from simrig.btf.grid import repeated_pair
from simrig.btf.stack import BtfStack, check_angles
from simrig.core import backend
from simrig.core.effects import DEFAULT_TOLERANCE, Tolerance, parse_tolerance
from simrig.core.errors import SimrigError
from simrig.core.progress import Progress
from simrig.directions.schemes import HemisphereScheme, hemisphere_81
from simrig.directions.spherical import to_vector
from simrig.files.btf.hdf5 import BtfLayout, read_btf
from simrig.files.btf.recording import BtfRecording
from simrig.files.checkpoint import recording_folder
from simrig.mesostructure.tile import Tile
from simrig.rigs.btf.bounces import plan_bounces
from simrig.rigs.btf.camera import TileCamera
from simrig.rigs.btf.orders import MOST_BOUNCES

AUTO = "auto"
STANDARD_ERROR = "standard_error"  # per pair, 1/sr
_STEEPEST_DEG = 89.0


@dataclass(frozen=True, eq=False)
class BtfView:
    """One view direction and its lights: consecutive pairs of a plan."""

    number: int
    first: int
    omega_v: np.ndarray
    lights: np.ndarray

    @property
    def pairs(self) -> slice:
        """Where its images stand in the stack."""
        return slice(self.first, self.first + len(self.lights))


def btf_angles(scheme: HemisphereScheme | None = None) -> np.ndarray:
    """Return all pairs of a scheme, view by view: theta_i, theta_v, phi_i, phi_v, (n², 4) radians.

    Args:
        scheme: of both sides; 81 × 81 directions when not given.
    """
    angles = (scheme or hemisphere_81()).pair_angles(reciprocal=False)
    return by_view(angles)


def by_view(angles: np.ndarray) -> np.ndarray:
    """Return pairs in the order in which they are measured: by view, else as they stood."""
    return angles[view_order(angles)]


def view_order(angles: np.ndarray) -> np.ndarray:
    """Return the numbers of the pairs in the order of ``by_view``."""
    _, first, which = np.unique(angles[:, [1, 3]], axis=0, return_index=True, return_inverse=True)
    return np.argsort(first[which.ravel()], kind="stable")


def stack_bytes(pairs: int, resolution: tuple[int, int]) -> int:
    """Return the bytes of the images of a measurement in float16.

    Args:
        pairs: of directions, one image each.
        resolution: (height, width) in texels.
    """
    return int(pairs) * resolution[0] * resolution[1] * 3 * 2


def measure_btf(
    tile: Tile,
    angles: np.ndarray | None = None,
    resolution: int | tuple[int, int] = 128,
    spp: int = 16,
    *,
    bounces: int | str = AUTO,
    tolerance: Tolerance | None = None,
    seed: int = 0,
    path: str | Path | None = None,
    dtype: type = np.float16,
    variant: str = "auto",
    progress: Progress | None = None,
) -> BtfStack:
    """Measure the BTF of a tile.

    Args:
        angles: (n, 4) theta_i, theta_v, phi_i, phi_v in radians, polar angles up to 89°; all pairs
            of 81 directions when not given.
        resolution: (height, width) in texels, or the width of a tile with square texels.
        bounces: how often light is reflected at most, or ``"auto"``: as the tolerance needs.
        tolerance: for ``"auto"``; ΔE 0.5 when not given.
        seed: of the samples. The same arguments give the same bits.
        path: an HDF5 file to write to, view by view. An interrupted measurement leaves its part,
            and the same call goes on from it. Without a path the images stay in memory.
        dtype: of the stored values, ``np.float16`` or ``np.float32``.
        variant: Mitsuba variant, RGB.

    Returns:
        The stack, in the order of ``by_view(angles)``. Its provenance says how it came about, and
        ``standard_error`` the root mean square over all texels of the standard error that two
        halves of the samples give, in 1/sr.

    Raises:
        SimrigError: arguments out of range, or a part of another measurement at ``path``.
    """
    angles = btf_angles() if angles is None else by_view(checked_plan(angles))
    shape = resolution_of(tile, resolution)
    if dtype not in (np.float16, np.float32):
        raise SimrigError(f"a BTF is stored as float16 or float32, not as {np.dtype(dtype)}")
    backend.select(variant)
    if bounces == AUTO:
        allowed = tolerance or parse_tolerance(DEFAULT_TOLERANCE)
        plan = plan_bounces(tile, angles, allowed, resolution=shape, spp=spp, seed=seed)
        bounces = int(plan.settings["bounces"])
    layout = btf_layout(tile, angles, shape, spp, checked_bounces(bounces), seed, dtype)
    folder = None if path is None else recording_folder(path)
    recording = record_btf(tile, layout, folder, progress)
    provenance = layout.said | {STANDARD_ERROR: _root_mean_square(recording.notes[STANDARD_ERROR])}
    if path is None:
        return replace(recording.stack(), provenance=provenance)
    recording.save(path)
    recording.remove()
    return replace(read_btf(path), provenance=provenance)


def btf_layout(
    tile: Tile,
    angles: np.ndarray,
    resolution: tuple[int, int],
    spp: int,
    bounces: int,
    seed: int,
    dtype: type = np.float16,
) -> BtfLayout:
    """Return what a measurement will hold and how it comes about; see ``measure_btf``."""
    provenance = {
        "rig": "virtual BTF",
        "tile": {"name": tile.name, "triangles": tile.triangles, "height_mm": tile.height_mm},
        **tile.origin,
        "spp": spp,
        "bounces": bounces,
        "seed": seed,
        "versions": {"simrig": simrig.__version__, "mitsuba": mi.__version__},
        "variant": mi.variant(),
    }
    return BtfLayout.of(angles, resolution, tile.size_mm, tile.name, provenance, dtype)


def record_btf(
    tile: Tile,
    layout: BtfLayout,
    checkpoint: Path | None = None,
    progress: Progress | None = None,
) -> BtfRecording:
    """Record the images of a tile, view by view; those that a checkpoint keeps are taken from it.

    Args:
        layout: of ``btf_layout``, pairs in the order of ``by_view``.
        checkpoint: folder that keeps every view; None keeps the images in memory.
    """
    angles, how = layout.angles, layout.said
    unique, lights = np.unique(angles[:, [0, 2]], axis=0, return_inverse=True)
    views = list(_views(angles, lights.ravel()))
    steepest = float(np.degrees(angles[:, :2].max()))
    towards = to_vector(unique[:, 0], unique[:, 1])
    camera = TileCamera(
        tile, towards, steepest, layout.resolution, how["spp"], how["seed"], len(views)
    )
    recording = BtfRecording(checkpoint, layout)
    missing = set(recording.missing.tolist())
    for done, view in enumerate(views):
        if progress is not None:
            progress(done, len(views))
        if missing.isdisjoint(range(view.pairs.start, view.pairs.stop)):
            continue
        images = camera.view(view.omega_v, view.lights, how["bounces"], view.number)
        notes = {STANDARD_ERROR: (images.standard_error, "1/sr, mean over texels")}
        recording.write(view.first, images.values.sum(axis=0), notes)
    if progress is not None:
        progress(len(views), len(views))
    return recording


def _root_mean_square(errors: np.ndarray) -> float | None:
    error = math.sqrt(float(np.mean(errors**2)))
    return None if math.isnan(error) else error


def _views(angles: np.ndarray, lights: np.ndarray) -> Iterator[BtfView]:
    """Yield the views of pairs that stand view by view; ``lights`` are their lights' numbers."""
    same = np.all(angles[1:, [1, 3]] == angles[:-1, [1, 3]], axis=1)
    firsts = np.flatnonzero(np.concatenate([[True], ~same]))
    for number, (first, last) in enumerate(zip(firsts, [*firsts[1:], len(angles)], strict=True)):
        omega_v = to_vector(angles[first, 1], angles[first, 3])
        yield BtfView(number, int(first), omega_v, lights[first:last])


def checked_plan(angles: np.ndarray) -> np.ndarray:
    """Return pairs as float64, or say what is wrong with them.

    Raises:
        SimrigError: another shape, no pairs, NaN, a pair that appears twice, or polar angles
        outside
            of 0° to 89°.
    """
    angles = np.array(angles, dtype=np.float64)
    if angles.ndim != 2 or len(angles) == 0:
        raise SimrigError(f"a BTF needs angles of shape (pairs, 4), got {angles.shape}")
    check_angles(angles, len(angles), "to be measured")
    steepest = float(np.degrees(angles[:, :2].max()))
    if steepest > _STEEPEST_DEG:
        raise SimrigError(
            f"a BTF reaches polar angles up to {_STEEPEST_DEG:g}°, the plan has {steepest:g}°"
        )
    twice = repeated_pair(angles)
    if twice is not None:
        raise SimrigError(
            f"pairs {twice[0] + 1} and {twice[1] + 1} of the plan are the same: measure one of them"
        )
    return angles


def resolution_of(tile: Tile, resolution: int | tuple[int, int]) -> tuple[int, int]:
    """Return (height, width) in texels; one number is the width, texels are then square.

    Raises:
        SimrigError: fewer than one texel.
    """
    if not isinstance(resolution, tuple):
        height = max(1, round(resolution * tile.size_mm[1] / tile.size_mm[0]))
        resolution = (height, resolution)
    if any(side != int(side) or not 1 <= side <= 16384 for side in resolution):
        raise SimrigError(f"the resolution must be 1 to 16384 texels a side, got {resolution}")
    return int(resolution[0]), int(resolution[1])


def checked_bounces(bounces: Any) -> int:
    """Return the number of orders.

    Raises:
        SimrigError: not a whole number from 1 to the most that is simulated.
    """
    if isinstance(bounces, str) or bounces != int(bounces) or not 1 <= bounces <= MOST_BOUNCES:
        raise SimrigError(f"orders must be 1 to {MOST_BOUNCES} or '{AUTO}', got '{bounces}'")
    return int(bounces)

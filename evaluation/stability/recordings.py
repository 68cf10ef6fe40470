"""A small recording of a printout on a plane of its own, by rays: for kills and tests."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from simrig.evaluation.studies.registration.photographs import (
    FRAME_MM,
    Lens,
    camera_to_world,
    photograph,
    view_directions,
)
from simrig.evaluation.studies.registration.surfaces import SURFACES
from simrig.imaging.alignment import Plane
from simrig.imaging.marks import frame_corners

PLANE = Plane.tilted(-0.8, np.radians(0.5), np.radians(70.0))
SAMPLE_MM = 40.0
ELECTRONS_PER_SECOND = 2e5  # of a pixel that shows 1/sr
SENSOR: dict[str, Any] = {
    "bits": 14, "black_DN": 200.0, "K_DN_e": 0.5, "sigma_d_e": 16.0, "mu_sat_e": 30000.0,
    "cfa": None, "electrons_per_second": ELECTRONS_PER_SECOND,
}  # fmt: skip
_LIGHT_MM = np.array([0.0, 0.0, 1e7])
_EXPOSURES = np.array([1.0, 0.25])
_WHITE = 0.9


def write_recording(folder: Path, poses: int = 9, seed: int = 0, calibrated: bool = True) -> None:
    """Write a recording as ``simrig record`` does: light at the pole, a monochrome sensor."""
    rng = np.random.default_rng(seed)
    surface = replace(SURFACES["printout"](rng), gloss=0.0)
    lens = Lens(pixels=240, focal=6300.0)
    for part in ("poses", "calibration"):
        (folder / part).mkdir(parents=True, exist_ok=True)
    along = np.linspace(-1.0, 1.0, lens.pixels)
    response = 1.0 - 0.2 * (along[:, None] ** 2 + along**2) if calibrated else np.ones((1, 1))
    for number, (theta, phi) in enumerate(view_directions(poses, np.radians(60.0))):
        off = rng.uniform(-5e-4, 5e-4, 3)
        pose = camera_to_world(theta + off[0], phi + off[1], off[2])
        seen = photograph(surface, PLANE.normal, PLANE.z_mm, pose, lens, 0.0, rng)
        angles = np.array([0.0, theta, 0.0, phi])
        _keep(folder / "poses" / f"{number:06d}.npz", seen * response, angles, lens, rng)
    if calibrated:
        white = np.full((lens.pixels, lens.pixels), _WHITE) * response
        _keep(folder / "calibration" / "white.npz", white, np.zeros(4), lens, rng)
    about = {
        "format": "simrig recording",
        "version": 1,
        "material": "printout",
        "plan": "views",
        "seed": seed,
        "effects": {"fall-off": False, "photon-noise": True},
        "poses": poses,
        "sensor": SENSOR | {"pixels": [lens.pixels, lens.pixels]},
        "sample": {
            "size_mm": SAMPLE_MM,
            "marks_mm": [[*corner, 0.0] for corner in frame_corners(FRAME_MM, FRAME_MM).tolist()],
        },
        "calibration": {"white_albedo": _WHITE},
    }
    (folder / "recording.json").write_text(json.dumps(about))


def _keep(
    path: Path, albedo: np.ndarray, angles: np.ndarray, lens: Lens, rng: np.random.Generator
) -> None:
    rate = np.maximum(albedo, 0.0) / np.pi * ELECTRONS_PER_SECOND
    electrons = np.minimum(rng.poisson(rate * _EXPOSURES[:, None, None]), SENSOR["mu_sat_e"])
    read = electrons + rng.normal(0.0, SENSOR["sigma_d_e"], electrons.shape)
    raw = np.rint(SENSOR["black_DN"] + SENSOR["K_DN_e"] * read)
    np.savez(
        path,
        frames=np.clip(raw, 0, 2 ** SENSOR["bits"] - 1).astype(np.uint16),
        exposures=_EXPOSURES,
        angles=angles,
        camera_to_world=camera_to_world(angles[1], angles[3]),
        light_mm=_LIGHT_MM,
        intrinsics=lens.matrix,
        distortion=np.zeros(5),
    )

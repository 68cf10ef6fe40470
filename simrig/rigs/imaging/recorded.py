"""Reading a recording: what ``recording.json`` says, and raw pictures; nothing is changed."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from simrig.core.errors import SimrigError
from simrig.files.atomic import is_temporary

NAME, FORMAT, VERSION = "recording.json", "simrig recording", 1
_KEYS = ("frames", "exposures", "angles", "camera_to_world", "light_mm", "intrinsics", "distortion")


class RecordedPictures:
    """A recording on disk.

    Args:
        folder: of it.

    Raises:
        SimrigError: none, damaged, of another version, or without a pose.
    """

    def __init__(self, folder: str | Path):
        self.folder = Path(folder)
        path = self.folder / NAME
        if not path.is_file():
            raise SimrigError(f"'{folder}' is no recording: it has no {NAME}")
        try:
            self.about: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
            named, version = self.about["format"], self.about["version"]
            self.sample, self.sensor = dict(self.about["sample"]), dict(self.about["sensor"])
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise SimrigError(f"'{path}' is damaged: {type(error).__name__} {error}") from error
        if (named, version) != (FORMAT, VERSION):
            raise SimrigError(f"'{path}' is of version {version} of '{named}', not read here")
        self.effects = {name for name, on in dict(self.about.get("effects", {})).items() if on}
        poses = self.folder / "poses"
        found = (p for p in poses.glob("*.npz") if not is_temporary(p))
        self.poses = sorted(found) if poses.is_dir() else []
        if not self.poses:
            raise SimrigError(f"'{folder}' has no poses yet: record first")
        expected = self.about.get("poses")
        if isinstance(expected, int) and len(self.poses) < expected:
            raise SimrigError(
                f"'{folder}' has {len(self.poses):,} of {expected:,} poses: finish recording first"
            )

    def pose(self, number: int) -> dict[str, np.ndarray]:
        """Return the arrays of a pose."""
        return _arrays(self.poses[number])

    def calibration(self, name: str) -> dict[str, np.ndarray] | None:
        """Return the arrays of a calibration picture, None where there is none."""
        path = self.folder / "calibration" / f"{name}.npz"
        return _arrays(path) if path.is_file() else None


def _arrays(path: Path) -> dict[str, np.ndarray]:
    """Return a recorded picture.

    Raises:
        SimrigError: a damaged file, missing arrays.
    """
    try:
        with open(path, "rb") as raw, np.load(raw, allow_pickle=False) as file:
            arrays = {n: np.asarray(file[n]) for n in file.files if not n.endswith(".json")}
    except (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile) as error:
        raise SimrigError(
            f"'{path}' is damaged ({' '.join(str(error).split())[:80]}): record it again; what is "
            "processed is kept"
        ) from error
    missing = [key for key in _KEYS if key not in arrays]
    if missing:
        raise SimrigError(f"'{path}' lacks {', '.join(missing)}: it is no recorded picture")
    return arrays

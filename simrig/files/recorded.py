"""Reading a recording: what ``recording.json`` says, and raw pictures; nothing is changed."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from simrig.core.errors import SimrigError
from simrig.files.atomic import atomic_write, is_temporary
from simrig.files.values import opened_arrays

NAME, FORMAT, VERSION = "recording.json", "simrig recording", 1
_SHAPES: dict[str, tuple[int, ...]] = {
    "angles": (4,),
    "camera_to_world": (4, 4),
    "light_mm": (3,),
    "intrinsics": (3, 3),
    "distortion": (5,),
}


def read_about(folder: str | Path) -> dict[str, Any]:
    """Return what a recording's ``recording.json`` says.

    Raises:
        SimrigError: there is none, it is damaged, or of another version.
    """
    about = read_facts(Path(folder), NAME, FORMAT, VERSION, ("sample", "sensor"))
    if not all(isinstance(about.get(key, {}), dict) for key in ("effects", "calibration")):
        raise SimrigError(f"'{Path(folder) / NAME}' is damaged: effects, calibration are objects")
    return about


def read_facts(
    folder: Path, name: str, kind: str, version: int, objects: Sequence[str]
) -> dict[str, Any]:
    """Return what the JSON file of a folder of pictures says.

    Args:
        folder: of the pictures.
        name: of the file in it.
        kind, version: its ``format`` and ``version``.
        objects: keys that it must have, each an object.

    Raises:
        SimrigError: there is none, it is damaged, or of another kind or version.
    """
    path = folder / name
    if not path.is_file():
        raise SimrigError(f"'{folder}' is no {kind.rpartition(' ')[2]}: it has no {name}")
    try:
        about = json.loads(path.read_text(encoding="utf-8"))
        named, found = about["format"], about["version"]
        whole = all(isinstance(about[key], dict) for key in objects)
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise SimrigError(f"'{path}' is damaged: {type(error).__name__} {error}") from error
    if (named, found) != (kind, version):
        raise SimrigError(f"'{path}' is of version {found} of '{named}', not read here")
    if not whole:
        raise SimrigError(f"'{path}' is damaged: {', '.join(objects)} are objects")
    return dict(about)


def begin_folder(folder: Path, name: str, about: dict[str, Any], there: Any) -> None:
    """Write the JSON file of a folder of pictures, or find that it is there and says the same.

    Args:
        folder: made where it is missing.
        name: of the file in it.
        about: what it is to say.
        there: reads what it says.

    Raises:
        SimrigError: a folder of something else, or of another recording; an unwritable one.
    """
    file, kind = folder / name, str(about["format"]).rpartition(" ")[2]
    if file.is_file():
        says = there(folder)
        for key in sorted(about.keys() | says.keys()):
            if about.get(key) != says.get(key):
                raise SimrigError(
                    f"'{folder}' holds another {kind} (its {key} differs): choose another "
                    "--output, or remove it"
                )
        return
    if folder.is_dir() and any(folder.iterdir()):
        raise SimrigError(f"'{folder}' holds something else: choose another --output")
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise SimrigError(f"cannot write '{folder}': {error.strerror}") from error
    with atomic_write(file) as temporary:
        temporary.write_text(json.dumps(about, indent=1), encoding="utf-8")


class RecordedPictures:
    """A recording on disk.

    Attributes:
        about: what ``recording.json`` says; ``sample``, ``sensor`` and ``calibrated``
            are parts of it.
        digest: of ``recording.json``, which tells recordings apart.
        effects: names of those that were simulated.
        poses: files of the poses that are there.

    Raises:
        SimrigError: see ``read_about``.
    """

    def __init__(self, folder: str | Path):
        self.folder = Path(folder)
        self.about = read_about(folder)
        self.digest = hashlib.sha256((self.folder / NAME).read_bytes()).hexdigest()[:16]
        self.sample, self.sensor = self.about["sample"], self.about["sensor"]
        self.calibrated = self.about.get("calibration", {})
        self.effects = {name for name, on in self.about.get("effects", {}).items() if on}
        poses = (self.folder / "poses").glob("*.npz")
        self.poses = sorted(path for path in poses if not is_temporary(path))

    def state(self) -> str:
        """Return a text that changes where the folder holds another recording."""
        files = [self.folder / NAME, *sorted((self.folder / "calibration").glob("*.npz"))]
        found = [(path.name, path.stat()) for path in files]
        said = [f"{name} {stat.st_mtime_ns} {stat.st_size}" for name, stat in found]
        return ", ".join([*said, f"{len(self.poses)} poses"])

    def check_whole(self) -> None:
        """Raise SimrigError where poses are still to be recorded, or are not those that it says."""
        if not self.poses:
            raise SimrigError(f"'{self.folder}' has no poses yet: record first")
        expected = self.about.get("poses", len(self.poses))
        if type(expected) is not int or expected < 1:
            raise SimrigError(
                f"poses of '{self.folder}/recording.json' must be a whole number above 0, got "
                f"{expected!r}"
            )
        if len(self.poses) < expected:
            raise SimrigError(
                f"'{self.folder}' has {len(self.poses):,} of {expected:,} poses: finish recording "
                "first"
            )
        if len(self.poses) > expected:
            raise SimrigError(
                f"'{self.folder}' has {len(self.poses):,} poses where recording.json says "
                f"{expected:,}: move away those that are not its own"
            )

    def pose(self, number: int, names: Sequence[str] = ()) -> dict[str, np.ndarray]:
        """Return the arrays of a pose, or only those that are named."""
        return _arrays(self.poses[number], names)

    def calibration(self, name: str) -> dict[str, np.ndarray] | None:
        """Return the arrays of a calibration picture, None where there is none."""
        path = self.folder / "calibration" / f"{name}.npz"
        return _arrays(path) if path.is_file() else None


def _arrays(path: Path, names: Sequence[str] = ()) -> dict[str, np.ndarray]:
    """Return a recorded picture, or what is named of it.

    Raises:
        SimrigError: a damaged file, arrays that are missing or of another shape.
    """
    hint = ": record it again; what is processed is kept"
    with opened_arrays(path, hint) as file:
        wanted = [n for n in file.files if not n.endswith(".json") and (not names or n in names)]
        arrays = {n: np.asarray(file[n]) for n in wanted}
    missing = [key for key in names or ("frames", "exposures", *_SHAPES) if key not in arrays]
    if missing:
        raise SimrigError(f"'{path}' lacks {', '.join(missing)}: it is no recorded picture")
    for name, shape in _SHAPES.items():
        if name not in arrays:
            continue
        found = arrays[name]
        if found.shape != shape or found.dtype.kind not in "uif" or not np.isfinite(found).all():
            raise SimrigError(
                f"'{path}': {name} must be {shape} finite numbers, got {found.dtype} {found.shape}"
            )
    return arrays

"""Where the pictures of a BTF lie: a folder or a zip archive, named by their angles.

Names hold tl, pl, tv, pv (light, then view; polar angle, then azimuth, in degrees, also decimal):
``tl000_pl000_tv052.5_pv060.exr``. Folders and what stands before the angles do not matter. Whatever
else is there is reported; pictures whose names say no angles are not left out in silence.
"""

from __future__ import annotations

import re
import shutil
import tempfile
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np

from simrig.btf.grid import repeated_pair
from simrig.core.errors import SimrigError
from simrig.files.pictures.exr import read_header
from simrig.files.pictures.reader import PICTURES

ANGLES = ("theta_i_deg", "theta_v_deg", "phi_i_deg", "phi_v_deg")  # attributes of our own pictures
_NUMBER = r"(-?\d+(?:[.,]\d+)?)"
_READ = {suffix for kind in PICTURES.values() for suffix in kind.suffixes}
_PICTURES = _READ | {".tif", ".tiff", ".bmp", ".gif", ".webp", ".ppm", ".dds", ".dng", ".raw"}
_NAME = re.compile(
    rf"tl{_NUMBER}[ _-]+pl{_NUMBER}[ _-]+tv{_NUMBER}[ _-]+pv{_NUMBER}(\.[a-z0-9]+)$", re.IGNORECASE
)
_RATIO, _LARGEST_MEMBER = 1100, 1 << 30
_MOST_NAMED = 5
_BROKEN = (zipfile.BadZipFile, zlib.error, OSError, RuntimeError, NotImplementedError, EOFError)


@dataclass(frozen=True)
class BtfPictures:
    """The pictures of a BTF; as a context manager an archive stays open for all of them.

    Attributes:
        names: of the pictures, paths below the source.
        angles: theta_i, theta_v, phi_i, phi_v in radians, shape (n, 4): by polar angle and azimuth
            of the illumination, then of the view.
    """

    source: Path
    names: list[str]
    angles: np.ndarray
    skipped: list[str]

    def __enter__(self) -> BtfPictures:
        """Keep an archive open: its list of files is read once for all pictures."""
        if not self.source.is_dir():
            self.__dict__["archive"] = zipfile.ZipFile(self.source)
        return self

    def __exit__(self, *_: object) -> None:
        if "archive" in self.__dict__:
            self.__dict__.pop("archive").close()

    @contextmanager
    def open(self, number: int) -> Iterator[Path]:
        """Give the path of a picture; of an archive, of a copy that is removed again."""
        name = self.names[number]
        if self.source.is_dir():
            yield self.source / name
            return
        kept = self.__dict__.get("archive")
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / PurePosixPath(name).name
            try:
                with ExitStack() as held:
                    archive = kept or held.enter_context(zipfile.ZipFile(self.source))
                    with archive.open(name) as packed, path.open("wb") as file:
                        shutil.copyfileobj(packed, file)
            except _BROKEN as error:
                raise SimrigError(f"'{name}' of '{self.source}' is damaged: {error}") from error
            yield path

    @property
    def skipped_text(self) -> str:
        """What was left out, for people; empty where nothing was."""
        if not self.skipped:
            return ""
        first = ", ".join(self.skipped[:_MOST_NAMED]) + (
            ", ..." if self.skipped[_MOST_NAMED:] else ""
        )
        return f"{len(self.skipped)} files that are no pictures left out: {first}"


def is_archive(path: Path) -> bool:
    """Return whether a file is a zip archive."""
    try:
        return path.is_file() and zipfile.is_zipfile(path)
    except OSError:
        return False


def find_pictures(source: str | Path) -> BtfPictures:
    """Return the pictures below a folder or in a zip archive.

    Raises:
        SimrigError: neither, no picture named by its angles, pictures that are not named so or that
            are of no format that is read, or two pictures of the same pair.
    """
    source = Path(source)
    if source.is_dir():
        files = sorted(path for path in source.rglob("*") if path.is_file())
        names = [path.relative_to(source).as_posix() for path in files]
    elif is_archive(source):
        names = _members(source)
    elif source.is_file():
        raise SimrigError(f"'{source}' is neither a folder of pictures nor a zip archive of them")
    else:
        raise SimrigError(f"there is no folder '{source}'")
    found, skipped, strange = [], [], []
    for name in names:
        match = _NAME.search(name)
        suffix = PurePosixPath(name).suffix.lower()
        if match and suffix in _READ:
            tl, pl, tv, pv = (float(angle.replace(",", ".")) for angle in match.groups()[:4])
            exact = _exact_angles(source / name) if source.is_dir() else None
            found.append((name, exact or (tl, tv, pl, pv)))
        elif suffix in _PICTURES or match:
            strange.append(name)
        else:
            skipped.append(name)
    if not found:
        raise SimrigError(
            f"no picture below '{source}' is named by its angles (tl000_pl000_tv000_pv000.exr)"
        )
    if strange:
        raise SimrigError(
            f"'{source}' holds {len(strange)} pictures that are not named by their angles or not "
            f"read, beside {len(found)} that are; the first is '{strange[0]}': rename it "
            "(tl052.5_pl060_tv000_pv000.exr) or move it out"
        )
    found.sort(key=lambda entry: (entry[1][0], entry[1][2], entry[1][1], entry[1][3], entry[0]))
    angles = np.radians([angles for _, angles in found])
    pictures = BtfPictures(source, [name for name, _ in found], angles, skipped)
    twice = repeated_pair(angles)
    if twice is not None:
        first, second = (source / pictures.names[number] for number in twice)
        raise SimrigError(
            f"'{first}' and '{second}' show the same pair of directions: remove one of them"
        )
    return pictures


def _members(source: Path) -> list[str]:
    """Return the files of an archive after checking what it claims."""
    try:
        with zipfile.ZipFile(source) as archive:
            entries = [e for e in archive.infolist() if not e.is_dir()]
    except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError) as error:
        raise SimrigError(f"'{source}' is damaged or truncated: it is no zip archive") from error
    for entry in entries:
        if entry.file_size > min(_RATIO * entry.compress_size + 1024, _LARGEST_MEMBER):
            raise SimrigError(
                f"'{entry.filename}' of '{source}' claims {entry.file_size:,} bytes, more than it "
                "can hold"
            )
    return sorted(entry.filename for entry in entries)


def _exact_angles(path: Path) -> tuple[float, float, float, float] | None:
    """Return the angles in degrees of a picture that simrig wrote, None of another."""
    if path.suffix.lower() != ".exr":
        return None
    header = read_header(path)
    try:
        a, b, c, d = (float(header[name]) for name in ANGLES)
    except (KeyError, ValueError, TypeError):
        return None
    return (a, b, c, d) if np.all(np.isfinite([a, b, c, d])) else None

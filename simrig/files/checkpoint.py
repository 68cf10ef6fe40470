"""What of a long job is finished, kept piece by piece: a kill damages nothing that was there.

A checkpoint is a folder. ``about.json`` says of which job; every finished piece is a file of its
own, an uncompressed zip of plain values (``record.json``) and arrays (``NAME.npy``), which
``numpy.load`` opens. A piece is written under a temporary name, pushed to the disk and renamed, so
one that is there is whole, and any number of processes write pieces side by side. The zip's
checksums tell what was damaged later: it is named, set aside and made again.

(Zarr was considered. It keeps a file for each chunk of each array; here the arrays and numbers of a
piece, of different types and sizes, have to appear together or not at all.)
"""

from __future__ import annotations

import io
import json
import logging
import os
import zipfile
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import quote, unquote

import numpy as np

from simrig.core.errors import SimrigError
from simrig.files.atomic import atomic_write, is_temporary

FORMAT = 1
ABOUT = "about.json"
_PIECE, _DAMAGED, _TEMPORARY = ".npz", ".damaged", ".tmp"
_RECORD, _ARRAY = "record.json", ".npy"
_BLOCK = 1 << 20
_log = logging.getLogger(__name__)


def checkpoint_of(output: Path) -> Path:
    """Return where the pieces of an output that is not finished are kept: beside it."""
    output = Path(os.path.realpath(output))
    return output.with_name(f".{output.name}.checkpoint")


def kept_bytes(folder: Path) -> int:
    """Return the size of what a checkpoint keeps."""
    return sum(path.stat().st_size for path in folder.iterdir()) if folder.is_dir() else 0


def clear_finished(output: Path) -> None:
    """Remove the pieces of an output that stands; a kill may have come just before that.

    Pieces younger than the output are of a job that is to replace it, and stay.
    """
    folder = checkpoint_of(output)
    if (folder / ABOUT).is_file():
        made = output.stat().st_mtime_ns
        if all(path.stat().st_mtime_ns <= made for path in folder.iterdir()):
            Checkpoint.forget(folder)


@dataclass(frozen=True, eq=False)
class Piece:
    """A finished piece.

    Attributes:
        record: plain values, as JSON gives them back.
        arrays: by name, read-only.
    """

    record: Any = None
    arrays: Mapping[str, np.ndarray] = field(default_factory=dict)


def of_version_0_1(path: Path) -> SimrigError:
    """Return the error for what an interrupted job of simrig 0.1 left behind."""
    return SimrigError(
        f"'{path}' is an unfinished recording of simrig 0.1, which cannot be continued: remove it "
        "to begin anew"
    )


def recording_folder(path: str | Path) -> Path:
    """Return where a recording for a file is kept until the file stands (``checkpoint_of``).

    Raises:
        SimrigError: a missing folder, or what version 0.1 left.
    """
    path = Path(path)
    if not path.parent.is_dir():
        raise SimrigError(f"cannot write '{path}': the folder '{path.parent}' does not exist")
    old = path.with_name(path.name + ".part")
    if old.is_file():
        raise of_version_0_1(old)
    return checkpoint_of(path)


class Checkpoint:
    """The finished pieces of a job.

    Args:
        folder: where they are kept; made with the first piece. None keeps nothing.
        identity: plain values that decide every piece; the pieces of another job are refused.

    Raises:
        SimrigError: the folder belongs to another job (says where they differ), or is none of ours.
    """

    def __init__(self, folder: Path | None, identity: Mapping[str, Any]):
        self.folder = folder
        self._identity = json.loads(json.dumps(identity, allow_nan=False))
        self._begun = folder is not None and self._continues(folder)

    def get(self, name: str) -> Piece | None:
        """Return a finished piece whose files are all there, else None.

        What is damaged is set aside, and a warning is logged that names it.
        """
        if self.folder is None:
            return None
        path = self._path(name)
        try:
            piece, files = _read(path)
        except FileNotFoundError:
            return None
        except _Damaged as error:
            self._set_aside(path, path.name, str(error))
            return None
        return piece if self._files_are_whole(files) else None

    def put(
        self,
        name: str,
        record: Any = None,
        arrays: Mapping[str, np.ndarray] | None = None,
        files: Iterable[str] = (),
    ) -> Piece:
        """Keep a finished piece.

        Args:
            name: any text; a piece of the same name is replaced.
            files: finished files that belong to it, relative to the checkpoint's parent folder.

        Returns:
            The piece as ``get`` will return it.

        Raises:
            SimrigError: when it cannot be written; what was there stays.
        """
        text = json.dumps(record, allow_nan=False)
        kept = {key: np.ascontiguousarray(value) for key, value in (arrays or {}).items()}
        if self.folder is not None:
            self._begin(self.folder)
            sums = {file: _checksum(self.folder.parent / file) for file in files}
            about = {"arrays": sorted(kept), "files": sums, "record": json.loads(text)}
            content = json.dumps(about)
            _write(self._path(name), content, kept)
        return Piece(json.loads(text), kept)

    def names(self) -> list[str]:
        """Return the names of the pieces that are there, sorted; none of them is read."""
        if self.folder is None or not self.folder.is_dir():
            return []
        found = (path.name for path in self.folder.iterdir() if path.suffix == _PIECE)
        return sorted(unquote(name.removesuffix(_PIECE)) for name in found)

    def remove(self) -> None:
        """Forget the job, which is complete; what was set aside goes too."""
        if self.folder is not None and self.folder.is_dir():
            self.forget(self.folder)
        self._begun = False

    @staticmethod
    def forget(folder: Path) -> None:
        """Remove the folder of a job."""
        for path in folder.iterdir():
            if path.name != ABOUT:  # the last: until then the rest is known to be ours
                path.unlink(missing_ok=True)
        (folder / ABOUT).unlink(missing_ok=True)
        folder.rmdir()

    # -- what happens inside ---------------------------------------------------------------------

    def _path(self, name: str) -> Path:
        assert self.folder is not None
        return self.folder / (quote(name, safe=" ,=+@") + _PIECE)

    def _continues(self, folder: Path) -> bool:
        """Return whether the job was begun before, after checking that it is the same."""
        if folder.is_file():
            raise of_version_0_1(folder)
        if not folder.is_dir() or not any(folder.iterdir()):
            return False
        try:
            about = json.loads((folder / ABOUT).read_text(encoding="utf-8"))
            known = about["format"] == FORMAT
            there = about["job"]
        except (OSError, ValueError, KeyError, TypeError):
            known = False
        if not known:
            if all(is_temporary(path) or path.name == ABOUT for path in folder.iterdir()):
                return False  # stopped before the first piece
            raise SimrigError(
                f"'{folder}' cannot be continued by this simrig: remove it to begin anew"
            )
        if there != self._identity:
            raise SimrigError(
                f"'{folder}' keeps the unfinished part of another job, "
                f"{_difference(there, self._identity)}: remove it or choose another output"
            )
        return True

    def _begin(self, folder: Path) -> None:
        if self._begun:
            return
        try:
            folder.mkdir(exist_ok=True)
        except OSError as error:
            raise SimrigError(f"cannot write '{folder}': {error.strerror}") from error
        with atomic_write(folder / ABOUT) as temporary:
            about = {"format": FORMAT, "job": self._identity}
            temporary.write_text(json.dumps(about, indent=1), encoding="utf-8")
        self._begun = True

    def _files_are_whole(self, files: Mapping[str, int]) -> bool:
        """Return whether the files of a piece are there as they were; others go aside."""
        assert self.folder is not None
        for name, checksum in files.items():
            path = self.folder.parent / name
            if not path.is_file():
                return False
            if _checksum(path) != checksum:
                self._set_aside(path, quote(name, safe=" ,=+@"), "it is not what was written")
                return False
        return True

    def _set_aside(self, path: Path, name: str, reason: str) -> None:
        assert self.folder is not None
        aside = self.folder / (name + _DAMAGED)
        path.replace(aside)
        _log.warning("'%s' is damaged (%s): set aside as '%s', made again", path, reason, aside)


class _Damaged(Exception):
    """A piece whose content is not what was written; says why."""


def _write(path: Path, content: str, arrays: Mapping[str, np.ndarray]) -> None:
    """Write a piece; its arrays go member by member."""
    with (
        atomic_write(path, suffix=_TEMPORARY) as temporary,
        zipfile.ZipFile(temporary, "w") as archive,
    ):
        archive.writestr(_RECORD, content)
        for key, value in arrays.items():
            with archive.open(key + _ARRAY, "w", force_zip64=True) as member:
                np.lib.format.write_array(member, value, version=(1, 0), allow_pickle=False)


def _read(path: Path) -> tuple[Piece, dict[str, int]]:
    """Return a piece and the checksums of its files."""
    try:
        with zipfile.ZipFile(path) as archive:
            size = path.stat().st_size
            contents = {}
            for member in archive.infolist():
                if member.compress_type != zipfile.ZIP_STORED or member.file_size > size:
                    raise _Damaged("it is no uncompressed zip")
                contents[member.filename] = archive.read(member)  # checks the sum
        about = json.loads(contents.pop(_RECORD))
        arrays = {key.removesuffix(_ARRAY): _array(raw) for key, raw in contents.items()}
        if sorted(arrays) != about["arrays"]:
            raise _Damaged("it lacks an array")
        return Piece(about["record"], arrays), dict(about["files"])
    except FileNotFoundError:
        raise
    except (OSError, ValueError, KeyError, TypeError, RuntimeError, NotImplementedError) as error:
        raise _Damaged(" ".join(str(error).split()) or type(error).__name__) from error
    except (zipfile.BadZipFile, EOFError) as error:
        raise _Damaged(" ".join(str(error).split())) from error


def _array(raw: bytes) -> np.ndarray:
    """Return the array of a NumPy file, a view of its bytes."""
    stream = io.BytesIO(raw)
    np.lib.format.read_magic(stream)
    shape, fortran, dtype = np.lib.format.read_array_header_1_0(stream)
    if fortran or dtype.hasobject:
        raise ValueError("it holds an array that simrig did not write")
    return np.frombuffer(raw, dtype, offset=stream.tell()).reshape(shape)


def _checksum(path: Path) -> int:
    found = 0
    with open(path, "rb") as file:
        while block := file.read(_BLOCK):
            found = zlib.crc32(block, found)
    return found


def _difference(there: Any, asked: Any) -> str:
    """Say in a few words where two identities differ."""
    if isinstance(there, dict) and isinstance(asked, dict):
        for key in sorted(there.keys() | asked.keys()):
            if there.get(key) != asked.get(key):
                return (
                    f"with {key} = {_short(there.get(key))}, asked for is {_short(asked.get(key))}"
                )
    return f"with {_short(there)}, asked for is {_short(asked)}"


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 60 else text[:57] + "..."

"""Writing files so that a half-written one never stands under its final name."""

from __future__ import annotations

import errno
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from simrig.core.errors import SimrigError

# what the system says when there is no room, and how HDF5 repeats it
_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


@contextmanager
def atomic_write(path: str | Path, suffix: str | None = None) -> Iterator[Path]:
    """Give a temporary path beside ``path``; rename it there on success, remove it on failure.

    What was written is on the disk before the rename, so that neither a kill nor a loss of power
    leaves a damaged file under the final name. A ``path`` that is a symbolic link stays one: what
    it points to is replaced.

    Args:
        path: the file.
        suffix: of the temporary name; that of ``path`` unless given.

    Raises:
        SimrigError: when the folder does not exist, cannot be written, or has no room.
    """
    given, path = Path(path), Path(os.path.realpath(path))
    if not path.parent.is_dir():
        raise SimrigError(f"cannot write '{given}': the folder '{path.parent}' does not exist")
    if path.is_dir():
        raise SimrigError(f"cannot write '{given}': it is a folder")
    try:
        handle, name = tempfile.mkstemp(
            prefix=f".{path.stem[:100]}-",
            suffix=path.suffix if suffix is None else suffix,
            dir=path.parent,
        )
    except OSError as error:
        raise SimrigError(f"cannot write '{given}': {error.strerror}") from error
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        umask = os.umask(0)
        os.umask(umask)
        temporary.chmod(0o666 & ~umask)
        push_to_disk(temporary)
        temporary.replace(path)
        push_to_disk(path.parent)
    except (OSError, RuntimeError) as error:  # h5py raises RuntimeError where closing fails
        if isinstance(error, SimrigError) or not _no_room(error):
            raise
        raise SimrigError(f"cannot write '{given}': no room is left on its disk") from error
    finally:
        temporary.unlink(missing_ok=True)


def push_to_disk(path: Path) -> None:
    """Wait until a file's content, or a folder's list of names, is on the disk."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _no_room(error: BaseException | None) -> bool:
    """Return whether an error, or what it came from, is that of a full disk."""
    while error is not None:
        if isinstance(error, OSError) and error.errno in _NO_ROOM:
            return True
        if any(f"errno = {number}," in str(error) for number in _NO_ROOM):
            return True
        error = error.__context__
    return False


def existing_file(path: str | Path) -> Path:
    """Return the path of a file that exists.

    Raises:
        SimrigError: when there is no such file, or it is a folder.
    """
    path = Path(path)
    if path.is_dir():
        raise SimrigError(f"'{path}' is a folder, a file was expected")
    if not path.is_file():
        raise SimrigError(f"there is no file '{path}'")
    return path

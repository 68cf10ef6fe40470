"""Writing files so that a half-written one never stands under its final name."""

from __future__ import annotations

import errno
import fcntl
import itertools
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from simrig.core.errors import SimrigError

_PARTIAL = ".partial-"
# what the system says when there is no room, and how HDF5 repeats it
_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


@contextmanager
def atomic_write(path: str | Path, suffix: str | None = None) -> Iterator[Path]:
    """Give a temporary path beside ``path``; rename it there on success, remove it on failure.

    What was written is on the disk before the rename, so that neither a kill nor a loss of power
    leaves a damaged file under the final name. What a killed process left under a temporary name is
    used by the next that writes the same file. A ``path`` that is a symbolic link stays one: what
    it points to is replaced.

    Args:
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
        temporary, handle = _temporary(path, path.suffix if suffix is None else suffix)
    except OSError as error:
        raise SimrigError(f"cannot write '{given}': {error.strerror}") from error
    try:
        yield temporary
        push_to_disk(temporary)
        temporary.replace(path)  # from here on the name may be that of another writer
    except BaseException as error:
        temporary.unlink(missing_ok=True)
        # h5py raises RuntimeError where closing fails
        if not isinstance(error, OSError | RuntimeError) or isinstance(error, SimrigError):
            raise
        if not _no_room(error):
            raise
        raise SimrigError(f"cannot write '{given}': no room is left on its disk") from error
    finally:
        os.close(handle)
    push_to_disk(path.parent)


def _temporary(path: Path, suffix: str) -> tuple[Path, int]:
    """Return the first temporary name that no living process uses, empty, and its lock.

    The lock is the system's, which frees it should the process die.
    """
    for number in itertools.count():
        temporary = path.with_name(f".{path.stem[:100]}{_PARTIAL}{number}{suffix}")
        try:
            handle = os.open(temporary, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o666)
        except OSError:
            if os.path.lexists(temporary):  # another user's
                continue
            raise
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            # whoever held it may have renamed it between our opening and our locking it
            if temporary.exists() and os.path.samestat(os.fstat(handle), temporary.stat()):
                os.truncate(handle, 0)
                return temporary, handle
        except BlockingIOError:
            pass
        except BaseException:
            os.close(handle)
            raise
        os.close(handle)
    raise AssertionError  # there is always a next number


def is_temporary(path: Path) -> bool:
    """Return whether a name is one of ``atomic_write``: what a killed process may leave."""
    return path.name.startswith(".") and _PARTIAL in path.name


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

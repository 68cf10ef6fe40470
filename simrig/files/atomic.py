"""Writing files so that a half-written one never stands under its final name."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from simrig.core.errors import SimrigError


@contextmanager
def atomic_write(path: str | Path) -> Iterator[Path]:
    """Give a temporary path beside ``path``; rename it there on success, remove it on failure.

    Raises:
        SimrigError: when the folder does not exist or cannot be written.
    """
    path = Path(path)
    if not path.parent.is_dir():
        raise SimrigError(f"cannot write '{path}': the folder '{path.parent}' does not exist")
    try:
        handle, name = tempfile.mkstemp(
            prefix=f".{path.stem}-", suffix=path.suffix, dir=path.parent
        )
    except OSError as error:
        raise SimrigError(f"cannot write '{path}': {error.strerror}") from error
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        umask = os.umask(0)
        os.umask(umask)
        temporary.chmod(0o666 & ~umask)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


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

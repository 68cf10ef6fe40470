"""A file that HDF5 can write to a disk that fills up."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import Any


class FileOnFullDisk:
    """A new file that takes every write and tells at the end what went wrong.

    HDF5 (1.14) crashes the process where it cannot flush what it has to. This file drops what
    cannot be written, and leaving it raises the first error.

    Args:
        path: the file, which is emptied.
    """

    def __init__(self, path: Path):
        self._file = open(path, "w+b", buffering=0)  # noqa: SIM115 (closed by __exit__)
        self._error: OSError | None = None

    def write(self, data: Any) -> int:
        """Write at the current place."""
        rest = memoryview(data).cast("B")
        size = len(rest)
        try:
            while len(rest) and self._error is None:
                rest = rest[self._file.write(rest) :]
        except OSError as error:
            self._error = error
        return size

    def truncate(self, size: int | None = None) -> int:
        """Set the size."""
        try:
            if self._error is None:
                self._file.truncate(size)
        except OSError as error:
            self._error = error
        return self._file.tell() if size is None else size

    def readinto(self, buffer: Any) -> int:
        """Read at the current place; what was dropped reads as zeros."""
        view = memoryview(buffer).cast("B")
        found = self._file.readinto(view) or 0
        view[found:] = bytes(len(view) - found)
        return len(view)

    def read(self, size: int = -1) -> bytes:
        """Read at the current place."""
        return self._file.read(size)

    def seek(self, offset: int, whence: int = 0) -> int:
        """Go to a place."""
        return self._file.seek(offset, whence)

    def tell(self) -> int:
        """Return the current place."""
        return self._file.tell()

    def flush(self) -> None:
        """Nothing is buffered."""

    def __enter__(self) -> FileOnFullDisk:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._file.close()
        if self._error is not None:
            raise self._error

"""Where results go: nothing half-written under a final name, nothing overwritten by accident.

Files: written beside under a temporary name and renamed; one that exists is refused without
``--overwrite``.

Folders: results are made in ``.NAME.partial`` beside the folder, which is then renamed. A folder
that simrig made, and that holds nothing else, is replaced. Any other folder that is not empty is
refused; with ``--overwrite`` the results are put into it, over files of the same names, and nothing
else in it is touched. An interrupted run leaves its partial folder behind, and the same command
goes on from there.

Both: while one process works on an output, another is refused, ``--overwrite`` or not.
"""

from __future__ import annotations

import fcntl
import json
import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from simrig import __version__
from simrig.cli import frame
from simrig.core.errors import SimrigError

MARKER = ".simrig.json"


@contextmanager
def output_file(path: Path, overwrite: bool) -> Iterator[Path]:
    """Hold a path for one result file; the writer writes it atomically.

    Raises:
        SimrigError: the file exists and ``overwrite`` is false, its folder does not exist, or
            another process is writing it.
    """
    _check_file(path, overwrite)
    with _locked(path):
        _check_file(path, overwrite)  # it may have been finished by whoever held the lock
        yield path


def _check_file(path: Path, overwrite: bool) -> None:
    if path.is_dir():
        raise SimrigError(f"'{path}' is a folder, give --output a file name")
    if path.exists() and not overwrite:
        raise SimrigError(f"'{path}' exists: choose another --output, or --overwrite to replace it")
    if not path.absolute().parent.is_dir():
        raise SimrigError(f"cannot write '{path}': the folder '{path.parent}' does not exist")


@contextmanager
def output_folder(path: Path, overwrite: bool, request: Mapping[str, Any]) -> Iterator[Path]:
    """Give a working folder; when the block ends well, its files stand under ``path``.

    Args:
        path: the folder the user asked for; its parents are made.
        overwrite: put the results into a folder that holds other files.
        request: what was asked for. An interrupted run is resumed only by the same request; the
            working folder of another one is emptied first.

    Raises:
        SimrigError: the folder is in use (see this module's docstring).
    """
    path = path.absolute()
    _check_folder(path, overwrite)
    path.parent.mkdir(parents=True, exist_ok=True)
    with _locked(path):
        partial = path.with_name(f".{path.name}.partial")
        _prepare(partial, {"simrig": __version__, "request": frame.plain(request)})
        frame.on_interrupt("the same command goes on from what is done")
        try:
            yield partial
        except Exception as error:
            if not frame.is_interrupt(error):
                shutil.rmtree(partial, ignore_errors=True)
            raise
        _list_files(partial)
        _check_folder(path, overwrite)
        _move(partial, path)


def _check_folder(path: Path, overwrite: bool) -> None:
    if path.exists() and not path.is_dir():
        raise SimrigError(f"'{path}' is a file, an output folder was expected")
    if overwrite or not path.is_dir():
        return
    foreign = _foreign_files(path)
    if foreign:
        raise SimrigError(
            f"output folder '{path}' is in use: it holds '{foreign[0]}', which simrig did not "
            "write; choose another --output, or --overwrite to add the results to it"
        )


def _foreign_files(folder: Path) -> list[str]:
    """Return what stands in the folder and was not written there by simrig."""
    try:
        ours = set(json.loads((folder / MARKER).read_text())["files"])
    except (OSError, ValueError, KeyError, TypeError):
        ours = set()
    return sorted(name for name in _files(folder) if name not in ours)


def _files(folder: Path) -> list[str]:
    return [
        str(Path(root, name).relative_to(folder))
        for root, _, names in os.walk(folder)
        for name in names
    ]


def _prepare(partial: Path, about: Mapping[str, Any]) -> None:
    """Make the working folder, or keep the one that the same request left behind."""
    marker = partial / MARKER
    if partial.exists() and (not marker.is_file() or marker.read_text() != json.dumps(about)):
        shutil.rmtree(partial)
    partial.mkdir(exist_ok=True)
    marker.write_text(json.dumps(about))


def _list_files(partial: Path) -> None:
    """Note in the marker which files are ours."""
    marker = partial / MARKER
    about = json.loads(marker.read_text())
    marker.write_text(json.dumps({**about, "files": sorted(_files(partial))}, indent=2))


def _move(partial: Path, final: Path) -> None:
    if final.is_dir() and _foreign_files(final):  # only with --overwrite
        for name in _files(partial):
            (final / name).parent.mkdir(parents=True, exist_ok=True)
            (partial / name).replace(final / name)
        shutil.rmtree(partial)
        return
    if final.is_dir():
        old = final.with_name(f".{final.name}.old")
        shutil.rmtree(old, ignore_errors=True)
        final.replace(old)
        partial.replace(final)
        shutil.rmtree(old)
    else:
        partial.replace(final)


@contextmanager
def _locked(path: Path) -> Iterator[None]:
    """Hold ``.NAME.lock`` beside the output; the system frees it should the process die."""
    lock = path.with_name(f".{path.name}.lock")
    with _open_lock(lock, path) as handle:
        handle.write(str(os.getpid()))
        handle.flush()
        try:
            yield
        finally:
            lock.unlink(missing_ok=True)


def _open_lock(lock: Path, path: Path) -> Any:
    while True:
        handle = open(lock, "a")  # noqa: SIM115 (the caller closes it, which frees the lock)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            handle.close()
            raise SimrigError(f"output '{path}' is in use by a running simrig") from None
        # the holder before us may have removed the file between our opening and our locking it
        if lock.exists() and os.fstat(handle.fileno()).st_ino == lock.stat().st_ino:
            return handle
        handle.close()

"""Where results go: nothing half-written under a final name, nothing overwritten by accident.

Files: written beside under a temporary name and renamed; one that exists is refused without
``--overwrite``.

Folders: results are made in a working folder and moved when they are complete. It is
``.NAME.partial`` beside a folder that does not exist yet, which it becomes; inside one that exists
it is ``.partial``, so that the folder itself may be a link, a mount or where the shell stands. A
folder that holds anything is refused. With ``--overwrite`` what simrig wrote there is replaced, and
nothing else in it is touched. A run that is stopped or fails leaves what it made in the working
folder, and the same command goes on from there.

Both: a symbolic link stays one, the results stand where it points to. While one process works on
an output, another is refused, ``--overwrite`` or not.
"""

from __future__ import annotations

import fcntl
import json
import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from simrig import __version__
from simrig.cli import frame
from simrig.core.errors import SimrigError
from simrig.files.atomic import atomic_write

MARKER = ".simrig.json"
_PARTIAL, _LOCK = ".partial", ".lock"


@contextmanager
def output_file(path: Path, overwrite: bool) -> Iterator[Path]:
    """Hold a path for one result file; the writer writes it atomically.

    Raises:
        SimrigError: the file exists and ``overwrite`` is false, its folder does not exist, or
            another process is writing it.
    """
    place = _resolved(path)
    if place.is_file() and not overwrite:
        from simrig.files.checkpoint import clear_finished

        with suppress(SimrigError), _locked(_lock_beside(place), path):
            clear_finished(place)
    _check_file(path, overwrite)
    with _locked(_lock_beside(place), path):
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
    given, path = path, _resolved(path)
    partial, lock = _working_places(path)
    if path.is_dir() and _lock_beside(path).exists():
        with suppress(SimrigError), _locked(_lock_beside(path), given):
            pass  # left by a kill just after the folder got its name
    if partial.is_dir():
        with _locked(lock, given), _errors_of_the_system(given):
            _finish_move(partial, path)
    _check_folder(given, path, overwrite)
    partial, lock = _working_places(path)
    with _errors_of_the_system(given):
        partial.parent.mkdir(parents=True, exist_ok=True)
    with _locked(lock, given):
        with _errors_of_the_system(given):
            _prepare(partial, {"simrig": __version__, "request": frame.plain(request)})
        frame.on_interrupt("the same command goes on from what is done")
        try:
            yield partial
        except BaseException:
            if not _results(partial):
                shutil.rmtree(partial, ignore_errors=True)
            raise
        _check_folder(given, path, overwrite)
        with _errors_of_the_system(given):
            _list_files(partial)
            _move(partial, path)


def _working_places(path: Path) -> tuple[Path, Path]:
    """Return where the results for a folder are made, and the lock."""
    if path.is_dir():
        return path / _PARTIAL, path / _LOCK
    return path.with_name(f".{path.name}{_PARTIAL}"), _lock_beside(path)


def _resolved(path: Path) -> Path:
    """Return where a path leads, links followed."""
    return Path(os.path.realpath(path))


@contextmanager
def _errors_of_the_system(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise SimrigError(f"cannot write '{path}': {error.strerror or error}") from error


def _check_folder(given: Path, path: Path, overwrite: bool) -> None:
    """Refuse a folder that cannot be one, or that holds something."""
    if path.exists() and not path.is_dir():
        raise SimrigError(f"'{given}' is a file, an output folder was expected")
    if overwrite or not path.is_dir():
        return
    foreign = _foreign_files(path)
    if foreign:
        raise SimrigError(
            f"output folder '{given}' is in use: it holds '{foreign[0]}', which simrig did not "
            "write; choose another --output, or --overwrite to add the results to it"
        )
    if _results(path):
        raise SimrigError(
            f"'{given}' exists and holds results: choose another --output, or --overwrite to "
            "replace them"
        )


def _foreign_files(folder: Path) -> list[str]:
    """Return what stands in the folder and was not written there by simrig."""
    ours = _ours(folder)
    return sorted(name for name in _files(folder) if name not in ours)


def _ours(folder: Path) -> set[str]:
    """Return the files that simrig wrote into a folder, as its marker says."""
    try:
        listed = json.loads((folder / MARKER).read_text(encoding="utf-8"))["files"]
        return {str(name) for name in listed if _inside(name)}
    except (OSError, ValueError, KeyError, TypeError):
        return set()


def _inside(name: Any) -> bool:
    """Return whether a name of a marker stays in its folder; what others wrote may not."""
    return isinstance(name, str) and not Path(name).is_absolute() and ".." not in Path(name).parts


def _files(folder: Path) -> list[str]:
    """Return the files of a folder, without its working folder and its lock."""
    found = []
    for root, folders, names in os.walk(folder):
        if Path(root) == folder:
            folders[:] = [name for name in folders if name != _PARTIAL]
            names = [name for name in names if name != _LOCK]
        found += [str(Path(root, name).relative_to(folder)) for name in names]
    return found


def _results(folder: Path) -> list[str]:
    """Return the files that are results."""
    return [name for name in _files(folder) if name != MARKER]


def _prepare(partial: Path, about: Mapping[str, Any]) -> None:
    """Make the working folder, or keep the one that the same request left behind."""
    marker = partial / MARKER
    if partial.exists():
        try:
            found = json.loads(marker.read_text(encoding="utf-8"))
            same = all(found.get(key) == value for key, value in about.items())
        except (OSError, ValueError, AttributeError):
            same = False
        if not same:
            shutil.rmtree(partial)
    partial.mkdir(exist_ok=True)
    with atomic_write(marker) as temporary:
        temporary.write_text(json.dumps(about), encoding="utf-8")


def _list_files(partial: Path) -> None:
    """Note in the marker which files are ours: the results are complete."""
    marker = partial / MARKER
    about = json.loads(marker.read_text(encoding="utf-8")) | {"files": sorted(_files(partial))}
    with atomic_write(marker) as temporary:
        temporary.write_text(json.dumps(about, indent=2), encoding="utf-8")


def _move(partial: Path, final: Path) -> None:
    """Give the results their place; a folder that is there stays the same folder."""
    if not final.exists():
        partial.replace(final)
        return
    made = _ours(partial)
    stale = _ours(final) - made
    for name in sorted(made - {MARKER}):
        if (partial / name).exists():  # else it was moved before a kill
            (final / name).parent.mkdir(parents=True, exist_ok=True)
            (partial / name).replace(final / name)
    for name in stale:
        (final / name).unlink(missing_ok=True)
        _remove_empty((final / name).parent, final)
    (partial / MARKER).replace(final / MARKER)
    shutil.rmtree(partial)


def _finish_move(partial: Path, final: Path) -> None:
    """Give complete results their place that a kill kept from it."""
    if _ours(partial):
        _move(partial, final)
    elif not (partial / MARKER).exists() and (final / MARKER).exists():
        shutil.rmtree(partial)


def _remove_empty(folder: Path, top: Path) -> None:
    while folder != top and folder.is_dir() and not any(folder.iterdir()):
        folder.rmdir()
        folder = folder.parent


def _lock_beside(path: Path) -> Path:
    return path.with_name(f".{path.name}.lock")


@contextmanager
def _locked(lock: Path, path: Path) -> Iterator[None]:
    """Hold the lock of an output; the system frees it should the process die."""
    with _open_lock(lock, path) as handle:
        handle.write(str(os.getpid()))
        handle.flush()
        try:
            yield
        finally:
            lock.unlink(missing_ok=True)


def _open_lock(lock: Path, path: Path) -> Any:
    while True:
        with _errors_of_the_system(path):
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

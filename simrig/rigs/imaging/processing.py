"""From a recording to a BTF: portions of poses through the stages, and the file.

Images are kept portion by portion, so an interrupted processing goes on with the same bits; the
recording is only read. Portions can be spread over processes.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from simrig.core.colour import TO_XYZ
from simrig.core.errors import SimrigError
from simrig.core.progress import Progress
from simrig.files.btf.recording import BtfWriter
from simrig.files.btf.source import ANGLES
from simrig.files.images import write_exr
from simrig.files.recorded import RecordedPictures
from simrig.imaging.alignment import Plane
from simrig.rigs.imaging.chain import Chain, Settings

_SURE_MM = 0.2  # uncertainty up to which a plane that was found is taken
_TOGETHER = 96  # poses of a portion at most: what a kill may cost
_MOST_TEXELS = 1 << 22  # of a portion, unless one picture has more
Spread = Callable[..., Iterable[list[dict[str, Any]]]]


def process_recording(
    folder: str | Path,
    output: str | Path,
    settings: Settings | None = None,
    pictures: str | Path | None = None,
    progress: Progress | None = None,
    spread: Spread | None = None,
) -> dict[str, Any]:
    """Make a BTF of a recording; an interrupted one continues with the same bits.

    Args:
        folder: of the recording.
        output: the HDF5 file.
        settings: what is made.
        pictures: folder for the registered images as OpenEXR too: linear sRGB, CIE XYZ, the pose.
        progress: called with poses done and in total.
        spread: gives portions to processes that see the folder; one after the other here unless
            given.

    Returns:
        What was found: the plane, how many poses were registered by their marks, the share of
        values that noise had made negative (they are 0), ΔE of the chart, and ``without``: a line
        for every calibration picture that is not there.

    Raises:
        SimrigError: no recording, a damaged picture, numbers that cannot be, no room.
    """
    chosen = settings or Settings()
    if chosen.plane not in ("fit", "marks"):
        raise SimrigError(f"the plane is to be 'fit' or that of the 'marks', got '{chosen.plane}'")
    recording = RecordedPictures(folder)
    recording.check_whole()
    chain = Chain(recording, chosen)
    angles, cameras = chain.stated()
    surface, about = _surface(chain, angles)
    provenance = {
        "recording": {key: recording.about.get(key) for key in ("material", "plan", "seed")}
        | {"digest": recording.digest},
        "settings": dict(vars(chosen)),
        "plane": about,
    }
    if pictures is not None:
        try:
            Path(pictures).mkdir(exist_ok=True)
        except OSError as error:
            raise SimrigError(f"cannot write '{pictures}': {error.strerror}") from error
    config = {
        "folder": str(recording.folder.absolute()),
        "state": recording.state(),
        "settings": dict(vars(chosen)),
        "plane": surface.numbers.tolist(),
        "pictures": None if pictures is None else str(Path(pictures).absolute()),
    }
    side = chosen.pixels
    with BtfWriter(
        output,
        angles,
        (side, side),
        chain.area.size_mm,
        name=str(recording.about.get("material", "recording")),
        provenance=provenance,
    ) as writer:
        cells = _cells(angles, cameras, writer.missing, max(1, _MOST_TEXELS // side**2))
        done, report = len(angles) - len(writer.missing), progress or (lambda *_: None)
        report(done, len(angles))
        for rows in (spread or _here)(process_cell, config, cells) if cells else ():
            notes = {
                "marks": (np.array([row["marks"] for row in rows]), "1 where the frame was found"),
                "negative": (np.array([row["negative"] for row in rows]), "share set to 0"),
            }
            writer.write(rows[0]["number"], np.stack([row["image"] for row in rows]), notes)
            done += len(rows)
            report(done, len(angles))
        marked, negative = (writer.notes[key] for key in ("marks", "negative"))
    errors = None if chain.colour is None else float(chain.colour.errors.mean())
    return {
        "poses": len(angles),
        "plane": about,
        "marks_found": int(np.nansum(marked)),
        "negative_share": float(np.nanmean(negative)),
        "chart_mean_dE": errors,
        "without": chain.without,
        "defects": 0 if chain.bad is None else int(chain.bad.sum()),
    }


def _cells(
    angles: np.ndarray, cameras: np.ndarray, missing: np.ndarray, most: int
) -> list[dict[str, Any]]:
    """Return portions of poses that follow each other from one place, without those that are there.

    The frame is looked for in the first, the middle and the last of the brighter half of the
    pictures from a place, whichever of them are to be processed.
    """
    moved = np.any(cameras[1:] != cameras[:-1], axis=(1, 2))
    cells: list[dict[str, Any]] = []
    for view in np.split(np.arange(len(angles)), np.flatnonzero(moved) + 1):
        bright = np.sort(view[np.argsort(angles[view, 0], kind="stable")[: (len(view) + 1) // 2]])
        seen_in = sorted({int(bright[k]) for k in (0, len(bright) // 2, -1)})
        todo = view[np.isin(view, missing)]
        runs = np.split(todo, np.flatnonzero(np.diff(todo) > 1) + 1) if len(todo) else []
        cells += [
            {"numbers": part.tolist(), "seen_in": seen_in}
            for run in runs
            for part in np.array_split(run, -(-len(run) // min(most, _TOGETHER)))
        ]
    return cells


def process_cell(config: Mapping[str, Any], cell: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Process some poses that follow each other from one place, perhaps in a worker.

    Args:
        config: ``folder`` of the recording, its ``state``, ``settings``, ``plane``, ``pictures``.
        cell: ``numbers`` of the poses, and ``seen_in`` which to look for the frame.
    """
    chain = _chain(config["folder"], config["state"], tuple(sorted(config["settings"].items())))
    plane, rows = Plane(*config["plane"]), []
    for number, image, marked in chain.images(cell["numbers"], cell["seen_in"], plane):
        if config["pictures"] is not None:
            _write_picture(Path(config["pictures"]), number, image, chain, plane)
        rows.append(
            {
                "number": number,
                "image": np.maximum(image, 0.0).astype(np.float32),
                "marks": float(marked),
                "negative": float((image < 0.0).mean()),
            }
        )
    return rows


@lru_cache(maxsize=1)
def _chain(folder: str, state: str, settings: tuple[tuple[str, Any], ...]) -> Chain:
    """Return the stages of a recording in this state; a worker lives on, and may get another."""
    return Chain(RecordedPictures(folder), Settings(**dict(settings)))


def _here(
    work: Callable[..., list[dict[str, Any]]],
    config: Mapping[str, Any],
    cells: Sequence[Mapping[str, Any]],
) -> Iterator[list[dict[str, Any]]]:
    for cell in cells:
        yield work(config, cell)


def _surface(chain: Chain, angles: np.ndarray) -> tuple[Plane, dict[str, Any]]:
    """Return the plane that images are registered to, and what is known of it.

    Numbers are rounded far below what they are known to, so that a resumed run has the same.
    """
    if chain.settings.plane == "marks":
        return Plane(), {"taken": "the plane of the marks"}
    try:
        fit = chain.plane(angles)
    except SimrigError as error:
        return Plane(), {"taken": f"the plane of the marks: no other is found ({error})"}
    if not fit.u_z_mm < _SURE_MM or fit.left_range:
        said = "; ".join(fit.doubts)
        return Plane(), {"taken": f"the plane of the marks: another is not certain ({said})"}
    plane = Plane(*(round(float(number), 7) for number in fit.plane.numbers))
    about = {k: v for k, v in fit.as_dict().items() if k not in ("seconds", "evaluations")}
    about = {k: round(v, 5) if isinstance(v, float) else v for k, v in about.items()}
    return plane, about | {"numbers": plane.numbers.tolist(), "taken": "found by alignment"}


def _write_picture(
    folder: Path, number: int, image: np.ndarray, chain: Chain, plane: Plane
) -> None:
    """Write one registered image: R, G, B linear sRGB and xyz.X, xyz.Y, xyz.Z, with its pose."""
    angles = np.degrees(chain.recording.pose(number, ("angles",))["angles"])
    about = {
        "unit": "f_r in 1/sr",
        "width_mm": chain.area.size_mm[0],
        "plane_mm": json.dumps(plane.numbers.tolist()),
        **dict(zip(ANGLES, angles, strict=True)),
    }
    xyz = dict(zip(("xyz.X", "xyz.Y", "xyz.Z"), np.moveaxis(image @ TO_XYZ.T, -1, 0), strict=True))
    write_exr(folder / f"{number:06d}.exr", image, about, xyz)

"""What a file is, what it says about its values, and what simrig would make of it."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from simrig.brdf.plausibility import plausibility
from simrig.core.errors import SimrigError
from simrig.files import hdf5
from simrig.files.atomic import existing_file
from simrig.files.btf import hdf5 as btf_hdf5
from simrig.files.btf.source import find_pictures, is_archive
from simrig.files.formats import FORMATS, ReadOptions
from simrig.files.load import read_material
from simrig.files.pictures import picture_format, read_picture
from simrig.files.recognise import file_format
from simrig.files.recorded import NAME, RecordedPictures
from simrig.files.utia import DATABASE, states_layout

_MOST_ENTRIES = 24
_SCENE = "a Mitsuba scene"
_NAMED = (", not a material", ", not read")


@dataclass(frozen=True)
class Description:
    """What is known of a file.

    Attributes:
        kind: picture, material, BTF, measurement, folder of pictures, or another file.
        format: what people call it.
        says: what it says about its values, in its own words.
        made: what reading it does to the values, and what is assumed.
        use: what simrig makes of it; empty where nothing.
    """

    file: Path
    kind: str
    format: str
    says: dict[str, Any] = field(default_factory=dict)
    made: list[str] = field(default_factory=list)
    facts: dict[str, Any] = field(default_factory=dict)
    use: list[str] = field(default_factory=list)

    def as_dict(self) -> dict[str, Any]:
        """Return it as plain values."""
        return asdict(self)


def describe(
    path: str | Path, options: ReadOptions | None = None, layer: str | None = None
) -> Description:
    """Look at a file, whole: what is damaged in it is found.

    Args:
        path: a file, or a folder of pictures.
        options: what the file cannot say, as for reading a material.
        layer: of an OpenEXR file with several.

    Raises:
        SimrigError: no such file, a damaged one, or one of no kind that is known.
    """
    about = _described(path, options, layer)
    stated = options.stated if options else []
    if stated and about.kind != "material":
        raise SimrigError(f"'{path}' is a {about.kind}: leave out {', '.join(stated)}")
    if layer is not None and about.kind != "picture":
        raise SimrigError(f"'{path}' is a {about.kind}, layers are those of pictures: leave it out")
    return about


def _described(path: str | Path, options: ReadOptions | None, layer: str | None) -> Description:
    path = Path(path)
    if (path / NAME).is_file():
        return _recording(path)
    if path.is_dir() or (is_archive(path) and _holds_pictures(path)):
        return _folder(path)
    path = existing_file(path)
    kind = picture_format(path)
    if kind is not None and not (kind == "OpenEXR" and states_layout(path)):
        return _picture(path, layer)
    content = hdf5.content_of(path)
    if content == btf_hdf5.CONTENT:
        return _btf(path)
    if content and content != "brdf":
        return _ours(path, content)
    try:
        file_format(path)
    except SimrigError as error:
        text = str(error)
        start = f"'{path}' is "
        if not text.startswith(start) or not any(sign in text for sign in _NAMED):
            raise
        what = text.removeprefix(start).replace(", not a material", "")
        use = [f"simrig render --scene {path}"] if what == _SCENE else []
        made = [what] if "," in what else []
        return Description(path, "another file", what.partition(",")[0], made=made, use=use)
    return _material(path, options or ReadOptions())


def _holds_pictures(path: Path) -> bool:
    try:
        file_format(path)
    except SimrigError as error:
        return "pictures" in str(error)
    return False


def _folder(path: Path) -> Description:
    found = find_pictures(path)
    endings = Counter(Path(name).suffix.lower() for name in found.names)
    degrees = np.degrees(found.angles)
    with found.open(0) as first:
        picture = read_picture(first)
    facts = {
        "pictures": len(found.names),
        "endings": dict(endings),
        "lights": len(np.unique(degrees[:, [0, 2]], axis=0)),
        "views": len(np.unique(degrees[:, [1, 3]], axis=0)),
        "largest_theta_deg": float(degrees[:, :2].max()),
        "first": picture.size,
        "left_out": found.skipped,
    }
    return Description(
        path,
        "folder of pictures",
        "BTF, pictures named by their angles",
        dict(picture.says),
        list(picture.made),
        facts,
        [f"simrig btf convert {path} NAME.h5 --size-mm WIDTHxHEIGHT"],
    )


def _recording(path: Path) -> Description:
    found = RecordedPictures(path)
    frames = found.pose(0)["frames"].shape if found.poses else ()
    names = sorted(file.stem for file in (path / "calibration").glob("*.npz"))
    keys = ("material", "plan", "seed", "seconds")
    facts = {
        **{key: found.about[key] for key in keys if key in found.about},
        "poses": f"{len(found.poses):,} of {found.about.get('poses', len(found.poses))}",
        "frames_of_the_first": list(frames),
        "calibration": names,
        "sample": {k: v for k, v in found.sample.items() if isinstance(v, int | float)},
        "effects": sorted(found.effects),
    }
    try:
        found.check_whole()
        use = f"simrig process recording {path} --output NAME.h5"
    except SimrigError as error:
        use = str(error)
    says = {k: v for k, v in found.sensor.items() if v is not None}
    return Description(path, "recording", "raw pictures, pose by pose", says, [], facts, [use])


def _picture(path: Path, layer: str | None) -> Description:
    picture = read_picture(path, layer)
    height, width = picture.pixels.shape[:2]
    low, high = float(picture.pixels.min()), float(picture.pixels.max())
    facts: dict[str, Any] = {
        "size": picture.size,
        "least": low,
        "largest": high,
        "mean": [float(v) for v in picture.pixels.mean(axis=(0, 1), dtype=np.float64)],
        "negative_pixels": int((picture.pixels < 0.0).any(axis=2).sum()),
    }
    use = ["simrig compare"]
    if width == 2 * height:
        use.append("simrig render --environment, as latitude and longitude")
    if picture.format == "OpenEXR" and width == height:
        grid = " (of 6 × 48 directions)" if width == DATABASE.directions else ", with --layout"
        use.append(f"simrig materials, as a UTIA table{grid}")
    made = list(picture.made) or ["values taken as they are: linear RGB with sRGB primaries"]
    if picture.format in ("PNG", "JPEG") and not picture.made:
        made = ["decoded from sRGB"]
    return Description(path, "picture", picture.format, dict(picture.says), made, facts, use)


def _material(path: Path, options: ReadOptions) -> Description:
    try:
        read = read_material(path, options)
    except SimrigError as error:
        if "--" not in str(error):
            raise
        about = FORMATS[file_format(path)]
        made = [str(error)]
        use = ["a material, with the option that is named"]
        return Description(
            path, "material", f"{about.name}: {about.description}", {}, made, {}, use
        )
    brdf = read.brdf
    found = plausibility(brdf)
    facts: dict[str, Any] = {
        "name": brdf.name,
        "model": type(brdf).__name__,
        "theta_max_deg": round(float(np.degrees(brdf.theta_max)), 6),
        "arrays": {
            name: f"{' × '.join(map(str, value.shape))} {value.dtype}"
            for name, value in brdf.data().items()
            if value.ndim
        },
        **{
            f"albedo_{view:g}": list(rgb)
            for view, rgb in zip(found.views_deg, found.albedo, strict=True)
        },
        "reciprocity_error": found.reciprocity,
        "negative_share": found.negative_share,
        "constant_channels": list(found.constant_channels),
    }
    about = FORMATS[read.format]
    says = {"honoured": about.honours} if about.honours else {}
    if read.format == "hdf5":
        says |= _attributes(path)
        facts |= _found(says)
    use = ["simrig materials, render, measure, compare, convert, and the plugin simrig_table"]
    made = [*read.notes, *(f"note: {remark}" for remark in found.remarks)]
    format = f"{read.format}: {about.description}"
    return Description(path, "material", format, says, made, facts, use)


def _btf(path: Path) -> Description:
    stack = btf_hdf5.read_btf(path)
    facts = {
        "name": stack.name,
        "images": len(stack),
        "resolution": list(stack.resolution),
        "size_mm": list(stack.size_mm),
        "type": str(stack.values.dtype),
        "provenance": dict(stack.provenance),
    }
    use = ["simrig btf info, fill, average, convert, and the plugin simrig_btf"]
    return Description(path, "BTF", "simrig HDF5", _attributes(path), [], facts, use)


def _ours(path: Path, content: str) -> Description:
    """Describe another HDF5 file of simrig: its attributes and its arrays."""
    import h5py

    arrays: dict[str, str] = {}

    def note(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and len(arrays) < _MOST_ENTRIES:
            arrays[name] = f"{' × '.join(map(str, item.shape))} {item.dtype}"

    try:
        with h5py.File(path, "r") as file:
            file.visititems(note)
    except (OSError, RuntimeError, KeyError) as error:
        raise SimrigError(f"HDF5 file '{path}' is damaged: {error}") from error
    use = ["simrig reconstruct"] if "measurement" in content else []
    says = _attributes(path)
    facts = {**_found(says), "arrays": arrays}
    return Description(path, content, "simrig HDF5", says, [], facts, use)


def _found(says: Mapping[str, Any]) -> dict[str, str]:
    """Return what a plan or a bake found, line by line; nothing of other files."""
    try:
        lines = json.loads(says["provenance"])["found"]["lines"]
    except (ValueError, KeyError, TypeError, RecursionError):
        return {}
    lines = lines if isinstance(lines, list) else []
    return {f"found, {number}": str(line) for number, line in enumerate(lines, 1)}


def _attributes(path: Path) -> dict[str, Any]:
    """Return the attributes that every HDF5 file of simrig has."""
    import h5py

    try:
        with h5py.File(path, "r") as file:
            found = {key: file.attrs[key] for key in list(file.attrs)[:_MOST_ENTRIES]}
    except (OSError, RuntimeError, KeyError, TypeError) as error:
        raise SimrigError(f"HDF5 file '{path}' is damaged: {error}") from error
    return {
        key: value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)
        for key, value in found.items()
    }

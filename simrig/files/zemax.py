"""Zemax BSDF interchange files: f_r around the specular direction, for several incidences.

Keywords, then per colour and incidence ``TIS value`` and one row of values per scatter azimuth,
over the scatter radial angles. Radial 0° is the specular direction; azimuth 0° points from there
towards the normal and runs counter-clockwise seen from outside (Zemax, BSDF Data Interchange file
format). Several sample rotations, transmission and other symmetries are refused.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from simrig.brdf.checks import CLAMP
from simrig.brdf.protocol import Brdf
from simrig.brdf.tables.from_samples import assemble
from simrig.brdf.tables.scattered import ScatteredSamples
from simrig.core.colour import FROM_XYZ
from simrig.core.errors import SimrigError
from simrig.directions.spherical import to_vector
from simrig.files.text import read_text

_MOST_ANGLES = 100_000
_LISTS = ("SampleRotation", "AngleOfIncidence", "ScatterAzimuth", "ScatterRadial")
_BLOCKS = {"Monochrome": ("Monochrome",), "XYZ": ("TristimulusX", "TristimulusY", "TristimulusZ")}
_SYMMETRIES = ("PlaneSymmetrical", "Asymmetrical", "ASymmetrical")


def is_zemax(text: str) -> bool:
    """Return whether the start of a text file has this format's header."""
    return bool(re.search(r"^\s*SampleRotation\b", text, re.MULTILINE))


def read_zemax(path: str | Path, clamp_negative: bool = False) -> ScatteredSamples:
    """Read the samples above the horizon, as isotropic ones.

    Args:
        clamp_negative: set negative values to 0 instead of refusing them.

    Raises:
        SimrigError: an incomplete header, what is not read, values that are missing or cannot be.
    """
    path, lines = Path(path), read_text(path, "Zemax", "latin-1").splitlines()
    words = [w for line in lines if not line.lstrip().startswith("#") for w in line.split()]
    fields, lists, start = _header(path, words)
    content = fields.get("SpectralContent", "Monochrome")
    if content not in _BLOCKS:
        raise SimrigError(f"Zemax file '{path}' has the SpectralContent '{content}', not read")
    if fields.get("ScatterType", "BRDF") != "BRDF":
        raise SimrigError(f"Zemax file '{path}' holds {fields['ScatterType']}, not reflection")
    if fields.get("Symmetry", _SYMMETRIES[0]) not in _SYMMETRIES or len(lists[_LISTS[0]]) > 1:
        raise SimrigError(f"Zemax file '{path}' has several sample rotations, which are not read")
    incidence, azimuth, radial = (lists[name] for name in _LISTS[1:])
    shape = (len(incidence), len(azimuth), len(radial))
    blocks = _blocks(path, words[start:], _BLOCKS[content], shape)
    values = np.stack(blocks, axis=-1).reshape(-1, len(blocks))
    colours = values @ FROM_XYZ.T if content == "XYZ" else np.repeat(values, 3, axis=1)
    rounding = 1e-3 * np.abs(colours).max(axis=1, keepdims=True)
    negative = int((colours < -rounding).any(axis=1).sum())
    if negative and not clamp_negative:
        raise SimrigError(f"'{path}' has {negative} negative of {len(colours)} colours{CLAMP}")
    colours = np.maximum(colours, 0.0)
    view = _views(incidence, azimuth, radial).reshape(-1, 3)
    above = view[:, 2] > 1e-6
    if not above.any():
        raise SimrigError(f"Zemax file '{path}' has no direction above the horizon")
    theta_i = np.repeat(np.radians(incidence), len(azimuth) * len(radial))[above]
    theta_v = np.arctan2(np.hypot(view[:, 0], view[:, 1]), view[:, 2])[above]
    phi_v = np.arctan2(view[:, 1], view[:, 0])[above]
    return ScatteredSamples(
        theta_i, np.zeros_like(theta_i), theta_v, phi_v, colours[above], path.stem, isotropic=True
    )


def load_zemax(path: str | Path, clamp_negative: bool = False) -> tuple[Brdf, list[str]]:
    """Read the samples and make a table of them (see ``assemble``).

    Returns:
        The table, and what was done.
    """
    found = assemble(read_zemax(path, clamp_negative), "Zemax samples")
    return found.brdf, [found.how]


def _header(path: Path, words: list[str]) -> tuple[dict[str, str], dict[str, np.ndarray], int]:
    """Return the keywords, the lists of angles in degrees, and where the data start."""
    fields: dict[str, str] = {}
    lists: dict[str, np.ndarray] = {}
    position = 0
    starts = {name for names in _BLOCKS.values() for name in names} | {"DataBegin"}
    while position + 1 < len(words):
        key = words[position]
        if key in _LISTS:
            try:
                count = int(words[position + 1])
                angles = np.array(words[position + 2 : position + 2 + count], dtype=np.float64)
            except ValueError as error:
                raise SimrigError(f"Zemax file '{path}' has no angles at {key}") from error
            if (
                not 0 < count <= _MOST_ANGLES
                or len(angles) != count
                or not np.abs(angles).max() <= 360.0
            ):
                raise SimrigError(f"Zemax file '{path}' has no {count} angles at {key}")
            lists[key] = angles
            position += 2 + count
        elif key in starts:
            break
        else:
            fields[key] = words[position + 1]
            position += 2
    missing = [name for name in _LISTS if name not in lists]
    if missing:
        raise SimrigError(f"Zemax file '{path}' lacks {', '.join(missing)}")
    return fields, lists, position


def _blocks(
    path: Path, words: list[str], names: tuple[str, ...], shape: tuple[int, int, int]
) -> list[np.ndarray]:
    """Return one array of values per colour, over incidence, azimuth and radial angle."""
    size = shape[1] * shape[2]
    found = []
    position = 0
    for name in names:
        block = []
        if name in words[position:]:
            position = words.index(name, position) + 1
        position += words[position : position + 1] == ["DataBegin"]
        for _ in range(shape[0]):
            if words[position : position + 1] == ["TIS"]:
                position += 2
            block.append(words[position : position + size])
            position += size
        try:
            values = np.array(block, dtype=np.float64)
        except ValueError as error:
            raise SimrigError(f"Zemax file '{path}' has values missing: truncated?") from error
        if values.shape != (shape[0], size) or not np.all(np.isfinite(values)):
            raise SimrigError(f"Zemax file '{path}' has values missing: truncated?")
        found.append(values.reshape(shape))
        position += words[position : position + 1] == ["DataEnd"]
    return found


def _views(incidence: np.ndarray, azimuth: np.ndarray, radial: np.ndarray) -> np.ndarray:
    """Return unit vectors (incidence, azimuth, radial, 3) for light that comes from phi = 0."""
    theta = np.radians(incidence)[:, None, None, None]
    a = np.radians(azimuth)[None, :, None, None]
    r = np.radians(radial)[None, None, :, None]
    specular = to_vector(theta[..., 0], np.full_like(theta[..., 0], np.pi))
    up = np.concatenate([np.cos(theta), np.zeros_like(theta), np.sin(theta)], axis=-1)
    side = np.cross(specular, up)
    return np.cos(r) * specular + np.sin(r) * (np.cos(a) * up + np.sin(a) * side)

"""ALTA text files: BRDF samples with a header that names their parameterisation.

Header lines start with ``#``: ``#DIM inputs outputs``, ``#PARAM_IN name``, ``#PARAM_OUT name``,
``#VS`` (how the samples' confidence is stored; only 0, none, is read). Then one row per sample: the
inputs (angles in radians) and the outputs. Source: the ALTA library (Belcour, Barla, Pacanowski),
``core/params``: V and L are view and light, H the half vector, of which D is measured; DPHI is the
azimuth between, PROJ_DPHI theta_v times its cosine and sine.

Outputs: INV_STERADIAN and RGB_COLOR are f_r, XYZ_COLOR is converted, INV_STERADIAN_COSINE_FACTOR
is divided by the light's cosine, ENERGY is refused.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from simrig.brdf.protocol import Brdf
from simrig.brdf.tables.from_samples import assemble, half_difference_table
from simrig.brdf.tables.scattered import ScatteredSamples
from simrig.core.colour import FROM_XYZ
from simrig.core.errors import SimrigError, check_known
from simrig.core.gamut import CLIP, outside
from simrig.directions.half_difference import from_half_difference
from simrig.directions.spherical import to_vector
from simrig.files.text import not_negative, number_rows, read_text

_HORIZON = 1e-6  # cosine below which a pair of half-difference angles is no pair of the hemisphere

Pair = tuple[np.ndarray, np.ndarray]  # light and view, unit vectors (n, 3)


def _angles(theta_i: np.ndarray, phi_i: np.ndarray, theta_v: np.ndarray, phi_v: np.ndarray) -> Pair:
    return to_vector(theta_i, phi_i), to_vector(theta_v, phi_v)


def _projected(theta_i: np.ndarray, x: np.ndarray, y: np.ndarray) -> Pair:
    return _angles(theta_i, 0.0 * x, np.hypot(x, y), np.arctan2(y, x))


def _half(theta_h: np.ndarray, phi_h: np.ndarray, theta_d: np.ndarray, phi_d: np.ndarray) -> Pair:
    # the difference vector is that of the view, which the library's vectors have first
    view, light = from_half_difference(theta_h, phi_h, theta_d, phi_d)
    return light, view


def _retro(theta_i: np.ndarray, x: np.ndarray, y: np.ndarray) -> Pair:
    """The view in polar coordinates around the light, turned towards the pole."""
    separation, turn = np.hypot(x, y), np.arctan2(y, x)
    z = np.cos(separation) * np.cos(theta_i) + np.cos(turn) * np.sin(separation) * np.sin(theta_i)
    size = np.sqrt(np.maximum(1.0 - z * z, 0.0))
    across = np.clip(np.sin(separation) * np.sin(turn), -size, size)
    view = np.stack([np.sqrt(np.maximum(size**2 - across**2, 0.0)), across, z], axis=-1)
    return to_vector(theta_i, 0.0 * theta_i), view


def _back(theta_i: np.ndarray, x: np.ndarray, y: np.ndarray) -> Pair:
    """The view as the mirror image of the reflected light in a back vector (Schlick)."""
    light = to_vector(theta_i, 0.0 * theta_i)
    back = to_vector(np.hypot(x, y), np.arctan2(y, x))
    reflected = light * [-1.0, -1.0, 1.0]
    view = 2.0 * (back * reflected).sum(axis=-1, keepdims=True) * back - reflected
    return light, view


def _neumann(half: np.ndarray, back: np.ndarray, turn: np.ndarray) -> Pair:
    """Half and back vector projected to the surface, and the azimuth between (Neumann 1996)."""
    x, y = np.cos(turn) * back, np.sin(turn) * back
    sides = []
    for sign in (-1.0, 1.0):  # light, view
        px, py = half + sign * x, sign * y
        squared = px * px + py * py
        z = np.where(squared <= 1.0, np.sqrt(np.maximum(1.0 - squared, 0.0)), -1.0)
        sides.append(np.stack([px, py, z], axis=-1))
    return sides[0], sides[1]


@dataclass(frozen=True)
class _Parameterisation:
    inputs: int
    to_pair: Callable[..., Pair]
    isotropic: bool


_KNOWN: dict[str, _Parameterisation] = {
    "SPHERICAL_TL_PL_TV_PV": _Parameterisation(4, _angles, False),
    "CARTESIAN": _Parameterisation(
        6, lambda *v: (np.stack(v[3:], axis=-1), np.stack(v[:3], axis=-1)), False
    ),
    "RUSIN_TH_PH_TD_PD": _Parameterisation(4, _half, False),
    "RUSIN_TH_PH_TD": _Parameterisation(3, lambda h, p, d: _half(h, p, d, 0.0 * h), False),
    "RUSIN_TH_TD_PD": _Parameterisation(3, lambda h, d, p: _half(h, 0.0 * h, d, p), True),
    "RUSIN_TH_TD": _Parameterisation(
        2, lambda h, d: _half(h, 0.0 * h, d, 0.0 * h + np.pi / 2), True
    ),
    "COS_TH_TD": _Parameterisation(
        2, lambda h, d: _half(_arccos(h), 0.0 * h, _arccos(d), 0.0 * h), True
    ),
    "ISOTROPIC_TL_TV_PROJ_DPHI": _Parameterisation(3, _projected, True),
    "ISOTROPIC_TV_PROJ_DPHI": _Parameterisation(2, lambda x, y: _projected(0.0 * x, x, y), True),
    "ISOTROPIC_TV_TL_DPHI": _Parameterisation(3, lambda v, i, p: _angles(i, 0.0 * i, v, p), True),
    "RETRO_TL_TVL_PROJ_DPHI": _Parameterisation(3, _retro, True),
    "SCHLICK_TL_TK_PROJ_DPHI": _Parameterisation(3, _back, True),
    "NEUMANN_3D": _Parameterisation(3, _neumann, True),
    "NEUMANN_2D": _Parameterisation(2, lambda h, b: _neumann(h, b, 0.0 * h + np.pi / 2), True),
}
# named by the library; they hold less than a pair of directions, or its code is not settled
_NOT_READ = {
    **dict.fromkeys(
        ("COS_TH", "COS_TK", "COS_TLV", "COS_TLR", "RUSIN_VH", "SCHLICK_VK", "SCHLICK_VH"),
        "one direction or cosine alone, which does not tell light from view",
    ),
    **dict.fromkeys(
        (
            "STARK_2D",
            "STARK_3D",
            "STEREOGRAPHIC",
            "RUSIN_VH_VD",
            "SCHLICK_TK_PK",
            "ROMEIRO_TH_TD",
            "ISOTROPIC_TV_TL",
            "ISOTROPIC_TD_PD",
        ),
        "not read; ALTA's data2data converts it to SPHERICAL_TL_PL_TV_PV",
    ),
}
_OUTPUTS = (
    "RGB_COLOR",
    "XYZ_COLOR",
    "INV_STERADIAN",
    "INV_STERADIAN_COSINE_FACTOR",
    "UNKNOWN_OUTPUT",
)


@dataclass(frozen=True)
class _Content:
    """The rows of a file that are pairs of the hemisphere, and what they are."""

    name: str
    inputs: np.ndarray
    light: np.ndarray
    view: np.ndarray
    values: np.ndarray
    isotropic: bool
    below: int


def read_alta(path: str | Path, clamp_negative: bool = False) -> ScatteredSamples:
    """Read the samples of an ALTA file; one output becomes a grey, three are linear RGB.

    Args:
        clamp_negative: set negative values to 0 instead of refusing them.

    Raises:
        SimrigError: an incomplete header, an unknown parameterisation, rows that do not fit it,
            NaN or negative values.
    """
    return _samples(Path(path), _content(Path(path), clamp_negative))


def load_alta(
    path: str | Path, clamp_negative: bool = False, gamut: str = CLIP
) -> tuple[Brdf, list[str]]:
    """Read the samples and make a table of them (see ``assemble``).

    A whole grid of half-difference angles becomes a table of these angles; grids of directions a
    table of directions.

    Returns:
        The table, and what was done.

    Raises:
        SimrigError: see ``read_alta``; samples that are too sparse, with what is missing.
    """
    path = Path(path)
    content = _content(path, clamp_negative)
    notes = [content.name]
    if content.below:
        notes.append(f"{content.below:,} rows below the horizon left out")
    if content.name == "RUSIN_TH_TD_PD":
        table = half_difference_table(content.inputs, content.values, path.stem, gamut)
        if table is not None:
            table.outside = outside(content.values)
            return table, [*notes, "a whole grid of theta_h, theta_d, phi_d"]
    found = assemble(replace(_samples(path, content), gamut=gamut), "ALTA samples")
    return found.brdf, [*notes, found.how]


def is_alta(text: str) -> bool:
    """Return whether the start of a text file has this format's header."""
    return "DIM" in _header(text.splitlines())


def _content(path: Path, clamp_negative: bool) -> _Content:
    lines = read_text(path, "ALTA").splitlines()
    header = _header(lines)
    inputs, outputs, name = _structure(path, header)
    unit = _output(path, header, outputs)
    table = _numbers(path, lines, inputs, inputs + outputs)
    values = not_negative(path, table[:, inputs:], clamp_negative)
    values = np.array(np.broadcast_to(values, (len(table), 3)))
    known = _KNOWN[name]
    with np.errstate(invalid="ignore"):
        light, view = known.to_pair(*table[:, :inputs].T)
    lengths = [np.linalg.norm(side, axis=1, keepdims=True) for side in (light, view)]
    if min(length.min() for length in lengths) < 1e-6:
        raise SimrigError(f"ALTA file '{path}' has a direction of no length")
    light, view = (side / length for side, length in zip((light, view), lengths, strict=True))
    # only these parameters can describe a pair that the hemisphere does not have
    indirect = name.startswith(("RUSIN", "COS_", "RETRO", "SCHLICK", "NEUMANN"))
    above = np.minimum(light[:, 2], view[:, 2]) > _HORIZON
    kept = above if indirect else np.ones(len(table), dtype=bool)
    if not kept.any():
        raise SimrigError(f"ALTA file '{path}' has no pair of directions above the horizon")
    if unit == "XYZ_COLOR":
        values = values @ FROM_XYZ.T
    if unit == "INV_STERADIAN_COSINE_FACTOR":
        values = values / np.maximum(light[:, 2:], 1e-3)
    kept_parts = (table[kept, :inputs], light[kept], view[kept], values[kept])
    return _Content(name, *kept_parts, known.isotropic, int((~kept).sum()))


def _samples(path: Path, content: _Content) -> ScatteredSamples:
    angles = [
        angle
        for d in (content.light, content.view)
        for angle in (np.arctan2(np.hypot(d[:, 0], d[:, 1]), d[:, 2]), np.arctan2(d[:, 1], d[:, 0]))
    ]
    theta_i, phi_i, theta_v, phi_v = angles
    return ScatteredSamples(
        theta_i, phi_i, theta_v, phi_v, content.values, path.stem, content.isotropic
    )


def _arccos(cosine: np.ndarray) -> np.ndarray:
    return np.arccos(np.clip(cosine, -1.0, 1.0))


def _header(lines: list[str]) -> dict[str, list[str]]:
    fields: dict[str, list[str]] = {}
    for line in lines:
        if not line.startswith("#"):
            if line.strip():
                break
            continue
        words = line[1:].split()
        if words:
            fields[words[0]] = words[1:]
    return fields


def _structure(path: Path, header: dict[str, list[str]]) -> tuple[int, int, str]:
    try:
        inputs, outputs = (int(word) for word in header["DIM"])
        name = header["PARAM_IN"][0]
    except (KeyError, ValueError, IndexError) as error:
        raise SimrigError(
            f"ALTA file '{path}' needs '#DIM inputs outputs' and '#PARAM_IN'"
        ) from error
    if name in _NOT_READ:
        raise SimrigError(f"ALTA file '{path}' is in {name}: {_NOT_READ[name]}")
    check_known("ALTA parameterisation", name, _KNOWN)
    if inputs != _KNOWN[name].inputs or outputs not in (1, 3):
        raise SimrigError(
            f"ALTA file '{path}' has {inputs} inputs and {outputs} outputs; {name} has "
            f"{_KNOWN[name].inputs}, and 1 or 3 outputs can be read"
        )
    if any(word != "0" for word in header.get("VS", [])):
        raise SimrigError(f"ALTA file '{path}' stores confidences (#VS), which cannot be read")
    return inputs, outputs, name


def _output(path: Path, header: dict[str, list[str]], outputs: int) -> str:
    """Return what the outputs are."""
    unit = (header.get("PARAM_OUT") or ["UNKNOWN_OUTPUT"])[0]
    if unit == "ENERGY":
        raise SimrigError(f"ALTA file '{path}' holds ENERGY, not f_r in 1/sr: it cannot be used")
    check_known("ALTA output", unit, _OUTPUTS)
    if unit == "XYZ_COLOR" and outputs != 3:
        raise SimrigError(f"ALTA file '{path}' says XYZ_COLOR and has {outputs} outputs")
    return unit


def _numbers(path: Path, lines: list[str], inputs: int, width: int) -> np.ndarray:
    """Return the rows that are not comments, shape (n, width)."""
    rows = ((number, line.partition("#")[0].split()) for number, line in enumerate(lines, 1))
    table = number_rows(f"ALTA file '{path}'", ((n, words) for n, words in rows if words), width)
    if np.abs(table[:, :inputs]).max() > 1e6:
        raise SimrigError(f"ALTA file '{path}' has angles that cannot be (radians are expected)")
    return table

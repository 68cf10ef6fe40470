"""ALTA text files: BRDF samples with a header that names their parameterisation.

Header lines start with ``#``: ``#DIM inputs outputs``, ``#PARAM_IN name``, ``#VS`` (how the
samples' confidence is stored; only 0, none, is read). Then one row per sample: the inputs and
the outputs. Parameterisations (angles in radians): ``ISOTROPIC_TL_TV_PROJ_DPHI`` (theta_l,
theta_v·cos Δphi, theta_v·sin Δphi), ``ISOTROPIC_TV_TL_DPHI``, ``SPHERICAL_TL_PL_TV_PV`` and
``CARTESIAN`` (view, light). Source: the ALTA library (Belcour, Barla, Pacanowski).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from simrig.brdf.checks import CLAMP
from simrig.brdf.tables.scattered import ScatteredSamples
from simrig.core.errors import SimrigError, unknown_name
from simrig.files.atomic import existing_file

_LARGEST_FILE = 1 << 28
_INPUTS = {
    "ISOTROPIC_TL_TV_PROJ_DPHI": 3,
    "ISOTROPIC_TV_TL_DPHI": 3,
    "SPHERICAL_TL_PL_TV_PV": 4,
    "CARTESIAN": 6,
}


def read_alta(path: str | Path, clamp_negative: bool = False) -> ScatteredSamples:
    """Read the samples of an ALTA file; one output becomes a grey, three are linear RGB.

    Args:
        path: the file.
        clamp_negative: set negative values to 0 instead of refusing them.

    Raises:
        SimrigError: an incomplete header, an unknown parameterisation, rows that do not fit it,
            NaN or negative values.
    """
    path = existing_file(path)
    if path.stat().st_size > _LARGEST_FILE:
        raise SimrigError(f"ALTA file '{path}' is too large to be one")
    lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    header = _header(lines)
    inputs, outputs, parameterisation = _structure(path, header)
    rows = [
        (number, line.split())
        for number, line in enumerate(lines, 1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    table = _numbers(path, rows, inputs + outputs)
    values = np.broadcast_to(table[:, inputs:], (len(table), 3))
    negative = int((table[:, inputs:] < 0.0).sum())
    if negative and not clamp_negative:
        raise SimrigError(
            f"'{path}' has {negative} negative of {table[:, inputs:].size} values{CLAMP}"
        )
    angles = _angles(parameterisation, table[:, :inputs])
    isotropic = parameterisation.startswith("ISOTROPIC")
    return ScatteredSamples(*angles, np.maximum(values, 0.0), path.stem, isotropic)


def is_alta(text: str) -> bool:
    """Return whether the start of a text file has this format's header."""
    return "DIM" in _header(text.splitlines())


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
    if name not in _INPUTS:
        raise unknown_name("ALTA parameterisation", name, _INPUTS)
    if inputs != _INPUTS[name] or outputs not in (1, 3):
        raise SimrigError(
            f"ALTA file '{path}' has {inputs} inputs and {outputs} outputs; {name} has "
            f"{_INPUTS[name]}, and 1 or 3 outputs can be read"
        )
    if header.get("VS", ["0"]) not in (["0"], []):
        raise SimrigError(f"ALTA file '{path}' stores confidences (#VS), which cannot be read")
    return inputs, outputs, name


def _numbers(path: Path, rows: list[tuple[int, list[str]]], width: int) -> np.ndarray:
    if not rows:
        raise SimrigError(f"ALTA file '{path}' has no samples")
    for number, words in rows:
        if len(words) != width:
            raise SimrigError(
                f"line {number} of ALTA file '{path}' has {len(words)} numbers instead of {width}: "
                "truncated?"
            )
    try:
        table = np.array([[float(word) for word in words] for _, words in rows])
    except ValueError as error:
        raise SimrigError(f"ALTA file '{path}' has a row that is not numeric") from error
    if not np.all(np.isfinite(table)):
        raise SimrigError(f"ALTA file '{path}' has NaN or infinite values")
    return table


def _angles(name: str, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return theta_i, phi_i, theta_v, phi_v."""
    zero = np.zeros(len(x))
    if name == "ISOTROPIC_TL_TV_PROJ_DPHI":
        return x[:, 0], zero, np.hypot(x[:, 1], x[:, 2]), np.arctan2(x[:, 2], x[:, 1])
    if name == "ISOTROPIC_TV_TL_DPHI":
        return x[:, 1], zero, x[:, 0], x[:, 2]
    if name == "SPHERICAL_TL_PL_TV_PV":
        return x[:, 0], x[:, 1], x[:, 2], x[:, 3]
    view, light = x[:, :3], x[:, 3:]
    angles = [
        angle
        for d in (light, view)
        for angle in (
            np.arctan2(np.hypot(d[:, 0], d[:, 1]), d[:, 2]),
            np.arctan2(d[:, 1], d[:, 0]),
        )
    ]
    return angles[0], angles[1], angles[2], angles[3]

"""The universal BRDF format of the BiRD project: JSON with one array per variable.

``data`` holds theta_i, phi_i, theta_r, phi_r and BRDF, each with a unit and values, one value per
sample; wavelength_i tells spectral samples apart, polarization_i and polarization_r polarised ones,
which are averaged. The older form, ``variables`` and rows of ``values``, is read too. What simrig
writes has one sample per colour channel, named in ``adhoc_variables.channel`` (linear RGB).
Source: Lanevski et al. 2022, Color Research and Application 47, 1177; schema v1.0.
"""

from __future__ import annotations

import json
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from simrig.brdf.protocol import Brdf
from simrig.brdf.tables.from_samples import assemble
from simrig.brdf.tables.scattered import ScatteredSamples
from simrig.brdf.tables.to_samples import sampled
from simrig.core.colour import FROM_XYZ
from simrig.core.errors import SimrigError
from simrig.core.gamut import CLIP
from simrig.files.atomic import atomic_write
from simrig.files.text import not_negative, read_text
from simrig.files.wavelengths import to_rgb

_ANGLES = ("theta_i", "phi_i", "theta_r", "phi_r")
_SCHEMA = (
    "https://raw.githubusercontent.com/BiRD-project/BiRD_view/master/BRDF_JSON_schema/"
    "brdf_json_schema_v1.0.json"
)


def is_bird(text: str) -> bool:
    """Return whether the start of a text file looks like JSON of this format."""
    return text.lstrip("\ufeff \t\r\n").startswith("{") and '"metadata"' in text


def load_bird(
    path: str | Path,
    clamp_negative: bool = False,
    wavelength: float | None = None,
    gamut: str = CLIP,
) -> tuple[Brdf, list[str]]:
    """Read the samples as linear RGB and make a table of them (see ``assemble``).

    Args:
        clamp_negative: set negative values to 0 instead of refusing them.
        wavelength: in nm, to take one of several as grey.

    Returns:
        The table, and what was done.

    Raises:
        SimrigError: not JSON, not of this format, arrays that do not fit together, values that
            cannot be.
    """
    path = Path(path)
    data = _data(path)
    columns = [_angle(path, data, name) for name in _ANGLES]
    values = _array(path, data, "BRDF")
    if {len(column) for column in columns} != {len(values)}:
        raise SimrigError(f"BiRD file '{path}' has arrays of different lengths")
    angles = np.stack(columns, axis=1)
    unit = str(data["BRDF"].get("unit", "1/sr")).replace(" ", "")
    if unit not in ("1/sr", "sr^-1", "sr-1", "sr⁻¹", ""):
        raise SimrigError(f"BiRD file '{path}' has a BRDF in '{unit}', not in 1/sr")
    values = not_negative(path, values, clamp_negative)
    keys, kinds, notes = _keys(path, data, len(values))
    directions, table = _pivot(path, angles, keys, values, len(kinds))
    colours, note = _colours(path, kinds, table, wavelength)
    theta_i, phi_i, theta_v, phi_v = directions.T
    samples = ScatteredSamples(theta_i, phi_i, theta_v, phi_v, colours, path.stem, gamut=gamut)
    found = assemble(samples, "BiRD samples")
    return found.brdf, [*notes, note, found.how]


def write_bird(path: str | Path, brdf: Brdf) -> None:
    """Write a BRDF as samples on a grid of directions (see ``sampled``), three per direction."""
    samples = sampled(brdf)
    columns = (samples.theta_i, samples.phi_i, samples.theta_v, samples.phi_v)
    data: dict[str, Any] = {
        name: {"unit": "deg", "values": np.repeat(np.degrees(column), 3).round(9).tolist()}
        for name, column in zip(_ANGLES, columns, strict=True)
    }
    data["BRDF"] = {
        "unit": "1/sr",
        "values": [float(f"{value:.9g}") for value in samples.values.ravel()],
    }
    data["adhoc_variables"] = {
        "channel": {
            "description": "colour channel, linear RGB with sRGB primaries",
            "unit": "",
            "type": "string",
            "values": ["R", "G", "B"] * len(samples),
        }
    }
    metadata = {
        "schema": _SCHEMA,
        "id": brdf.name,
        "type": "BRDF",
        "timestamp": datetime.now(UTC).isoformat(timespec="seconds"),
        "provenance": {},
        "description": f"{brdf.name}, sampled by simrig",
        "method": "simulation",
        "instrumentation": {},
        "software": {"name": "simrig"},
        "sample": {"name": brdf.name},
        "environment": {},
    }
    with atomic_write(path) as temporary:
        text = json.dumps({"metadata": metadata, "data": data}, allow_nan=False)
        temporary.write_text(text, encoding="utf-8")


def _data(path: Path) -> dict[str, Any]:
    """Return the variables by name, the older form made like the newer one."""
    try:
        content = json.loads(read_text(path, "BiRD"))
    except (ValueError, RecursionError) as error:
        raise SimrigError(f"'{path}' is damaged or truncated: it is no JSON ({error})") from error
    data = content.get("data") if isinstance(content, dict) else None
    if not isinstance(data, dict):
        raise SimrigError(f"'{path}' is JSON, but no BRDF of the BiRD format: it has no 'data'")
    variables, rows = data.get("variables"), data.get("values")
    if isinstance(variables, list) and isinstance(rows, list):
        named = [v for v in variables if isinstance(v, dict) and isinstance(v.get("name"), str)]
        whole = all(isinstance(row, list) and len(row) == len(variables) for row in rows)
        if len(named) != len(variables) or not whole or not rows:
            raise SimrigError(f"BiRD file '{path}' has rows that do not fit its variables")
        columns = zip(*rows, strict=True)
        data = {v["name"]: {**v, "values": list(c)} for v, c in zip(named, columns, strict=True)}
    missing = [name for name in (*_ANGLES, "BRDF") if not isinstance(data.get(name), dict)]
    if missing:
        raise SimrigError(
            f"'{path}' is JSON, but no BRDF of the BiRD format: 'data' lacks {', '.join(missing)}"
        )
    return data


def _array(path: Path, data: dict[str, Any], name: str) -> np.ndarray:
    try:
        values = np.array(data[name]["values"], dtype=np.float64)
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise SimrigError(f"'{name}' of BiRD file '{path}' has no array of numbers") from error
    if values.ndim != 1 or values.size == 0 or not np.all(np.isfinite(values)):
        raise SimrigError(f"'{name}' of BiRD file '{path}' is no list of finite numbers")
    return values


def _angle(path: Path, data: dict[str, Any], name: str) -> np.ndarray:
    values, unit = _array(path, data, name), data[name].get("unit")
    if unit in ("deg", "°", "degree", "degrees"):
        return np.radians(values)
    if unit in ("rad", "radian", "radians"):
        return values
    raise SimrigError(f"'{name}' of BiRD file '{path}' is in '{unit}'; deg and rad are read")


def _keys(path: Path, data: dict[str, Any], count: int) -> tuple[np.ndarray, list[Any], list[str]]:
    """Return the number of each sample's channel or wavelength, these, and what was averaged."""
    notes = [
        f"{name.replace('_', ' of ')} averaged"
        for name, side in (("polarization_i", "light"), ("polarization_r", "view"))
        if name in data and side
    ]
    adhoc = data.get("adhoc_variables")
    channel = adhoc.get("channel") if isinstance(adhoc, dict) else None
    if isinstance(channel, dict) and isinstance(channel.get("values"), list):
        labels = [str(label).upper() for label in channel["values"]]
        for wanted in ("RGB", "XYZ"):
            if len(labels) == count and set(labels) == set(wanted):
                return np.array([wanted.index(label) for label in labels]), list(wanted), notes
        raise SimrigError(f"BiRD file '{path}' names channels that are neither R, G, B nor X, Y, Z")
    for name in ("wavelength_i", "wavelength_r"):
        if isinstance(data.get(name), dict):
            waves = _array(path, data, name)
            unit = str(data[name].get("unit", "nm"))
            if unit not in ("nm", "μm", "µm", "um"):
                raise SimrigError(f"BiRD file '{path}' has wavelengths in '{unit}'; nm are read")
            waves = waves if unit == "nm" else 1000.0 * waves
            if len(waves) != count:
                raise SimrigError(f"BiRD file '{path}' has arrays of different lengths")
            kinds, number = np.unique(np.round(waves, 6), return_inverse=True)
            return number.ravel(), kinds.tolist(), notes
    return np.zeros(count, dtype=np.int64), ["grey"], notes


def _pivot(
    path: Path, angles: np.ndarray, keys: np.ndarray, values: np.ndarray, count: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the different pairs of directions and their values, (pairs, count)."""
    _, first, pair = np.unique(np.round(angles, 7), axis=0, return_index=True, return_inverse=True)
    cells = pair.ravel() * count + keys
    number = np.bincount(cells, minlength=len(first) * count)
    if np.any(number == 0):
        raise SimrigError(
            f"BiRD file '{path}' has not every channel or wavelength at every pair of directions"
        )
    table = np.bincount(cells, values, len(first) * count) / number
    return angles[first], table.reshape(len(first), count)


def _colours(
    path: Path, kinds: list[Any], table: np.ndarray, wanted: float | None
) -> tuple[np.ndarray, str]:
    if kinds == ["grey"]:
        return np.repeat(table, 3, axis=1), "grey: no wavelengths or channels"
    if kinds == list("RGB"):
        return table, "RGB"
    if kinds == list("XYZ"):
        return table @ FROM_XYZ.T, "CIE XYZ to RGB"
    return to_rgb(table, np.array(kinds), f"BiRD file '{path}'", wanted)

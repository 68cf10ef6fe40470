"""Scatter data as ASTM E1392 and E2387 lay them out: keywords, then one line per sample.

A header of ``KEYWORD value`` lines ends with ``VARS theta_i,phi_i,theta_s,phi_s,...``, which names
the columns; ``NUM_POINTS`` counts the lines that follow. Values are named R, G, B, or X, Y, Z, or
by their wavelength (``550nm``), or stand alone (BRDF, BSDF); CCBSDF and ARS hold f_r times the
cosine of theta_s and are divided by it. Angles are radians as Cornell publishes them, or degrees
where they do not fit into a quarter turn of radians; a negative theta lies across the normal.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from simrig.brdf.protocol import Brdf
from simrig.brdf.tables.from_samples import assemble
from simrig.brdf.tables.scattered import ScatteredSamples
from simrig.brdf.tables.to_samples import sampled
from simrig.core.colour import FROM_XYZ
from simrig.core.errors import SimrigError
from simrig.core.gamut import CLIP
from simrig.files.atomic import atomic_write
from simrig.files.text import not_negative, number_rows, read_text
from simrig.files.wavelengths import to_rgb

_COLUMNS = {
    "theta_i": ("theta_i", "thetai", "theta_in", "ti"),
    "phi_i": ("phi_i", "phii", "phi_in", "pi"),
    "theta_s": ("theta_s", "thetas", "theta_r", "theta_o", "theta_v", "theta_out", "ts"),
    "phi_s": ("phi_s", "phis", "phi_r", "phi_o", "phi_v", "phi_out", "ps"),
}
_WITH_COSINE = ("ccbsdf", "ccbrdf", "ars", "cosbrdf")
_TRIPLES = {("r", "g", "b"): "rgb", ("red", "green", "blue"): "rgb", ("x", "y", "z"): "xyz"}
_KEYWORD = re.compile(r"^[A-Z][A-Z0-9_]*(\s|$)")
_QUARTER = np.pi / 2 + 1e-3


def is_astm(text: str) -> bool:
    """Return whether the start of a text file has this format's header."""
    lines = [line for line in text.splitlines() if line.strip()][:80]
    named = any(line.startswith(("VARS ", "VARS\t", "NUM_POINTS")) for line in lines)
    return named and any(_KEYWORD.match(line) for line in lines[:1])


def load_astm(
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
        SimrigError: no VARS line, columns that are missing or unknown, another number of lines than
            NUM_POINTS says, values that cannot be.
    """
    path, lines = Path(path), read_text(path, "ASTM", "latin-1").splitlines()
    header, names, start = _header(path, lines)
    table = _table(path, lines, start, len(names), header.get("NUM_POINTS"))
    angles, columns, notes = _angles(path, names, table)
    rest = [name for number, name in enumerate(names) if number not in columns]
    values = table[:, [number for number in range(len(names)) if number not in columns]]
    values = not_negative(path, values, clamp_negative)
    colours, note = _colours(path, rest, values, angles[:, 2], wavelength)
    theta_i, phi_i, theta_v, phi_v = angles.T
    samples = ScatteredSamples(theta_i, phi_i, theta_v, phi_v, colours, path.stem, gamut=gamut)
    found = assemble(samples, "ASTM samples")
    return found.brdf, [*notes, note, found.how]


def write_astm(path: str | Path, brdf: Brdf) -> None:
    """Write a BRDF as samples on a grid of directions (see ``sampled``), linear RGB in 1/sr."""
    samples = sampled(brdf)
    name = "".join(c for c in brdf.name if c.isprintable() and c != '"')
    head = [
        "LAB_NAME simrig",
        f'SAMPLE_NAME "{name}"',
        "MEAS_NAME BRDF",
        "UNITS 1/sr",
        "ANGLE_UNITS radians",
        "COLOR linear RGB, sRGB primaries",
        f"NUM_POINTS {len(samples)}",
        "VARS theta_i,phi_i,theta_s,phi_s,R,G,B",
        "",
    ]
    columns = (samples.theta_i, samples.phi_i, samples.theta_v, samples.phi_v, *samples.values.T)
    with (
        atomic_write(path) as temporary,
        open(temporary, "w", encoding="ascii", errors="replace") as f,
    ):
        f.write("\n".join(head))
        np.savetxt(f, np.stack(columns, axis=1), fmt="%.8g", delimiter=",")


def _header(path: Path, lines: list[str]) -> tuple[dict[str, str], list[str], int]:
    header: dict[str, str] = {}
    for number, line in enumerate(lines[:10_000]):
        words = line.strip().split(None, 1)
        if not words:
            continue
        key, value = words[0].upper(), words[1] if len(words) > 1 else ""
        if key == "VARS":
            names = [
                name.strip().strip('"') for name in re.split(r"[,;\s]+", value.strip()) if name
            ]
            return header, names, number + 1
        header.setdefault(key, value.strip())
    raise SimrigError(f"'{path}' is no ASTM file: it has no VARS line that names its columns")


def _table(path: Path, lines: list[str], start: int, width: int, stated: str | None) -> np.ndarray:
    rows = (
        (number, re.split(r"[,;\s]+", line.strip().rstrip(",;")))
        for number, line in enumerate(lines[start:], start + 1)
        if line.strip()
    )
    table = number_rows(f"ASTM file '{path}'", rows, width)
    if stated is not None and stated.isdigit() and int(stated) != len(table):
        raise SimrigError(
            f"ASTM file '{path}' says NUM_POINTS {stated} and has {len(table)} samples: truncated?"
        )
    return table


def _angles(
    path: Path, names: list[str], table: np.ndarray
) -> tuple[np.ndarray, list[int], list[str]]:
    """Return theta_i, phi_i, theta_v, phi_v in radians, their columns, and what was assumed."""
    lower = [name.lower() for name in names]
    columns, notes = [], []
    for wanted, known in _COLUMNS.items():
        found = [lower.index(name) for name in known if name in lower]
        if not found:
            raise SimrigError(f"ASTM file '{path}' has no column {wanted}, only {', '.join(names)}")
        columns.append(found[0])
    angles = table[:, columns]
    largest = float(np.abs(angles[:, [0, 2]]).max())
    whole = float(np.abs(angles).max())
    if largest > 90.0 + 1e-6 or whole > 720.0:
        raise SimrigError(f"ASTM file '{path}' has a theta of {largest:g}, beyond 90 degrees")
    if largest > _QUARTER or whole > 4.0 * np.pi:
        angles = np.radians(angles)
        notes.append("angles in degrees")
    else:
        notes.append(f"angles in radians (largest theta {largest:.3g})")
    angles = angles.copy()
    for theta, phi in ((0, 1), (2, 3)):
        across = angles[:, theta] < 0.0
        angles[across, theta] *= -1.0
        angles[across, phi] += np.pi
    return angles, columns, notes


def _colours(
    path: Path, names: list[str], values: np.ndarray, theta_v: np.ndarray, wanted: float | None
) -> tuple[np.ndarray, str]:
    what = f"ASTM file '{path}'"
    lower = tuple(name.lower() for name in names)
    waves = [re.fullmatch(r"(\d+(?:\.\d+)?)\s*nm", name) for name in lower]
    if lower in _TRIPLES and wanted is None:
        rgb = _TRIPLES[lower] == "rgb"
        return (values if rgb else values @ FROM_XYZ.T), ("RGB" if rgb else "CIE XYZ to RGB")
    if waves and all(waves):
        wavelengths = np.array([float(match[1]) for match in waves if match])
        return to_rgb(values, wavelengths, what, wanted)
    if len(lower) == 1:
        grey = values
        note = f"grey: one column, {names[0]}"
        if lower[0] in _WITH_COSINE:
            grey = values / np.maximum(np.cos(theta_v), 1e-3)[:, None]
            note += ", divided by the cosine of theta_s"
        return np.repeat(grey, 3, axis=1), note
    raise SimrigError(
        f"{what} has the columns {', '.join(names)}: R,G,B, or X,Y,Z, or wavelengths (550nm), or "
        "one of f_r are read"
    )

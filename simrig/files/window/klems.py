"""Klems matrices: f_r averaged over patches of the hemisphere, illumination by view.

A basis divides the hemisphere into rings of polar angles and these into patches, the first of each
ring around azimuth 0. An illumination's patch is that into which its light travels, so the light
comes from half a turn further (Klems 1994; Radiance ``bsdf_m.c``): mirror reflection lies on the
diagonal. Read, patches are joined by barycentric interpolation between their centres; written, each
value is the mean over both patches, weighted by the projected solid angle.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from simrig.brdf.checks import CLAMP
from simrig.brdf.protocol import Brdf, evaluate
from simrig.brdf.tables.barycentric import BarycentricBrdf
from simrig.core.colour import FROM_XYZ, TO_XYZ
from simrig.core.errors import SimrigError, check_known, unknown_name
from simrig.core.gamut import CLIP, in_gamut, outside
from simrig.directions.spherical import to_vector
from simrig.files.atomic import atomic_write
from simrig.files.window import xml

_MOST_RINGS = 180
_MOST_PATCHES = 4096
_SAMPLES = 3  # per side of a patch when its mean is taken
_CHUNK = 1 << 19  # pairs of directions that are evaluated at once


@dataclass(frozen=True)
class KlemsBasis:
    """Patches of the hemisphere.

    Attributes:
        bounds_deg: polar angles between the rings, from 0 to 90.
        counts: patches of each ring.
    """

    bounds_deg: tuple[float, ...]
    counts: tuple[int, ...]

    @property
    def patches(self) -> int:
        """How many patches there are."""
        return sum(self.counts)

    def centres(self) -> tuple[np.ndarray, np.ndarray]:
        """Return theta and phi of the centres in radians, (patches,); the pole's is the normal."""
        theta, phi = [], []
        for low, high, count in zip(
            self.bounds_deg[:-1], self.bounds_deg[1:], self.counts, strict=True
        ):
            middle = 0.0 if low == 0.0 and count == 1 else (low + high) / 2.0
            theta += [np.radians(middle)] * count
            phi += (2.0 * np.pi / count * np.arange(count)).tolist()
        return np.array(theta), np.array(phi)

    def inside(self, samples: int) -> np.ndarray:
        """Return directions in each patch, uniform in projected solid angle: (patches, n², 3)."""
        step = (np.arange(samples) + 0.5) / samples
        rings = []
        for low, high, count in zip(
            self.bounds_deg[:-1], self.bounds_deg[1:], self.counts, strict=True
        ):
            sine = np.sin(np.radians([low, high])) ** 2
            theta = np.arcsin(np.sqrt(sine[0] + step * (sine[1] - sine[0])))
            phi = 2.0 * np.pi / count * (np.arange(count)[:, None] + step[None, :] - 0.5)
            rings.append(to_vector(theta[None, None, :], phi[:, :, None]).reshape(count, -1, 3))
        return np.concatenate(rings)


BASES: dict[str, KlemsBasis] = {
    "LBNL/Klems Full": KlemsBasis(
        (0, 5, 15, 25, 35, 45, 55, 65, 75, 90), (1, 8, 16, 20, 24, 24, 24, 16, 12)
    ),
    "LBNL/Klems Half": KlemsBasis(
        (0, 6.5, 19.5, 32.5, 46.5, 61.5, 76.5, 90), (1, 8, 12, 16, 20, 12, 4)
    ),
    "LBNL/Klems Quarter": KlemsBasis((0, 9, 27, 46, 66, 90), (1, 8, 12, 12, 8)),
}


def read_klems(
    path: Path,
    layer: ElementTree.Element,
    blocks: list[xml.Block],
    side: str | None,
    clamp: bool,
    gamut: str = CLIP,
) -> tuple[Brdf, list[str]]:
    """Return the material of a matrix file, and what was done.

    Raises:
        SimrigError: an unknown basis, another count of values than the basis has, values that
            cannot be.
    """
    what = f"BSDF file '{path}'"
    bases = BASES | _own_bases(layer, what)
    matrices = {id(block): _matrix(block, bases, what) for block in blocks}
    chosen, notes = xml.choose_side(path, blocks, side, lambda b: not matrices[id(b)][1].any())
    parts = {b.colour: matrices[id(b)] for b in blocks if b.side == chosen}
    basis, luminance = parts["Y"]
    by_rows = xml.text_of(layer, "DataDefinition/IncidentDataStructure").lower() == "rows"
    if {"X", "Z"} <= set(parts) and all(parts[c][0] is basis for c in "XZ"):
        xyz = np.stack([parts[c][1] for c in "XYZ"], axis=-1)
        values, note = xyz @ FROM_XYZ.T, "CIE XYZ to RGB"
    else:
        xyz = luminance[..., None]
        values, note = np.repeat(xyz, 3, axis=-1), "grey: visible light alone"
    negative = int((xyz < 0.0).sum())
    if negative and not clamp:
        raise SimrigError(f"'{path}' has {negative} negative of {xyz.size} values{CLAMP}")
    if not by_rows:
        values = values.swapaxes(0, 1)
    theta, phi = basis.centres()
    values = values[_opposite(basis)]  # from where the light travels to where it comes from
    brdf = BarycentricBrdf(theta, phi, in_gamut(values, gamut), name=path.stem, gamut=gamut)
    brdf.outside = outside(values)
    return brdf, [f"Klems matrix of {basis.patches} patches", *notes, note]


def write_klems(path: str | Path, brdf: Brdf, basis: str = "LBNL/Klems Full") -> None:
    """Write a BRDF as a Klems matrix (reflection of the front, X, Y and Z).

    Raises:
        SimrigError: an unknown basis.
    """
    check_known("Klems basis", basis, BASES)
    values = _values(brdf, BASES[basis])
    xyz = np.maximum(values[_opposite(BASES[basis])] @ TO_XYZ.T, 0.0).swapaxes(0, 1)
    names = f"<ColumnAngleBasis>{basis}</ColumnAngleBasis>\n<RowAngleBasis>{basis}</RowAngleBasis>"
    data = "".join(
        xml.wavelength_data(
            colour,
            "front",
            names,
            "\n".join(", ".join(f"{v:.7g}" for v in row) + "," for row in xyz[..., channel]),
        )
        for channel, colour in ((1, "Visible"), (0, "CIE-X"), (2, "CIE-Z"))
    )
    definition = _definition(basis, BASES[basis])
    with atomic_write(path) as temporary:
        text = xml.document(brdf.name, "Columns", definition, data)
        temporary.write_text(text, encoding="utf-8")


def _values(brdf: Brdf, basis: KlemsBasis) -> np.ndarray:
    """Return means over patches, (patches of the light, patches of the view, 3)."""
    theta, phi = basis.centres()
    if isinstance(brdf, BarycentricBrdf) and len(brdf.theta) == basis.patches:
        same = np.allclose(brdf.theta, theta, atol=1e-9) and np.allclose(brdf.phi, phi, atol=1e-9)
        if same:  # it is such a matrix: its values are the means already
            return np.asarray(brdf.values, dtype=np.float64)
    inside = basis.inside(_SAMPLES)
    patches, samples = inside.shape[:2]
    view = inside.reshape(-1, 3)
    out = np.empty((patches, patches, 3))
    rows = max(1, _CHUNK // (samples * len(view)))
    for start in range(0, patches, rows):
        light = inside[start : start + rows].reshape(-1, 3)
        values = evaluate(brdf, light[:, None, :], view[None, :, :])
        shape = (-1, samples, patches, samples, 3)
        out[start : start + rows] = values.reshape(shape).mean(axis=(1, 3))
    return out


def _opposite(basis: KlemsBasis) -> np.ndarray:
    """Return the patch half a turn further of each patch.

    Raises:
        SimrigError: a ring of an odd number of patches, which has none.
    """
    numbers, start = [], 0
    for count in basis.counts:
        if count > 1 and count % 2:
            raise SimrigError(
                f"a ring of {count} patches has none opposite: this basis of angles is not read"
            )
        numbers += [start + (k + count // 2) % count for k in range(count)]
        start += count
    return np.array(numbers)


def _matrix(
    block: xml.Block, bases: dict[str, KlemsBasis], what: str
) -> tuple[KlemsBasis, np.ndarray]:
    names = [block.text(tag) for tag in ("ColumnAngleBasis", "RowAngleBasis")]
    known = {name.lower(): basis for name, basis in bases.items()}
    for name in names:
        if name.lower() not in known:
            raise unknown_name(f"basis of angles in {what}:", name, bases)
    basis = known[names[0].lower()]
    if known[names[1].lower()] != basis:
        raise SimrigError(f"{what} has different bases for light and view, which are not read")
    values = xml.numbers(block.text("ScatteringData"), what)
    if values.size != basis.patches**2:
        raise SimrigError(
            f"{what} has {values.size} values instead of {basis.patches}² for {names[0]}: "
            "truncated?"
        )
    return basis, values.reshape(basis.patches, basis.patches)


def _own_bases(layer: ElementTree.Element, what: str) -> dict[str, KlemsBasis]:
    """Return the bases that the file defines."""
    found = {}
    for node in layer.findall("DataDefinition/AngleBasis"):
        name, bounds, counts = xml.text_of(node, "AngleBasisName"), [0.0], []
        for block in node.findall("AngleBasisBlock")[: _MOST_RINGS + 1]:
            try:
                bounds.append(float(xml.text_of(block, "ThetaBounds/UpperTheta")))
                counts.append(int(float(xml.text_of(block, "nPhis"))))
            except (ValueError, OverflowError) as error:
                raise SimrigError(f"{what} defines the basis '{name}' incompletely") from error
        rising = all(np.diff(bounds) > 0.0) and bounds[-1] <= 90.0 + 1e-6
        if not counts or not rising or min(counts) < 1 or sum(counts) > _MOST_PATCHES:
            raise SimrigError(f"{what} defines a basis of angles '{name}' that cannot be")
        found[name] = KlemsBasis(tuple(bounds), tuple(counts))
    return found


def _definition(name: str, basis: KlemsBasis) -> str:
    blocks = "".join(
        f"<AngleBasisBlock><Theta>{0 if low == 0 else (low + high) / 2:g}</Theta>"
        f"<nPhis>{count}</nPhis><ThetaBounds><LowerTheta>{low:g}</LowerTheta>"
        f"<UpperTheta>{high:g}</UpperTheta></ThetaBounds></AngleBasisBlock>\n"
        for low, high, count in zip(
            basis.bounds_deg[:-1], basis.bounds_deg[1:], basis.counts, strict=True
        )
    )
    return f"<AngleBasis>\n<AngleBasisName>{name}</AngleBasisName>\n{blocks}</AngleBasis>\n"

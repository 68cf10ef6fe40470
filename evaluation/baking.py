"""What renders need not be what was measured: the cheapest form within a tolerance.

Every form of ``FORMS`` is made from coarse to fine until its pictures are as near to those of the
material as asked. Which of these is the cheapest is counted, not timed, in the code of its look-up
(``simrig.evaluation.instructions``): the choice does not depend on a busy machine.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import drjit as dr
import numpy as np

from simrig.brdf.analytic import Lambert
from simrig.brdf.kriging.coordinates import EVEN, Stretch
from simrig.brdf.kriging.symmetry import Symmetry
from simrig.brdf.protocol import Brdf, evaluate
from simrig.brdf.tables.dense import DenseTable
from simrig.brdf.tables.half_difference import HalfDifferenceTable, node_angles
from simrig.brdf.tables.resample import is_isotropic, resample_dense
from simrig.brdf.tables.simplex import SimplexTable
from simrig.btf.spatial import SpatialBrdf
from simrig.core import backend
from simrig.core.arrays import table_bytes
from simrig.core.effects import Tolerance
from simrig.core.errors import SimrigError, check_known
from simrig.core.progress import Progress, tracked
from simrig.directions.half_difference import from_half_difference
from simrig.evaluation.instructions import count
from simrig.evaluation.metrics.sphere_picture import SpherePicture
from simrig.files.hdf5 import origin
from simrig.plugins import make_bsdf
from simrig.rendering.render import timed

BAKED = "baked"  # in the provenance of a file
_GATHER = 20.0  # instructions that take as long as one gather (a third of a table's time)
# what else a sample costs, so that baked slices render twice as fast ('simrig bench plugins')
_REST, _TABLE = 3000.0, 829 + 13 * _GATHER
_LONGEST = 10.0  # seconds that baking takes, or finding that no form is within a tolerance
_SHARE = 0.25  # of a picture's tolerance that is spent on baking
_LIGHTS = (16, 4)  # of the two pictures that are compared
_PAIRS, _ROUNDS = 1 << 19, 5  # of the timed look-ups
_LARGEST_THETA = float(np.radians(89.0))
_DENSE = ((15.0, 24), (10.0, 36), (7.5, 48), (5.0, 72), (3.75, 96))  # step in degrees, azimuths
_HALF_DIFFERENCE = ((24, 12, 12, 12), (48, 16, 16, 24), (64, 32, 24, 32))  # nodes


@dataclass(frozen=True)
class Form:
    """One way to store a BRDF for rendering.

    Attributes:
        levels: what ``make`` takes, from coarse to fine, by a name of each.
        make: of a BRDF and a level.
    """

    about: str
    levels: Mapping[str, Any]
    make: Callable[[Brdf, Any], Brdf]


def _lambert(brdf: Brdf, level: None) -> Brdf:
    """Return the diffuse BRDF of the mean albedo, weighted by the cosine of the viewer."""
    sines = (np.arange(8) + 0.5) / 8.0  # of squares: equal projected solid angles
    thetas = np.repeat(np.arcsin(np.sqrt(sines)), 3)
    phis = np.arange(thetas.size) * 2.4  # the golden angle
    views = zip(thetas, phis, strict=True)
    albedos = [brdf.directional_albedo(theta, phi, 48, 96) for theta, phi in views]
    return Lambert(tuple(float(c) for c in np.clip(np.mean(albedos, axis=0), 0.0, 1.0)))


def _dense(brdf: Brdf, level: tuple[float, int]) -> DenseTable:
    step, azimuths = level
    theta_max = min(brdf.theta_max, _LARGEST_THETA)
    number = backend.types("float32").Float
    return resample_dense(brdf, np.radians(step), azimuths, theta_max, float_type=number)


def _simplex(brdf: Brdf, level: tuple[float, int]) -> SimplexTable:
    dense = _dense(brdf, level)
    return SimplexTable(
        dense.values,
        dense.theta_step,
        dense.theta_max,
        reciprocal=dense.reciprocal,
        name=brdf.name,
        gamut=dense.gamut,
    )


def _half_difference(brdf: Brdf, shape: tuple[int, int, int, int]) -> HalfDifferenceTable:
    """Return a table of logarithms; beyond the largest polar angle it holds what is there."""
    isotropic = is_isotropic(brdf)
    symmetry = Symmetry(isotropic=isotropic, reciprocal=brdf.reciprocal)
    shape = (shape[0], 1, *shape[2:]) if isotropic else shape
    stretch, top = Stretch(0.05, 0.3), min(brdf.theta_max, _LARGEST_THETA)
    angles = np.meshgrid(*node_angles(shape, symmetry, stretch), indexing="ij")
    wi, wv = (_lifted(w, top) for w in from_half_difference(*angles))
    values = evaluate(brdf, wi, wv, backend.types("float32").Float)
    floor = max(1e-3 * float(values.mean()), 1e-9)
    return HalfDifferenceTable(
        np.log(np.maximum(values, 0.0) + floor), symmetry, stretch, floor, 0, top, brdf.name, EVEN
    )


def _lifted(w: np.ndarray, theta_max: float) -> np.ndarray:
    """Return directions with polar angles of at most theta_max, of the same azimuths."""
    theta = np.arctan2(np.hypot(w[..., 0], w[..., 1]), w[..., 2])
    phi = np.arctan2(w[..., 1], w[..., 0])
    theta = np.minimum(theta, theta_max)
    parts = np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)
    return np.stack(parts, axis=-1)


def _by_step(levels: tuple[tuple[float, int], ...]) -> dict[str, tuple[float, int]]:
    return {f"{step:g}°": (step, azimuths) for step, azimuths in levels}


FORMS: dict[str, Form] = {
    "lambert": Form("a diffuse formula", {"": None}, _lambert),
    "simplex": Form("a table over all angles, five reads", _by_step(_DENSE), _simplex),
    "dense": Form("the same, multilinear, sixteen reads", _by_step(_DENSE), _dense),
    "half-difference": Form(
        "logarithms over half-difference angles",
        {"×".join(map(str, shape)): shape for shape in _HALF_DIFFERENCE},
        _half_difference,
    ),
}


@dataclass(frozen=True)
class Candidate:
    """What one form came to at the level where it stopped.

    Attributes:
        form: its name in ``FORMS``, or ``"as it is"`` for the material itself.
        delta_e: mean CIE ΔE of the worse of the pictures.
        instructions, gathers: of a look-up with ``eval_pdf`` and ``sample``.
        bytes: that look-ups read.
        nanoseconds: of one look-up of random directions, by kernels; the fastest of a few.
    """

    form: str
    level: str
    delta_e: float
    instructions: int
    gathers: int
    bytes: int
    nanoseconds: float

    @property
    def cost(self) -> float:
        """Instructions, with gathers counted as what they take."""
        return _cost(self.instructions, self.gathers)

    def __str__(self) -> str:
        return f"{self.form} {self.level}".rstrip() + f" ΔE {self.delta_e:.2g}"


@dataclass(frozen=True)
class Baked:
    """A material in the form that renders fastest.

    Attributes:
        chosen: the form and what it comes to.
        itself: the same of the material as it was.
    """

    brdf: Brdf
    chosen: Candidate
    itself: Candidate
    tried: tuple[Candidate, ...]
    tolerance: Tolerance

    @property
    def rest(self) -> Tolerance:
        """What is left of the tolerance of a picture that was baked for (``bake_for``)."""
        return replace(self.tolerance, value=self.tolerance.value * (1.0 / _SHARE - 1.0))

    @property
    def line(self) -> str:
        """What was done, in a line."""
        gain = self.itself.cost / self.chosen.cost
        return (
            f"baked as {self.chosen} (allowed {self.tolerance}): {self.chosen.instructions:,} "
            f"instructions and {self.chosen.gathers} gathers of a look-up in place of "
            f"{self.itself.instructions:,} and {self.itself.gathers} (counted as {gain:.2g} times "
            f"cheaper; {self.chosen.nanoseconds:.3g} ns in place of "
            f"{self.itself.nanoseconds:.3g} when baked)"
        )

    def provenance(self) -> dict[str, Any]:
        """Return what the file says."""
        about = {
            "of": self.brdf.name,
            "tolerance": str(self.tolerance),
            "chosen": asdict(self.chosen),
            "itself": asdict(self.itself),
            "tried": [asdict(candidate) for candidate in self.tried],
        }
        return {BAKED: about, "found": {"lines": [self.line]}}


def _cost(instructions: int, gathers: int) -> float:
    return instructions + _GATHER * gathers


def bake_for(brdf: Any, tolerance: Tolerance, seconds: float) -> Baked | None:
    """Return a material baked for one picture, where that saves time.

    Args:
        brdf: what the picture looks up; nothing but a BRDF can be baked.
        tolerance: of the picture; the baked form takes a quarter of it.
        seconds: that the picture is expected to take without.

    Returns:
        None where less is expected to be saved than baking takes, or where nothing can be baked.
    """
    mine = isinstance(brdf, Brdf) and not isinstance(brdf, SpatialBrdf) and brdf.in_kernels
    if not mine or tolerance.metric != "dE" or not backend.current().startswith("llvm"):
        return None
    if seconds < _LONGEST or origin(brdf).get(BAKED):
        return None
    own = _cost(**count(make_bsdf(brdf), sampled=True))
    if seconds * (own - _TABLE) / (_REST + own) < _LONGEST:
        return None
    try:
        return bake(brdf, replace(tolerance, value=tolerance.value * _SHARE), first=True)
    except SimrigError:  # none within it
        return None


def bake(
    brdf: Brdf, tolerance: Tolerance, progress: Progress | None = None, first: bool = False
) -> Baked:
    """Return the cheapest form of a BRDF whose pictures stay within a tolerance.

    Args:
        tolerance: mean ΔE of pictures of a sphere under directional lights, ``dE``.
        first: try no more forms once one is within the tolerance: they are dearer.

    Raises:
        SimrigError: another metric than ``dE``; a BTF; what is baked already; a variant of another
            backend than LLVM; no form that is within the tolerance and cheaper than the material,
            with the error of each.
    """
    check_known("tolerance of a bake", tolerance.metric, ("dE",))
    _check(brdf)
    pictures = [SpherePicture(brdf, lights=lights) for lights in _LIGHTS]
    itself = _candidate("as it is", "", brdf, 0.0)
    made: dict[str, Brdf] = {}
    tried: list[Candidate] = []
    for name in tracked(FORMS, progress, str):
        made[name], found = _finest_needed(name, brdf, pictures, tolerance.value)
        tried.append(found)
        if first and found.delta_e <= tolerance.value:
            break
    within = [one for one in tried if one.delta_e <= tolerance.value]
    errors = ", ".join(map(str, tried))
    if not within:
        raise SimrigError(
            f"no form of '{brdf.name}' is within {tolerance}: {errors}; render it as it is"
        )
    chosen = min(within, key=lambda one: one.cost)
    if chosen.cost >= itself.cost:
        raise SimrigError(
            f"'{brdf.name}' is rendered fastest as it is, no form within {tolerance} is cheaper: "
            f"{errors}"
        )
    return Baked(made[chosen.form], chosen, itself, tuple(tried), tolerance)


def _check(brdf: Brdf) -> None:
    if isinstance(brdf, SpatialBrdf):
        raise SimrigError(
            f"'{brdf.name}' is a BTF, which no table of a BRDF can hold: store its factors "
            "('simrig btf convert') or average it ('simrig btf average')"
        )
    before = origin(brdf).get(BAKED)
    if before:
        of = before.get("of", brdf.name) if isinstance(before, dict) else brdf.name
        raise SimrigError(f"'{brdf.name}' is baked already: bake what it was made of ('{of}')")


def _finest_needed(
    name: str, brdf: Brdf, pictures: list[SpherePicture], allowed: float
) -> tuple[Brdf, Candidate]:
    """Return a form at the coarsest level that is within the tolerance, or else its best."""
    best: tuple[float, str, Brdf] | None = None
    for level, value in FORMS[name].levels.items():
        form = FORMS[name].make(brdf, value)
        error = max(picture.compare(form).delta_e for picture in pictures)
        if best is None or error < best[0]:
            best = error, level, form
        if error <= allowed:
            break
    assert best is not None
    error, level, form = best
    return form, _candidate(name, level, form, error)


def _candidate(name: str, level: str, brdf: Brdf, error: float) -> Candidate:
    number = backend.types("float32").Float
    found = count(make_bsdf(brdf), sampled=True)
    size = table_bytes(brdf.tables(number, False))
    return Candidate(name, level, error, **found, bytes=size, nanoseconds=_nanoseconds(brdf))


def _nanoseconds(brdf: Brdf) -> float:
    """Return the time of one look-up of random directions, by kernels."""
    import mitsuba

    mi: Any = mitsuba  # its stubs describe one variant
    tables, random = brdf.tables(mi.Float, False), mi.PCG32(_PAIRS)
    wi, wv = (
        mi.warp.square_to_uniform_hemisphere(
            mi.Point2f(random.next_float32(), random.next_float32())
        )
        for _ in range(2)
    )
    dr.eval(wi, wv)
    seconds = []
    for _ in range(_ROUNDS):
        with timed() as clock:
            dr.eval(brdf.eval(wi, wv, tables))
            dr.sync_thread()
        seconds.append(clock.kernel_seconds)
    return 1e9 * min(seconds) / _PAIRS

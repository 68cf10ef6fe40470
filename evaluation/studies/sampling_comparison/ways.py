"""The methods that are compared: each makes a table of a material that is held out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.linalg import lstsq, qr

from simrig.brdf.protocol import Brdf, evaluate
from simrig.brdf.tables.dense import DenseTable
from simrig.core import backend
from simrig.core.errors import SimrigError
from simrig.database import design, linear
from simrig.database.grid import EPSILON
from simrig.database.known import Known
from simrig.database.patterns import (
    Pattern,
    Subspaces,
    axial_and_diagonal,
    most_average,
    most_similar,
    pairs,
    reference_pattern,
    template_pattern,
    uniform_pattern,
)
from simrig.database.posterior import Posterior
from simrig.database.process import RotationProcess
from simrig.database.slices import SliceBasis
from simrig.directions.half_difference import from_half_difference
from simrig.directions.spherical import to_vector
from simrig.methods import METHODS
from simrig.reconstruction.basis.table import slice_table

ALIGNMENT, DIAGONAL = 48, 42  # samples that methods of section 7.1 spend first
_BRIGHTNESS = np.array([0.299, 0.587, 0.114])
_SPARE = 16
# directions per rotation and rotations of the thesis's minimal sampling, by samples
SPLIT = {10: (2, 5), 20: (5, 4), 40: (5, 8), 80: (10, 8), 160: (20, 8), 500: (50, 10),
         1438: (100, 14), 2000: (100, 20)}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Stage:
    """A material that is held out, with others of its kind or alone.

    Attributes:
        known: the whole database, on UTIA's grid.
        left_out: numbers of all that the methods do not see.
    """

    known: Known
    number: int
    left_out: tuple[int, ...]
    _patterns: dict[int, Pattern] = field(default_factory=dict)
    _rows: dict[int, np.ndarray] = field(default_factory=dict)

    @cached_property
    def truth(self) -> DenseTable:
        """The material."""
        return _table(self.known, self.number)

    @cached_property
    def spaces(self) -> Subspaces:
        """Its subspaces."""
        return Subspaces.of([self.truth.values])

    @cached_property
    def others(self) -> list[Subspaces]:
        """Those of each material that is not held out."""
        used = (n for n in range(len(self.known.database)) if n not in self.left_out)
        return [Subspaces.of([_table(self.known, n).values]) for n in used]

    @cached_property
    def together(self) -> Subspaces:
        """Those of all of them, channels side by side."""
        first = self.others[0]
        values = tuple(
            np.concatenate([o.values[k] for o in self.others], axis=1)
            for k in range(len(first.values))
        )
        return Subspaces(first.thetas, first.azimuths, values)

    @cached_property
    def compressed(self) -> Subspaces:
        """The same, whose patterns take a tenth of the time."""
        return self.together.compressed()

    @cached_property
    def process(self) -> RotationProcess:
        """What the database without those held out says."""
        return RotationProcess.of(self.basis)

    @cached_property
    def basis(self) -> SliceBasis:
        """Its basis."""
        return self.known.slices.basis(self.left_out)

    @cached_property
    def places(self) -> np.ndarray:
        """The joint design of most samples; its first ones are that of fewer."""
        return design.joint(self.process, max(SPLIT))

    def rows(self, directions: int) -> np.ndarray:
        """Return the directions of least condition number."""
        if directions not in self._rows:
            quick = {"starts": 1, "restarts": 2} if directions > 20 else {}
            self._rows[directions] = design.least_condition(self.basis, directions, **quick)
        return self._rows[directions]

    def pattern(self, spaces: Subspaces, count: int) -> Pattern:
        """Return the pattern of Alg. 7.1, which goes on with the last one of fewer samples."""
        begun = self._patterns.get(id(spaces))
        if begun is None or sum(map(len, begun)) > count:
            begun = most_average(self.together if spaces is self.compressed else spaces)
        self._patterns[id(spaces)] = reference_pattern(spaces, count, begun=begun)
        return self._patterns[id(spaces)]

    def errors(self, made: np.ndarray | Brdf) -> dict[str, float]:
        """Return how far a table, or a BRDF at its nodes, is from the truth.

        Returns:
            ``mean_log_error``: mean |Δ ln(f w + ε)|, ``log_rmse`` its root mean square, ``psnr`` in
            dB with a peak of 1 (section 7.1.1), ``log_psnr`` 20 log10(ln 10⁴ / RMS of Δ ln max(f,
            1e-5)).
        """
        truth = self.truth.values.astype(np.float64)
        wi, wv, weight = _nodes(self.truth)
        if isinstance(made, Brdf):
            made = evaluate(made, wi, wv, backend.types("float32", "llvm").Float)
        made = np.maximum(made, 0.0)
        logs = np.log((made * weight + EPSILON) / (truth * weight + EPSILON))
        decades = np.log(np.maximum(made, 1e-5) / np.maximum(truth, 1e-5))
        rms = max(float(np.sqrt(np.mean(decades**2))), 1e-9)
        mse = max(float(np.mean((made - truth) ** 2)), 1e-12)
        return {
            "mean_log_error": float(np.abs(logs).mean()),
            "log_rmse": float(np.sqrt(np.mean(logs**2))),
            "psnr": -10.0 * float(np.log10(mse)),
            "log_psnr": 20.0 * float(np.log10(np.log(1e4) / rms)),
        }


def _table(known: Known, number: int) -> DenseTable:
    brdf = known.database.entries[number].load()
    if not isinstance(brdf, DenseTable):
        raise SimrigError(
            f"'{brdf.name}' is no regular table: the study compares tables of one grid, as "
            "'simrig database build' makes them"
        )
    return brdf


def _nodes(table: DenseTable) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    phi_i, phi_v = table.azimuths
    wi = to_vector(table.thetas[:, None, None, None], phi_i[None, None, :, None])
    wv = to_vector(table.thetas[None, :, None, None], phi_v[None, None, None, :])
    weight = np.maximum(wi[..., 2] * wv[..., 2], EPSILON)[..., None]
    wi, wv = np.broadcast_arrays(wi, wv)
    return wi, wv, weight


# --- what takes a stage and a number of samples, and returns a table or a BRDF with its samples ---


def _uniform(stage: Stage, count: int) -> tuple[np.ndarray, int]:
    pattern = uniform_pattern(stage.compressed, count)
    return _filled(stage, pattern)


def _global(stage: Stage, count: int) -> tuple[np.ndarray, int]:
    return _filled(stage, stage.pattern(stage.compressed, count - ALIGNMENT), ALIGNMENT)


def _adaptive(stage: Stage, count: int) -> tuple[np.ndarray, int]:
    return _filled(stage, stage.pattern(stage.spaces, count))


def _method1(stage: Stage, count: int) -> tuple[np.ndarray, int]:
    space = _subspace_60(stage.spaces)
    nodes = axial_and_diagonal(stage.spaces.azimuths, DIAGONAL)
    own = stage.spaces.values[space][nodes] @ _BRIGHTNESS
    others = np.array([o.values[space][nodes] @ _BRIGHTNESS for o in stage.others])
    similar = stage.others[most_similar(own, others)]
    spent = ALIGNMENT + DIAGONAL
    return _filled(stage, stage.pattern(similar, count - spent), spent)


def _method2(stage: Stage, count: int) -> tuple[np.ndarray, int]:
    pattern = template_pattern(stage.spaces, stage.others, count - ALIGNMENT, _SPARE)
    return _filled(stage, pattern, ALIGNMENT)


def _subspace_60(spaces: Subspaces) -> int:
    i = max(1, round(60.0 / 75.0 * (spaces.thetas - 1)))
    return pairs(spaces.thetas).index((i, i))


def _filled(stage: Stage, pattern: list[list[int]], spent: int = 0) -> tuple[np.ndarray, int]:
    made = stage.spaces.table(stage.spaces.filled(pattern))
    return made, spent + sum(map(len, pattern))


def _linear_combination(stage: Stage, count: int) -> tuple[np.ndarray, int]:
    """[MPBM03b]: nodes by pivoted QR of the database, least squares of its BRDFs, per channel."""
    count -= ALIGNMENT
    if count < 1:
        raise SimrigError("too few samples")
    matrix = np.concatenate(stage.together.values)  # (nodes, materials · 3)
    brightness = matrix.reshape(len(matrix), -1, 3) @ _BRIGHTNESS
    pivots = qr(brightness.T, mode="r", pivoting=True)[1][: min(count, brightness.shape[1])]
    rest = np.setdiff1d(np.arange(len(matrix)), pivots)
    more = np.random.default_rng(0).permutation(rest)[: count - len(pivots)]
    nodes = np.concatenate([pivots, more])
    truth = np.concatenate(stage.spaces.values)
    made = np.empty_like(truth)
    for channel in range(3):
        own = matrix[:, channel::3]
        weights = lstsq(own[nodes], truth[nodes, channel], cond=1e-3)[0]
        made[:, channel] = own @ weights
    cuts = np.cumsum([len(v) for v in stage.spaces.values])[:-1]
    return stage.spaces.table(np.split(made, cuts)), count + ALIGNMENT


def _run(name: str) -> Callable[[Stage, int], tuple[Brdf, int]]:
    def way(stage: Stage, count: int) -> tuple[Brdf, int]:
        result = METHODS[name].run(stage.truth, count)
        return result.brdf, result.samples

    return way


def _minimal(solver: str) -> Callable[[Stage, int], tuple[Brdf, int]]:
    def way(stage: Stage, count: int) -> tuple[Brdf, int]:
        directions, rotations = SPLIT.get(count, (max(1, count // 8), 8))
        basis = stage.basis
        rows = stage.rows(directions)
        phi = 2.0 * np.pi / rotations * np.arange(rotations)
        wi, wv = from_half_difference(*design.rotated(rows, basis, rotations, False).T)
        logs = _logs(stage.truth, wi, wv).reshape(directions, rotations, 3)
        values = logs - basis.mean[rows][:, None, None]
        c = linear.solved(basis, basis.principal[rows], values, phi, solver)
        c = linear.over_rotations(c, phi, basis.grid.rotations)
        whole = np.einsum("pk,krc->prc", basis.principal, c) + basis.mean[:, None, None]
        return slice_table(basis.grid, whole, "minimal"), directions * rotations

    return way


def _process(stage: Stage, count: int) -> tuple[Brdf, int]:
    wi, wv = from_half_difference(*stage.places[:count].T)
    values = stage.truth.eval(wi, wv)
    posterior = Posterior.of(stage.process, wi, wv, values)
    made = slice_table(stage.process.basis.grid, posterior.logs(), "process")
    made.predicted = posterior.error()  # type: ignore[attr-defined]
    return made, count


def _logs(truth: Brdf, wi: np.ndarray, wv: np.ndarray) -> np.ndarray:
    weight = np.maximum(wi[:, 2] * wv[:, 2], EPSILON)[:, None]
    found: np.ndarray = np.log(truth.eval(wi, wv) * weight + EPSILON)
    return found


# name: what makes it, fewest samples, whether it is of the thesis and open to anybody
WAYS: dict[str, tuple[Callable[[Stage, int], tuple[np.ndarray | Brdf, int]], int]] = {
    "uniform": (_uniform, 21),
    "global": (_global, ALIGNMENT + 21),
    "method1": (_method1, ALIGNMENT + DIAGONAL + 21),
    "method2": (_method2, ALIGNMENT + 320),
    "lin.comb.": (_linear_combination, ALIGNMENT + 10),
    "slices": (_run("slices"), 55),
    "minimal-ridge": (_minimal("ridge"), 2),
    "minimal-constrained": (_minimal("constrained"), 2),
    "process": (_process, 1),
    "auto": (_run("auto"), METHODS["auto"].least_samples),
    "adaptive": (_adaptive, 21),
}
OURS = ("process", "auto")
ORACLE = ("adaptive",)  # knows the material that it measures

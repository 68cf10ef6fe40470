"""Sampling patterns in the azimuthal subspaces of a regular table (thesis section 7.1).

Samples of a subspace (two polar angles) are interpolated by thin-plate splines of both azimuths,
which lie on a torus: the distance is that of (cos φ_i, sin φ_i, cos φ_v, sin φ_v). Reciprocity
leaves the subspaces with θ_i ≤ θ_v.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from simrig.core.errors import SimrigError

Pattern = list[list[int]]  # numbers of the nodes of each subspace
_LINEAR_FROM = 8  # samples from which on a spline has linear terms
_RIDGE = 1e-8
_LOST = 1e-7
RESOLUTIONS = (1, 2, 3, 4, 6, 8, 12, 16, 24)


@dataclass(frozen=True, eq=False)
class Subspaces:
    """Tables of one grid, subspace by subspace.

    Attributes:
        thetas: polar angles of the grid.
        azimuths: of both directions.
        values: of each subspace θ_i ≤ θ_v: (nodes, channels); nodes are azimuths² of both, azimuths
            where θ_i = 0, and 1 where both are.
    """

    thetas: int
    azimuths: int
    values: tuple[np.ndarray, ...]

    @classmethod
    def of(cls, tables: Sequence[np.ndarray]) -> Subspaces:
        """Return the subspaces of tables (n, n, m, m, 3), their channels side by side."""
        n, _, m, _, _ = tables[0].shape
        found = []
        for i, j in pairs(n):
            blocks = [t[i, j] for t in tables]
            if i == 0:
                blocks = [b[:1] if j else b[:1, :1] for b in blocks]
            found.append(np.concatenate([b.reshape(-1, 3) for b in blocks], axis=1))
        return cls(n, m, tuple(v.astype(np.float64) for v in found))

    def compressed(self) -> Subspaces:
        """Return the same with each subspace's channels turned to their principal axes, those kept
        that hold all but 1e-7 of its squares: sums of squared errors are the same, and cheaper."""
        found = []
        for v in self.values:
            squares, axes = np.linalg.eigh(v.T @ v)
            lost = np.cumsum(np.maximum(squares, 0.0)) <= _LOST * max(float(squares.sum()), 1e-300)
            found.append(v @ axes[:, ~lost])
        return Subspaces(self.thetas, self.azimuths, tuple(found))

    def table(self, blocks: Sequence[np.ndarray]) -> np.ndarray:
        """Return the whole table (n, n, m, m, 3) of values of the subspaces."""
        n, m = self.thetas, self.azimuths
        whole = np.empty((n, n, m, m, 3))
        for (i, j), block in zip(pairs(n), blocks, strict=True):
            shape = (m, m) if i else (1, m if j else 1)
            own = np.broadcast_to(block.reshape(*shape, 3), (m, m, 3))
            if i == j:
                own = 0.5 * (own + own.swapaxes(0, 1))
            whole[i, j], whole[j, i] = own, own.swapaxes(0, 1)
        return whole

    def reconstructed(self, number: int, chosen: Sequence[int], values: np.ndarray) -> np.ndarray:
        """Return a subspace interpolated from values (k, channels) at some of its nodes."""
        size = len(self.values[number])
        kernel, terms = _kernel(size, self.azimuths)
        index = np.asarray(chosen, dtype=int)
        linear = terms if len(index) >= _LINEAR_FROM else terms[:, :1]
        count, extra = len(index), linear.shape[1]
        system = np.zeros((count + extra, count + extra))
        system[:count, :count] = kernel[np.ix_(index, index)]
        system[range(count), range(count)] += _RIDGE
        system[:count, count:] = linear[index]
        system[count:, :count] = linear[index].T
        system[range(count, count + extra), range(count, count + extra)] -= _RIDGE
        right = np.concatenate([values, np.zeros((extra, values.shape[1]))])
        weights = np.linalg.solve(system, right)
        made: np.ndarray = kernel[index].T @ weights[:count] + linear @ weights[count:]
        return made

    def filled(self, pattern: Pattern, truth: Subspaces | None = None) -> list[np.ndarray]:
        """Return all subspaces interpolated from the values (of ``truth``) at a pattern."""
        source = (truth or self).values
        return [
            self.reconstructed(k, chosen, source[k][chosen]) for k, chosen in enumerate(pattern)
        ]


def pairs(thetas: int) -> list[tuple[int, int]]:
    """Return the subspaces: numbers of θ_i ≤ θ_v."""
    return [(i, j) for i in range(thetas) for j in range(i, thetas)]


@lru_cache(maxsize=8)
def _kernel(size: int, azimuths: int) -> tuple[np.ndarray, np.ndarray]:
    """Return r² log r of all nodes of a subspace, and 1 with its coordinates."""
    phi = 2.0 * np.pi / azimuths * np.arange(azimuths)
    circle = np.column_stack([np.cos(phi), np.sin(phi)])
    points = np.zeros((1, 1))
    if size == azimuths:
        points = circle
    elif size > 1:
        points = np.concatenate(
            [np.repeat(circle, azimuths, axis=0), np.tile(circle, (azimuths, 1))], axis=1
        )
    square = (points**2).sum(axis=1)
    apart = np.maximum(square[:, None] + square - 2.0 * points @ points.T, 0.0)
    kernel = 0.5 * apart * np.log(np.maximum(apart, 1e-300))
    return kernel, np.concatenate([np.ones((size, 1)), points], axis=1)


def reference_pattern(
    spaces: Subspaces, count: int, passes: int = 0, begun: Pattern | None = None
) -> Pattern:
    """Return the pattern of Alg. 7.1 for one table, or for the channels of many (*global*).

    Args:
        spaces: the truth.
        count: of samples, at least one for each subspace.
        passes: how often each sample is taken out and placed again (steps 6 and 7).
        begun: a pattern of fewer samples, without passes, which this one goes on with.

    Raises:
        SimrigError: fewer samples than subspaces, or more than nodes.
    """
    sizes = [len(v) for v in spaces.values]
    if not len(sizes) <= count <= sum(sizes):
        raise SimrigError(f"a pattern has {len(sizes)} to {sum(sizes)} samples, got {count}")
    pattern = [list(chosen) for chosen in begun or most_average(spaces)]
    state = Refined(spaces, pattern)
    while sum(map(len, pattern)) < count:
        state.add()
    for _ in range(passes):
        for number, chosen in enumerate(pattern):
            for node in list(chosen):
                if len(chosen) > 1 and node in chosen:
                    chosen.remove(node)
                    state.refresh(number)
                    state.add()
    return pattern


def most_average(spaces: Subspaces) -> Pattern:
    """Return the node of each subspace that is nearest to its mean: step 1 of Alg. 7.1."""
    return [[int(np.argmin(np.abs(v - v.mean(axis=0)).sum(axis=1)))] for v in spaces.values]


class Refined:
    """Which subspace is worst under a pattern, and where."""

    def __init__(self, spaces: Subspaces, pattern: Pattern):
        self.spaces, self.pattern = spaces, pattern
        self.errors: list[np.ndarray] = [np.zeros(0)] * len(pattern)
        self.mean = np.zeros(len(pattern))
        for number in range(len(pattern)):
            self.refresh(number)

    def refresh(self, number: int) -> None:
        """Interpolate a subspace anew."""
        truth, chosen = self.spaces.values[number], self.pattern[number]
        made = self.spaces.reconstructed(number, chosen, truth[chosen])
        error = ((made - truth) ** 2).sum(axis=1)
        full = len(chosen) == len(truth)
        self.mean[number] = -1.0 if full else error.mean()
        error[chosen] = -1.0
        self.errors[number] = error

    def add(self) -> int:
        """Add the worst node of the worst subspace; return the subspace."""
        worst = int(np.argmax(self.mean))
        self.pattern[worst].append(int(np.argmax(self.errors[worst])))
        self.refresh(worst)
        return worst


def uniform_pattern(spaces: Subspaces, count: int) -> Pattern:
    """Return regular nodes, in each subspace as many as lower the error of the tables most.

    The resolution of one subspace is raised at a time, where it gains most for each sample.
    """
    levels = [_levels(len(v), spaces.azimuths) for v in spaces.values]
    errors = [
        [float(np.sum((spaces.reconstructed(k, c, v[c]) - v) ** 2)) for c in own]
        for k, (v, own) in enumerate(zip(spaces.values, levels, strict=True))
    ]
    at = [0] * len(levels)
    used = len(levels)
    while True:
        steps = [
            ((errors[k][at[k]] - errors[k][n]) / (len(levels[k][n]) - len(levels[k][at[k]])), k, n)
            for k in range(len(levels))
            for n in range(at[k] + 1, len(levels[k]))
            if used + len(levels[k][n]) - len(levels[k][at[k]]) <= count
        ]
        if not steps or max(steps)[0] <= 0.0:
            return [own[n] for own, n in zip(levels, at, strict=True)]
        _, k, n = max(steps)
        used += len(levels[k][n]) - len(levels[k][at[k]])
        at[k] = n


def _levels(size: int, azimuths: int) -> list[list[int]]:
    if size == 1:
        return [[0]]
    found = []
    for resolution in RESOLUTIONS:
        if azimuths % resolution:
            continue
        own = np.arange(0, azimuths, azimuths // resolution)
        nodes = own if size == azimuths else (own[:, None] * azimuths + own).ravel()
        found.append(nodes.tolist())
    return found


def regular_pattern(spaces: Subspaces) -> Pattern:
    """Return 4 × 4 azimuths in each subspace (4 where one direction is at the pole)."""
    levels = (_levels(len(v), spaces.azimuths) for v in spaces.values)
    return [list(own[min(3, len(own) - 1)]) for own in levels]


def axial_and_diagonal(azimuths: int, count: int) -> list[int]:
    """Return nodes of a subspace on an axial slice (one turn), then on four diagonal ones.

    The first ``azimuths`` nodes are those that alignment takes.
    """
    turn = np.arange(azimuths)
    # an eighth of a turn beside the mirror direction, where many materials look the same all round
    axial = turn * azimuths + (turn + azimuths // 2 - azimuths // 8) % azimuths
    found = axial.tolist()
    each = max(1, count // 4)
    for k in range(4):
        step = np.round(np.linspace(0, azimuths, each, endpoint=False)).astype(int)
        start = k * azimuths // 8  # the sum of both azimuths is twice that
        diagonal = ((start + step) % azimuths) * azimuths + (start - step) % azimuths
        found += [int(n) for n in diagonal if int(n) not in found]
    return found


def most_similar(own: np.ndarray, others: np.ndarray) -> int:
    """Return which row of others is nearest to samples, up to a scale and an offset (L1).

    Args:
        own: (n,) brightness of the samples.
        others: (materials, n) of the database at the same nodes.
    """
    centred = others - others.mean(axis=1, keepdims=True)
    spread = np.maximum((centred**2).sum(axis=1), 1e-300)
    k = centred @ (own - own.mean()) / spread
    fitted = own.mean() + k[:, None] * centred
    return int(np.argmin(np.abs(own - fitted).sum(axis=1)))


def template_pattern(
    truth: Subspaces, database: Sequence[Subspaces], count: int, spare: int
) -> Pattern:
    """Return the samples of Alg. 7.3 (*method2*): 4 × 4 nodes, then where the most similar errs.

    Args:
        truth: what is measured; seen at samples only.
        database: subspaces of each material.
        spare: samples between two looks for the most similar material.

    Raises:
        SimrigError: too few samples for 4 × 4 nodes.
    """
    pattern = regular_pattern(truth)
    if sum(map(len, pattern)) > count:
        raise SimrigError(f"method2 needs {sum(map(len, pattern))} samples at least, got {count}")
    weights = np.array([0.299, 0.587, 0.114])
    chosen, state = -1, None
    while sum(map(len, pattern)) < count:
        own = np.concatenate([v[c] @ weights for v, c in zip(truth.values, pattern, strict=True)])
        others = np.array(
            [np.concatenate([v[c] @ weights for v, c in zip(d.values, pattern, strict=True)])
             for d in database]
        )  # fmt: skip
        best = most_similar(own, others)
        if best != chosen or state is None:
            chosen, state = best, Refined(database[best], pattern)
        for _ in range(min(spare, count - sum(map(len, pattern)))):
            state.add()
    return pattern

"""All isotropic slices of a database, compressed material by material, and their linear basis.

The basis of thesis section 7.2.1 is a singular value decomposition of some 8,000 × 32,400 numbers,
and cross-validation wants one without each material. The 216 slices of a material lie in some
twenty to forty dimensions, so each material is compressed once, and a basis is that of the factors.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np

from simrig.core.blas import one_thread
from simrig.core.errors import SimrigError
from simrig.core.progress import Progress
from simrig.database.grid import SliceGrid
from simrig.database.store import Database
from simrig.files.atomic import atomic_write

COMPONENTS = 160  # that are kept of a basis
_RANK, _LOST = 48, 1e-5  # of a material: at most, and the share of its variance that may be lost
_CACHE = ".slices-{}.npz"
_SEED = 7
_log = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class SliceBasis:
    """A linear basis of isotropic slices: logs ≈ mean + components · coefficients.

    Attributes:
        mean: (p,) μ of eq. 7.2.
        components: (p, k) orthonormal columns of U.
        deviations: (k,) standard deviation along each: singular values over √m.
        columns: m, how many slices it was made of.
        coefficients: (materials, k, rotations, 3) of the materials, without the mean.
    """

    grid: SliceGrid
    mean: np.ndarray
    components: np.ndarray
    deviations: np.ndarray
    columns: int
    coefficients: np.ndarray = field(repr=False)

    @cached_property
    def principal(self) -> np.ndarray:
        """Q = U Σ of the thesis, (p, k)."""
        return self.components * (self.deviations * np.sqrt(self.columns))

    def first(self, count: int) -> SliceBasis:
        """Return the basis of the first components."""
        return SliceBasis(
            self.grid,
            self.mean,
            self.components[:, :count],
            self.deviations[:count],
            self.columns,
            self.coefficients[:, :count],
        )


@dataclass(frozen=True, eq=False)
class Slices:
    """The compressed slices of a database.

    Attributes:
        means: (materials, p) mean over all slices of each.
        factors: one (p, r) for each material: its slices less the mean are factor · loading.
        loadings: one (r, rotations · 3) for each, orthonormal rows.
    """

    grid: SliceGrid
    names: tuple[str, ...]
    categories: tuple[str, ...]
    generators: tuple[str, ...]
    means: np.ndarray
    factors: tuple[np.ndarray, ...]
    loadings: tuple[np.ndarray, ...]

    @classmethod
    def of(cls, database: Database, progress: Progress | None = None) -> Slices:
        """Return the slices of a database; kept beside it where its folder can be written.

        Raises:
            SimrigError: what a file of the database says.
        """
        kept = database.entries[0].path.parent / _CACHE.format(database.fingerprint)
        if kept.is_file():
            try:
                return cls._read(kept, database)
            except (OSError, ValueError, KeyError):
                _log.warning("'%s' is damaged: made again", kept)
        made = cls.sampled(database, progress)
        if os.access(kept.parent, os.W_OK):
            for old in kept.parent.glob(_CACHE.format("*")):
                old.unlink(missing_ok=True)
            made._write(kept)
        return made

    @classmethod
    @one_thread()
    def sampled(cls, database: Database, progress: Progress | None = None) -> Slices:
        """Return the slices of a database, sampled anew."""
        grid, means, factors, loadings = SliceGrid(), [], [], []
        for number, entry in enumerate(database.entries):
            if progress is not None:
                progress(number, len(database))
            try:
                logs = grid.sampled(entry.load()).reshape(len(grid.angles), -1)
            except SimrigError as error:
                if str(entry.path) in str(error):
                    raise
                raise SimrigError(f"database: '{entry.path}': {error}") from error
            mean = logs.mean(axis=1)
            factor, loading = compressed(logs - mean[:, None])
            means.append(mean)
            factors.append(factor)
            loadings.append(loading)
        entries = database.entries
        return cls(
            grid,
            tuple(e.name for e in entries),
            tuple(e.category for e in entries),
            tuple(e.generator for e in entries),
            np.array(means, dtype=np.float32),
            tuple(factors),
            tuple(loadings),
        )

    def logs(self, number: int) -> np.ndarray:
        """Return the logarithms of a material as they are kept, (p, rotations, 3)."""
        whole = self.factors[number] @ self.loadings[number] + self.means[number][:, None]
        return whole.reshape(len(whole), -1, 3)

    def basis(self, leaving_out: Sequence[int] = ()) -> SliceBasis:
        """Return the basis of all materials but some.

        The decomposition is a random projection that is refined twice [HMT11].

        Args:
            leaving_out: numbers of materials.

        Raises:
            SimrigError: nothing is left.
        """
        used = [n for n in range(len(self.names)) if n not in set(leaving_out)]
        if not used:
            raise SimrigError("no material is left to make a basis of: add some to the database")
        each = self.loadings[0].shape[1]
        mean = self.means[used].mean(axis=0)
        apart = (self.means[used] - mean).T * np.float32(np.sqrt(each))
        whole = np.concatenate([apart, *(self.factors[n] for n in used)], axis=1)
        left, values = _decomposed(whole, COMPONENTS, np.random.default_rng(_SEED))
        coefficients = np.stack(
            [
                ((left.T @ self.factors[n]) @ self.loadings[n])
                + (left.T @ (self.means[n] - mean))[:, None]
                for n in used
            ]
        )
        columns = each * len(used)
        rotations = self.grid.rotations
        return SliceBasis(
            self.grid,
            mean.astype(np.float64),
            left.astype(np.float64),
            values.astype(np.float64) / np.sqrt(columns),
            columns,
            coefficients.reshape(len(used), -1, rotations, 3).astype(np.float64),
        )

    def _write(self, path: Path) -> None:
        ranks = [factor.shape[1] for factor in self.factors]
        with atomic_write(path) as temporary, open(temporary, "wb") as file:
            np.savez(
                file,
                means=self.means,
                ranks=np.array(ranks),
                factors=np.concatenate(self.factors, axis=1),
                loadings=np.concatenate(self.loadings, axis=0),
            )

    @classmethod
    def _read(cls, path: Path, database: Database) -> Slices:
        with np.load(path, allow_pickle=False) as kept:
            cuts = np.cumsum(kept["ranks"])[:-1]
            entries, grid = database.entries, SliceGrid()
            made = cls(
                grid,
                tuple(e.name for e in entries),
                tuple(e.category for e in entries),
                tuple(e.generator for e in entries),
                kept["means"],
                tuple(np.split(kept["factors"], cuts, axis=1)),
                tuple(np.split(kept["loadings"], cuts, axis=0)),
            )
        if made.means.shape != (len(entries), len(grid.angles)):
            raise ValueError("another grid")
        return made


def compressed(logs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (p, r) and (r, m) whose product is a matrix (p, m) but for 1e-5 of its variance."""
    gram = (logs.T @ logs).astype(np.float64)
    values, vectors = np.linalg.eigh(gram)
    values, vectors = values[::-1], vectors[:, ::-1]
    total = max(float(values.sum()), np.finfo(float).tiny)
    left = 1.0 - np.cumsum(np.maximum(values, 0.0)) / total
    rank = min(int(np.searchsorted(-left, -_LOST)) + 1, _RANK, len(values))
    loading = vectors[:, :rank].T.astype(np.float32)
    return (logs @ loading.T).astype(np.float32), np.ascontiguousarray(loading)


def _decomposed(
    matrix: np.ndarray, components: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Return the first left singular vectors and the singular values of a matrix."""
    size = min(components, *matrix.shape)
    wide = min(size + 24, *matrix.shape)
    span = matrix @ rng.standard_normal((matrix.shape[1], wide), dtype=np.float32)
    for _ in range(2):
        span, _ = np.linalg.qr(span)
        span, _ = np.linalg.qr(matrix.T @ span)
        span = matrix @ span
    span, _ = np.linalg.qr(span)
    small = span.T @ matrix
    values, vectors = np.linalg.eigh((small @ small.T).astype(np.float64))
    order = np.argsort(values)[::-1][:size]
    deviations = np.sqrt(np.maximum(values[order], 0.0))
    used = deviations > 1e-6 * max(float(deviations[0]), np.finfo(float).tiny)
    used[0] = True  # a database of one isotropic black material has no variance at all
    return (span @ vectors[:, order[used]].astype(np.float32)), deviations[used]

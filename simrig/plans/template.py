"""Sampling patterns of known materials, reused for an unknown one (thesis section 7.1.2)."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

from simrig.brdf.tables.dense import DenseTable
from simrig.core.errors import SimrigError, check_known
from simrig.core.options import Option
from simrig.database.known import Known, known
from simrig.database.patterns import (
    Refined,
    Subspaces,
    axial_and_diagonal,
    most_similar,
    pairs,
    reference_pattern,
    regular_pattern,
)
from simrig.plans.minimal import DATABASE
from simrig.plans.protocol import Batches, Plan, Recorded

if TYPE_CHECKING:
    from simrig.brdf.protocol import Brdf

KINDS = ("method1", "method2")
_BRIGHTNESS = np.array([0.299, 0.587, 0.114])
_DIAGONAL = 42
_LEAST = 120
_STEP = 16  # samples of method2 between two looks at which material is the most similar
Asked = Generator[np.ndarray, Recorded, Any]


@dataclass(frozen=True)
class TemplatePlan(Plan):
    """One turn of the material, four diagonal slices, and then the pattern of the most similar one.

    The first samples, along the axial slice at 60°/60°, say how the material is turned. Then
    ``method1`` (Alg. 7.2) measures by the pattern that was made for the material of the database
    whose brightness is nearest (L1, up to a scale and an offset); ``method2`` (Alg. 7.3) begins
    with 4 × 4 azimuths at each pair of polar angles and adds samples where the most similar
    material is reconstructed worst.

    Attributes:
        database: folders, with commas between: tables of one regular grid.
        fingerprint: of their content when the plan was made.
        kind: one of ``KINDS``.
        theta_max: of the database's grid, radians.

    Raises:
        SimrigError: what cannot be.
    """

    name: ClassVar[str] = "template"
    about: ClassVar[str] = "by the pattern of the most similar material of a database (7.1)"
    options: ClassVar[tuple[Option, ...]] = (
        DATABASE,
        Option("samples", int, "How many samples.", 1438, least=_LEAST, most=20000, short="-n"),
        Option("template", str, "How the pattern is chosen.", "method1", KINDS),
    )
    needs: ClassVar[tuple[str, ...]] = ("database",)
    adaptive: ClassVar[bool] = True

    database: str
    fingerprint: str
    samples: int
    kind: str = "method1"
    theta_max: float = float(np.radians(75.0))

    def __post_init__(self) -> None:
        check_known("kind of template", self.kind, KINDS)
        if self.samples < _LEAST:
            raise SimrigError(f"a template plan has {_LEAST} samples at least, got {self.samples}")

    @classmethod
    def for_material(  # type: ignore[override]
        cls,
        material: Brdf | None,
        database: str | None = None,
        samples: int = 1438,
        template: str = "method1",
    ) -> Self:
        """Return the plan that options give.

        Raises:
            SimrigError: no database, one that is not of one regular grid, or what cannot be.
        """
        if not database:
            raise SimrigError(
                "plan 'template' needs --database, a folder of BRDFs: 'simrig database build' "
                "makes one"
            )
        own = known(database)
        first = _tables(own)[0]
        if material is not None and material.theta_max < first.theta_max - 1e-6:
            raise SimrigError(
                f"'{material.name}' has data up to {np.degrees(material.theta_max):g}°, the "
                f"patterns of the database go to {np.degrees(first.theta_max):g}°: use plan minimal"
            )
        made = cls(database, own.fingerprint, samples, template, first.theta_max)
        if template == "method2":
            made._check_room(Subspaces.of([first.values]))
        return made

    @property
    def one_order(self) -> bool:
        """Whether a pair is measured in one order alone."""
        return True

    def batches(self) -> Batches:
        """Yield directions to measure (see ``Plan.batches``)."""
        tables = _tables(known(self.database))
        spaces = [Subspaces.of([t.values]) for t in tables]
        n, m = spaces[0].thetas, spaces[0].azimuths
        space = pairs(n).index((max(1, round(0.8 * (n - 1))),) * 2)
        nodes = axial_and_diagonal(m, _DIAGONAL)
        axial = yield self._angles([(space, k) for k in nodes[:m]], spaces[0], 0)
        turn = _turn(axial.values @ _BRIGHTNESS, spaces[0].values[space][nodes[:m]] @ _BRIGHTNESS)
        diagonal = yield self._angles([(space, k) for k in nodes[m:]], spaces[0], turn)
        # the axial slice again, in the order in which the aligned material has it
        own = np.concatenate([np.roll(axial.values, -turn, axis=0), diagonal.values]) @ _BRIGHTNESS
        left = self.samples - len(nodes)
        if self.kind == "method1":
            others = np.array([s.values[space][nodes] @ _BRIGHTNESS for s in spaces])
            similar = spaces[most_similar(own, others)]
            most = sum(len(v) for v in similar.values)
            pattern = reference_pattern(similar, min(left, most))
            listed = [(k, node) for k, own_ in enumerate(pattern) for node in own_]
            yield self._angles(listed, spaces[0], turn)
            return {}
        yield from self._follow(spaces, left, turn)
        return {}

    def _follow(self, spaces: list[Subspaces], left: int, turn: int) -> Asked:
        """Measure by Alg. 7.3."""
        pattern = regular_pattern(spaces[0])
        listed = [(k, node) for k, own in enumerate(pattern) for node in own]
        values = []
        chosen, state = -1, None
        while listed:
            taken = yield self._angles(listed, spaces[0], turn)
            values += list(zip(listed, taken.values @ _BRIGHTNESS, strict=True))
            left -= len(listed)
            own = np.array([value for _, value in values])
            places = [place for place, _ in values]
            others = np.array(
                [[float(s.values[k][node] @ _BRIGHTNESS) for k, node in places] for s in spaces]
            )
            best = most_similar(own, others)
            if best != chosen or state is None:
                chosen, state = best, Refined(spaces[best], pattern)
            listed = []
            for _ in range(min(_STEP, left)):
                space = state.add()
                listed.append((space, pattern[space][-1]))

    def describe(self) -> str:
        """Return the plan in words."""
        return f"{self.samples} samples by templates ({self.kind}) of database '{self.database}'"

    def _check_room(self, spaces: Subspaces) -> None:
        least = sum(map(len, regular_pattern(spaces))) + spaces.azimuths + _DIAGONAL
        if self.samples < least:
            raise SimrigError(f"method2 takes {least} samples at least, got {self.samples}")

    def _angles(self, listed: list[tuple[int, int]], spaces: Subspaces, turn: int) -> np.ndarray:
        """Return theta_i, theta_v, phi_i, phi_v of nodes of a material turned by ``turn``."""
        all_pairs, m = pairs(spaces.thetas), spaces.azimuths
        thetas = np.linspace(0.0, self.theta_max, spaces.thetas)
        found = []
        for space, node in listed:
            i, j = all_pairs[space]
            phi = ((node // m if i else 0) + turn, (node % m if j else 0) + turn)
            azimuths = [2.0 * np.pi / m * (p % m) for p in phi]
            found.append(
                (thetas[i], thetas[j], azimuths[0] if i else 0.0, azimuths[1] if j else 0.0)
            )
        return np.array(found)


def _turn(own: np.ndarray, template: np.ndarray) -> int:
    """Return by how many azimuths a material is turned from the template, within half a turn."""
    wished = template / max(float(template.mean()), 1e-30)
    shown = own / max(float(own.mean()), 1e-30)
    turns = range(len(own) // 2)
    return min(turns, key=lambda s: float(np.abs(wished - np.roll(shown, -s)).sum()))


def _tables(own: Known) -> list[DenseTable]:
    """Return the tables of a database of one regular grid.

    Raises:
        SimrigError: another kind of BRDF in it, or another grid.
    """
    found: list[DenseTable] = []
    for entry in own.database.entries:
        brdf = entry.load()
        grid = brdf.values.shape if isinstance(brdf, DenseTable) else None
        if not isinstance(brdf, DenseTable) or (found and grid != found[0].values.shape):
            raise SimrigError(
                f"template plans need tables of one regular grid, '{entry.path}' is another: "
                "use plan minimal"
            )
        found.append(brdf)
    return found

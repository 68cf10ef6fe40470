"""Few samples, chosen by what a database knows (thesis section 7.2, and past it)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

from simrig.core.errors import SimrigError, check_known
from simrig.core.options import Option
from simrig.database import design
from simrig.database.known import Known, known
from simrig.database.posterior import Posterior
from simrig.directions.half_difference import from_half_difference
from simrig.directions.spherical import to_angles, to_vector
from simrig.plans.protocol import THETA_MAX, Batches, Plan, Recorded, largest_theta_deg

if TYPE_CHECKING:
    from simrig.brdf.protocol import Brdf

LAYOUTS = ("joint", "staggered", "regular", "adaptive")
MOST_SAMPLES = 2000
_THETA_MAX_DEG = 75.0  # of the database
_BATCH = 16  # samples between looks at the predicted error
_FIRST_ROTATIONS = 8
DATABASE = Option(
    "database", str, "Folder of BRDFs: of 'simrig database build', or your own; commas between."
)


@dataclass(frozen=True)
class MinimalPlan(Plan):
    """Directions and rotations of the material that tell the most, given a database.

    ``joint`` chooses both together, the place that lowers the expected error most first. The others
    measure the same directions at rotations about the normal: ``regular`` as the thesis does,
    ``staggered`` with each direction's rotations between those of the others, ``adaptive`` at
    eight rotations and then between those that differ (Alg. 7.5).

    Attributes:
        database: folders, with commas between.
        fingerprint: of their content when the plan was made.
        samples: the most that are taken.
        layout: one of ``LAYOUTS``.
        directions: per rotation; not of ``joint``.
        criterion: of the directions: ``"kappa"`` (Alg. 7.4), ``"i"``, ``"a"`` or ``"d"``.
        until: predicted error, root mean square of logarithms, at which ``joint`` stops before.
        threshold: e of Alg. 7.5: difference of logarithms between neighbouring rotations.
        theta_max: largest polar angle, radians.

    Raises:
        SimrigError: what cannot be.
    """

    name: ClassVar[str] = "minimal"
    about: ClassVar[str] = "few samples, chosen by a database of BRDFs (7.2)"
    options: ClassVar[tuple[Option, ...]] = (
        DATABASE,
        Option("samples", int, "How many samples at most.", 80, least=1, most=MOST_SAMPLES,
               short="-n"),
        Option("layout", str, "Directions and rotations.", "joint", LAYOUTS),
        Option("directions", int, "Per rotation; an eighth of the samples unless given.",
               least=1, most=MOST_SAMPLES),
        Option("criterion", str, "Of the directions per rotation.", "i", design.CRITERIA),
        Option("predicted_error", float, "Stop at this predicted RMS error of logarithms.",
               least=1e-4, most=10.0),
        Option("threshold", float, "Of adaptive rotations: difference of logarithms.", 0.1,
               least=1e-4, most=10.0),
        THETA_MAX,
    )  # fmt: skip
    needs: ClassVar[tuple[str, ...]] = ("database",)

    database: str
    fingerprint: str
    samples: int
    layout: str = "joint"
    directions: int = 0
    criterion: str = "i"
    until: float | None = None
    threshold: float = 0.1
    theta_max: float = float(np.radians(_THETA_MAX_DEG))

    def __post_init__(self) -> None:
        check_known("layout", self.layout, LAYOUTS)
        check_known("criterion", self.criterion, design.CRITERIA)
        if not 1 <= self.samples <= MOST_SAMPLES or not 0 <= self.directions <= self.samples:
            raise SimrigError(
                f"a minimal plan has 1 to {MOST_SAMPLES} samples and at most as many directions, "
                f"got {self.samples} and {self.directions}"
            )
        if self.until is not None and self.layout != "joint":
            raise SimrigError("only layout 'joint' stops at a predicted error")
        if self.layout == "joint" and self.directions:
            raise SimrigError("layout 'joint' chooses its directions: leave out --directions")

    @classmethod
    def for_material(  # type: ignore[override]
        cls,
        material: Brdf | None,
        database: str | None = None,
        samples: int = 80,
        layout: str = "joint",
        directions: int | None = None,
        criterion: str = "i",
        predicted_error: float | None = None,
        threshold: float = 0.1,
        theta_max_deg: float | None = None,
    ) -> Self:
        """Return the plan that options give.

        Raises:
            SimrigError: no database, or what cannot be.
        """
        if not database:
            raise SimrigError(
                "plan 'minimal' needs --database, a folder of BRDFs: 'simrig database build' "
                "makes one"
            )
        end = min(largest_theta_deg(material, theta_max_deg), _THETA_MAX_DEG)
        count = 0 if layout == "joint" else max(1, samples // _FIRST_ROTATIONS)
        return cls(
            database,
            known(database).fingerprint,
            samples,
            layout,
            directions if directions is not None else count,
            criterion,
            predicted_error,
            threshold,
            float(np.radians(end)),
        )

    @property
    def adaptive(self) -> bool:  # type: ignore[override]
        """Whether directions depend on what was recorded."""
        return self.layout == "adaptive" or self.until is not None

    @property
    def one_order(self) -> bool:
        """Whether a pair is measured in one order alone."""
        return True

    def batches(self) -> Batches:
        """Yield directions to measure (see ``Plan.batches``)."""
        own = known(self.database)
        if self.layout == "adaptive":
            yield from self._between(own)
            return {}
        angles = self._listed(own)
        if self.until is None:
            yield angles
            return {}
        values: list[np.ndarray] = []
        for start in range(0, len(angles), _BATCH):
            recorded = yield angles[start : start + _BATCH]
            values.append(recorded.values)
            if self._predicted(own, angles, values) <= self.until:
                break
        return {}

    def describe(self) -> str:
        """Return the plan in words."""
        stop = "" if self.until is None else f" or a predicted error of {self.until:g}"
        if self.layout == "joint":
            how = "directions and rotations chosen together"
        else:
            each = f"{self.directions} directions ({self.criterion})"
            how = f"{each}, {self.layout} rotations"
        return f"at most {self.samples} samples{stop} by database '{self.database}', {how}"

    def _listed(self, own: Known) -> np.ndarray:
        """Return all directions, (n, 4) theta_i, theta_v, phi_i, phi_v."""
        if self.layout == "joint":
            return _measured(design.joint(own.process, self.samples, self.theta_max))
        rows = self._rows(own)
        rotations = max(1, self.samples // len(rows))
        half = design.rotated(rows, own.basis, rotations, self.layout == "staggered")
        return _measured(half)

    def _rows(self, own: Known) -> np.ndarray:
        if self.criterion == "kappa":
            return design.least_condition(own.basis, self.directions, theta_max=self.theta_max)
        basis = own.process.basis
        return design.optimal(basis, self.directions, self.criterion, theta_max=self.theta_max)

    def _predicted(self, own: Known, angles: np.ndarray, values: list[np.ndarray]) -> float:
        taken = np.concatenate(values)
        theta_i, theta_v, phi_i, phi_v = angles[: len(taken)].T
        wi, wv = to_vector(theta_i, phi_i), to_vector(theta_v, phi_v)
        return Posterior.of(own.process, wi, wv, taken).error()

    def _between(self, own: Known) -> Any:
        """Measure at eight rotations, then in the middle of neighbours that differ (Alg. 7.5).

        The box of the algorithm is missing in the printed text. It is read so: between two
        neighbouring rotations whose logarithms differ by more than e (root mean square over the
        directions and channels) another is measured, until none do or no samples are left.
        """
        rows = self._rows(own)
        angles, weight = own.basis.grid.angles[rows], own.basis.grid.weight[rows]
        finest = 2.0 * np.pi / own.basis.grid.rotations
        logs: dict[float, np.ndarray] = {}
        count = min(_FIRST_ROTATIONS, max(1, self.samples // len(rows)))
        wanted = [2.0 * np.pi / count * k for k in range(count)]
        while wanted:
            half = np.concatenate([np.insert(angles, 1, turn, axis=1) for turn in wanted])
            recorded: Recorded = yield _measured(half)
            values = recorded.values.reshape(len(wanted), len(rows), 3)
            for turn, own_values in zip(wanted, values, strict=True):
                logs[turn] = np.log(np.maximum(own_values, 0.0) * weight[:, None] + 1e-3)
            left = self.samples // len(rows) - len(logs)
            wanted = [turn for _, turn in self._gaps(logs, finest)][: max(left, 0)]

    def _gaps(self, logs: dict[float, np.ndarray], finest: float) -> Iterator[tuple[float, float]]:
        """Yield the middles of neighbours that differ too much, the largest difference first."""
        turns = sorted(logs)
        found = []
        for first, second in zip(turns, [*turns[1:], turns[0] + 2.0 * np.pi], strict=True):
            other = logs[second if second in logs else turns[0]]
            apart = float(np.sqrt(np.mean((logs[first] - other) ** 2)))
            if apart > self.threshold and second - first > 1.5 * finest:
                found.append((-apart, 0.5 * (first + second)))
        yield from sorted(found)


def _measured(half: np.ndarray) -> np.ndarray:
    """Return (n, 4) theta_i, theta_v, phi_i, phi_v of theta_h, phi_h, theta_d, phi_d."""
    wi, wv = from_half_difference(*half.T)
    (theta_i, phi_i), (theta_v, phi_v) = to_angles(wi), to_angles(wv)
    return np.stack([theta_i, theta_v, phi_i, phi_v], axis=1)

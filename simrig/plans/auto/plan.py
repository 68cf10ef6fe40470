"""The automatic plan: pilot, description, batches, and a look back at what the pilot said."""

from __future__ import annotations

from collections.abc import Generator, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

from simrig.brdf.kriging.choice import final_model, with_profile
from simrig.brdf.kriging.displayed import displayed_pairs, even_pairs, lobe_pairs
from simrig.brdf.kriging.model import KrigingModel, fit_model
from simrig.brdf.kriging.outliers import STANDS_OUT, outstanding, trusted
from simrig.brdf.kriging.predicted import LIKELY_BELOW, predicted_delta_e
from simrig.brdf.kriging.samples import Samples
from simrig.brdf.kriging.symmetry import Symmetry
from simrig.core.effects import parse_tolerance
from simrig.core.errors import SimrigError
from simrig.core.options import Option
from simrig.directions.spherical import to_angles
from simrig.plans.auto.batches import next_batch, travel_order
from simrig.plans.auto.description import describe
from simrig.plans.auto.families import FAMILIES, Choice, Shares, choose, family_named
from simrig.plans.auto.findings import Doubt, findings_of, layout_of
from simrig.plans.auto.look_back import back_to, looked_back
from simrig.plans.auto.pilot import Pilot, pilot_pairs
from simrig.plans.auto.told import told
from simrig.plans.listed import Directions
from simrig.plans.protocol import Batches, Plan

if TYPE_CHECKING:
    from simrig.brdf.protocol import Brdf

MOST_SAMPLES = 50_000  # the order of poses and the model take time that grows with the square
LEAST_SAMPLES = 16
LARGEST_THETA_I_DEG, LARGEST_THETA_V_DEG = 88.0, 85.0
_BATCHES = 6
_BATCHES_UNTIL = 14  # when the predicted error decides: more, smaller ones
_CANDIDATES = 16384  # at least, and per sample:
_CANDIDATES_PER_SAMPLE = 4
_SHARE_AGAIN = 0.05  # of a batch, at most, are samples that others contradict
_LOOKS_BACK = (1, 3)  # batches after which symmetries are tried again
_PAST_THE_END = float(np.radians(1.0))  # of a material's data, to see where it is
_PROBED = 512  # pairs that pictures show, for the bounds of effects

# yields (n, 4) theta_i, theta_v, phi_i, phi_v in radians, and is sent (n, 3) values of f_r
Asked = Generator[np.ndarray, np.ndarray, KrigingModel]


class Goal(Option):
    """A predicted ΔE: a number, or text such as ``dE=1``."""

    def checked(self, value: Any) -> float:
        """Return the ΔE (see ``Option.checked``)."""
        if not isinstance(value, str):
            number = isinstance(value, int | float) and not isinstance(value, bool)
            value = f"dE={value}" if number else str(value)
        goal = parse_tolerance(value if "=" in value else f"dE={value}")
        if goal.metric != "dE" or not np.isfinite(goal.value):
            raise SimrigError(f"{self.flag} is a predicted ΔE: write dE=1, not {value}")
        return goal.value


@dataclass(frozen=True)
class AutomaticPlan(Plan):
    """Looks first, then measures where it shows.

    Attributes:
        samples: the most that are taken.
        theta_i_max, theta_v_max: how far the rig looks, radians.
        until: predicted ΔE at which to stop before; None takes all samples.
        seed: of the directions.
        family: that is measured whatever the pilot says, a key of ``FAMILIES``; None leaves it to
            the pilot.

    Raises:
        SimrigError: too few samples, an unknown family, or numbers that cannot be.
    """

    name: ClassVar[str] = "auto"
    implied_by: ClassVar[tuple[str, ...]] = ("until", "family")
    about: ClassVar[str] = "looks first, then measures where errors would show"
    adaptive: ClassVar[bool] = True
    logarithms: ClassVar[bool] = True
    options: ClassVar[tuple[Option, ...]] = (
        Option("samples", int, "At most so many.", 1000, least=1, short="-n"),
        Goal("until", str, "Stop where this mean ΔE is predicted (dE=1); takes all else."),
        Option("family", str, "Measured so whatever the pilot says.", choices=tuple(FAMILIES)),
        Option("plan_seed", int, "Of the directions.", 0, least=0),
    )

    samples: int
    theta_i_max: float = float(np.radians(LARGEST_THETA_I_DEG))
    theta_v_max: float = float(np.radians(LARGEST_THETA_V_DEG))
    until: float | None = None
    seed: int = 0
    family: str | None = None

    def __post_init__(self) -> None:
        if self.samples < LEAST_SAMPLES:
            raise SimrigError(
                f"{self.samples} samples are too few for the automatic plan, it needs at least "
                f"{LEAST_SAMPLES}"
            )
        if self.samples > MOST_SAMPLES:
            raise SimrigError(
                f"the automatic plan takes at most {MOST_SAMPLES:,} samples, got {self.samples:,}: "
                "choose another plan for more"
            )
        if self.until is not None and not 0.0 < self.until < float("inf"):
            raise SimrigError(f"the ΔE to stop at must be a number above 0, got {self.until:g}")
        if self.family is not None:
            family_named(self.family)
        for theta in (self.theta_i_max, self.theta_v_max):
            if not 0.0 < theta < 0.5 * np.pi:
                raise SimrigError("the largest theta of a plan must lie between 0 and 90 degrees")

    @classmethod
    def for_material(  # type: ignore[override]
        cls,
        material: Brdf | None = None,
        *,
        samples: int = 1000,
        until: float | None = None,
        family: str | None = None,
        plan_seed: int = 0,
    ) -> AutomaticPlan:
        """Return the plan for a material, within its data (see the class)."""
        plan = cls(samples, until=until, seed=plan_seed, family=family)
        return plan if material is None else plan.within(material.theta_max)

    @classmethod
    def restored(cls, settings: Mapping[str, Any], angles: np.ndarray) -> Self:
        """Return the plan of a stored measurement (see ``Plan.restored``)."""
        return cls(**{name: value for name, value in settings.items() if name != "assumed"})

    def check_layout(self, angles: np.ndarray, layout: Mapping[str, np.ndarray]) -> None:
        """Refuse what are no findings (see ``simrig.plans.auto.findings``)."""
        findings_of(layout)

    @property
    def theta_max(self) -> float:
        """The largest polar angle in radians."""
        return max(self.theta_i_max, self.theta_v_max)

    def probe(self, most: int) -> Plan:
        """Return the pilot and pairs that pictures show, from which batches are taken."""
        pilot = self.pilot()
        shown = displayed_pairs(_PROBED, self.theta_i_max, self.theta_v_max)
        sides = (np.concatenate(pair) for pair in zip((pilot.wi, pilot.wv), shown, strict=True))
        return Directions(_angles(*sides))

    def within(self, theta_max: float) -> AutomaticPlan:
        """Return the plan for a material or an instrument that ends at ``theta_max``, radians."""
        return replace(
            self,
            theta_i_max=min(self.theta_i_max, theta_max),
            theta_v_max=min(self.theta_v_max, theta_max),
        )

    def describe(self) -> str:
        """Return the plan in words."""
        i, v = np.degrees([self.theta_i_max, self.theta_v_max])
        goal = "" if self.until is None else f", until ΔE = {self.until:g} is predicted"
        wished = "" if self.family is None else f", family {self.family}"
        return f"automatic, theta_i to {i:.3g}°, theta_v to {v:.3g}°{wished}{goal}"

    def found(self, values: np.ndarray, layout: Mapping[str, np.ndarray]) -> dict[str, Any]:
        """Return what the pilot saw, which family that gave, and how good it is predicted to be."""
        seen = describe(self.pilot(), values[: len(self.pilot().wi)])
        return told(seen, choose(seen, self.family), findings_of(layout))

    def pilot(self) -> Pilot:
        """Return the pilot in the order of measurement."""
        return pilot_pairs(self.samples, self.theta_i_max, self.theta_v_max, self.seed)

    def batches(self) -> Batches:
        """Yield the pilot, then batch after batch where errors would show.

        Yields (n, 4) angles, is sent what has ``values`` (n, 3), and returns what was found (see
        ``simrig.plans.auto.findings``).
        """
        work = _Run(self)
        asked = work.asked()
        values: Any = None
        while True:
            try:
                angles = asked.send(values)
            except StopIteration:
                return layout_of(work.symmetries, work.predictions, work.doubts)
            values = (yield angles).values


@dataclass
class _Run:
    """One measurement under way.

    Attributes:
        plan: that is carried out.
        symmetries: how many samples there were when each was taken.
        predictions: ΔE that was predicted with so many samples.
        doubts: what spoke against the family that the user wished.
        angles, values: (n, 4) and (n, 3) so far; of those measured again both times.
    """

    plan: AutomaticPlan
    symmetries: list[tuple[int, Symmetry]] = field(default_factory=list)
    predictions: list[tuple[int, float]] = field(default_factory=list)
    doubts: list[Doubt] = field(default_factory=list)
    angles: np.ndarray = field(default_factory=lambda: np.zeros((0, 4)))
    values: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))

    @property
    def taken(self) -> int:
        """How many samples there are so far."""
        return len(self.values)

    def asked(self) -> Asked:
        plan = self.plan
        pilot = plan.pilot()
        values = yield from self._asked(pilot.wi, pilot.wv)
        seen = describe(pilot, values)
        choice = choose(seen, plan.family)
        self.symmetries.append((self.taken, choice.symmetry))
        samples = Samples.of(pilot.wi, pilot.wv, values, plan.theta_i_max, plan.theta_v_max)
        model = fit_model(samples.lit(), choice.symmetry)
        count = _BATCHES if plan.until is None else _BATCHES_UNTIL
        ends = np.geomspace(self.taken, plan.samples, count + 1).round().astype(int)[1:]
        for number, end in enumerate(ends):
            if plan.until is not None and self._good_enough(model, plan.until):
                return model
            wanted = int(end) - self.taken
            if wanted <= 0:
                continue
            wi, wv = self._batch(model, replace(choice, symmetry=model.symmetry), wanted, number)
            samples = samples.with_more(wi, wv, (yield from self._asked(wi, wv)))
            lit, fitted = samples.lit(), (model.symmetry, model.parameters)
            model = with_profile(fit_model(lit, *fitted, profile=model.profile))
            fully = number in _LOOKS_BACK or (model.symmetry.bivariate and end == ends[-1])
            model = self._looked_back(model, choice.symmetry, seen.bivariate, fully)
        self._predicted(model)
        return model

    def _asked(self, wi: np.ndarray, wv: np.ndarray) -> Generator[np.ndarray, Any, np.ndarray]:
        """Yield the angles of pairs, and return the values that are sent back."""
        angles = _angles(wi, wv)
        values = yield angles
        self.angles, self.values = (
            np.concatenate(both) for both in ((self.angles, angles), (self.values, values))
        )
        return values

    def _batch(
        self, model: KrigingModel, choice: Choice, wanted: int, number: int
    ) -> tuple[np.ndarray, np.ndarray]:
        again = _again(model, wanted)
        wi, wv = self._candidates(choice.shares, model.samples, wanted, number)
        chosen = next_batch(model, wi, wv, wanted - len(again))
        samples = model.samples
        wi = np.concatenate([samples.wi[again], wi[chosen]])
        wv = np.concatenate([samples.wv[again], wv[chosen]])
        order = travel_order(wi, wv)
        return wi[order], wv[order]

    def _candidates(
        self, shares: Shares, samples: Samples, wanted: int, number: int
    ) -> tuple[np.ndarray, np.ndarray]:
        plan = self.plan
        count = max(_CANDIDATES, _CANDIDATES_PER_SAMPLE * (self.taken + wanted))
        even, cores = int(shares.even * count), int(shares.cores * count)
        lobes = cores + int(shares.back * count)
        seed = 1000 * plan.seed + 2 * number
        reach = plan.theta_i_max, plan.theta_v_max
        if samples.dark_beyond:
            end = max(samples.theta_i_max, samples.theta_v_max) + _PAST_THE_END
            reach = min(reach[0], end), min(reach[1], end)
        parts = (
            displayed_pairs(count - even - lobes, *reach, seed),
            even_pairs(even, *reach, seed + 1),
            lobe_pairs(lobes, min(reach), seed, cores),
        )
        return np.concatenate([p[0] for p in parts]), np.concatenate([p[1] for p in parts])

    def _looked_back(
        self, model: KrigingModel, first: Symmetry, bivariate: bool, fully: bool
    ) -> KrigingModel:
        """Return the model, or that of a symmetry that predicts left-out samples clearly better.

        Samples lie at all azimuths and in both orders, whatever was assumed, so that they show
        what a pilot missed. The shape that a user wished stays, and the doubt is told.

        Args:
            model: that is in use.
            first: symmetry that the pilot saw; unless ``fully`` no other one is tried.
            bivariate: whether the pilot allows that phi_d does not matter.
            fully: whether the neighbouring ones are tried.
        """
        found = back_to(model, first)
        if fully:
            look = looked_back(found, bivariate)
            wished = self.plan.family
            found = look.best
            if wished is not None and FAMILIES[wished].shape is not None:
                found = look.same
                if look.best.symmetry.dimensions != found.symmetry.dimensions:
                    self.doubts.append(Doubt(self.taken, look.best.symmetry, look.share))
        if found is not model:
            self.symmetries.append((self.taken, found.symmetry))
        return found

    def _good_enough(self, model: KrigingModel, until: float) -> bool:
        """Return whether the ΔE is below a goal in nine of ten measurements.

        A prediction that falls faster than samples are added is believed with the next batch.
        """
        goal = until / LIKELY_BELOW
        before = [made * taken for taken, made in self.predictions[-1:]]
        self.predictions.append((self.taken, predicted_delta_e(trusted(model))))
        likely = max(self.predictions[-1][1], *(each / self.taken for each in before), 0.0)
        return likely <= goal and self._predicted(model) <= goal

    def _predicted(self, model: KrigingModel) -> float:
        """Return the ΔE that is predicted of what a reconstruction makes of the same samples."""
        samples = Samples.recorded(self.angles, self.values)
        predicted = predicted_delta_e(final_model(samples, model.symmetry))
        self.predictions.append((self.taken, predicted))
        return predicted


def _again(model: KrigingModel, wanted: int) -> np.ndarray:
    """Return which samples to measure again among so many: those that stand out most."""
    stands_out = outstanding(model)
    most = np.argsort(-stands_out, kind="stable")[: max(1, int(_SHARE_AGAIN * wanted))]
    return most[stands_out[most] > STANDS_OUT][: wanted - 1]


def _angles(wi: np.ndarray, wv: np.ndarray) -> np.ndarray:
    """Return theta_i, theta_v, phi_i, phi_v in radians, (n, 4)."""
    (theta_i, phi_i), (theta_v, phi_v) = to_angles(wi), to_angles(wv)
    return np.stack([theta_i, theta_v, phi_i, phi_v], axis=1)

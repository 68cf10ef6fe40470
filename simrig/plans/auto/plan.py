"""The automatic plan: pilot, description, batches, and a look back at what the pilot said."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from simrig.brdf.kriging.choice import left_out_error
from simrig.brdf.kriging.coordinates import half_difference_angles
from simrig.brdf.kriging.displayed import displayed_pairs, even_pairs
from simrig.brdf.kriging.model import KrigingModel, Samples, fit_model
from simrig.brdf.kriging.predicted import predicted_delta_e
from simrig.brdf.kriging.symmetry import Symmetry
from simrig.core.errors import SimrigError
from simrig.directions.spherical import to_angles
from simrig.plans.auto.batches import next_batch, travel_order
from simrig.plans.auto.description import Description, describe
from simrig.plans.auto.pilot import pilot_pairs

# (m, 4) theta_i, theta_v, phi_i, phi_v in radians -> (m, 3) f_r in 1/sr
Take = Callable[[np.ndarray], np.ndarray]

LEAST_SAMPLES = 16
LARGEST_THETA_I, LARGEST_THETA_V = np.radians(88.0), np.radians(85.0)
_BATCHES = 6
_BATCHES_UNTIL = 14  # when the predicted error decides: more, smaller ones
_CANDIDATES = 16384  # at least, and per sample:
_CANDIDATES_PER_SAMPLE = 4
_EVEN = {True: 0.1, False: 0.5}  # of the candidates, isotropic or not
_LOOKS_BACK = (1, 3)  # batches after which symmetries are tried again
_CLEARLY = 0.9  # another symmetry must predict this much better
_SURE = 0.01


@dataclass(frozen=True, eq=False)
class AutomaticSamples:
    """What the plan measured.

    Attributes:
        angles: (n, 4) theta_i, theta_v, phi_i, phi_v in radians, in the order of measurement.
        values: (n, 3) f_r in 1/sr.
        found: plain values: description, symmetry, why, batches, predicted ΔE.
    """

    angles: np.ndarray
    values: np.ndarray
    found: dict[str, Any]


@dataclass(frozen=True)
class AutomaticPlan:
    """Looks first, then measures where it shows.

    Attributes:
        samples: the most that are taken.
        theta_i_max, theta_v_max: how far the rig may look, radians.
        until: predicted ΔE at which to stop before; None takes all samples.
        symmetry: taken as given instead of what the pilot says.
        seed: of the directions.

    Raises:
        SimrigError: too few samples, or a goal that is no positive number.
    """

    samples: int
    theta_i_max: float = float(LARGEST_THETA_I)
    theta_v_max: float = float(LARGEST_THETA_V)
    until: float | None = None
    symmetry: Symmetry | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        if self.samples < LEAST_SAMPLES:
            raise SimrigError(
                f"{self.samples} samples are too few for the automatic plan, it needs at least "
                f"{LEAST_SAMPLES}"
            )
        if self.until is not None and not 0.0 < self.until < float("inf"):
            raise SimrigError(f"the ΔE to stop at must be a number above 0, got {self.until:g}")
        for theta in (self.theta_i_max, self.theta_v_max):
            if not 0.0 < theta < 0.5 * np.pi:
                raise SimrigError("the largest theta of a plan must lie between 0 and 90 degrees")

    def within(self, theta_max: float) -> AutomaticPlan:
        """Return the plan for a material or an instrument that ends at ``theta_max``, radians."""
        theta_i, theta_v = (min(t, theta_max) for t in (self.theta_i_max, self.theta_v_max))
        return AutomaticPlan(self.samples, theta_i, theta_v, self.until, self.symmetry, self.seed)

    def describe(self) -> str:
        """Return the plan in words."""
        i, v = np.degrees([self.theta_i_max, self.theta_v_max])
        goal = "" if self.until is None else f", until ΔE = {self.until:g} is predicted"
        return f"automatic, theta_i to {i:.3g}°, theta_v to {v:.3g}°{goal}"

    def run(self, take: Take) -> AutomaticSamples:
        """Measure.

        Args:
            take: measures directions; the same directions must give the same values.
        """
        return _Run(self, take).result()


@dataclass
class _Run:
    """One measurement under way."""

    plan: AutomaticPlan
    take: Take
    angles: list[np.ndarray] = field(default_factory=list)
    values: list[np.ndarray] = field(default_factory=list)
    batches: list[dict[str, Any]] = field(default_factory=list)
    why: list[str] = field(default_factory=list)

    def result(self) -> AutomaticSamples:
        plan = self.plan
        pilot = pilot_pairs(plan.samples, plan.theta_i_max, plan.theta_v_max, plan.seed)
        order = travel_order(pilot.wi, pilot.wv)
        values = np.empty((len(pilot.wi), 3))
        values[order] = self._measured(pilot.wi[order], pilot.wv[order])
        description = describe(pilot, values)
        symmetry = plan.symmetry or description.symmetry
        said = "given" if plan.symmetry else "by the pilot"
        self.why.append(f"{symmetry.describe()} ({said})")
        samples = Samples(pilot.wi, pilot.wv, values, plan.theta_i_max, plan.theta_v_max)
        model = fit_model(samples, symmetry, evaluations=200)
        count = _BATCHES if plan.until is None else _BATCHES_UNTIL
        ends = np.geomspace(len(samples), plan.samples, count + 1).round().astype(int)[1:]
        for number, end in enumerate(ends):
            if plan.until is not None and self._predicted(model) <= plan.until:
                break
            model = self._one_batch(model, int(end), number)
            if number in _LOOKS_BACK and plan.symmetry is None:
                model = self._looked_back(model)
        predicted = self._predicted(model)
        return AutomaticSamples(
            np.concatenate(self.angles),
            np.concatenate(self.values),
            self._found(model, description, predicted),
        )

    def _measured(self, wi: np.ndarray, wv: np.ndarray) -> np.ndarray:
        (theta_i, phi_i), (theta_v, phi_v) = to_angles(wi), to_angles(wv)
        angles = np.stack([theta_i, theta_v, phi_i, phi_v], axis=1)
        values = self.take(angles)
        self.angles.append(angles)
        self.values.append(values)
        return values

    def _one_batch(self, model: KrigingModel, end: int, number: int) -> KrigingModel:
        """Measure until there are ``end`` samples and fit the model again."""
        samples = model.samples
        wanted = end - len(samples)
        if wanted <= 0:
            return model
        wi, wv = self._candidates(model.symmetry, number)
        angles = half_difference_angles(wi, wv, model.symmetry.axis)
        chosen = next_batch(model, angles, np.ones(len(wi), dtype=bool), wanted)
        chosen = chosen[travel_order(wi[chosen], wv[chosen])]
        values = self._measured(wi[chosen], wv[chosen])
        more = samples.with_more(wi[chosen], wv[chosen], values)
        return fit_model(more, model.symmetry, model.parameters, evaluations=100)

    def _candidates(self, symmetry: Symmetry, number: int) -> tuple[np.ndarray, np.ndarray]:
        plan = self.plan
        count = max(_CANDIDATES, _CANDIDATES_PER_SAMPLE * plan.samples)
        even = int(_EVEN[symmetry.isotropic] * count)
        seed = 1000 * plan.seed + 2 * number
        reach = plan.theta_i_max, plan.theta_v_max
        parts = (
            displayed_pairs(count - even, *reach, seed),
            even_pairs(even, *reach, seed + 1),
        )
        return np.concatenate([p[0] for p in parts]), np.concatenate([p[1] for p in parts])

    def _looked_back(self, model: KrigingModel) -> KrigingModel:
        """Return the model, or that of a symmetry that predicts left-out samples clearly better.

        Samples lie at all azimuths and in both orders, whatever was assumed, so that they show
        what a pilot missed.
        """
        least = left_out_error(model)
        best = model
        for symmetry in _alternatives(model.symmetry):
            other = fit_model(model.samples, symmetry, evaluations=100)
            error = left_out_error(other)
            if error < _CLEARLY * least:
                best, least = other, error
        if best is not model:
            self.why.append(
                f"{best.symmetry.describe()} (left-out samples of {len(model.samples)} contradict)"
            )
        return best

    def _predicted(self, model: KrigingModel) -> float:
        predicted = predicted_delta_e(model)
        self.batches.append({"samples": len(model.samples), "predicted_delta_e": predicted})
        return predicted

    def _found(
        self, model: KrigingModel, description: Description, predicted: float
    ) -> dict[str, Any]:
        return {
            "description": description.as_dict(),
            "symmetry": model.symmetry.as_dict(),
            "why": "; then ".join(self.why),
            "batches": self.batches,
            "predicted_delta_e": predicted,
        }


def _alternatives(symmetry: Symmetry) -> list[Symmetry]:
    """Return the symmetries that differ in one, and in reciprocity where isotropy is in doubt."""
    flags = symmetry.as_dict()
    if not symmetry.isotropic:
        turned = [
            {**flags, name: not flags[name]} for name in ("reciprocal", "mirror", "half_turn")
        ]
        turned.append({**flags, "isotropic": True, "mirror": True, "half_turn": True})
    else:
        turned = [{**flags, "reciprocal": not symmetry.reciprocal}]
        turned += [
            {**flags, "isotropic": False, "reciprocal": swap, "mirror": both, "half_turn": both}
            for swap in (True, False)
            for both in (True, False)
        ]
    return [Symmetry(**own) for own in turned]

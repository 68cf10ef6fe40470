"""The budget: every source alone, all together, by polar angle; of f_r and of the albedo.

Source: JCGM 101:2008 (propagation of distributions by Monte Carlo) and JCGM 100:2008 (expanded
uncertainty, k = 2). The uncertainty is the root mean square of the error, so that an error which is
not corrected for counts as well as a spread.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from simrig.brdf.protocol import Brdf
from simrig.core.errors import SimrigError
from simrig.core.gamut import KEEP
from simrig.evaluation.uncertainty.draws import draw
from simrig.evaluation.uncertainty.model import Bench, seen, stated
from simrig.evaluation.uncertainty.sources import SOURCES, unstated
from simrig.instruments.calibration import replaced
from simrig.instruments.description import Description, GonioreflectometerDescription
from simrig.instruments.instrument import AXES
from simrig.instruments.quantity import Quantity, quantities_of
from simrig.rigs.direct.recording import at

K = 2.0  # coverage factor of expanded uncertainties
COVERAGE = 0.95
BLACK = 1e-30  # 1/sr, up to which no uncertainty is relative
THETAS_DEG = (0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 85.0)
TRIALS = 2000
_LEAST_TRIALS, _MOST_NUMBERS = 100, 2e8
_GOLDEN = np.pi * (3.0 - np.sqrt(5.0))
_ALBEDO_THETAS, _ALBEDO_AZIMUTHS = 8, 16


@dataclass(frozen=True)
class Spread:
    """What errors do to values.

    Attributes:
        bias: their mean, shape of the values.
        rms: root of their mean square.
        low, high: between which ``COVERAGE`` of them are.
    """

    bias: np.ndarray
    rms: np.ndarray
    low: np.ndarray
    high: np.ndarray

    @classmethod
    def of(cls, errors: np.ndarray) -> Spread:
        """Return it of errors, (trials, …)."""
        tail = 0.5 * (1.0 - COVERAGE)
        low, high = np.quantile(errors, [tail, 1.0 - tail], axis=0)
        return cls(errors.mean(axis=0), np.sqrt((errors**2).mean(axis=0)), low, high)

    @property
    def variance(self) -> np.ndarray:
        """Of the errors about their mean."""
        return np.maximum(self.rms**2 - self.bias**2, 0.0)


@dataclass(frozen=True, eq=False)
class Instruments:
    """Virtual instruments of one file that look at one material.

    Attributes:
        brdf: the material.
        description: the instrument.
        trials, seed: how many are drawn, and of which stream.
        changes: numbers in the place of those of the file (an alternative).
        exposures: of every value.
    """

    brdf: Brdf
    description: GonioreflectometerDescription
    trials: int = TRIALS
    seed: int = 0
    changes: Mapping[str, Quantity] | None = None
    exposures: int = 1

    @cached_property
    def quantities(self) -> dict[str, Quantity]:
        """All numbers of the instrument, by path."""
        every = quantities_of(self.description)
        own = {path: each for path, each in every.items() if not path.startswith("alternative.")}
        return replaced(own, self.changes or {})

    @cached_property
    def bench(self) -> Bench:
        """What the measurement equation reads."""
        return Bench.of(self.description, self.quantities, self.exposures)

    def errors(
        self, angles: np.ndarray, on: Collection[str], kept: dict[frozenset[str], Any] | None = None
    ) -> np.ndarray:
        """Return stated values less f_r, (trials or 1, n, 3).

        Args:
            angles: (n, 4) in radians.
            on: names of the sources that count.
            kept: of calls for the same angles: what was seen, by the sources that move the light.
        """
        pixels = self.bench.instrument.pixels
        draws = draw(self.quantities, len(angles), self.trials, self.seed, on, pixels)
        moving = frozenset(name for name in on if SOURCES[name].moves_light)
        kept = {} if kept is None else kept
        if moving not in kept:
            kept[moving] = seen(self.brdf, angles, self.bench, draws)
        values = stated(kept[moving], angles, self.bench, draws)
        return np.asarray(values - at(self.brdf, angles))


@dataclass(frozen=True, eq=False)
class Table:
    """The budget of values.

    Attributes:
        angles: (n, 4) in radians. truth: (n, 3) f_r, or albedo.
        group: (n,) index of the polar angle that each value belongs to.
        alone: every source by itself. total: all together.
        without: all but one.
    """

    angles: np.ndarray
    truth: np.ndarray
    group: np.ndarray
    alone: Mapping[str, Spread]
    total: Spread
    without: Mapping[str, Spread]

    @cached_property
    def black(self) -> bool:
        """Whether no value is above 0, so that uncertainties are absolute."""
        return not np.any(self.truth > BLACK)

    @property
    def unit(self) -> str:
        """Of what ``parts`` returns."""
        return "1/sr" if self.black else "%"

    def parts(self, rms: np.ndarray, which: int | None = None) -> np.ndarray:
        """Return uncertainties (n, 3) in the table's unit: those of a group, or all.

        They are relative, in per cent, of all values above ``BLACK``; absolute where none is.
        """
        own = np.ones(self.truth.shape, dtype=bool)
        if which is not None:
            own &= (self.group == which)[:, None]
        if self.black:
            return np.asarray(rms[own])
        own &= self.truth > BLACK
        return np.asarray(100.0 * rms[own] / self.truth[own])

    def typical(self, rms: np.ndarray, which: int | None = None) -> float | None:
        """Return the median of ``parts``; None of a group that is black beside others."""
        parts = self.parts(rms, which)
        return float(np.median(parts)) if parts.size else None

    def worst(self, rms: np.ndarray, which: int | None = None) -> float | None:
        """Return the largest of ``parts``; None of a group that is black beside others."""
        parts = self.parts(rms, which)
        return float(parts.max()) if parts.size else None

    def share(self, name: str) -> float:
        """Return the median share of a source in the sum of the squares of all."""
        every = sum(self.parts(spread.rms) ** 2 for spread in self.alone.values())
        part = self.parts(self.alone[name].rms) ** 2
        return float(np.median(part / np.maximum(every, 1e-300)))

    def dominant(self) -> str | None:
        """Return the source with the largest share; None where nothing is uncertain."""
        best = max(self.alone, key=self.share, default=None)
        return best if best is not None and self.share(best) > 0.0 else None


def check_subject(material: Brdf, description: Description) -> GonioreflectometerDescription:
    """Return the description of an instrument that a budget can be made of.

    Raises:
        SimrigError: another kind of instrument, or a material whose channels are negative.
    """
    if not isinstance(description, GonioreflectometerDescription):
        raise SimrigError(
            f"the budget is that of a gonioreflectometer, '{description.instrument.name}' is a "
            f"{description.instrument.kind}: choose another --instrument"
        )
    if material.gamut == KEEP:
        raise SimrigError(
            f"'{material.name}' keeps colours outside sRGB, which no sensor sees: use gamut 'clip'"
        )
    return description


def directions(thetas_deg: Sequence[float], azimuths: int) -> tuple[np.ndarray, np.ndarray]:
    """Return pairs with both polar angles alike, (n, 4) in radians, and the index of the angle.

    Azimuth differences are even and hold 180°, the mirror direction; the light stands at another
    azimuth for each, so that anisotropy shows.
    """
    difference = 2.0 * np.pi * np.arange(azimuths) / azimuths + (np.pi if azimuths % 2 else 0.0)
    phi_i = np.mod(_GOLDEN * np.arange(azimuths), 2.0 * np.pi)
    angles = [
        np.stack(np.broadcast_arrays(t, t, phi_i, np.mod(phi_i + difference, 2 * np.pi)), axis=-1)
        for t in np.radians(thetas_deg)
    ]
    return np.concatenate(angles), np.repeat(np.arange(len(thetas_deg)), azimuths)


def check_angles(
    angles: np.ndarray, material: Brdf, description: GonioreflectometerDescription
) -> None:
    """Raise SimrigError for directions that cannot be measured."""
    if not np.all(np.isfinite(angles)) or not np.all(
        (angles[:, :2] >= 0.0) & (angles[:, :2] < np.pi / 2)
    ):
        raise SimrigError("a budget needs finite directions with polar angles in [0, 90) degrees")
    worst = float(angles[:, :2].max())
    if worst > material.theta_max + 1e-6:
        raise SimrigError(
            f"'{material.name}' has data up to theta = {np.degrees(material.theta_max):g} degrees, "
            f"the budget asks for {np.degrees(worst):g}: lower --theta"
        )
    reach = {str(axis.name): axis.range_deg for axis in description.axis}
    for name, column in zip(AXES[:2], np.degrees(angles[:, :2]).T, strict=True):
        low, high = reach[name]
        if column.min() < low - 1e-6 or column.max() > high + 1e-6:
            raise SimrigError(
                f"'{description.instrument.name}' reaches {name} from {low:g} to {high:g} degrees, "
                f"the budget asks for {column.min():g} to {column.max():g}: change --theta"
            )


def check_trials(trials: int, values: int) -> None:
    """Raise SimrigError for too few trials to tell intervals by, or too many to hold."""
    if trials < _LEAST_TRIALS:
        raise SimrigError(f"a budget needs at least {_LEAST_TRIALS} trials, got {trials}")
    if trials * values * 3 > _MOST_NUMBERS:
        raise SimrigError(
            f"{trials:,} trials of {values:,} values do not fit the memory: "
            f"take at most {int(_MOST_NUMBERS / 3 / values):,} trials"
        )


def table_of_values(
    instruments: Instruments,
    angles: np.ndarray,
    group: np.ndarray,
    on: Sequence[str],
    progress: Any = None,
) -> Table:
    """Return the budget of f_r at directions."""
    kept: dict[frozenset[str], Any] = {}
    alone, without = {}, {}
    total = Spread.of(instruments.errors(angles, on, kept))
    for done, name in enumerate(on):
        alone[name] = Spread.of(instruments.errors(angles, [name], kept))
        rest = [other for other in on if other != name]
        without[name] = Spread.of(instruments.errors(angles, rest, kept))
        kept = {key: kept[key] for key in kept if len(key) != 1 and key | {name} <= set(on)}
        if progress is not None:
            progress(done + 1, len(on))
    truth = at(instruments.brdf, angles)
    return Table(angles, truth, group, alone, total, without)


def table_of_albedos(
    instruments: Instruments, thetas_deg: Sequence[float], on: Sequence[str]
) -> Table:
    """Return the budget of the albedo seen from polar angles, of 8 × 16 values each.

    The error of a value goes into the sum as it is: what is shared by all values does not average
    out, what belongs to a move does.
    """
    nodes, weights = np.polynomial.legendre.leggauss(_ALBEDO_THETAS)
    theta = np.arcsin(np.sqrt((nodes + 1.0) / 2.0))
    phi = (np.arange(_ALBEDO_AZIMUTHS) + 0.5) * (2.0 * np.pi / _ALBEDO_AZIMUTHS)
    theta_i, phi_i = (grid.ravel() for grid in np.meshgrid(theta, phi, indexing="ij"))
    weight = np.repeat(0.5 * np.pi * weights / _ALBEDO_AZIMUTHS, _ALBEDO_AZIMUTHS)
    made: dict[str, list[np.ndarray]] = {}
    truth = []
    for theta_v in np.radians(thetas_deg):
        zero = np.zeros_like(theta_i)
        angles = np.stack([theta_i, zero + theta_v, phi_i, zero], axis=1)
        kept: dict[frozenset[str], Any] = {}
        for name, names in (("", on), *((name, [name]) for name in on)):
            errors = np.einsum("n,tnc->tc", weight, instruments.errors(angles, names, kept))
            made.setdefault(name, []).append(errors)
        truth.append(weight @ at(instruments.brdf, angles))
    spreads = {name: Spread.of(np.stack(each, axis=1)) for name, each in made.items()}
    total = spreads.pop("")
    seen_from = np.zeros((len(thetas_deg), 4))
    seen_from[:, 1] = np.radians(thetas_deg)
    group = np.arange(len(thetas_deg))
    return Table(seen_from, np.stack(truth), group, spreads, total, {})


def silent_numbers(description: GonioreflectometerDescription) -> dict[str, list[str]]:
    """Return the numbers of an instrument whose uncertainty its file does not state, by source."""
    return unstated(quantities_of(description), quantities_of(description, given=True))

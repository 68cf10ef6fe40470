"""What a pilot says of a material: its symmetries, highlight, body and noise, with uncertainty."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from simrig.brdf.kriging.symmetry import Symmetry
from simrig.directions.half_difference import to_half_difference
from simrig.plans.auto.pilot import OPERATIONS, Pilot
from simrig.plans.auto.quantities import Quantity, numbers, uncertainties

_SAME = 3e-4  # relative difference that counts as none
_HANDED = 0.03  # relative difference of mirror images of an isotropic material that counts
_KEPT, _NO_NOISE = 0.75, 1e-4  # of the groups, those that differ least; where there is noise
_DIGITS = 9  # of a per cent; what differs by less differs by rounding
_OF_MEDIAN = 1.17  # standard error of a median deviation, over deviation and root of the count
_DEVIATIONS = 3.0  # standard errors by which a difference must exceed that of noise


@dataclass(frozen=True)
class Test:
    """One symmetry, tried.

    Attributes:
        difference: mean of the relative differences of values that it would make equal.
        uncertainty: its standard error; infinite where it was tried once at most.
        holds: whether they are equal within noise.
    """

    difference: float
    uncertainty: float
    holds: bool

    def __str__(self) -> str:
        difference = f"{round(100 * self.difference, _DIGITS):.2g}"
        if not np.isfinite(self.uncertainty):
            return f"{difference} %"
        return f"{difference} ± {float(f'{100 * self.uncertainty:.1g}'):g} %"


@dataclass(frozen=True)
class Description:
    """A material as the pilot saw it.

    Attributes:
        tests: of ``isotropic``, ``reciprocal``, ``mirror``, ``half_turn`` and ``bivariate``.
        noise: relative standard deviation of a value.
        noise_uncertainty: its standard error.
        seen: see ``simrig.plans.auto.quantities.numbers``.
        errors: the uncertainties of these.
    """

    tests: Mapping[str, Test]
    noise: float
    noise_uncertainty: float
    seen: Mapping[str, float]
    errors: Mapping[str, float]

    @property
    def symmetry(self) -> Symmetry:
        """The symmetries that hold."""
        holds = {name: test.holds for name, test in self.tests.items()}
        if not holds["isotropic"]:
            return Symmetry(False, holds["reciprocal"], holds["mirror"], holds["half_turn"])
        # without mirror images only where handedness is plain: hardly a material has it
        mirror = holds["mirror"] or self.tests["mirror"].difference < _HANDED
        return Symmetry(True, holds["reciprocal"], mirror, True)

    @property
    def bivariate(self) -> bool:
        """Whether phi_d may not matter: left-out samples must say so too."""
        own = self.symmetry
        return self.tests["bivariate"].holds and own.isotropic and own.reciprocal and own.mirror

    @property
    def peak(self) -> float:
        """Largest f_r seen, 1/sr, mean of the channels."""
        return self.seen["peak"]

    @property
    def body(self) -> float:
        """Median f_r away from the highlight, 1/sr, mean of the channels."""
        return self.seen["body"]

    @property
    def width(self) -> float | None:
        """theta_h at which values have fallen halfway to the body, radians; None without one."""
        return known(self.seen["width"])

    @property
    def retro(self) -> float:
        """f_r of light that goes back, over what lies beside; 1 where unknown."""
        return float(np.nan_to_num(self.seen["retro"], nan=1.0))

    def quantities(self) -> list[Quantity]:
        """Return everything in numbers, with uncertainties."""
        found = [
            Quantity(
                f"{_SAID[name]} ({'yes' if test.holds else 'no'}), values differ by",
                round(100.0 * test.difference, _DIGITS),
                known(100.0 * test.uncertainty),
                "%",
            )
            for name, test in self.tests.items()
        ]
        noise, error = round(100.0 * self.noise, _DIGITS), 100.0 * self.noise_uncertainty
        found.append(Quantity("noise of the rig", noise, known(error), "%"))
        for name, label, unit, factor in _NUMBERS:
            value, spread = (known(factor * of[name]) for of in (self.seen, self.errors))
            found.append(Quantity(label, value, None if value is None else spread, unit))
        return found


_SAID = {
    "isotropic": "isotropic",
    "reciprocal": "reciprocal",
    "mirror": "mirror symmetric",
    "half_turn": "the same after half a turn",
    "bivariate": "the same at all phi_d",
}
_NUMBERS = (  # key, what it is, unit, factor to this unit
    ("width", "highlight, half width", "°", float(np.degrees(1.0))),
    ("peak", "highlight, largest value seen", "1/sr", 1.0),
    ("body", "body, median", "1/sr", 1.0),
    ("retro", "retro-reflection over what lies beside", "", 1.0),
    ("dynamic_range", "dynamic range", "EV", 1.0),
    *(
        (f"{name}_{number}", f"{label}, {channel} of its largest channel", "%", 100.0)
        for name, label in (("peak", "colour of the highlight"), ("body", "colour of the body"))
        for number, channel in enumerate(("red", "green", "blue"))
    ),
)


def known(value: float) -> float | None:
    """Return a number, or None where it is NaN or infinite."""
    return float(value) if np.isfinite(value) else None


def describe(pilot: Pilot, values: np.ndarray) -> Description:
    """Return what the values of a pilot say.

    Args:
        pilot: its pairs.
        values: (n, 3) f_r in 1/sr.
    """
    means = values.mean(axis=1)
    floor = 1e-3 * float(np.median(means)) + 1e-12
    grouped = means[pilot.groups].reshape(-1, len(OPERATIONS))
    differences = np.abs(grouped[:, 1:] - grouped[:, :1]) / (
        0.5 * (grouped[:, 1:] + grouped[:, :1]) + floor
    )
    by_name = dict(zip(OPERATIONS[1:], differences.T, strict=True))
    turned = np.maximum(by_name["turned_45"], by_name["turned_90"])
    nudged = by_name["nudged"]
    noise, noise_error = _noise(nudged)
    found = {
        "isotropic": _test(turned, nudged),
        "reciprocal": _test(by_name["swapped"], nudged),
        "mirror": _test(by_name["mirrored"], nudged),
        "half_turn": _test(by_name["half_turned"], nudged),
        "bivariate": _test(by_name["phi_d_turned"], nudged),
    }
    at = to_half_difference(pilot.wi, pilot.wv)
    return Description(
        found, noise, noise_error, numbers(at, values), uncertainties(at, values, noise)
    )


def _noise(differences: np.ndarray) -> tuple[float, float]:
    """Return the noise of one value and its error from differences of pairs all but the same."""
    if len(differences) == 0:
        return 0.0, 0.0
    noise = float(np.median(differences) / (np.sqrt(2.0) * 0.6745))
    return noise, _OF_MEDIAN * noise / np.sqrt(len(differences))


def _test(differences: np.ndarray, nudged: np.ndarray) -> Test:
    """Return whether differences are those of noise, as pairs that are all but the same show it."""
    if len(differences) == 0:
        return Test(0.0, float("inf"), True)  # nothing speaks against it
    count = len(nudged)
    mean = float(differences.mean())
    spread = np.sqrt((differences.var() + nudged.var()) / count)
    error = float(spread) if count > 1 else float("inf")
    # a few groups, on the flanks of narrow highlights, see errors of the axes many times enlarged
    kept = count if nudged.max() < _NO_NOISE else int(np.ceil(_KEPT * count))
    least_of_both = (np.sort(differences)[:kept], np.sort(nudged)[:kept])
    holds = _as_noise(differences, nudged) or _as_noise(*least_of_both)
    return Test(mean, error, holds)


def _as_noise(differences: np.ndarray, nudged: np.ndarray) -> bool:
    """Return whether differences are no larger than those of pairs that are all but the same."""
    count = len(nudged)
    # the larger of two differences by noise alone is some 1.4 times one; few groups know it badly
    spread = float(nudged.std()) / np.sqrt(count) * (1.0 + 4.0 / count)
    least = _SAME + 2.0 * float(nudged.mean()) + _DEVIATIONS * spread
    return bool(differences.mean() <= least)

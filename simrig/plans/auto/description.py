"""What a pilot says of a material: its symmetries, highlight, body and noise, with uncertainty."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from simrig.brdf.kriging.symmetry import Symmetry
from simrig.directions.half_difference import to_half_difference
from simrig.plans.auto.pilot import OPERATIONS, Pilot

_SAME = 3e-4  # relative difference that counts as none
_HANDED = 0.03  # relative difference of mirror images of an isotropic material that counts
_KEPT, _NO_NOISE = 0.75, 1e-4  # of the groups, those that differ least; where there is noise
_DEVIATIONS = 3.0  # standard errors by which a difference must exceed that of noise


@dataclass(frozen=True)
class Test:
    """One symmetry, tried.

    Attributes:
        difference: mean of the relative differences of values that it would make equal.
        uncertainty: its standard error.
        holds: whether they are equal within noise.
    """

    difference: float
    uncertainty: float
    holds: bool


@dataclass(frozen=True)
class Description:
    """A material as the pilot saw it.

    Attributes:
        tests: of ``isotropic``, ``reciprocal``, ``mirror`` and ``half_turn``.
        noise: relative standard deviation of a value.
        noise_uncertainty: its standard error.
        peak: largest f_r seen, 1/sr, mean of the channels.
        body: median f_r away from the highlight, 1/sr, mean of the channels.
        peak_colour, body_colour: of these, largest channel 1.
        width: theta_h at which values have fallen halfway to the body, radians; None where no
            highlight stands out.
        retro: f_r of light that goes back where it comes from, over the body.
        dynamic_range: binary logarithm of the largest over the smallest positive value.
    """

    tests: Mapping[str, Test]
    noise: float
    noise_uncertainty: float
    peak: float
    body: float
    peak_colour: tuple[float, float, float]
    body_colour: tuple[float, float, float]
    width: float | None
    retro: float
    dynamic_range: float

    @property
    def symmetry(self) -> Symmetry:
        """The symmetries that hold."""
        holds = {name: test.holds for name, test in self.tests.items()}
        if holds["isotropic"]:
            # without mirror images only where handedness is plain: hardly a material has it
            mirror = holds["mirror"] or self.tests["mirror"].difference < _HANDED
            return Symmetry(True, holds["reciprocal"], mirror, True)
        return Symmetry(False, holds["reciprocal"], holds["mirror"], holds["half_turn"])

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for provenance and reports."""
        return asdict(self)

    def lines(self) -> list[str]:
        """Return what a reader wants to know, one fact a line."""
        said = [
            f"{name.replace('_', ' ')}: {'yes' if test.holds else 'no'} (values differ by "
            f"{100 * test.difference:.2g} ± {100 * test.uncertainty:.1g} %)"
            for name, test in self.tests.items()
        ]
        width = "none" if self.width is None else f"half width {np.degrees(self.width):.2g}°"
        return [
            *said,
            f"noise: {100 * self.noise:.2g} ± {100 * self.noise_uncertainty:.1g} %",
            f"highlight: {width}, peak {self.peak:.3g}/sr over a body of {self.body:.3g}/sr",
            f"retro-reflection: {self.retro:.2g} of the body",
            f"dynamic range: {self.dynamic_range:.1f} EV",
        ]


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
    }
    at = to_half_difference(pilot.wi, pilot.wv)
    away = at.theta_h > np.radians(25.0)
    body = values[away] if np.any(away) else values
    middle = np.median(body, axis=0)
    top = values[np.argmax(means)]
    body_level = max(float(middle.mean()), 1e-12)
    back = (at.theta_d < np.radians(2.0)) & away
    positive = means[means > 0.0]
    return Description(
        tests=found,
        noise=noise,
        noise_uncertainty=noise_error,
        peak=float(top.mean()),
        body=float(middle.mean()),
        peak_colour=_colour(top),
        body_colour=_colour(middle),
        width=_half_width(at.theta_h, means, body_level),
        retro=float(means[back].max() / body_level) if np.any(back) else 1.0,
        dynamic_range=float(np.log2(positive.max() / positive.min())) if len(positive) else 0.0,
    )


def _noise(differences: np.ndarray) -> tuple[float, float]:
    """Return the noise of one value and its error from differences of pairs all but the same."""
    if len(differences) == 0:
        return 0.0, 0.0
    noise = float(np.median(differences) / (np.sqrt(2.0) * 0.6745))
    return noise, noise / np.sqrt(2.0 * len(differences))


def _test(differences: np.ndarray, nudged: np.ndarray) -> Test:
    """Return whether differences are those of noise, as pairs that are all but the same show it."""
    if len(differences) == 0:
        return Test(0.0, float("inf"), True)  # nothing speaks against it
    count = len(nudged)
    mean = float(differences.mean())
    error = float(np.sqrt((differences.var() + nudged.var()) / count))
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


def _colour(value: np.ndarray) -> tuple[float, float, float]:
    red, green, blue = value / max(float(value.max()), 1e-12)
    return float(red), float(green), float(blue)


def _half_width(theta_h: np.ndarray, means: np.ndarray, body: float) -> float | None:
    """Return theta_h beyond which values stay below halfway between body and peak, in logs."""
    peak = float(means.max())
    if peak < 2.0 * body:
        return None
    above = means > np.sqrt(peak * body)
    return float(np.median(theta_h[above]))

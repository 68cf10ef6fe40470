"""What the values of a pilot say in numbers, each with its uncertainty.

The uncertainty is the standard deviation over pilots drawn from this one with replacement
(bootstrap), each value with new noise. It says how well so few samples know a quantity; what no
sample saw, as a highlight narrower than the distance between them, it cannot know.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from simrig.directions.half_difference import HalfDifference

_AWAY = np.radians(25.0)  # theta_h from which on a sample shows the body
_BACK = np.radians(2.0)  # theta_d up to which light goes back where it comes from
_BESIDE, _NEAREST = (np.radians(6.0), np.radians(30.0)), 5  # theta_d, and how many
_STANDS_OUT = 2.0  # times the body: a highlight
_DRAWS = 100


@dataclass(frozen=True)
class Quantity:
    """A number that a pilot found.

    Attributes:
        name: what it is.
        value: None where there is none, as the width of no highlight.
        uncertainty: its standard deviation, of the same unit; None where it is not known.
        unit: empty of a pure number.
    """

    name: str
    value: float | None
    uncertainty: float | None
    unit: str = ""

    def as_dict(self) -> dict[str, Any]:
        """Return plain values."""
        return asdict(self)


def numbers(at: HalfDifference, values: np.ndarray) -> dict[str, float]:
    """Return quantities by name; NaN where there is none.

    Args:
        at: half-difference angles of (n,) pairs.
        values: (n, 3) f_r in 1/sr.

    Returns:
        ``peak`` and ``body`` in 1/sr (largest value, median away from the highlight, means of the
        channels), ``peak_0`` ... ``body_2`` their colours (largest channel 1), ``width`` (theta_h
        at which values have fallen halfway to the body, radians), ``retro`` (of light that goes
        back, over the brightest that lies beside), ``dynamic_range`` (EV).
    """
    means = values.mean(axis=1)
    away = at.theta_h > _AWAY
    middle = np.median(values[away] if np.any(away) else values, axis=0)
    top = values[np.argmax(means)]
    peak, body = float(top.mean()), float(middle.mean())
    back, positive = np.flatnonzero(away & (at.theta_d < _BACK)), means[means > 0.0]
    above = means > np.sqrt(max(peak * body, 0.0))
    stands_out = peak >= _STANDS_OUT * body and bool(np.any(above))
    found = {
        "peak": peak,
        "body": body,
        "width": float(np.median(at.theta_h[above])) if stands_out else np.nan,
        "retro": _outshines(at, means, back),
        "dynamic_range": float(np.log2(positive.max() / positive.min())) if len(positive) else 0.0,
    }
    for name, value in (("peak", top), ("body", middle)):
        colour = value / max(float(value.max()), 1e-12)
        found |= {f"{name}_{channel}": float(part) for channel, part in enumerate(colour)}
    return found


def _outshines(at: HalfDifference, means: np.ndarray, back: np.ndarray) -> float:
    """Return the largest of the samples ``back`` over the samples beside, at about its theta_h."""
    beside = np.flatnonzero((at.theta_d > _BESIDE[0]) & (at.theta_d < _BESIDE[1]))
    if len(back) == 0 or len(beside) == 0:
        return float("nan")
    brightest = back[np.argmax(means[back])]
    order = np.argsort(np.abs(at.theta_h[beside] - at.theta_h[brightest]), kind="stable")
    others = float(means[beside[order[:_NEAREST]]].max())
    return float(means[brightest]) / max(others, 1e-12)


def uncertainties(
    at: HalfDifference, values: np.ndarray, noise: float, seed: int = 0
) -> Mapping[str, float]:
    """Return the standard deviations of ``numbers``; NaN where fewer than two pilots know one.

    Args:
        at, values: as in ``numbers``.
        noise: relative standard deviation of a value.
        seed: of the draws.
    """
    rng = np.random.default_rng(seed)
    drawn = []
    for _ in range(_DRAWS):
        own = rng.integers(0, len(values), len(values))
        noisy = values[own] * np.maximum(1.0 + noise * rng.standard_normal((len(own), 1)), 0.0)
        drawn.append(numbers(HalfDifference(*(part[own] for part in at)), noisy))
    found = {}
    for name in drawn[0]:
        known = [each[name] for each in drawn if np.isfinite(each[name])]
        found[name] = float(np.std(known, ddof=1)) if len(known) > 1 else float("nan")
    return found

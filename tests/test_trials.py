"""Psychometric functions of counts: psignifit's published cases, closed forms, hard cases."""

from __future__ import annotations

import numpy as np
import pytest

import simrig as sr
from simrig.core.errors import SimrigError
from simrig.perception.trials import SIGMOIDS, TrialFit, fit_psychometric

# psignifit's example: two alternatives, 90 trials a level
LEVELS = [1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 4.5, 5.0, 6.0, 7.0, 8.0, 10.0]
HITS = [45, 50, 44, 44, 52, 53, 62, 64, 76, 79, 88, 90, 90]


def test_psignifits_example_is_fitted_within_its_tolerance() -> None:
    """Published: 4.6448 and 4.6838 with the lapse rate free; 4.6 and 4.5 at 0.01; ± 0.1."""
    free = sr.fit_psychometric(LEVELS, HITS, 90, guess=0.5)
    assert free.threshold == pytest.approx(4.6448, abs=0.1)
    assert free.width == pytest.approx(4.6838, abs=0.1)
    assert free.lapses == pytest.approx(0.0, abs=1e-4)
    kept = sr.fit_psychometric(LEVELS, HITS, 90, guess=0.5, lapses=0.01, bootstrap=100)
    assert kept.threshold == pytest.approx(4.6, abs=0.1)
    assert kept.width == pytest.approx(4.5, abs=0.1)
    low, high = kept.intervals["threshold"]
    assert 4.2 < low < 4.5 < 4.7 < high < 5.0


@pytest.mark.parametrize("sigmoid", SIGMOIDS)
@pytest.mark.parametrize(("guess", "lapses", "fitted"), [(0.5, 0.0532, 0.5), (0.1, 0.0232, None)])
def test_parameters_are_recovered_as_psignifit_recovers_them(
    sigmoid: str, guess: float, lapses: float, fitted: float | None
) -> None:
    levels = np.linspace(0.001, 0.331, 15)
    true = TrialFit(sigmoid, 0.12, 0.3, guess, lapses, False, 0.0, {})
    assert true.level(0.95) - true.level(0.05) == pytest.approx(0.3, abs=1e-12)
    hits = np.floor(true.probability(levels) * 9e6)
    found = fit_psychometric(levels, hits, 9e6, sigmoid, guess=fitted, lapses=lapses)
    for name in ("threshold", "width", "guess"):
        assert getattr(found, name) == pytest.approx(getattr(true, name), abs=1e-4)


def test_a_gumbel_of_the_logarithm_is_weibulls_function() -> None:
    levels = np.geomspace(0.2, 8.0, 9)
    seen = -np.expm1(-((levels / 2.0) ** 1.7))
    found = fit_psychometric(levels, np.round(seen * 1e7), 1e7, "gumbel", lapses=0.0, log=True)
    assert found.threshold == pytest.approx(2.0 * np.log(2.0) ** (1.0 / 1.7), rel=1e-5)
    assert found.level(1.0 - np.exp(-1.0)) == pytest.approx(2.0, rel=1e-5)


def test_what_falls_with_the_level_has_a_negative_width() -> None:
    levels = np.array([1.0, 2.0, 3.0, 4.0, 5.0])
    found = fit_psychometric(levels, [40, 36, 21, 5, 0], 40, lapses=0.0)
    mirrored = fit_psychometric(-levels, [40, 36, 21, 5, 0], 40, lapses=0.0)
    assert found.width == pytest.approx(-mirrored.width, rel=1e-4) and found.width < 0.0
    assert found.threshold == pytest.approx(-mirrored.threshold, rel=1e-4)
    assert found.level(0.9) < found.threshold < found.level(0.1)


def test_a_step_between_two_levels_is_finite() -> None:
    found = fit_psychometric([1.0, 2.0, 3.0, 4.0], [0, 0, 30, 30], 30)
    assert 2.0 <= found.threshold <= 3.0 and 0.0 < found.width < 1.0


@pytest.mark.parametrize(
    ("levels", "hits", "trials", "options", "said"),
    [
        ([1, 2], [3, 4, 5], 9, {}, "one length"),
        ([1, 2], [3, 10], 9, {}, "whole numbers"),
        ([1, 2], [3, 4.5], 9, {}, "whole numbers"),
        ([1, np.nan], [3, 4], 9, {}, "finite"),
        ([0, 1], [3, 4], 9, {"log": True}, "above 0"),
        ([1, 2, 3], [9, 9, 9], 9, {}, "no threshold"),
        ([1, 1], [3, 4], 9, {}, "no threshold"),
        ([1, 2], [3, 4], 9, {"sigmoid": "probit"}, "sigmoid"),
        ([1, 2], [3, 4], 9, {"guess": 1.0}, "rate"),
        ([1, 2], [3, 4], 9, {"guess": 0.6, "lapses": 0.5}, "below 1"),
        (["a", "b"], [3, 4], 9, {}, "numbers"),
    ],
)
def test_counts_that_tell_nothing_are_refused(
    levels: list, hits: list, trials: int, options: dict, said: str
) -> None:
    with pytest.raises(SimrigError, match=said):
        fit_psychometric(levels, hits, trials, **options)

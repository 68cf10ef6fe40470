"""Psychometric functions: closed forms, SciPy's optimiser beside ours, recovery and coverage."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

from simrig.core.errors import SimrigError
from simrig.perception.psychometric import (
    READINGS,
    Psychometric,
    fit,
    fit_many,
    goodness,
    shared_lapses,
)

DISTANCES = 0.6 + 0.35 * np.arange(12)


@pytest.mark.parametrize("reading", READINGS)
def test_thresholds_are_where_the_function_has_their_level(reading: str) -> None:
    function = Psychometric(reading, 2.5, 3.0)
    for level in (0.05, 0.25, 0.5, 0.9):
        assert function.seen(function.distance(level)) == pytest.approx(level, abs=1e-12)
    assert function.probabilities(DISTANCES).sum() == pytest.approx(1.0, abs=1e-12)


def test_the_two_readings_are_those_of_the_formulas() -> None:
    """Palamedes' Gumbel, 1 − exp(−10^(β(x − α))), at x = −log10 d; and exp(−(d/d₀)^β)."""
    x, alpha, beta = -np.log10(DISTANCES), -np.log10(2.5), 3.0
    gumbel = 1.0 - np.exp(-(10.0 ** (beta * (x - alpha))))
    assert Psychometric("nearness", 2.5, 3.0).seen(DISTANCES) == pytest.approx(gumbel, abs=1e-13)
    survival = np.exp(-((DISTANCES / 2.5) ** 3.0))
    assert Psychometric("survival", 2.5, 3.0).seen(DISTANCES) == pytest.approx(survival, abs=1e-13)


@pytest.mark.parametrize("reading", READINGS)
@pytest.mark.parametrize("lapses", [0.0, 0.04])
def test_fits_are_those_of_another_optimiser(reading: str, lapses: float) -> None:
    rng = np.random.default_rng(3)
    true = Psychometric(reading, 2.2, 2.5, lapses)
    for n in rng.multinomial(120, true.probabilities(DISTANCES), 5):
        cut = rng.multinomial(20, np.full(13, 1.0 / 13.0))

        def cost(at: np.ndarray, n: np.ndarray = n, cut: np.ndarray = cut) -> float:
            p = Psychometric(reading, np.exp(at[0]), np.exp(at[1]), lapses).probabilities(DISTANCES)
            least = np.cumsum(p[::-1])[::-1]
            return -float(n @ np.log(p + 1e-300) + cut @ np.log(least + 1e-300))

        best = minimize(
            cost, np.log([2.0, 2.0]), method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-10}
        )
        ours = fit(n, DISTANCES, reading, lapses, cut)
        assert -ours.log_likelihood == pytest.approx(best.fun, abs=2e-6)
        assert ours.function.scale_m == pytest.approx(np.exp(best.x[0]), rel=2e-4)


@pytest.mark.parametrize("reading", READINGS)
def test_answers_that_are_always_the_same_are_fitted(reading: str) -> None:
    """All of them none, one and the same, or all the last: a step, or beyond what was shown."""
    for answer in (0, 1, 5, 12):
        counts = np.zeros(13)
        counts[answer] = 40.0
        fitted = fit(counts, DISTANCES, reading).function
        assert np.isfinite([fitted.scale_m, fitted.slope, fitted.distance(0.5)]).all()
        if 0 < answer < 12:
            assert DISTANCES[answer - 1] <= fitted.distance(0.5) <= DISTANCES[answer]


def test_censored_answers_pull_up_and_dropped_ones_pull_down() -> None:
    """web.md's case: half of the answers lie beyond the screen; dropping them is biased."""
    rng = np.random.default_rng(5)
    true = Psychometric("nearness", 2.3, 3.0)
    answers = rng.choice(13, 4000, p=true.probabilities(DISTANCES))
    beyond = answers >= 6
    kept = np.bincount(answers[~beyond], minlength=13)
    cut = beyond.sum() * np.eye(13)[6]
    assert fit(kept, DISTANCES).function.distance(0.5) < true.distance(0.5) - 0.2
    both = fit(kept, DISTANCES, censored=cut).function
    assert both.distance(0.5) == pytest.approx(true.distance(0.5), abs=0.05)


def test_a_bootstrap_over_subjects_covers_and_single_bits_do_not() -> None:
    """40 subjects who differ, four materials each; 300 experiments, 95 % intervals."""
    rng = np.random.default_rng(11)
    runs, subjects, looks = 300, 40, 4
    spread = 0.25
    scales = 2.4 * np.exp(rng.normal(0.0, spread, (runs, subjects)))
    answers = np.zeros((runs, subjects, 13))
    for run in range(runs):
        for s in range(subjects):
            p = Psychometric("nearness", scales[run, s], 4.0).probabilities(DISTANCES)
            answers[run, s] = rng.multinomial(looks, p)
    whole, _ = fit_many(answers.sum(axis=(0, 1))[None], DISTANCES)
    true = Psychometric("nearness", *np.exp(whole[0])).distance(0.5)
    inside = 0
    for run in range(runs):
        weights = rng.multinomial(subjects, np.full(subjects, 1.0 / subjects), 200)
        drawn, _ = fit_many(weights @ answers[run], DISTANCES)
        half = np.exp(drawn[:, 0]) * np.log(2.0) ** (-1.0 / np.exp(drawn[:, 1]))
        low, high = np.percentile(half, [2.5, 97.5])
        inside += low <= true <= high
    assert 0.90 <= inside / runs <= 0.98


def test_goodness_of_fit_is_uniform_for_a_true_model_and_small_for_a_false_one() -> None:
    rng = np.random.default_rng(7)
    true = Psychometric("nearness", 2.4, 3.0)
    shares = []
    for n in rng.multinomial(80, true.probabilities(DISTANCES), 40):
        shares.append(goodness(n, fit(n, DISTANCES).function, DISTANCES, rng, 60))
    assert 0.3 < np.mean(shares) < 0.7
    two_kinds = np.zeros(13)
    two_kinds[1], two_kinds[11] = 40, 40
    assert goodness(two_kinds, fit(two_kinds, DISTANCES).function, DISTANCES, rng, 60) < 0.05


def test_shared_lapses_are_found() -> None:
    rng = np.random.default_rng(9)
    groups = [
        (
            rng.multinomial(2000, Psychometric("nearness", d, 4.0, 0.04).probabilities(DISTANCES)),
            np.zeros(13),
        )
        for d in (1.2, 2.4)
    ]
    assert shared_lapses(groups, DISTANCES, "nearness") == pytest.approx(0.04, abs=0.015)


@pytest.mark.parametrize(
    ("counts", "distances", "said"),
    [
        (np.zeros(13), DISTANCES, "at least one answer"),
        (np.ones(12), DISTANCES, "12 distances need 13 counts"),
        (-np.ones(13), DISTANCES, ">= 0"),
        (np.ones(13), DISTANCES[::-1], "rise"),
        (np.ones(13), DISTANCES - 0.6, "above 0"),
        (np.full(13, np.nan), DISTANCES, ">= 0"),
    ],
)
def test_what_cannot_be_fitted_is_refused(
    counts: np.ndarray, distances: np.ndarray, said: str
) -> None:
    with pytest.raises(SimrigError, match=said):
        fit(counts, distances)


def test_answers_must_be_numbers_of_things() -> None:
    with pytest.raises(SimrigError, match="λ lies"):
        fit(np.ones(13), DISTANCES, lapses=1.0)

"""The analysis of an experiment (thesis 3.3.2, 3.3.3, B.3, B.4) from its exported tables."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import binomtest, pearsonr

from simrig.core.errors import SimrigError, check_known
from simrig.perception import psychometric
from simrig.perception.fitting import fit_distances
from simrig.perception.psychometric import LEVELS, READINGS, Psychometric
from simrig.web.experiment.analysis.tables import Answers, beyond_pixels, read_answers

LAPSES = ("none", "shared")
_WITHIN_M = 0.2  # for the number of subjects that is needed
_GOODNESS_RUNS = 200
_HEADLINE = ("d25_m", "d50_m", "extrapolated", "goodness_p")


def analyse_tables(
    folder: Path,
    *,
    others: dict[str, Path],
    observers: str = "auto",
    lapses: str = "none",
    effective: bool = False,
    bootstrap: int = 500,
    features: Path | None = None,
    seed: int = 0,
    progress: Callable[..., None] = lambda *_: None,
) -> dict[str, Any]:
    """Return everything that the answers say.

    Args:
        folder: that ``simrig experiment export`` wrote.
        others: further ones by name, to correlate with (Table B.1).
        observers: people, virtual, all, or auto: people where there are any.
        lapses: of the fits: ``none``, or ``shared``: one λ up to 0.06 for all groups.
        effective: distances as the size that was shown makes them, instead of the scene's.
        bootstrap: resamplings of subjects; 0 leaves intervals and goodness of fit out.
        features: a table of stimuli and values; that of the export else.
        seed: of the random numbers.
        progress: called with groups done and in total.

    Raises:
        SimrigError: tables that cannot be read, unknown settings.
    """
    check_known("kind of lapses", lapses, LAPSES)
    read = read_answers(folder, observers)
    results: dict[str, Any] = {
        "title": read.design.title,
        "observers": read.observers,
        "subjects": len(read.subjects),
        "filters": read.filters,
        "checks": read.checks,
        "repeats": read.repeats,
        "response_s": _times(read),
    }
    if not read.design.distances_m:
        return results | {
            "choices": _choices(read, "stimulus"),
            "groups_chosen": _choices(read, "group"),
        }
    distances, scale = _distances(read, effective)
    results |= {"distances_m": distances.tolist(), "shown": scale, "effective": effective}
    results["stimuli"] = _averages(read, distances, "stimulus")
    rng = np.random.default_rng(seed)
    results["groups"] = _groups(read, distances, lapses, bootstrap, rng, progress)
    results["rotations"] = _rotations(read, results["stimuli"])
    results["beside"] = {n: _others(place, observers, effective) for n, place in others.items()}
    results["correlations"] = {
        name: _correlation(results["stimuli"], rows) for name, rows in results["beside"].items()
    }
    table = features or folder / "features.csv"
    if table.is_file():
        results["predictors"] = _predictors(read, results["stimuli"], table)
    elif features is not None:
        raise SimrigError(f"there is no file '{features}'")
    return results


def _distances(read: Answers, effective: bool) -> tuple[np.ndarray, dict[str, float]]:
    """Return the distances of the cylinders, and how large they were shown."""
    true = read.design.display.true_width_mm
    shown = np.array([row["shown_mm"] for row in read.rows]) / (true or 1.0)
    if not shown.size:
        raise SimrigError("no answer is left: every subject was excluded by a check or calibration")
    middle = float(np.median(shown))
    said = {"median": middle, "least": float(shown.min()), "most": float(shown.max())}
    if effective and true is None:
        raise SimrigError("--effective needs true_width_mm in [display] of experiment.toml")
    return np.array(read.design.distances_m) / (middle if effective else 1.0), said


def _in_metres(answers: np.ndarray, distances: np.ndarray) -> np.ndarray:
    """Return distances of answers; none is taken as one step before the first."""
    step = distances[1] - distances[0] if len(distances) > 1 else distances[0]
    return np.concatenate([[max(0.0, distances[0] - step)], distances])[answers]


def _averages(read: Answers, distances: np.ndarray, by: str) -> dict[str, Any]:
    """Return means and deviations of the kept answers, by stimulus or group."""
    found: dict[str, Any] = {}
    for name in dict.fromkeys(row[by] for row in read.rows):
        own = [row for row in read.rows if row[by] == name]
        kept = _in_metres(
            np.array([r["answer"] for r in own if not beyond_pixels(r)], dtype=int), distances
        )
        found[name] = {
            "answers": len(kept),
            "beyond_pixels": len(own) - len(kept),
            "mean_m": _mean(kept),
            "sd_m": float(kept.std(ddof=1)) if len(kept) > 1 else None,
            "mean_rt_s": _mean(np.array([r["rt_ms"] for r in own]) / 1000.0),
            **{key: own[0][key] for key in ("material", "group", "rotation_deg", "structure_mm")},
        }
    return found


def _mean(values: np.ndarray) -> float | None:
    return float(values.mean()) if len(values) else None


def _counts(
    read: Answers, names: list[str], count: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return counts by subject, group and answer: kept, censored, and all as they were given."""
    shape = (len(read.subjects), len(names), count + 1)
    kept, censored, given = np.zeros(shape), np.zeros(shape), np.zeros(shape)
    places = {subject: n for n, subject in enumerate(read.subjects)}
    groups = {name: n for n, name in enumerate(names)}
    for row in read.rows:
        at = places[row["subject"]], groups[row["group"]]
        given[*at, row["answer"]] += 1.0
        if beyond_pixels(row):
            censored[*at, min(row["k_max"], count)] += 1.0
        else:
            kept[*at, row["answer"]] += 1.0
    return kept, censored, given


def _groups(
    read: Answers,
    distances: np.ndarray,
    lapses: str,
    bootstrap: int,
    rng: np.random.Generator,
    progress: Callable[..., None],
) -> dict[str, Any]:
    """Return averages and psychometric fits of every group, with intervals over subjects."""
    averages = _averages(read, distances, "group")
    names = list(averages)
    kept, censored, given = _counts(read, names, len(distances))
    ways = {
        "censored": (kept, censored),
        "filtered": (kept, np.zeros_like(kept)),
        "all": (given, np.zeros_like(kept)),
    }
    count = len(read.subjects)
    weights = rng.multinomial(count, np.full(count, 1.0 / count), bootstrap)
    rates = {
        way: _rate([(n[:, g].sum(0), c[:, g].sum(0)) for g in range(len(names))], distances, lapses)
        for way, (n, c) in ways.items()
    }
    found: dict[str, Any] = {}
    for number, name in enumerate(names):
        progress(number, len(names), name)
        fits: dict[str, Any] = {}
        for way, (n, c) in ways.items():
            if not (n[:, number].sum() + c[:, number].sum()):
                continue
            for reading in READINGS:
                fits[f"{way}_{reading}"] = _fitted(
                    n[:, number],
                    c[:, number],
                    distances,
                    reading,
                    rates[way][reading],
                    weights,
                    rng,
                )
        headline = fits.get("censored_nearness", {})
        own = averages[name]
        found[name] = {
            **{
                key: own[key] for key in ("answers", "beyond_pixels", "mean_m", "sd_m", "mean_rt_s")
            },
            **{key: headline.get(key) for key in _HEADLINE},
            "subjects_for_0_2_m": _needed(headline, count),
            "fits": fits,
        }
    return found


def _rate(
    groups: list[tuple[np.ndarray, np.ndarray]], distances: np.ndarray, lapses: str
) -> dict[str, float]:
    own = [(n, c) for n, c in groups if n.sum() + c.sum()]
    if lapses == "none":
        return dict.fromkeys(READINGS, 0.0)
    return {r: psychometric.shared_lapses(own, distances, r) for r in READINGS}


def _fitted(
    counts: np.ndarray,
    censored: np.ndarray,
    distances: np.ndarray,
    reading: str,
    rate: float,
    weights: np.ndarray,
    rng: np.random.Generator,
) -> dict[str, Any]:
    """Return one fit with its thresholds, from counts by subject and resamplings of subjects."""
    total, cut = counts.sum(axis=0), censored.sum(axis=0)
    function = psychometric.fit(total, distances, reading, rate, cut).function
    said: dict[str, Any] = {
        "scale_m": function.scale_m,
        "slope": function.slope,
        "lapses": rate,
        **{f"d{100 * level:.0f}_m": function.distance(level) for level in LEVELS},
        "extrapolated": not distances[0] <= function.distance(0.5) <= distances[-1],
    }
    if not len(weights):
        return said | {"goodness_p": None}
    again, more = weights @ counts, weights @ censored
    used = again.sum(axis=1) + more.sum(axis=1) > 0.0
    drawn, _ = psychometric.fit_many(again[used], distances, reading, rate, more[used])
    for level in LEVELS:
        all_of_them = [
            Psychometric(reading, float(np.exp(a)), float(np.exp(b))).distance(level)
            for a, b in drawn
        ]
        key = f"d{100 * level:.0f}"
        said[f"{key}_interval_m"] = np.percentile(all_of_them, [2.5, 97.5]).tolist()
        said[f"{key}_standard_error_m"] = (
            float(np.std(all_of_them, ddof=1)) if len(drawn) > 1 else None
        )
    # only answers that are known to the step can be compared with what a fit expects
    good = (
        psychometric.goodness(total, function, distances, rng, _GOODNESS_RUNS)
        if total.sum()
        else None
    )
    return said | {"goodness_p": good if not cut.any() else None}


def _needed(fitted: dict[str, Any], count: int) -> int | None:
    """Return how many subjects bring the threshold at 50 % to within 0.2 m (95 %)."""
    error = fitted.get("d50_standard_error_m")
    return None if error is None else int(np.ceil(count * (1.96 * error / _WITHIN_M) ** 2))


def _rotations(read: Answers, stimuli: dict[str, Any]) -> dict[str, dict[str, float]]:
    """Return mean distances of materials by rotation (Fig. B.5)."""
    found: dict[str, dict[str, float]] = {}
    for row in stimuli.values():
        found.setdefault(row["material"], {})[f"{row['rotation_deg']:g}"] = row["mean_m"]
    return {name: rows for name, rows in found.items() if len(rows) > 1}


def _others(folder: Path, observers: str, effective: bool) -> dict[str, Any]:
    read = read_answers(folder, observers)
    return _averages(read, _distances(read, effective)[0], "stimulus")


def _correlation(first: dict[str, Any], second: dict[str, Any]) -> dict[str, Any]:
    """Return Pearson's correlation of the mean distances of what both have."""
    both = [
        n for n in first if n in second and None not in (first[n]["mean_m"], second[n]["mean_m"])
    ]
    x, y = ([rows[n]["mean_m"] for n in both] for rows in (first, second))
    return {"stimuli": len(both)} | _pearson(x, y)


def _pearson(x: Iterable[float], y: Iterable[float]) -> dict[str, float | None]:
    x, y = np.array(list(x)), np.array(list(y))
    if len(x) < 3 or np.ptp(x) == 0.0 or np.ptp(y) == 0.0:
        return {"r": None, "p": None}
    found = pearsonr(x, y)
    return {"r": float(found.statistic), "p": float(found.pvalue)}


def _predictors(read: Answers, stimuli: dict[str, Any], path: Path) -> dict[str, Any]:
    """Return how features of pictures go with the answers (Tables 3.1 and 3.2)."""
    with path.open(newline="", encoding="utf-8") as handle:
        table = list(csv.DictReader(handle))
    if not table or "stimulus" not in table[0]:
        raise SimrigError(f"'{path}' needs a column 'stimulus' and one for each feature")
    own = {row["stimulus"]: row for row in table}
    used = [
        name
        for name, row in stimuli.items()
        if name in own
        and row["structure_mm"]
        and row["mean_m"] is not None
        and not row["rotation_deg"]
    ]
    found: dict[str, Any] = {}
    seen = np.array([stimuli[name]["mean_m"] for name in used])
    size = np.array([stimuli[name]["structure_mm"] for name in used], dtype=np.float64)
    for feature in [key for key in table[0] if key != "stimulus"]:
        try:
            value = np.array([float(own[name][feature]) for name in used])
        except (ValueError, TypeError):
            raise SimrigError(f"'{path}': the values of '{feature}' are no numbers") from None
        said: dict[str, Any] = {
            "alone": _pearson(value, seen),
            "scaled": _pearson(size * value, seen),
        }
        if len(used) >= 4 and np.isfinite(value).all() and np.ptp(size * value) > 0.0:
            fitted = fit_distances(size, value, seen)
            model = fitted.model
            said |= {
                "k_1": model.k_1,
                "k_1_std": model.k_1_std,
                "k_2": model.k_2,
                "k_2_std": model.k_2_std,
                "left_out_m": dict(zip(used, fitted.left_out.tolist(), strict=True)),
                "left_out_error_m": float(np.abs(fitted.left_out - seen).mean()),
            }
        found[feature] = said
    return {"stimuli": len(used), "size": _pearson(size, seen), "features": found}


def _times(read: Answers) -> dict[str, float | None]:
    times = np.array([row["rt_ms"] for row in read.rows]) / 1000.0
    if not len(times):
        return {"mean": None, "median": None}
    return {"mean": float(times.mean()), "median": float(np.median(times))}


def _choices(read: Answers, by: str) -> dict[str, Any]:
    """Return how often each answer was chosen, and the share of the first with its interval."""
    found: dict[str, Any] = {}
    count = len(read.design.answers)
    for name in dict.fromkeys(row[by] for row in read.rows):
        own = np.array([row["answer"] for row in read.rows if row[by] == name])
        chosen = np.bincount(own, minlength=count)
        interval = binomtest(int(chosen[0]), len(own)).proportion_ci(method="wilson")
        found[name] = {
            "answers": len(own),
            "counts": dict(zip(read.design.answers, chosen.tolist(), strict=True)),
            "share": float(chosen[0] / len(own)),
            "interval": [float(interval.low), float(interval.high)],
        }
    return found

"""Choosing 18,721 samples adaptively, and evaluating the material there.

Compared with a straightforward implementation (every slice a Python list, sorted anew in each
iteration), which must choose the same samples. The thesis reports 8 s for its own.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from simrig.brdf import kurt_material
from simrig.core.progress import Progress
from simrig.core.tables import text_table
from simrig.evaluation.benchmarks.timing import MEDIAN, side_by_side
from simrig.plans.adaptive import AdaptiveSamples
from simrig.plans.along_slices import SlicePlan, slice_samples
from simrig.plans.placement import SlicePlacement
from simrig.plans.slices import MIRRORED, OPEN, PERIODIC, build_slices
from simrig.rigs.direct.gonioreflectometer import Gonioreflectometer

MATERIAL = "yellow_satin"
SAMPLES = 18721
THESIS_SECONDS = 8.0


def run(
    progress: Progress | None = None, samples: int = SAMPLES, rounds: int = 7
) -> dict[str, Any]:
    """Run the benchmark.

    Returns:
        ``rows`` with ``method``, ``median_seconds``, ``first_seconds`` and the ratio to ours,
        and ``same_samples``: whether both methods chose the same directions.
    """
    rig, truth = Gonioreflectometer(), kurt_material(MATERIAL)
    placement = SlicePlacement.from_degrees(10.0, 36.0)
    found: dict[str, AdaptiveSamples] = {}

    def measure(angles: np.ndarray) -> np.ndarray:
        return rig.record(truth, angles).values

    def ours() -> None:
        found["simrig"] = slice_samples(rig.measure(truth, SlicePlan(placement, samples)))

    def plain() -> None:
        found["plain Python"] = _plain(measure, placement, samples)

    timings = side_by_side({"simrig": ours, "plain Python": plain}, rounds, progress)
    chosen = [np.unique(s.angles.round(9), axis=0) for s in found.values()]
    fastest = timings["simrig"].median
    return {
        "benchmark": "sampling",
        "material": MATERIAL,
        "samples": samples,
        "same_samples": bool(np.array_equal(chosen[0], chosen[1])),
        "thesis_seconds": THESIS_SECONDS,
        "hardware_hours": rig.timing.seconds(samples, adaptive=True) / 3600.0,
        "rounds": rounds,
        "rows": [
            {"method": name, **timing.as_dict(), "ratio_to_simrig": timing.median / fastest}
            for name, timing in timings.items()
        ],
    }


def _plain(
    measure: Callable[[np.ndarray], np.ndarray], placement: SlicePlacement, samples: int
) -> AdaptiveSamples:
    """Algorithms 5.1 and 5.2 slice by slice, as one would write them down."""
    slices = build_slices(placement)
    angles = placement.corner_angles()
    values = measure(angles)
    bounds = zip(slices.first_knot[:-1], slices.first_knot[1:], strict=True)
    knots = [list(zip(slices.position[a:b], slices.sample[a:b], strict=True)) for a, b in bounds]
    extra = samples - len(values)
    targets = np.round(extra * np.cumsum([0.18] * 5 + [0.02] * 5)).astype(int)
    for count in np.diff(targets, prepend=0):
        candidates = []
        for s, line in enumerate(knots):
            error = [
                _left_out(line, n, slices.ends[s], slices.length[s], values)
                for n in range(len(line))
            ]
            for n in range(len(line) - (slices.ends[s] != PERIODIC)):
                after = (n + 1) % len(line)
                end = line[after][0] + (slices.length[s] if after == 0 else 0.0)
                weight = max(error[n], error[after])
                candidates.append((-weight, s, n, 0.5 * (line[n][0] + end)))
        candidates.sort(key=lambda c: c[0])  # stable: ties in the order of the slices
        chosen = candidates[:count]
        new = np.concatenate([slices.angles(np.array([s]), np.array([p])) for _, s, _, p in chosen])
        for number, (_, s, _, position) in enumerate(chosen):
            knots[s].append((position, len(values) + number))
        for line in knots:
            line.sort(key=lambda knot: knot[0])
        angles, values = np.concatenate([angles, new]), np.concatenate([values, measure(new)])
    return AdaptiveSamples(angles, values, None)  # type: ignore[arg-type]


def _left_out(
    line: list[tuple[float, int]], n: int, ends: int, length: float, values: np.ndarray
) -> float:
    """Return the leave-one-out error of one knot."""
    position, sample = line[n]
    before, after = n - 1, n + 1
    if ends == PERIODIC:
        shift_before = -length if before < 0 else 0.0
        shift_after = length if after == len(line) else 0.0
        low, high = line[before % len(line)], line[after % len(line)]
        left, right = low[0] + shift_before, high[0] + shift_after
    elif before < 0 or after == len(line):
        if ends == OPEN:
            return 0.0
        assert ends == MIRRORED
        low = high = line[1] if before < 0 else line[-2]
        left, right = position - abs(low[0] - position), position + abs(low[0] - position)
    else:
        low, high = line[before], line[after]
        left, right = low[0], high[0]
    t = (position - left) / (right - left) if right > left else 0.5
    predicted = values[low[1]] + t * (values[high[1]] - values[low[1]])
    return float(np.abs(predicted - values[sample]).max())


def table(results: dict[str, Any]) -> Any:
    """Return the results as a table for the terminal."""
    rows = [
        [
            row["method"],
            MEDIAN.format_map(row),
            f"{row['first_seconds']:.3f}",
            f"{row['ratio_to_simrig']:.1f}",
        ]
        for row in results["rows"]
    ]
    rows.append(["thesis (its own machine)", f"{results['thesis_seconds']:g}", "", ""])
    same = "same" if results["same_samples"] else "DIFFERENT"
    title = (
        f"Choosing {results['samples']:,} samples of {results['material']} "
        f"({results['hardware_hours']:.0f} simulated hours), median of {results['rounds']}; "
        f"both choose the {same} samples"
    )
    return text_table(title, ["method", "median [s] (range)", "first [s]", "÷ simrig"], rows)

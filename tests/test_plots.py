"""The Pareto front and the accuracy-versus-cost plot."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from refusals import refused
from simrig.core.cost import Cost
from simrig.viewing.plots import COST_AXES, CostPoint, accuracy_versus_cost, pareto_front


def test_pareto_front_by_hand():
    costs = [1.0, 2.0, 3.0, 3.0, 4.0, 5.0]
    errors = [9.0, 5.0, 6.0, 4.0, 4.0, 1.0]
    np.testing.assert_array_equal(pareto_front(costs, errors), [0, 1, 3, 5])


def test_pareto_front_of_equal_and_missing_results():
    np.testing.assert_array_equal(pareto_front([2.0, 1.0, 1.0], [1.0, 3.0, 3.0]), [1, 0])
    np.testing.assert_array_equal(pareto_front([1.0, np.nan, 2.0], [np.nan, 0.0, 5.0]), [2])
    assert pareto_front([], []).size == 0
    refused("2 costs do not fit 1 errors", pareto_front, [1.0, 2.0], [1.0])


@given(st.lists(st.tuples(st.integers(0, 9), st.integers(0, 9)), max_size=25))
def test_pareto_front_is_exactly_what_nothing_beats(results):
    front = set(pareto_front([c for c, _ in results], [e for _, e in results]).tolist())
    kept = {results[k] for k in front}
    assert len(kept) == len(front)  # of equal results one
    for result in results:
        beaten = any(o != result and o[0] <= result[0] and o[1] <= result[1] for o in results)
        assert (result in kept) == (not beaten)


def _points() -> list[CostPoint]:
    return [
        CostPoint(method, Cost(samples=n, hardware_seconds=10.0 * n), factor / n)
        for method, factor in (("slices", 1e4), ("uniform", 9e4))
        for n in (100, 1000, 10_000)
    ]


def test_plot_is_written_and_returned(tmp_path):
    path = tmp_path / "cost.png"
    png = accuracy_versus_cost(_points(), "MRE [%]", title="test", path=path)
    assert png.startswith(b"\x89PNG") and path.read_bytes() == png


def test_panels_without_a_cost_are_left_out():
    from PIL import Image

    def width(png: bytes) -> int:
        import io

        return Image.open(io.BytesIO(png)).width

    # no computing time is known: two panels, as wide as when only two are asked for
    assert width(accuracy_versus_cost(_points(), "MRE [%]")) == width(
        accuracy_versus_cost(_points(), "MRE [%]", axes=COST_AXES[:2])
    )
    one = accuracy_versus_cost(_points(), "MRE [%]", axes=COST_AXES[:1])
    assert width(one) < width(accuracy_versus_cost(_points(), "MRE [%]"))


def test_nothing_to_plot():
    nothing = [CostPoint("slices", Cost(samples=10), 0.0), CostPoint("slices", Cost(), 1.0)]
    refused("nothing to plot", accuracy_versus_cost, nothing, "MRE [%]")

"""The benchmarks run, compare what they say, and judge nothing by time."""

import time

import pytest

from simrig.evaluation.benchmarks import (
    BENCHMARKS,
    btf,
    planned,
    plugins,
    sampling,
    storage,
    whole_array,
)
from simrig.evaluation.benchmarks.timing import side_by_side


def test_every_benchmark_is_documented():
    for module in BENCHMARKS.values():
        assert module.__doc__ and callable(module.run) and callable(module.table)


def test_first_call_and_steady_state_are_kept_apart():
    calls = []

    def job():
        calls.append(1)
        time.sleep(0.05 if len(calls) == 1 else 0.0)

    timing = side_by_side({"job": job}, rounds=3)["job"]
    assert len(calls) == 4 and timing.rounds == 3
    assert timing.first >= 0.05
    assert timing.fastest <= timing.median <= timing.slowest
    assert timing.kernels == (0.0, 0.0, 0.0)  # it only slept


def test_both_ways_of_sampling_choose_the_same_directions():
    results = sampling.run(samples=7500, rounds=1)
    assert results["same_samples"]
    assert sampling.table(results)


def test_storage_is_that_of_table_d3():
    results = storage.run()
    for row in results["rows"]:
        assert row["stored_bytes"] / 2**20 == pytest.approx(row["published_megabytes"], abs=0.05)
        assert row["mre_percent"] < 1.5
    assert storage.table(results)


def test_plugin_benchmark_renders_every_material():
    results = plugins.run(resolution=32, spp=1, rounds=1, variant="llvm_ad_rgb")
    assert len(results["rows"]) == 2 * 2 * 7
    for row in results["rows"]:
        same = row["material"] in plugins.SAME_MATERIAL
        assert (row["delta_e"] is not None) == same
        if same:
            assert row["delta_e"] < 6.0
    assert plugins.table(results)


def test_planned_renders_are_those_written_by_hand():
    """The same picture but for noise, from one integrator call for each; no time is judged."""
    results = planned.run(resolution=48, rounds=2, variant="llvm_ad_rgb")
    assert len(results["rows"]) == len(planned.BY_HAND) * len(planned.MATERIALS)
    for row in results["rows"]:
        assert row["delta_e"] < 1.0
        assert row["planned_seconds"] > 0.0 < row["minimal_seconds"]
        assert row["integrator"] == "simrig_all_lights"
        for ratios in (row, row["same"]):
            assert ratios["interval"][0] <= ratios["ratio"] <= ratios["interval"][1]
            assert ratios["kernel_ratio"] > 0.0
    assert planned.table(results)


@pytest.mark.slow
def test_btf_benchmark_renders_every_form():
    options = {"resolution": 16, "spp": 1, "rounds": 1, "texels": 2}
    results = btf.run(**options, variant="llvm_ad_rgb")
    assert len(results["rows"]) == 2 * 6
    rows = {row["material"]: row for row in results["rows"] if row["integrator"] == "direct"}
    assert rows["factored, 20 %"]["bytes"] <= rows["factored, 5 %"]["bytes"]
    assert rows["full"]["delta_e"] == 0.0
    assert rows["factored, 5 %"]["delta_e"] < rows["168 images"]["delta_e"]
    assert btf.table(results)


@pytest.mark.slow
def test_the_whole_array_is_filled_by_every_method_beside_scipy():
    results = whole_array.run(samples=1000, rounds=1, part=5000)
    by = {(row["method"], row["by"]) for row in results["rows"]}
    scipy = {method for method, how in by if how == "SciPy"}
    assert scipy == {"barycentric", "regular_grid", "rbf_global", "rbf_local"}
    assert {method for method, _ in by} == set(results["mre_percent"]) == set(results["samples"])
    for row in results["rows"]:
        assert row["seconds"] > 0.0
        assert (row["extrapolated_from"] is None) == ("with its" in row["by"])
    assert results["mre_percent"]["slices"] < results["mre_percent"]["barycentric"] < 50.0
    assert whole_array.table(results)

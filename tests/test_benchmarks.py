"""The benchmarks run, compare what they say, and judge nothing by time."""

import time

import mitsuba as mi
import numpy as np
import pytest

from simrig.btf.full import FullBtf
from simrig.btf.synthetic import bumps
from simrig.core import backend
from simrig.evaluation.benchmarks import planned, plugins, sampling, saving, storage
from simrig.evaluation.benchmarks.btf import rendering as btf
from simrig.evaluation.benchmarks.btf import scenes as btf_scenes
from simrig.evaluation.benchmarks.timing import one_alive, side_by_side
from simrig.evaluation.benchmarks.whole_array import methods as whole_array


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


def test_scenes_are_loaded_one_after_the_other():
    events = []

    def maker(name):
        def loaded():
            events.append(f"load {name}")
            return lambda: events.append(name)

        return loaded

    timings = one_alive({name: maker(name) for name in "ab"}, rounds=1, sweeps=2)
    assert events == 2 * ["load a", "a", "a", "load b", "b", "b"]
    assert all(t.rounds == 2 == len(t.kernels) for t in timings.values())
    assert timings["a"].kernel == 0.0 and timings["a"].tracing == timings["a"].median


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
    assert len(results["rows"]) == 2 * 2 * 8
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


def test_what_planning_saves_counts_all_of_both():
    results = saving.run(resolution=16, rounds=1, variant="llvm_ad_rgb", scenes=("sphere",))
    assert len(results["rows"]) == len(saving.MATERIALS) * len(saving.TOLERANCES)
    for row in results["rows"]:
        for arm in (row["planned"], row["everything"]):
            assert arm["clock"] > arm["planning"] + arm["checking"] > 0.0
    assert saving.table(results)


BTF_OPTIONS = {
    "resolution": 16,
    "spp": 4,
    "rounds": 1,
    "sweeps": 1,
    "texels": 4,
    "texel_spp": 1,
    "large": 2,
    "tile_steps": 24,
    "variant": "llvm_ad_rgb",
}


@pytest.mark.slow
def test_btf_benchmark_renders_every_form_beside_the_structure():
    results = btf.run(**BTF_OPTIONS, scenes=("cylinder", "patch", "large"))
    rows = {(row["scene"], row["integrator"], row["material"]): row for row in results["rows"]}
    for name in ("cylinder", "cylinder, 2² texels"):
        assert rows[name, "direct", "full"]["delta_e"] == 0.0
        assert rows[name, "direct", "8 factors"]["delta_e"] < 0.5
    few = rows["cylinder", "direct", "168 images, 8 factors"]
    assert few["delta_e"] > rows["cylinder", "direct", "8 factors"]["delta_e"]
    assert few["bytes"] < rows["cylinder", "direct", "full"]["bytes"]
    # the structure's own noise is less than what a coarse BTF of it is off
    own, full = (rows["patch", "path", name] for name in ("structure", "full"))
    assert own["delta_e"] < full["delta_e"] < 10.0
    assert own["ratio_to_structure"] == 1.0 and few["ratio_to_structure"] is None
    for row in results["rows"]:
        low, high = row["fastest_seconds"], row["slowest_seconds"]
        assert 0.0 < low <= row["kernel_seconds"] <= high and row["first_seconds"] > 0.0
    assert btf.table(results)


@pytest.mark.slow
def test_the_room_of_the_btf_benchmark_has_tables_for_every_part():
    backend.select("llvm_ad_rgb")
    stack = bumps((4, 4))
    full = FullBtf.from_stack(stack)
    contest = btf_scenes.chairs({"full": full}, stack, 24, 1)
    assert set(contest.loaders) == {"principled, bitmap", "full", "BRDF", "switched"}
    sizes = contest.device_bytes
    assert sizes["full"] == 14 * full.device_bytes
    assert sizes["switched"] == sizes["full"] + sizes["BRDF"]
    pictures = {
        name: np.array(mi.render(contest.loaders[name](), spp=1, seed=1))
        for name in ("full", "BRDF")
    }
    lit = pictures["full"].max(axis=-1) > 0.0
    assert lit.mean() > 0.5 and np.array_equal(lit, pictures["BRDF"].max(axis=-1) > 0.0)


@pytest.mark.slow
def test_the_whole_array_is_filled_by_every_method_beside_scipy():
    results = whole_array.run(samples=1000, rounds=1, part=5000)
    by = {(row["method"], row["by"]) for row in results["rows"]}
    scipy = {method for method, how in by if how == "SciPy"}
    assert scipy == {"barycentric", "regular-grid", "rbf-global", "rbf-local"}
    assert {method for method, _ in by} == set(results["mre_percent"]) == set(results["samples"])
    for row in results["rows"]:
        assert row["seconds"] > 0.0
        assert (row["extrapolated_from"] is None) == ("with its" in row["by"])
    assert results["mre_percent"]["slices"] < results["mre_percent"]["barycentric"] < 50.0
    assert whole_array.table(results)


@pytest.mark.slow
def test_recording_is_timed_beside_mitsuba_and_through_the_chain():
    from simrig.evaluation.benchmarks import recording

    results = recording.run(views=1, alone=2, whole=1)
    assert [row["name"] for row in results["rows"]] == ["flat", "tile", "mitsuba"]
    assert all(row["seconds_per_picture"] > 0.0 for row in results["rows"])
    chain = results["chain"]
    assert chain["pictures"] == chain["marks_found"] == 81 and chain["whole_pictures"] == 6561
    assert chain["whole_seconds"] > chain["recording_seconds"] > 0.0
    assert recording.table(results).row_count == 3

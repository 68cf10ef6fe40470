"""Methods and plugins in the stability suite: clean as shipped, and planted flaws are found."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from refusals import refused
from simrig.brdf import Kurt, KurtLobe, Ward
from simrig.brdf.tables.thin_plate import ThinPlateSpline
from simrig.directions.schemes import uniform_scheme
from simrig.evaluation.stability import gantry, methods, plugins, splines, uniform
from simrig.evaluation.stability.fuzz import FUZZ_PAIRS, fuzz_cases, unit
from simrig.evaluation.stability.gantry import gantry_rows
from simrig.evaluation.stability.hard_cases import HardCase, hard_case, hard_cases
from simrig.evaluation.stability.highlights import highlight_rows
from simrig.evaluation.stability.judgement import direction_rows
from simrig.evaluation.stability.methods import (
    adaptive_rows,
    along_slice_rows,
    method_jobs,
    method_row,
    reconstruction_rows,
    signals,
)
from simrig.evaluation.stability.plugins import plugin_rows
from simrig.evaluation.stability.rows import stability_markdown
from simrig.evaluation.stability.scattered import barycentric_rows, scattered_rows, solve_extended
from simrig.evaluation.stability.subjects import (
    BrdfSubject,
    default_parameterisations,
    small_slices,
)
from simrig.evaluation.stability.suite import stability_suite
from simrig.evaluation.stability.uniform import hard_samples, rbf_rows, uniform_rows
from simrig.methods import METHODS
from simrig.plans.adaptive import Knots
from simrig.plans.slices import OPEN
from simrig.plans.uniform import RegularGrid
from simrig.plugins import make_bsdf
from simrig.reconstruction.slices.along_slices import INTERPOLATIONS, SliceInterpolator
from simrig.rigs.measurements.measurement import Measurement


@pytest.mark.slow
def test_the_whole_suite_is_clean_and_complete(variant_llvm):
    calls: list[tuple[int, int]] = []
    rows = stability_suite("llvm", lambda done, total: calls.append((done, total)))
    flagged = [row for row in rows if not row.explained or row.non_finite or row.negative]
    assert not flagged, stability_markdown(flagged, every_case=True)
    objects = {row.object for row in rows}
    assert {f"along slices, {kind}" for kind in INTERPOLATIONS} < objects
    assert {f"reconstruct, {kind}" for kind in INTERPOLATIONS} < objects
    for method in ("reconstruct", "reconstruct along highlights"):
        for plan in ("axial and diagonal", "intersections only"):
            assert f"{method}, cubic, {plan}" in objects
    assert {"adaptive sampling", "scattered, thin-plate spline"} < objects
    for name in ("simrig_kurt", "simrig_ward", "simrig_slices", "simrig_table"):
        assert {f"plugin {name}: {part}" for part in ("value", "pdf", "weight")} < objects
    assert calls[0] == (0, calls[0][1]) and calls[-1][0] == calls[-1][1] == len(calls) - 1
    json.dumps([row.explanation for row in rows], allow_nan=False)


def test_unknown_backend_is_refused():
    refused("did you mean 'cuda_ad_rgb'", stability_suite, "cida")


# methods


@pytest.mark.parametrize("interpolation", INTERPOLATIONS)
def test_degenerate_slices_are_clean(interpolation):
    rows = along_slice_rows(interpolation)
    flagged = [row for row in rows if not row.explained or row.non_finite or row.negative]
    assert not flagged, stability_markdown(flagged, every_case=True)
    assert {"one sample", "duplicate samples", "all-zero", "spike"} < {row.case for row in rows}
    assert {row.precision for row in rows} == {"numpy-float64", "stored-float32"}
    if interpolation == "cubic":
        worst = max(row.condition or 0.0 for row in rows)
        assert 1e7 < worst < 1e9  # samples 1e-4 rad apart between samples 1 rad apart


def test_a_flawed_interpolation_is_flagged(monkeypatch):
    class Flawed(SliceInterpolator):
        def __call__(self, slice_index, position):
            return 1.0001 * super().__call__(slice_index, position)

    monkeypatch.setattr(splines, "SliceInterpolator", Flawed)
    rows = [row for row in along_slice_rows("linear") if row.case == "constant"]
    assert len(rows) == 2 and not any(row.explained for row in rows)


def test_duplicate_samples_become_their_mean():
    position, value = np.array([0.0, 1.0, 1.0, 2.0]), np.array([0.0, 0.2, 0.6, 0.0])
    knots = Knots(np.array([0, 4]), np.array([OPEN]), np.array([2.0]), position, np.arange(4))
    for kind in INTERPOLATIONS:
        found = SliceInterpolator(knots, value[:, None], kind)(np.array([0]), np.array([[1.0]]))
        assert found[0, 0, 0] == pytest.approx(0.4)


def test_reconstructions_of_hard_signals_are_clean():
    cases = [hard_case("random"), hard_case("azimuth-wrap")]
    rows = reconstruction_rows("pchip", cases, "llvm")
    assert {row.case for row in rows} == set(signals())
    assert all(row.explained for row in rows), stability_markdown(rows, every_case=True)


def test_adaptive_sampling_of_hard_signals_is_clean():
    rows = adaptive_rows()
    assert all(row.explained for row in rows), stability_markdown(rows, every_case=True)
    assert len(rows) == 2 * len(signals())


def test_scattered_data_report_their_condition_numbers():
    rows = {row.case: row for row in scattered_rows()}
    assert all(row.explained for row in rows.values())
    assert rows["one sample"].explanation.startswith("refused: 'one sample' has too few")
    assert rows["random"].condition < 1e6 and rows["random"].worst_relative < 1e-11
    along = [rows[f"theta_v = theta_i to {d} rad"].condition for d in ("0.0001", "1e-08", "1e-12")]
    assert along[0] < along[1] < 1e16 < along[2]


def test_barycentric_weights_are_clean():
    rows = barycentric_rows()
    assert all(row.explained for row in rows), stability_markdown(rows, every_case=True)
    assert sum(row.explanation.startswith("refused") for row in rows) >= 2


def test_a_method_row_flags_what_conditioning_does_not_explain():
    exact = np.ones(3)
    wrong = exact + 1e-9
    assert not method_row("c", "m", wrong, exact, 1.0).explained
    assert method_row("c", "m", wrong, exact, 1.0, condition=1e6).explained
    assert method_row("c", "m", wrong, exact, 1.0, sensitivity=1e-9).explained
    nan = np.array([1.0, np.nan, np.inf])
    row = method_row("c", "m", nan, exact, 1.0, condition=1e20)
    assert row.non_finite == 2 and not row.explained
    assert not method_row("c", "m", exact, exact, 1.0, negative=1).explained


def test_solve_extended_is_more_precise_than_double():
    matrix = 1.0 / (np.arange(10)[:, None] + np.arange(10) + 1.0).astype(np.longdouble)  # Hilbert
    truth = np.ones((10, 1), dtype=np.longdouble)
    found = solve_extended(matrix, matrix @ truth)
    double = np.linalg.solve(matrix.astype(float), (matrix @ truth).astype(float))
    assert np.abs(found - 1.0).max() < 0.01 * np.abs(double - 1.0).max()


def test_every_method_has_a_job():
    jobs = [getattr(job, "func", job) for job in method_jobs(hard_cases(4), "llvm")]
    for rows in (along_slice_rows, reconstruction_rows):
        assert jobs.count(rows) >= len(INTERPOLATIONS)
    assert {adaptive_rows, scattered_rows, barycentric_rows, rbf_rows, uniform_rows} <= set(jobs)
    assert {highlight_rows, gantry_rows} <= set(jobs)


def test_axial_and_diagonal_slices_of_a_spike_are_clean(monkeypatch):
    spike = {"spike": signals()["spike"]}
    monkeypatch.setattr(methods, "signals", lambda: spike)
    cases = [hard_case("pole-one", 16), hard_case("azimuth-wrap", 16)]
    rows = reconstruction_rows("cubic", cases, "llvm", slice_types="axial-diagonal")
    assert len(rows) == 2 and all(row.explained for row in rows)


@pytest.mark.parametrize(
    ("method", "plan"),
    [("barycentric", uniform_scheme(3)), ("regular-grid", RegularGrid(4, 9, 1.4).scheme())],
)
def test_hard_lists_of_samples_give_the_table_of_the_easy_one(method, plan):
    rows = {row.case: row for row in uniform.list_rows(method, plan)}
    assert all(row.explained for row in rows.values()), rows
    assert rows["one sample"].explanation.startswith("refused: ")
    assert not any(
        "refused" in row.explanation for row in rows.values() if row.case != "one sample"
    )
    assert len(rows) == 5


def test_a_method_that_drops_duplicates_is_flagged(monkeypatch):
    usual = METHODS["barycentric"]

    def first_only(measurement, **options):
        _, kept = np.unique(measurement.angles.round(6), axis=0, return_index=True)
        first = Measurement(measurement.angles[kept], measurement.values[kept], "first")
        return usual.make(first, **options)

    monkeypatch.setitem(METHODS, "barycentric", replace(usual, make=first_only))
    rows = uniform.list_rows("barycentric", uniform_scheme(1))
    assert [row.case for row in rows if not row.explained] == ["duplicates with other values"]


def test_a_nearly_singular_spline_is_smoothed_and_says_so(monkeypatch):
    cases = [case for case in hard_samples() if case[0] == "five in a row, hardly apart"]
    monkeypatch.setattr(uniform, "hard_samples", lambda: iter(cases))
    rows = rbf_rows()
    assert len(rows) == 4 and all(row.explained for row in rows)
    for row in rows:
        if "global" in row.object:
            assert "nearly singular (condition" in row.explanation and row.condition > 1e9


def test_a_planted_flaw_of_a_spline_is_found(monkeypatch):
    right = ThinPlateSpline.__call__
    monkeypatch.setattr(
        ThinPlateSpline, "__call__", lambda self, *args: 1.0001 * right(self, *args)
    )
    cases = list(hard_samples())[:2]
    monkeypatch.setattr(uniform, "hard_samples", lambda: iter(cases))
    flawed = [row for row in rbf_rows() if row.object == "RBF, global" and not row.explained]
    assert flawed


# plugins


def test_plugins_are_clean(variant_llvm):
    narrow = Ward(k_d=(0.0,) * 3, m_x=0.005, m_y=3.0, name="narrow")
    for brdf in (narrow, small_slices()):
        rows = plugin_rows(brdf.name, make_bsdf(brdf), hard_cases(), variant_llvm)
        assert all(row.explained for row in rows), stability_markdown(rows, every_case=True)
        assert {row.precision for row in rows} == {variant_llvm}
        assert len(rows) == 3 * len(hard_cases(1))


@pytest.mark.parametrize(
    ("part", "flaw", "column"),
    [
        ("eval", lambda value: value * 1.001, "explained"),
        ("eval", lambda value: value - 1.0, "negative"),
        ("pdf", lambda value: value / (value - value), "non_finite"),
    ],
)
def test_flawed_plugins_are_flagged(variant_llvm, monkeypatch, part, flaw, column):
    brdf = Ward(m_x=0.2, m_y=0.2)
    bsdf = make_bsdf(brdf)
    exact = getattr(type(bsdf), part)
    monkeypatch.setattr(type(bsdf), part, lambda self, *arguments: flaw(exact(self, *arguments)))
    rows = plugin_rows("flawed", bsdf, [hard_case("random")], variant_llvm)
    name = {"eval": "value", "pdf": "pdf"}[part]
    (row,) = (row for row in rows if row.object == f"plugin flawed: {name}")
    assert not row.explained
    assert column == "explained" or getattr(row, column) > 0


def test_samples_are_compared_where_they_were_drawn(variant_llvm):
    bsdf = make_bsdf(Ward(m_x=0.1, m_y=0.1))
    case = hard_case("random")
    (drawn,), weights = plugins._draw(bsdf, [case])
    assert np.array_equal(drawn.wv, case.wv) and weights.shape == (len(case.wv), 3)
    below = drawn.wi[:, 2] < 0.0
    assert not weights[below].any() and np.all(weights[~below] > 0.0)


# the table says why


def test_the_lower_limit_of_slices_is_named_in_the_table():
    rows = direction_rows(BrdfSubject(small_slices()), hard_cases(), ["drjit-float32"])
    named = [row for row in rows if "formula D.1" in row.explanation]
    assert named and all(row.explained for row in named)
    assert max(row.worst_relative for row in named) > 1e-4
    assert all(row.sensitivity * 16.0 >= row.worst_relative / 2.0 for row in named)
    assert "formula D.1" in stability_markdown(named, every_case=True)


def test_markdown_shows_the_condition_number():
    row = next(r for r in scattered_rows() if r.case == "random")
    assert f"| {row.condition:.1e} |" in stability_markdown([row])
    flagged = replace(row, explained=False, explanation="because")
    assert "**no** because" in stability_markdown([flagged])


# fuzz


def test_fuzz_pairs_are_directions():
    (case,) = fuzz_cases()
    assert case.wi.shape == case.wv.shape == (FUZZ_PAIRS, 3)
    for v in (case.wi, case.wv):
        assert np.allclose(np.linalg.norm(v, axis=1), 1.0, atol=1e-15) and v[:, 2].min() >= 0.0
    (again,) = fuzz_cases()
    assert np.array_equal(case.wi, again.wi)
    (other,) = fuzz_cases(seed=1)
    assert not np.array_equal(case.wi, other.wi)


def test_unit_takes_the_smallest_denormals():
    tiny = np.nextafter(0.0, 1.0)
    assert np.allclose(
        unit(np.array([[tiny, tiny, 0.0], [0.0, 0.0, tiny]])),
        [[np.sqrt(0.5), np.sqrt(0.5), 0.0], [0.0, 0.0, 1.0]],
    )


_component = st.floats(-1.0, 1.0)
_direction = st.tuples(_component, _component, st.floats(0.0, 1.0, exclude_min=True))
_roughness = st.floats(0.005, 3.0)
_size = st.sampled_from([0.0, 1e-12, 1e-3, 1.0, 1e6])


@settings(max_examples=60, suppress_health_check=[HealthCheck.too_slow])
@given(
    st.lists(st.tuples(_direction, _direction), min_size=16, max_size=16),
    _roughness,
    _roughness,
    _size,
    st.sampled_from(Ward.VARIANTS),
    st.floats(0.0, 1.0),
)
def test_no_material_breaks_on_any_directions(pairs, m_x, m_y, size, variant, alpha):
    """hypothesis looks for directions and parameters whose error nothing explains."""
    wi, wv = (unit(np.array([pair[side] for pair in pairs])) for side in (0, 1))
    case = HardCase("found by hypothesis", "", wi, wv)
    lobe = KurtLobe(k_s=(size,) * 3, f_0=alpha, m_x=m_x, m_y=m_y, alpha=alpha)
    materials = [
        Ward((size,) * 3, (size,) * 3, m_x, m_y, variant),
        Kurt(k_d=(size,) * 3, lobes=(lobe,), name="kurt"),
    ]
    subjects = [*default_parameterisations(), *map(BrdfSubject, materials)]
    for row in (r for s in subjects for r in direction_rows(s, [case], ["drjit-float32"])):
        assert row.explained and not row.non_finite and not row.negative, row


# --- the gantry ----------------------------------------------------------------------------------


@pytest.mark.slow
def test_gantry_rows_are_clean_and_planted_flaws_are_found(monkeypatch):
    rows = gantry.gantry_rows()
    flagged = [row for row in rows if not row.explained or row.non_finite or row.negative]
    assert not flagged, stability_markdown(flagged, every_case=True)
    objects = {row.object for row in rows}
    assert {"gantry, A", "gantry, B", "gantry, BD"} < objects
    assert {"Minnaert fit", "optimal transport"} < objects
    assert all(row.condition for row in rows if row.object == "gantry, A")
    small = gantry.linear
    monkeypatch.setattr(gantry, "linear", lambda ends, w, axis: small(ends, w, axis) + 1e-6)
    plan = gantry.GantryPlan()
    flat = gantry._scaled("planted", "flat", plan, gantry.linear, lambda a: np.full(len(a), 1e-9))
    assert not flat.explained

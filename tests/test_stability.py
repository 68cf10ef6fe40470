"""The stability table: it is clean for what we ship, and it catches what is not."""

from __future__ import annotations

import json

import numpy as np
import pytest

from refusals import refused
from simrig.brdf import Lambert, Ward, kurt_material
from simrig.core.arrays import components, namespace
from simrig.directions import to_angles
from simrig.evaluation.stability.hard_cases import BRDF_VALUES, case_names, hard_case, hard_cases
from simrig.evaluation.stability.judgement import PRECISIONS, direction_rows
from simrig.evaluation.stability.rows import stability_data, stability_markdown, stability_summary
from simrig.evaluation.stability.subjects import (
    BrdfSubject,
    default_brdfs,
    default_parameterisations,
)


def rows_of(*brdfs, cases=None, precisions=PRECISIONS):
    subjects = map(BrdfSubject, brdfs)
    return [r for s in subjects for r in direction_rows(s, cases or hard_cases(), precisions)]


@pytest.fixture(scope="module")
def table():
    cases = hard_cases()
    first = [r for s in default_parameterisations() for r in direction_rows(s, cases, PRECISIONS)]
    return [*first, *rows_of(*default_brdfs())]


def test_everything_is_finite_non_negative_and_explained(table):
    flagged = [row for row in table if not row.explained or row.non_finite or row.negative]
    assert not flagged, stability_markdown(flagged, every_case=True)


def test_table_is_complete(table):
    names = {row.object for row in table}
    assert {brdf.name for brdf in default_brdfs()} < names
    assert {"spherical", "half-difference", "onion", "slices", "dense_table"} < names
    assert {row.case for row in table} == set(case_names())
    assert {row.precision for row in table} == set(PRECISIONS)
    assert len(table) == len(names) * len(case_names()) * len(PRECISIONS)


def test_double_precision_is_at_rounding(table):
    """Analytic models in float64, away from where the half vector is undefined."""
    tables = ("dense_table", "isotropic_table", "slices")
    for row in table:
        flushed = row.precision != "numpy-float64" and "denormal" in row.explanation
        if row.precision != "drjit-float32" and row.object not in tables and not flushed:
            assert row.worst_relative < 1e-13, row  # lobes of m = 0.005: 450 roundings


def test_single_precision_on_random_directions(table):
    for row in table:
        if row.precision == "drjit-float32" and row.case == "random":
            assert row.worst_relative < 2e-4, row


def _flawed(factor):
    """Return a Lambertian reflector with a flaw in its arithmetic: a factor that should be 1."""

    class Flawed(Lambert):
        def look_up(self, wi, wv, tables):
            value = super().look_up(wi, wv, tables)
            f = factor(components(wi)[2], namespace(components(wi)[2]))
            return value * (f[..., None] if isinstance(f, np.ndarray) else f)

    return Flawed(name="flawed")


@pytest.mark.parametrize(
    ("factor", "column"),
    [
        # four digits lost in a value that is not sensitive
        (lambda z, xp: 1.0 + ((z + 1e4) - 1e4 - z), "unexplained"),
        # 0/0 where z¹² underflows in float32
        (lambda z, xp: (z**12 * 1e-10) / (z**12 * 1e-10), "non_finite"),
        (lambda z, xp: z - 0.5, "negative"),
    ],
)
def test_flaws_are_flagged(factor, column):
    cases = [c for c in hard_cases() if c.name not in ("denormal", "bit-patterns")]  # z may be 0
    rows = rows_of(_flawed(factor), cases=cases, precisions=["drjit-float32"])
    assert stability_summary(rows)[column] > 0
    assert stability_summary(rows)["unexplained"] > 0


def test_large_errors_of_sensitive_values_are_explained():
    """The narrowest lobe: float32 is off by 1e-5 because 1 ulp of the directions is as much."""
    ward = Ward((0, 0, 0), m_x=0.005, m_y=0.005)
    (row,) = rows_of(ward, cases=[hard_case("near-mirror")], precisions=["drjit-float32"])
    assert row.explained and row.sensitivity > 100 * np.finfo(np.float32).eps
    assert row.input_relative > row.sensitivity / 100


def test_where_is_where_it_happens():
    near_normal = _flawed(lambda z, xp: 1.0 + xp.select(z > 0.99, (z + 1e4) - 1e4 - z, 0.0 * z))
    cases = [hard_case("random", 1000)]
    (row,) = rows_of(near_normal, cases=cases, precisions=["drjit-float32"])
    theta_i, _, theta_v, _ = row.where
    assert theta_i < np.degrees(np.arccos(0.99)) < theta_v
    assert not row.explained


@pytest.mark.parametrize("value", BRDF_VALUES)
def test_values_of_any_size_keep_their_precision(value):
    ward = Ward((value,) * 3, (value,) * 3, 0.2, 0.2)
    rows = rows_of(ward)
    assert stability_summary(rows) == {
        "rows": len(rows),
        "unexplained": 0,
        "non_finite": 0,
        "negative": 0,
    }


def test_json_and_markdown_hold_the_rows():
    rows = rows_of(kurt_material("wood01"))
    content = json.loads(json.dumps(stability_data(rows), allow_nan=False))
    assert content["summary"] == stability_summary(rows)
    assert [row["case"] for row in content["rows"]] == [row.case for row in rows]
    assert len(content["rows"][0]["where"]) == 4
    short, full = stability_markdown(rows), stability_markdown(rows, every_case=True)
    assert short.count("| wood01 |") == len(PRECISIONS)
    assert full.count("| wood01 |") == len(rows)
    for line in full.splitlines()[2:]:
        assert line.count("|") == 13


# The cases themselves


@pytest.mark.parametrize("name", case_names())
def test_cases_are_unit_vectors_above_the_horizon(name):
    case = hard_case(name, count=50)
    assert case.wi.shape == case.wv.shape == (50, 3) and case.wi.dtype == np.float64
    for v in (case.wi, case.wv):
        assert np.allclose(np.linalg.norm(v, axis=-1), 1.0, atol=1e-15)
        assert np.all(v[:, 2] > 0.0)
    again = hard_case(name, count=50)
    assert np.array_equal(case.wi, again.wi) and np.array_equal(case.wv, again.wv)
    assert case.description


def test_cases_are_as_hard_as_they_say():
    cases = {case.name: case for case in hard_cases()}
    theta_i, _ = to_angles(cases["grazing-one"].wi)
    assert np.degrees(theta_i).min() >= 79.9 and np.degrees(theta_i).max() > 89.9
    mirror = cases["mirror"].wi + cases["mirror"].wv
    assert np.all(mirror[:, :2] == 0.0)
    assert np.array_equal(cases["retro"].wi, cases["retro"].wv)
    apart = np.linalg.norm(cases["opposite"].wi + cases["opposite"].wv, axis=-1)
    assert 0.0 < apart[0] < 1e-11 and apart.max() < 0.03
    equal = cases["equal-theta"]
    assert np.allclose(equal.wi[:, 2], equal.wv[:, 2], rtol=1e-14)
    assert cases["horizon"].wi[:, 2].min() < 1e-10


def test_unknown_case_is_refused():
    refused("did you mean 'mirror'", hard_case, "mirrors")

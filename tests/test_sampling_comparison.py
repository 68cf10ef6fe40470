"""Patterns of thesis section 7.1, and the study of all methods of chapter 7 beside ours."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from refusals import refused
from simrig.brdf import kurt_material
from simrig.brdf.tables.resample import resample_dense
from simrig.database.known import known
from simrig.database.patterns import (
    Subspaces,
    axial_and_diagonal,
    most_average,
    most_similar,
    reference_pattern,
    template_pattern,
    uniform_pattern,
)
from simrig.evaluation.studies.sampling_comparison import study
from simrig.evaluation.studies.sampling_comparison.ways import SPLIT, WAYS, Stage


def _spaces(*names: str) -> Subspaces:
    tables = [
        resample_dense(kurt_material(n), np.radians(25.0), 12, np.radians(75.0)).values
        for n in names
    ]
    return Subspaces.of(tables)


def _error(spaces: Subspaces, pattern: list[list[int]], truth: Subspaces | None = None) -> float:
    made = spaces.filled(pattern, truth)
    source = (truth or spaces).values
    return float(
        np.mean(np.concatenate([((a - b) ** 2).ravel() for a, b in zip(made, source, strict=True)]))
    )


def test_splines_pass_through_their_samples_and_a_whole_table_comes_back() -> None:
    spaces = _spaces("purple_satin")
    whole = [list(range(len(v))) for v in spaces.values]
    assert _error(spaces, whole) < 1e-12
    table = resample_dense(kurt_material("purple_satin"), np.radians(25.0), 12, np.radians(75.0))
    assert np.allclose(spaces.table(spaces.values), table.values, atol=1e-6)
    pattern = reference_pattern(spaces, 60)
    for k, chosen in enumerate(pattern):
        made = spaces.reconstructed(k, chosen, spaces.values[k][chosen])
        assert np.allclose(made[chosen], spaces.values[k][chosen], atol=1e-5)


def test_the_reference_pattern_beats_the_uniform_one() -> None:
    spaces = _spaces("purple_satin")
    for count in (80, 200):
        uniform = uniform_pattern(spaces, count)
        assert sum(map(len, uniform)) <= count
        reference = reference_pattern(spaces, count)
        assert sum(map(len, reference)) == count
        assert len({(k, n) for k, own in enumerate(reference) for n in own}) == count
        assert _error(spaces, reference) < _error(spaces, uniform)
    shorter = reference_pattern(spaces, 80)
    assert reference_pattern(spaces, 200, begun=shorter) == reference
    turned = reference_pattern(spaces.compressed(), 200, begun=most_average(spaces))
    assert turned == reference
    moved = reference_pattern(spaces, 80, passes=1)
    assert sum(map(len, moved)) == 80
    refused("a pattern has 10 to", reference_pattern, spaces, 5)


def test_the_template_pattern_follows_the_most_similar_material() -> None:
    truth, others = _spaces("purple_satin"), [_spaces("yellow_satin"), _spaces("fabric041")]
    pattern = template_pattern(truth, others, 200, spare=16)
    assert sum(map(len, pattern)) == 200
    even = uniform_pattern(_spaces("yellow_satin", "fabric041"), 200)
    assert _error(truth, pattern) < 2.0 * _error(truth, even)
    refused("method2 needs", template_pattern, truth, others, 20, 16)


def test_the_most_similar_material_is_found_whatever_its_brightness() -> None:
    rng = np.random.default_rng(0)
    others = rng.uniform(size=(5, 30))
    assert most_similar(0.2 + 3.0 * others[3], others) == 3
    assert 0 <= most_similar(np.zeros(30), np.zeros((2, 30))) < 2  # black beside black


def test_the_first_samples_are_those_of_alignment() -> None:
    nodes = axial_and_diagonal(48, 42)
    assert len(nodes) == len(set(nodes)) and 84 <= len(nodes) <= 90
    first = np.array(nodes[:48])
    assert np.all((first % 48 - first // 48) % 48 == 18)  # one turn beside the mirror


@pytest.mark.parametrize("name", list(WAYS))
def test_every_way_is_nearer_than_nothing(name: str, small_database: Path) -> None:
    own = known(str(small_database))
    stage = Stage(own, own.slices.names.index("fabric002"), (own.slices.names.index("fabric002"),))
    make, least = WAYS[name]
    made, taken = make(stage, max(least, 160 if name == "slices" else 80))
    errors = stage.errors(made)
    nothing = stage.errors(np.full_like(stage.truth.values, stage.truth.values.mean()))
    assert taken <= max(least, 160)
    assert errors["mean_log_error"] < 0.95 * nothing["mean_log_error"]
    assert errors["log_rmse"] >= errors["mean_log_error"] > 0.0


def test_the_study_says_who_is_ahead(monkeypatch: pytest.MonkeyPatch, small_database: Path) -> None:
    monkeypatch.setenv(study.VARIABLE, str(small_database))
    methods = ["minimal-ridge", "process"]
    config = {"database": "folder", "materials": 1, "samples": [40], "methods": methods}
    listed = study.cells(config)
    assert [cell["held_out"] for cell in listed] == ["material", "family"]
    rows = [{**cell, **row} for cell in listed for row in study.run_cell(config, cell)]
    summary = study.summarise(config, rows)
    assert {row["method"] for row in summary["rows"]} == set(methods)
    for row in summary["rows"]:
        assert row["samples"] == 40 and row["mean_log_error"] > 0.0 and np.isfinite(row["psnr"])
    assert all(one["ours"] == "process" for one in summary["ahead"])
    assert study.table(summary)
    monkeypatch.setenv(study.VARIABLE, "nowhere")
    refused("simrig database build", study.run_cell, config, listed[0])
    assert all(n * r <= count for count, (n, r) in SPLIT.items())

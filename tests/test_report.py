"""The report: one file, nothing from outside, everything escaped, numbers rounded sensibly."""

from __future__ import annotations

import base64
import html.parser
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from simrig.evaluation.experiment.config import (
    ComparisonSettings,
    Experiment,
    MeasurementSettings,
    RenderingSettings,
    SceneSettings,
)
from simrig.evaluation.experiment.run import run_experiment
from simrig.evaluation.report.html import (
    metric,
    plain,
    scene_title,
    significant,
    size,
    slice_ranking,
)

HOSTILE = '<script src="http://example.com/x.js">alert("&")</script>'
EXPERIMENT = Experiment(
    material="fabric112",
    title=HOSTILE,
    measurement=MeasurementSettings(samples=(700,)),
    rendering=RenderingSettings(spp=1),
    comparison=ComparisonSettings(estimate_samples=2000, step_deg=20.0),
    scenes=(SceneSettings("cylinder", {"resolution": 12, "light": "left"}),),
)


class Reader(html.parser.HTMLParser):
    """Collects what the tests ask: tags, their attributes, the text."""

    VOID = frozenset({"meta", "img", "br", "link", "hr"})

    def __init__(self, text: str):
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.open: list[str] = []
        self.text = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag, f"</{tag}> closes nothing"

    def pictures_of(self, label: str) -> int:
        """Return how many pictures are described by a label alone: one per scene."""
        return sum(tag == "img" and attributes.get("alt") == label for tag, attributes in self.tags)

    def handle_data(self, data: str) -> None:
        self.text += data


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> str:
    folder = tmp_path_factory.mktemp("report")
    run_experiment(EXPERIMENT, folder)
    return (folder / "report.html").read_text(encoding="utf-8")


def test_nothing_comes_from_outside(report: str) -> None:
    reader = Reader(report)
    assert reader.open == []
    assert not {"script", "link", "iframe", "object", "embed"} & {tag for tag, _ in reader.tags}
    sources = [a[k] or "" for _, a in reader.tags for k in ("src", "href", "srcset") if k in a]
    assert sources
    assert all(source.startswith("data:image/png;base64,") for source in sources)
    assert not re.search(r"url\(|@import", report)


def test_every_picture_is_a_png_and_has_a_description(report: str) -> None:
    images = [attributes for tag, attributes in Reader(report).tags if tag == "img"]
    # reference, two reconstructions with differences; slices; BRDF with two and differences;
    # the anisotropy's sheet; plots
    assert len(images) == 1 + 4 + 1 + 1 + 4 + 1 + 2
    for image in images:
        data = base64.b64decode((image["src"] or "").partition(",")[2], validate=True)
        assert data.startswith(b"\x89PNG\r\n\x1a\n")
        assert image["alt"]


def test_what_the_user_wrote_is_escaped(report: str) -> None:
    assert HOSTILE not in report
    assert HOSTILE in Reader(report).text


def test_figures_stand_beside_their_cost(report: str) -> None:
    text = " ".join(Reader(report).text.split())
    for part in (
        "MRE",
        "log error",
        "edian relative error",
        "ΔE",
        "Pareto front",
        "h measuring",
        "700 samples",
        "fingerprint",
    ):
        assert part in text
    assert "255 − 10 · |difference|" in text
    headline = text[: text.index("The reference beside")]
    assert re.search(r"[\d.]+ ΔE mean colour difference of the pictures, adaptive slices", headline)
    assert re.search(r"[\d.]+ ΔE mean colour difference of the pictures, from a regular", headline)
    assert "mean relative error over all directions" not in headline
    assert not re.search(r"\bNone\b|\bnan\b|\binf\b|Undefined", text)


def test_the_report_of_one_set_of_slices_without_baseline_and_exact_errors(tmp_path: Path) -> None:
    plain_one = replace(
        EXPERIMENT,
        measurement=MeasurementSettings(
            samples=(700,), slice_types="axial-diagonal", baseline=False
        ),
        comparison=ComparisonSettings(exact=False, estimate_samples=2000, step_deg=20.0),
    )
    run_experiment(plain_one, tmp_path)
    text = " ".join(Reader((tmp_path / "report.html").read_text()).text.split())
    assert "±" in text
    assert ", exact" not in text and "exact figures" not in text
    assert "egular grid" not in text
    assert "Axial and diagonal slices, 700 samples" in text
    assert "Which slices?" not in text
    assert "daptive slices" not in text


@pytest.mark.slow
def test_the_automatic_plan_comes_first_and_tells_what_it_saw(tmp_path: Path) -> None:
    measurement = MeasurementSettings(samples=(300,), automatic=True)
    quick = ComparisonSettings(exact=False, estimate_samples=2000, step_deg=20.0)
    results = run_experiment(
        replace(EXPERIMENT, measurement=measurement, comparison=quick), tmp_path
    )
    auto, slices, grid = results["reconstructions"]
    assert [r["method"] for r in (auto, slices, grid)] == ["auto", "slices", "regular-grid"]
    assert slices["found"] is None and auto["found"]["families"]
    row = results["accuracy_versus_cost"][0]
    reader = Reader((tmp_path / "report.html").read_text())
    text = " ".join(reader.text.split())
    headline = text[: text.index("The reference beside")]
    first = f"{significant(row['delta_e'])} ΔE mean colour difference of the pictures, automatic"
    assert first in headline and headline.index(first) < headline.index("adaptive slices, for")
    section = text[text.index("What the automatic plan saw") : text.index("Where the slices")]
    reasons = [auto["found"][key][1:] for key in ("why", "reciprocity")]
    names = [quantity["name"] for quantity in auto["found"]["pilot"]]
    assert all(part in section for part in [*reasons, *names])
    assert f"{significant(auto['found']['predicted_delta_e'], 2)}" in section
    assert reader.pictures_of("automatic plan, 300 samples") == 1
    assert not re.search(r"\bNone\b|\bnan\b|\binf\b|Undefined", text)


def test_the_report_shows_both_sets_of_slices_and_says_which_is_better(tmp_path: Path) -> None:
    measurement = MeasurementSettings(samples=(700,), slice_types="both")
    results = run_experiment(replace(EXPERIMENT, measurement=measurement), tmp_path)
    reader = Reader((tmp_path / "report.html").read_text())
    text = " ".join(reader.text.split())
    errors = {row["method"]: significant(row["delta_e"]) for row in results["accuracy_versus_cost"]}
    assert reader.pictures_of("adaptive slices, 700 samples") == 1
    assert reader.pictures_of("axial and diagonal slices, 700 samples") == 1
    best, other = sorted((errors["slices"], errors["slices-axial-diagonal"]), key=float)
    assert f"(mean ΔE {best} against {other} from" in text


def test_the_better_set_of_slices_comes_first() -> None:
    def row(method: str, samples: int, delta_e: float) -> dict[str, Any]:
        return {"method": method, "samples": samples, "delta_e": delta_e}

    few = [
        row("slices", 10, 0.1),
        row("slices-axial-diagonal", 10, 0.2),
        row("regular-grid", 9, 0.01),
    ]
    full, axial, grid = (
        row("slices", 20, 0.6),
        row("slices-axial-diagonal", 20, 0.5),
        row("regular-grid", 18, 0.01),
    )
    assert slice_ranking([*few, full, axial, grid]) == (axial, full)
    assert slice_ranking([*few, full, {**axial, "delta_e": 0.6}])[0] == full
    assert slice_ranking([axial, grid]) == (axial, None)


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (0.0, "0"),
        (0.12345, "0.123"),
        (9.996, "10.0"),
        (99.96, "100"),
        (1234.5, "1,234"),
        (18721, "18,721"),
        (0.00012345, "0.000123"),
        (1.5e-9, "1.50e-09"),
        (-2.345, "-2.35"),
    ],
)
def test_significant_digits(value: float, shown: str) -> None:
    assert significant(value) == shown


def test_sizes_metrics_and_settings() -> None:
    assert [size(n) for n in (12, 1500, 5_331_420, 2.5e9)] == [
        "12 bytes",
        "1.50 kB",
        "5.33 MB",
        "2.50 GB",
    ]
    assert (metric(None), metric(1.0), plain(10.0), plain(0.9)) == ("∞", "1.00", "10", "0.9")


def test_scene_titles() -> None:
    assert scene_title({"name": "sphere", "options": {}}) == "Sphere"
    options = {"lights": 16, "environment": "maps/grace.exr"}
    title = scene_title({"name": "environment_sphere", "options": options})
    assert title == "Environment sphere, 16 directional lights, grace"


def test_the_report_shows_what_the_pictures_simulate(report: str) -> None:
    text = " ".join(Reader(report).text.split())
    assert "What all pictures of this scene simulate, planned for dE=0.5" in text
    for shown in ("inter-reflection", "one convex body: no point sees another", "anti-aliasing"):
        assert shown in text

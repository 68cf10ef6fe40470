"""The report of an experiment: one HTML file that needs nothing else, on screen and on paper."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import jinja2
import markupsafe

from simrig.brdf.protocol import Brdf
from simrig.evaluation.experiment.reconstructions import AUTOMATIC, LABELS, SLICE_METHODS, Subject
from simrig.evaluation.report.pictures import (
    anisotropy_sheet,
    brdf_pictures,
    cost_plots,
    data_uri,
    directions_picture,
    slices_picture,
)
from simrig.rendering.environment import BUILTIN

_LEGENDS = {  # of rows of pictures
    AUTOMATIC: "it looks first, then measures where errors would show",
    "slices": "the thesis's adaptive sampling along slices of all kinds",
    "slices-axial-diagonal": "as adaptive slices, without the horizontal and vertical ones",
    "regular-grid": "equal steps in all angles, multilinear interpolation, for comparison",
}
_TEMPLATES = Path(__file__).with_name("templates")


def render(
    results: Mapping[str, Any],
    folder: Path,
    truth: Brdf,
    subjects: Sequence[Subject],
    settings: str,
) -> str:
    """Return the report as HTML.

    Args:
        results: what ``results.json`` holds (``docs/experiments.md``).
        folder: where the pictures are that it names.
        subjects: the reconstructions in the order of the results.
        settings: the experiment as TOML.
    """
    records = {record["key"]: record for record in results["reconstructions"]}
    by_method = {m: [s for s in subjects if s.plan.method == m] for m in LABELS}
    by_method = {method: own for method, own in by_method.items() if own}
    finest = {own[-1].plan.key: own[-1].brdf for own in by_method.values()}
    rows = results["accuracy_versus_cost"]
    ranking = slice_ranking(rows)
    drawn = by_method[ranking[0]["method"]]
    measured = [s.measurement for s in drawn]
    automatic = [s.measurement for s in by_method.get(AUTOMATIC, [])]
    lead = [row for row in rows if row["method"] == AUTOMATIC][-1:] or [ranking[0]]
    scale = results["experiment"]["rendering"]["difference_scale"]
    context = {
        "r": results,
        "methods": {m: [records[s.plan.key] for s in own] for m, own in by_method.items()},
        "names": LABELS,
        "legends": _LEGENDS,
        "lead": lead[0],
        "ranking": ranking,
        "directions": [directions_picture(m) for m in automatic],
        "titles": {key: scene_title(scene) for key, scene in results["scenes"].items()},
        "picture": lambda file: data_uri((folder / file).read_bytes()),
        # the middle one: enough samples to see a pattern, few enough to see dots
        "slices": slices_picture(truth, measured[len(measured) // 2]),
        "brdf": brdf_pictures(truth, finest, results["theta_max_deg"], scale),
        "anisotropy": anisotropy_sheet(truth),
        "records": records,
        "plots": cost_plots(rows, LABELS),
        "settings": settings,
    }
    return render_template("report.html", context)


def render_template(name: str, context: Mapping[str, Any]) -> str:
    """Return a template of ``evaluation/templates`` filled in."""
    return _environment().get_template(name).render(context)


def slice_ranking(
    rows: Sequence[Mapping[str, Any]],
) -> tuple[Mapping[str, Any], Mapping[str, Any] | None]:
    """Return which set of slices gave the better pictures, and the other where there are two.

    Args:
        rows: ``accuracy_versus_cost`` of the results, ascending in samples.

    Returns:
        The rows of the largest number of samples, that of the smaller mean ΔE first; of equal
        ones the full set.
    """
    largest = {row["method"]: row for row in rows if row["method"] in SLICE_METHODS}
    ranked = sorted(largest.values(), key=lambda row: row["delta_e"])
    return ranked[0], ranked[1] if len(ranked) > 1 else None


@cache
def _environment() -> jinja2.Environment:
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(_TEMPLATES),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    environment.filters.update(sig=significant, size=size, metric=metric, count=count, plain=plain)
    environment.filters.update(lines=lines, capitalize_first=capitalize_first)
    return environment


def significant(value: float | None, digits: int = 3) -> str:
    """Return a number rounded to so many significant digits, written out where that is short."""
    if value is None:
        return "–"
    if value == 0.0:
        return "0"
    exponent = math.floor(math.log10(abs(float(f"{value:.{digits - 1}e}"))))
    if not -5 <= exponent <= 7:
        return f"{value:.{digits - 1}e}"
    return f"{value:,.{max(0, digits - 1 - exponent)}f}"


def count(value: int) -> str:
    """Return a whole number with separated thousands."""
    return f"{value:,}"


def size(value: float) -> str:
    """Return a number of bytes in words, in powers of 1000."""
    for unit in ("bytes", "kB", "MB"):
        if value < 1000.0:
            return f"{value:.0f} {unit}" if unit == "bytes" else f"{significant(value)} {unit}"
        value /= 1000.0
    return f"{significant(value)} GB"


def metric(value: float | None, digits: int = 3) -> str:
    """Return an error figure; None stands for the infinite PSNR of identical images."""
    return "∞" if value is None else significant(value, digits)


def lines(text: str) -> markupsafe.Markup:
    """Return text whose lines stay apart on the page."""
    return markupsafe.Markup("<br>").join(text.split("\n"))


def capitalize_first(text: str) -> str:
    """Return a sentence with a large first letter, its other letters as they are."""
    return text[:1].upper() + text[1:]


def plain(value: float) -> str:
    """Return a setting as it was given, without trailing zeros."""
    return f"{value:g}"


def scene_title(scene: Mapping[str, Any]) -> str:
    """Return the heading of a scene from its name and options."""
    options, parts = scene["options"], [scene["name"].replace("_", " ").capitalize()]
    if "light" in options:
        parts.append(f"lit from the {options['light']}")
    if "lights" in options:
        parts.append(f"{options['lights']} directional lights")
    if options.get("environment", BUILTIN) != BUILTIN:
        parts.append(Path(options["environment"]).stem)
    return ", ".join(parts)

"""The uncertainty budget beside closed forms, GTC, and what averaging must give."""

from __future__ import annotations

import copy
import tomllib
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import simrig as sr
from command_line import done, refusal
from refusals import refused
from simrig.brdf import Lambert, kurt_material
from simrig.brdf.protocol import Brdf
from simrig.evaluation.uncertainty.budget import Instruments, Spread, directions
from simrig.evaluation.uncertainty.costs import Levers
from simrig.evaluation.uncertainty.draws import standard
from simrig.evaluation.uncertainty.result import Budget, make_budget
from simrig.evaluation.uncertainty.sources import SOURCES
from simrig.instruments.description import described

UTIA = tomllib.loads(files("simrig.instruments").joinpath("utia.toml").read_text(encoding="utf-8"))
GREY = Lambert((0.5, 0.5, 0.5), "grey")
MONTE_CARLO = 0.06  # relative, of a deviation from 2,000 trials: 1.6 %, times three and a rest


def instrument(bare: bool = True, **tables: dict[str, Any]) -> Any:
    """Return UTIA's instrument, without any uncertainty where it is bare, and with some keys."""
    made = copy.deepcopy(UTIA)
    if bare:
        made.pop("calibration")
        made.pop("alternative")
        for axis in made["axis"]:
            axis.update(repeatability_deg=0, offset_deg=0)
        made["sample"].update(height_mm=0, tilt_deg=0)
        made["light"].update(distance_mm=2000, non_uniformity=0, stray=0, drift_pct_h=0)
        made["camera"].update(distance_mm=2000, PRNU_pct=0)
    for table, keys in tables.items():
        if table == "axis":
            for axis in made["axis"]:
                axis.update(keys)
        else:
            made.setdefault(table, {}).update(keys)
    return described(made)


def relative(material: Brdf, description: Any, source: str, *pair: float, **more: Any) -> Spread:
    """Return what one source does to one value, relative to it."""
    angles = np.radians([pair])
    errors = Instruments(material, description, 2000, **more).errors(angles, [source])
    return Spread.of(errors / material.eval(*_vectors(angles)))


def _vectors(angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    theta, phi = angles[:, :2], angles[:, 2:]
    w = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)
    return w[:, 0], w[:, 1]


@pytest.mark.parametrize(("dist", "most"), [("uniform", 3**0.5), ("triangular", 6**0.5)])
def test_distributions_have_mean_0_and_deviation_1(dist: str, most: float) -> None:
    even = (np.arange(100_000) + 0.5) / 100_000
    for name in (dist, "normal"):
        drawn = standard(name, even)
        assert drawn.mean() == pytest.approx(0.0, abs=1e-10)
        assert drawn.std() == pytest.approx(1.0, rel=2e-4)
    assert np.abs(standard(dist, even)).max() == pytest.approx(most, rel=1e-2)


@pytest.mark.parametrize("theta", [0.0, 45.0, 75.0])
def test_closed_forms_of_a_matte_surface(theta: float) -> None:
    """The irradiance goes with the cosine: tan θ times the error of the angle, and so on."""
    tangent, pair = np.tan(np.radians(theta)), (theta, 30.0, 10.0, 70.0)
    offset = instrument(axis={"offset_deg": {"value": 0, "u": 0.02}})
    tilt = instrument(sample={"tilt_deg": {"value": 0, "u": 0.02, "dist": "uniform"}})
    for description, source in ((offset, "axis offset"), (tilt, "plane")):
        found = relative(GREY, description, source, *pair)
        expected = tangent * np.radians(0.02)
        np.testing.assert_allclose(found.rms, expected, rtol=MONTE_CARLO, atol=1e-6)
    moves = instrument(axis={"repeatability_deg": 0.03})
    found = relative(GREY, moves, "repeatability", *pair)
    expected = tangent * np.radians(0.03) / 3**0.5
    np.testing.assert_allclose(found.rms, expected, rtol=MONTE_CARLO, atol=1e-6)
    distance = instrument(light={"distance_mm": {"value": 2000, "u": 2}})
    absolute = relative(GREY, distance, "distance", *pair)  # no standard: 2 u(d) / d
    np.testing.assert_allclose(absolute.rms, 0.002, rtol=MONTE_CARLO)
    stray = instrument(light={"stray": {"value": 1e-4, "u": 0}})
    found = relative(GREY, stray, "stray light", *pair)
    np.testing.assert_allclose(found.bias, 2e-4 / np.cos(np.radians(theta)), rtol=1e-9)


def test_a_standard_cancels_the_distance() -> None:
    distance = {"value": 2000, "u": 2}
    calibration = {"reference_f_r_per_sr": {"value": 0.315, "u": 0.0}}
    kept = instrument(light={"distance_mm": distance}, calibration=calibration)
    assert relative(GREY, kept, "distance", 30, 30, 0, 90).rms.max() < 1e-12
    raised = instrument(sample={"height_mm": {"value": 0, "u": 1}}, calibration=calibration)
    # the surface is nearer to the light by h cos θ_i, and seen aside by h tan θ_v, from both sides
    found = relative(GREY, raised, "plane", 0, 0, 0, 0).rms
    np.testing.assert_allclose(found, 2.0 * 1.0 / 2000.0, rtol=MONTE_CARLO)


def test_groups_are_off_together() -> None:
    """An error of the standard and the same of the flat field cancel where they are one."""
    half = {"value": 0, "u": 0.002, "group": "lamp"}
    standard_of = {"value": 0.315, "u": 0.315 * 0.002, "group": "lamp"}
    one = instrument(calibration={"flat_field": half, "reference_f_r_per_sr": standard_of})
    own = {"flat_field": {**half, "group": "a"}, "reference_f_r_per_sr": standard_of}
    angles = np.radians([[30.0, 0.0, 0.0, 0.0]])
    both = ["flat field", "reference"]
    together = Instruments(GREY, one, 2000).errors(angles, both) * np.pi / 0.5
    apart = Instruments(GREY, instrument(calibration=own), 2000).errors(angles, both) * np.pi / 0.5
    assert together.std() < 1e-5
    assert apart.std() == pytest.approx(0.002 * 2**0.5, rel=MONTE_CARLO)


def test_a_linear_budget_by_gtc_agrees() -> None:
    """GTC propagates to first order; at a matte surface that is all there is."""
    gtc = pytest.importorskip("GTC", reason="GTC is not installed: pip install 'simrig[dev]'")
    theta, f = np.radians(60.0), 0.5 / np.pi
    description = instrument(
        axis={"offset_deg": {"value": 0, "u": 0.02}, "repeatability_deg": 0.03},
        sample={"height_mm": {"value": 0, "u": 0.5}, "tilt_deg": {"value": 0, "u": 0.01}},
        light={"drift_pct_h": {"value": 0, "u": 0.1}, "stray": {"value": 0, "u": 1e-5}},
        camera={"PRNU_pct": 1},
        calibration={
            "reference_f_r_per_sr": {"value": 0.315, "u": 0.0008},
            "interval_h": 1,
            "flat_field": {"value": 0, "u": 0.001},
        },
    )
    on = [name for name in SOURCES if name not in ("noise", "quantisation", "extent", "linearity")]
    angles = np.array([[theta, 0.0, 0.3, 0.0]])
    ours = Spread.of(Instruments(GREY, description, 8000).errors(angles, on)).rms

    offset, moved = gtc.ureal(0, np.radians(0.02)), gtc.ureal(0, np.radians(0.03) / 3**0.5)
    about_x, about_y = gtc.ureal(0, np.radians(0.01)), gtc.ureal(0, np.radians(0.01))
    height, azimuth = gtc.ureal(0, 0.5), 0.3
    aside = -np.sin(azimuth) * about_x + np.cos(azimuth) * about_y  # towards the light
    cosine = gtc.cos(theta + offset + moved - aside) / np.cos(theta)
    nearer = (1 - height * np.cos(theta) / 2000) ** -3 * (1 - height / (2000 * np.cos(theta)))
    rate, time = gtc.ureal(0, 0.001), gtc.ureal(0.5, 12**-0.5)
    gain = gtc.ureal(0.315, 0.0008) / 0.315
    value = f * cosine * nearer * (1 + rate * time) * (1 + gtc.ureal(0, 0.01 / 50))
    value = value * (1 + gtc.ureal(0, 0.001)) / gain
    value = value + gtc.ureal(0, 1e-5) / (np.pi * np.cos(theta))
    # a product of two errors, rate times time, is of second order to GTC: their mean square is 1/3
    linear = np.hypot(gtc.uncertainty(value), f * 0.001 * 12**-0.5)
    np.testing.assert_allclose(ours, linear, rtol=0.03)


def test_what_averages_does_and_what_is_shared_does_not() -> None:
    whole = instrument(bare=False)
    angles, group = directions([45.0], 8)
    budget = make_budget(GREY, whole, thetas_deg=[45.0], trials=1000)
    levers = Levers(budget.values, _timing(whole), 6561)
    again = [
        Instruments(GREY, whole, 1000, seed).errors(angles, ["repeatability"]) for seed in range(4)
    ]
    measured = Spread.of(np.mean(again, axis=0)).rms
    table = budget.values
    moves = table.alone["repeatability"]
    np.testing.assert_allclose(measured, moves.rms / 2.0, rtol=0.12)
    halves = sum(table.alone[name].rms ** 2 for name in ("repeatability", "noise", "quantisation"))
    predicted = table.total.rms**2 - 0.75 * halves
    np.testing.assert_allclose(levers.mean_square(4.0), predicted, rtol=1e-3)
    more = make_budget(GREY, whole, thetas_deg=[45.0], trials=1000, exposures=16, albedo=False)
    for name, factor in (("noise", 0.25), ("reference", 1.0)):
        ratio = more.values.alone[name].rms / table.alone[name].rms
        np.testing.assert_allclose(ratio, factor, rtol=0.05)
    albedos = budget.albedos
    assert albedos is not None
    shared = albedos.typical(albedos.alone["reference"].rms, 0)
    assert shared == pytest.approx(100 * 0.0008 / 0.315, rel=0.12)
    # 128 values: a move's error is a tenth of that of one value at 45°
    moved = albedos.typical(albedos.alone["repeatability"].rms, 0)
    assert moved is not None and moved < 0.25 * np.median(table.parts(moves.rms))
    assert len(group) == 8


def _timing(description: Any) -> Any:
    from simrig.rigs.timing import GonioreflectometerTiming

    return GonioreflectometerTiming.of(description.timing)


def test_sources_add_in_squares_where_they_are_independent() -> None:
    budget = make_budget(GREY, instrument(bare=False), thetas_deg=[30.0, 75.0], albedo=False)
    table = budget.values
    alone = np.sqrt(sum(spread.rms**2 for spread in table.alone.values()))
    np.testing.assert_allclose(table.total.rms, alone, rtol=0.05)
    for name, spread in table.without.items():
        rest = np.sqrt(table.total.rms**2 - table.alone[name].rms ** 2)
        np.testing.assert_allclose(spread.rms, rest, rtol=0.08)


def test_a_known_error_is_halved_by_correcting_for_it() -> None:
    biased = instrument(light={"stray": {"value": 1e-3, "u": 1e-5}})
    dominant = make_budget(GREY, biased, thetas_deg=[45.0], albedo=False).dominant
    assert dominant is not None and dominant["source"] == "stray light"
    assert dominant["U_halved"] == pytest.approx(0.5 * dominant["U"], rel=0.1)
    assert dominant["share_percent"] <= 100.0
    (way,) = dominant["ways"]
    assert "corrected" in way["how"] and way["U"] < 0.2 * dominant["U"]


def test_nothing_uncertain_gives_zero_and_says_so() -> None:
    certain = instrument(
        light={"diameter_mm": 0}, lens={"f_mm": 1e-6}, sample={"spot_diameter_mm": 1e-6}
    )
    on = [name for name in SOURCES if name not in ("noise", "quantisation")]
    budget = make_budget(GREY, certain, thetas_deg=[45.0], sources=on)
    assert budget.expanded < 1e-9 and budget.saturated == 0
    assert {"reference", "drift", "colour matrix"} <= set(budget.unstated)
    zero = instrument(light={"drift_pct_h": {"value": 0, "u": 0}})
    assert "drift" not in make_budget(GREY, zero, thetas_deg=[0.0], albedo=False).unstated


class Spike(Brdf):
    """A mirror lobe of a tenth of a degree over nothing."""

    name, in_kernels = "spike", False

    def __init__(self, height: float):
        self.height = height

    def data(self):
        return {"height": np.array(self.height)}

    def look_up(self, wi, wv, tables):
        h = wi + wv
        slope = (h[..., 0] ** 2 + h[..., 1] ** 2) / h[..., 2] ** 2
        return self.height * np.exp(-slope / np.radians(0.1) ** 2)[..., None] * np.ones(3)


@pytest.mark.parametrize("height", [0.0, 1e-300, 1.0, 1e6])
@pytest.mark.filterwarnings("error")
def test_hard_materials_stay_finite(height: float) -> None:
    whole = instrument(bare=False)
    mirror = np.radians([[85.0, 85.0, 0.0, 180.0], [0.0, 0.0, 0.0, 0.0], [30.0, 85.0, 0.0, 10.0]])
    budget = make_budget(Spike(height), whole, pairs=mirror, trials=200)
    for spread in (budget.values.total, *budget.values.alone.values()):
        assert all(np.all(np.isfinite(part)) for part in vars(spread).values())
    said = budget.to_dict()
    assert np.isfinite(said["expanded_uncertainty"]) and said["expanded_uncertainty"] > 0.0
    assert budget.saturated == (2 if height == 1e6 else 0)
    assert budget.values.unit == ("1/sr" if height < 1e-200 else "%")
    # errors of direction only darken a peak: the interval is not the symmetrical one
    if height == 1.0:
        moved = budget.values.alone["repeatability"]
        assert moved.bias[1, 0] < 0.0 and moved.high[1, 0] <= 1e-12


@pytest.mark.filterwarnings("error")
def test_huge_uncertainties_stay_finite() -> None:
    wide = {"value": 0, "u": 1e3}
    vague = instrument(
        axis={"offset_deg": wide, "repeatability_deg": 10.0},  # the largest there is
        sample={"tilt_deg": wide, "height_mm": wide},
        light={"distance_mm": {"value": 2000, "u": 1e5}, "drift_pct_h": wide, "stray": wide},
        calibration={"flat_field": wide, "colour_matrix": wide, "interval_h": 1e6},
    )
    budget = make_budget(kurt_material("fabric112"), vague, thetas_deg=[30.0], trials=200)
    assert np.isfinite(budget.expanded) and budget.expanded > 100.0


def test_what_cannot_be_is_refused(tmp_path: Path) -> None:
    whole = instrument(bare=False)
    for words, asked in (
        ("at least 100 trials", {"trials": 10}),
        ("do not fit the memory", {"trials": 10**9}),
        ("polar angles in", {"thetas_deg": [95.0]}),
        ("finite directions", {"thetas_deg": [float("nan")]}),
        ("at least one polar angle", {"thetas_deg": []}),
        ("contradict each other", {"thetas_deg": [0.0], "pairs": np.zeros((1, 4))}),
        ("n >= 1", {"pairs": np.zeros((0, 4))}),
        ("did you mean 'drift'", {"sources": ["drft"]}),
        ("--samples must be at least 1", {"samples": 0}),
        ("--seed must be >= 0", {"seed": -1}),
    ):
        refused(words, make_budget, GREY, whole, **asked)
    refused("is a gantry", sr.budget, "lambert", instrument="merkur-gantry")
    low = copy.deepcopy(UTIA)
    low["axis"][0]["range_deg"] = [0, 60]
    refused("reaches theta_i from 0 to 60", make_budget, GREY, described(low), thetas_deg=[70.0])
    assert make_budget(GREY, described(low), trials=100, albedo=False).thetas_deg[-1] == 60.0
    assert "no list of angles" in refusal("budget", "lambert", "--theta", "a,b")
    assert ".csv or .png" in refusal("budget", "lambert", "-o", tmp_path / "b.pdf")
    taken = tmp_path / "b.csv"
    taken.write_text("mine")
    assert "exists" in refusal("budget", "lambert", "-o", taken)
    assert taken.read_text() == "mine"


def test_the_command_writes_what_it_says(tmp_path: Path) -> None:
    pairs = tmp_path / "pairs.txt"
    pairs.write_text("45 0 0 0\n")  # one value
    csv, png = tmp_path / "b.csv", tmp_path / "b.png"
    said = done(
        "budget", "red_velvet", "--pairs", pairs, "--trials", "200", "-o", csv, "-o", png
    )  # fmt: skip
    assert len(said["values"]) == 1 and len(csv.read_text().splitlines()) == (
        1 + 2 * 17 + len(said["curves"])
    )
    assert png.read_bytes()[:4] == b"\x89PNG"
    low, high = np.array(said["values"][0]["interval_95"])
    assert np.all(low < said["values"][0]["f_r"]) and np.all(high > said["values"][0]["f_r"])
    over = {row["over"] for row in said["curves"]}
    assert over == {"hours", "exposures", "price"}
    assert said["dominant"]["U_halved"] < said["dominant"]["U"]
    found = sr.budget("red_velvet", pairs=np.radians([[45.0, 0, 0, 0]]), trials=200)
    assert isinstance(found, Budget) and found.expanded == said["expanded_uncertainty"]
    assert "k = 2" in str(found) and "not stated" in found._repr_html_()

"""Convergence: noise and bias told apart, rates, what is cheapest, samplers, and the command."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
import pytest

from command_line import done, simrig
from refusals import refused
from simrig.core.effects import parse_tolerance
from simrig.evaluation.convergence.ledger import Ledger
from simrig.evaluation.convergence.report import (
    convergence_csv,
    convergence_plot,
    convergence_tables,
)
from simrig.evaluation.convergence.results import Convergence, Point, Reference, fit_rate
from simrig.evaluation.convergence.run import INTEGRATORS, converge, result_so_far
from simrig.evaluation.metrics.replicates import Replicates, difference, distances
from simrig.rendering.render import render
from simrig.rendering.samplers import SAMPLERS, samples_for
from simrig.scenes import bright_corner, sphere

GREY = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.5}}
TOLERANCE = parse_tolerance("dE=3")
SCENE_FILE = """<scene version="3.0.0">
  <integrator type="path"/>
  <sensor type="perspective">
    <film type="hdrfilm">
      <integer name="width" value="16"/><integer name="height" value="16"/>
    </film>
    <sampler type="ldsampler"/>
    <transform name="to_world"><lookat origin="0,0,5" target="0,0,0" up="0,1,0"/></transform>
  </sensor>
  <shape type="sphere"/>
  <emitter type="point">
    <point name="position" x="3" y="0" z="5"/><rgb name="intensity" value="50"/>
  </emitter>
</scene>"""


@pytest.fixture(scope="module")
def corner() -> Convergence:
    """The corner at three levels; time is no matter, so every setting is rendered."""
    from simrig.core import backend

    backend.select("llvm_ad_rgb")
    return converge(
        bright_corner(GREY, resolution=24),
        TOLERANCE,
        integrators=("scene", "direct", "path"),
        samplers=("independent", "stratified"),
        levels=(4, 16, 64),
        budget_seconds=1e3,
        seed=5,
    )


def noisy(rng: np.random.Generator, truth: np.ndarray, sigma: float) -> Replicates:
    halves = truth + sigma * rng.standard_normal((2, *truth.shape))
    return Replicates(halves, 0.0, 2.0, 1.0, (4,))


def point(integrator: str = "path", spp: int = 4, error: float = 1.0, run: float = 1.0) -> Point:
    return Point(integrator, "independent", spp, error, 0.1, 30.0, error, 0.1, 0.0, 0.2, run)


def test_every_setting_is_there_once_and_the_scenes_own_is_not_doubled(corner: Any) -> None:
    settings = [(p.integrator, p.sampler, p.spp) for p in corner.points]
    expected = {
        (i, s, n)
        for i in ("direct", "path")
        for s in ("independent", "stratified")
        for n in (4, 16, 64)
    }
    assert len(settings) == len(set(settings)) and set(settings) == expected
    assert corner.left_out == 0


def test_monte_carlo_noise_falls_with_the_square_root(corner: Any) -> None:
    rates = {(r.integrator, r.sampler): r for r in corner.rates}
    plain = rates["path", "independent"]
    assert plain.slope == pytest.approx(-0.5, abs=0.05)
    assert 0.0 < plain.standard_error < 0.05
    assert rates["path", "stratified"].slope < plain.slope


def test_direct_light_alone_is_biased_and_path_tracing_is_not(corner: Any) -> None:
    finest = {p.integrator: p for p in corner.points if p.spp == 64 and p.sampler == "independent"}
    direct, path = finest["direct"], finest["path"]
    assert direct.bias > 5.0 * direct.noise
    assert direct.bias == pytest.approx(direct.relative_rmse, rel=0.05)
    assert path.bias < 0.2 * path.noise
    assert path.relative_rmse == pytest.approx(path.noise, rel=0.1)


def test_reference_states_a_standard_error_that_is_right(corner: Any) -> None:
    """A render of as many samples in other random numbers is about as far away, times √2."""
    stated = corner.reference
    assert stated.suffices and stated.error == stated.delta_e <= 0.15
    scene = mi.load_dict(bright_corner(GREY, resolution=24))
    images = [render(scene, stated.spp, seed).image for seed in (91, 92)]
    mask = np.ones((24, 24), dtype=bool)
    apart = distances(images[0], images[1], mask)["relative_rms"]
    assert stated.relative_rmse == pytest.approx(apart / np.sqrt(2.0), rel=0.2)


def test_cheapest_meets_the_tolerance_in_the_least_time(corner: Any) -> None:
    cheapest = corner.cheapest
    assert cheapest.integrator == "path" and cheapest.error <= 3.0
    good = [p.run_seconds for p in corner.points if p.error <= 3.0]
    assert cheapest.run_seconds == min(good)


def test_nothing_is_named_when_nothing_is_good_or_known_well_enough() -> None:
    known = Reference(64, 0.01, 0.01, 0.01, 1.0, True)
    unknown = Reference(64, 0.9, 0.01, 0.9, 1.0, False)
    points = (point(error=0.5, run=2.0), point(error=0.6, run=1.0), point(error=3.5, run=0.1))
    assert Convergence(TOLERANCE, known, points, (), 0).cheapest == points[1]
    assert Convergence(TOLERANCE, known, points[2:], (), 0).cheapest is None
    doubtful = Convergence(TOLERANCE, unknown, points, (), 0)
    assert doubtful.cheapest is None
    assert "raise --budget-seconds" in convergence_tables(doubtful)[-1]


@pytest.mark.usefixtures("variant_llvm")
def test_no_time_leaves_out_settings_and_says_so() -> None:
    result = converge(
        sphere(GREY, resolution=16),
        TOLERANCE,
        integrators=["direct"],
        samplers=["independent"],
        levels=(1, 4),
        budget_seconds=1e-9,
    )
    assert result.points == () and result.left_out == 2
    *_, rates, last = convergence_tables(result)
    assert "too few numbers of samples to fit" in rates and "2 settings had no time left" in last


def test_rate_is_the_slope_of_exact_power_laws() -> None:
    points = [
        Point("path", "independent", n, 1, 1, 1, 1, 3.0 * n**-0.75, 0, 0, 1) for n in (1, 4, 16)
    ]
    rate = fit_rate(points, "path", "independent")
    assert rate is not None and rate.points == 3
    assert rate.slope == pytest.approx(-0.75) and rate.standard_error < 1e-9
    assert fit_rate(points[:2], "path", "independent") is None
    assert fit_rate(points, "path", "stratified") is None


@pytest.mark.parametrize("sigma", [0.0, 0.002, 0.02])
def test_noise_is_not_read_as_change(rng: np.random.Generator, sigma: float) -> None:
    truth = rng.uniform(0.2, 0.8, (48, 48, 3))
    found = difference(noisy(rng, truth, sigma), noisy(rng, truth, sigma))
    for change in found.changes.values():
        assert change.least == 0.0
        assert change.measured == pytest.approx(change.noise, rel=0.1, abs=1e-9)
        assert change.corrected <= 0.35 * change.measured + 1e-9


def test_change_is_found_below_noise(rng: np.random.Generator) -> None:
    """A change of 2 %, in noise of 1 % per pixel, is measured in every metric."""
    truth = rng.uniform(0.2, 0.8, (48, 48, 3))
    exact = difference(noisy(rng, truth, 0.0), noisy(rng, 1.02 * truth, 0.0))
    found = difference(noisy(rng, truth, 0.005), noisy(rng, 1.02 * truth, 0.005))
    for metric, change in found.changes.items():
        true = exact.changes[metric].measured
        assert exact.changes[metric].noise == pytest.approx(0.0, abs=1e-12)
        assert change.corrected == pytest.approx(true, rel=0.15)
        assert 0.3 * true < change.least <= true
    assert exact.changes["relative"].measured == pytest.approx(0.02)


def test_common_random_numbers_lower_the_floor(rng: np.random.Generator) -> None:
    truth = rng.uniform(0.2, 0.8, (32, 32, 3))
    first = noisy(rng, truth, 0.02)
    same_noise = Replicates(first.halves + 1e-3, 0.0, 1.0, 1.0, (4,))
    assert difference(first, same_noise).changes["relative"].noise < 1e-9
    assert difference(first, same_noise).changes["relative"].least == pytest.approx(2e-3, rel=0.1)


def test_black_in_both_does_not_dilute(rng: np.random.Generator) -> None:
    first, second = np.zeros((2, 16, 16, 3))
    first[:4], second[:4] = 0.5, 0.6
    pair = [Replicates(np.stack([image] * 2), 0.0, 1.0, 1.0, (1,)) for image in (first, second)]
    assert difference(*pair).changes["relative"].measured == pytest.approx(0.2)


@pytest.mark.usefixtures("variant_llvm")
@pytest.mark.parametrize("sampler", SAMPLERS)
@pytest.mark.parametrize("wanted", [1, 16, 1024])
def test_samplers_draw_what_they_are_asked_for(sampler: str, wanted: int) -> None:
    spp = samples_for(sampler, wanted)
    assert mi.load_dict({"type": sampler, "sample_count": spp}).sample_count() == spp
    assert 0.5 * wanted <= spp <= 4 * wanted


@pytest.mark.usefixtures("variant_llvm")
@pytest.mark.parametrize("sampler", SAMPLERS)
def test_scenes_are_rendered_with_another_sampler(sampler: str) -> None:
    """Whatever its own is, a scene is the same on average, and seeds are independent."""
    scene = mi.load_dict(bright_corner(GREY, resolution=16))
    spp = samples_for(sampler, 64)
    first, second = (render(scene, spp, seed, "path", sampler=sampler).image for seed in (1, 2))
    assert np.abs(first - second).max() > 0.0
    own = render(scene, 1024, 3, "path").image
    assert first.mean() == pytest.approx(own.mean(), rel=0.02)
    error = np.abs(first - second).mean()
    alone = [render(scene, spp, seed, "path", sampler="independent").image for seed in (1, 2)]
    assert error <= 1.1 * np.abs(alone[0] - alone[1]).mean()


@pytest.mark.usefixtures("variant_llvm")
@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: samples_for("halton", 4), "unknown sampler"),
        (lambda: samples_for("stratified", 8), "powers of 4"),
        (lambda: converge(sphere(GREY), TOLERANCE, integrators=["paht"]), "did you mean 'path'"),
        (lambda: converge(sphere(GREY), TOLERANCE, budget_seconds=0.0), "above 0 s"),
    ],
)
def test_bad_arguments_are_refused_in_one_line(make: Any, message: str) -> None:
    refused(re.escape(message), make)


def test_csv_and_plot_hold_every_setting(corner: Any, tmp_path: Path) -> None:
    rows = list(csv.DictReader(convergence_csv(corner, tmp_path / "c.csv").splitlines()))
    assert len(rows) == len(corner.points)
    assert float(rows[-1]["delta_e"]) == corner.points[-1].delta_e
    assert convergence_plot(corner, tmp_path / "c.png").startswith(b"\x89PNG")


@pytest.mark.usefixtures("in_empty_folder")
def test_the_command_prints_and_writes_the_same(tmp_path: Path) -> None:
    (tmp_path / "scene.xml").write_text(SCENE_FILE)
    arguments = ["converge", "scene.xml", "--tolerance", "relative=0.05", "--output", "out"]
    arguments += ["--integrator", "direct", "--sampler", "independent"]
    arguments += ["--budget-seconds", "1000"]  # more than it takes on any machine
    data = done(*arguments)
    assert data["scene"] == "scene.xml" and data["unit"] == "relative radiance"
    assert data["cheapest"]["integrator"] == "direct"
    assert {"rows", "rates", "reference", "left_out"} <= data.keys()
    assert json.loads((tmp_path / "out" / "convergence.json").read_text()) == data
    assert {"convergence.csv", "convergence.png"} <= {p.name for p in (tmp_path / "out").iterdir()}


def test_integrators_name_the_depths_they_trace() -> None:
    for name, integrator in INTEGRATORS.items():
        if name.startswith("path-"):
            assert integrator == {"type": "path", "max_depth": int(name.removeprefix("path-"))}


def interrupted_after(points: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let Ctrl-C come while the setting after some others is rendered."""
    from simrig.evaluation.convergence import run as convergence

    render_pair, calls = convergence._pair, []

    def pair(*arguments: Any) -> Any:
        calls.append(arguments)
        if len(calls) > points:
            raise KeyboardInterrupt
        return render_pair(*arguments)

    monkeypatch.setattr(convergence, "_pair", pair)


ONE_METHOD: dict[str, Any] = {
    "integrators": ("direct",),
    "samplers": ("independent",),
    "levels": (1, 4, 16, 64),
    "budget_seconds": 1e3,
}


@pytest.mark.usefixtures("variant_llvm")
def test_an_interrupted_convergence_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With the same numbers as without the interruption, and nothing is rendered twice."""
    scene = sphere(GREY, resolution=16)
    whole = converge(scene, TOLERANCE, **ONE_METHOD)
    with monkeypatch.context() as patch:
        interrupted_after(2, patch)
        with pytest.raises(KeyboardInterrupt):
            converge(scene, TOLERANCE, **ONE_METHOD, ledger=Ledger.kept_in(tmp_path))
    kept = Ledger.kept_in(tmp_path)
    assert [p.spp for p in kept.points] == [1, 4] and kept.seconds > 0.0
    assert result_so_far(kept, TOLERANCE).points == tuple(kept.points)
    with monkeypatch.context() as patch:
        interrupted_after(2, patch)  # two more are enough
        resumed = converge(scene, TOLERANCE, **ONE_METHOD, ledger=kept)
    assert [p.error for p in resumed.points] == [p.error for p in whole.points]
    assert resumed.reference.spp == whole.reference.spp
    kept.close()
    assert list(tmp_path.iterdir()) == []


def test_a_ledger_whose_reference_is_damaged_is_empty(tmp_path: Path) -> None:
    Ledger.kept_in(tmp_path).kept.put("reference", {"no": "reference"})
    [piece] = tmp_path.rglob("*.npz")
    piece.write_bytes(piece.read_bytes()[:50])
    assert Ledger.kept_in(tmp_path).reference is None


@pytest.mark.usefixtures("in_empty_folder")
def test_a_budget_that_the_reference_takes_leaves_a_folder_without_settings(tmp_path: Path) -> None:
    (tmp_path / "scene.xml").write_text(SCENE_FILE)
    data = done("converge", "scene.xml", "--budget-seconds", "1e-9", "--output", "out")
    assert data["rows"] == [] and data["cheapest"] is None and data["left_out"] > 0
    kept = json.loads((tmp_path / "out" / "convergence.json").read_text())
    assert kept["reference"] == data["reference"]


@pytest.mark.usefixtures("in_empty_folder")
@pytest.mark.parametrize("output", [(), ("--output", "out")])
def test_ctrl_c_shows_what_there_is_and_the_same_command_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, output: tuple[str, ...]
) -> None:
    (tmp_path / "scene.xml").write_text(SCENE_FILE)
    arguments = ["converge", "scene.xml", "--integrator", "direct", "--sampler", "independent"]
    arguments += ["--tolerance", "relative=0.05", *output]
    with monkeypatch.context() as patch:
        interrupted_after(2, patch)
        stopped = simrig(*arguments, "--json")
    assert stopped.exit_code == 130, stopped.output
    shown = json.loads(stopped.stdout)
    assert shown["interrupted"] and len(shown["rows"]) == 2
    assert not (tmp_path / "out").exists()
    data = done(*arguments)
    assert (data["rows"][:2] == shown["rows"]) is bool(output), "seconds tell whether it went on"
    if output:
        assert not list((tmp_path / "out").glob(".convergence*"))
        assert not list(tmp_path.glob(".out*"))

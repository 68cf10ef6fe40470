"""``import simrig as sr``: what it offers, that it is light, and the whole path through it."""

from __future__ import annotations

import ast
import inspect
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import simrig as sr
from simrig.brdf import Lambert
from simrig.btf.synthetic import bumps
from simrig.core.errors import SimrigError
from simrig.core.shown import Shown
from simrig.directions.discs import disc
from simrig.evaluation.metrics.meanings import BRDF_METRICS

ROOT = Path(__file__).resolve().parents[1]
PACKED = ("plugins", "scenes", "evaluation")  # top-level folders that install below simrig


@pytest.fixture(scope="module")
def btf() -> sr.Btf:
    return bumps(resolution=(4, 4))


def test_importing_is_light_and_names_are_loaded_when_used() -> None:
    code = (
        "import sys, simrig as sr\n"
        "heavy = {'mitsuba', 'drjit', 'numpy', 'scipy', 'typer', 'simrig.core'}\n"
        "print(sorted(heavy & set(sys.modules)), 'measure' in dir(sr))\n"
        "sr.SimrigError\n"
        "print(sorted({'mitsuba', 'drjit'} & set(sys.modules)))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.stdout == "[] True\n[]\n", done.stderr


def test_type_checkers_see_the_names_that_there_are() -> None:
    """The stub and the table of homes say the same, and every name is there and documented."""
    tree = ast.parse((ROOT / "simrig" / "__init__.pyi").read_text())
    stub = {
        alias.asname: (node.module, alias.name)
        for node in tree.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    homes = {name: (home, sr._HOME_NAME.get(name, name)) for name, home in sr._HOME.items()}
    assert stub == homes
    assert {"__version__", *stub} == set(sr.__all__)
    for name in homes:
        item = getattr(sr, name)
        assert inspect.getdoc(item), name
        if inspect.isfunction(item):
            assert "Raises:" in inspect.getdoc(item) or name == "materials", name
            assert all(
                parameter.annotation is not parameter.empty
                for parameter in inspect.signature(item).parameters.values()
            ), name
    with pytest.raises(AttributeError, match="no attribute 'look'"):
        _ = sr.look


@pytest.mark.slow
def test_the_example_is_typed_strictly(tmp_path: Path) -> None:
    """mypy is shown the installed layout, as ``make types`` shows it."""
    (block,) = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    (tmp_path / "simrig").mkdir()
    for path in [*(ROOT / "simrig").iterdir(), *(ROOT / name for name in PACKED)]:
        (tmp_path / "simrig" / path.name).symlink_to(path)
    wrong = "reveal_type(scan.cost.samples)\nreveal_type(image.image)\nsr.mesure\n"
    (tmp_path / "example.py").write_text(f"{block}\n{wrong}")
    settings = ("--strict", "--follow-imports=silent", "--config-file", ROOT / "pyproject.toml")
    done = subprocess.run(
        [sys.executable, "-m", "mypy", *map(str, settings), "example.py"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=300,
    )
    said = [line.split(": ", 1)[1] for line in done.stdout.splitlines() if "example.py" in line]
    assert said[0] == 'note: Revealed type is "int"', done.stdout
    assert "ndarray" in said[1]
    assert [line for line in said if line.startswith("error")] == said[2:], said
    assert len(said) == 3 and 'maybe "measure"?' in said[2], said


def test_what_is_read_is_told_by_content(tmp_path: Path, btf: sr.Btf) -> None:
    satin = sr.load("yellow_satin")
    assert isinstance(satin, sr.Brdf)
    assert sr.load("leather_tan").name == "leather_tan"
    path = sr.save(satin, tmp_path / "satin.h5")
    again = sr.load(path)
    np.testing.assert_array_equal(np.asarray(again), np.asarray(satin))
    assert isinstance(sr.load(sr.save(btf, tmp_path / "bumps.h5")), sr.Btf)
    assert set(sr.materials()) > {"lambert", "fabric112", "leather_tan"}


def test_nothing_is_overwritten_unless_asked(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    sr.save(sr.load("lambert"), path)
    before = path.read_bytes()
    with pytest.raises(SimrigError, match="exists"):
        sr.save(sr.load("ward"), path)
    assert path.read_bytes() == before
    sr.save(sr.load("ward"), path, overwrite=True)
    assert sr.load(path).name == "ward"


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: sr.load("yelow_satin"), "did you mean 'yellow_satin'"),
        (lambda: sr.load("leather_tam"), "did you mean 'leather_tan'"),
        (lambda: sr.load("no.h5"), "no file 'no.h5'|'no.h5'"),
        (lambda: sr.save(3, "a.h5"), "what can be saved"),
        (lambda: sr.measure("leather_tan"), "measure its BTF"),
        (lambda: sr.measure(3), "a BRDF is needed, got int"),
        (lambda: sr.compare("lambert", np.zeros((16, 16, 3))), "not one of each"),
        (lambda: sr.compare("lambert", "ward", exposure=2.0), "has no exposure"),
        (lambda: sr.compare("lambert", "ward", theta_max_deg=-10.0), "theta|polar angle"),
        (lambda: sr.measure("lambert", plan="slises"), "did you mean 'slices'"),
        (lambda: sr.measure("lambert", rig="gantri"), "did you mean 'gantry'"),
        (lambda: sr.measure("lambert", samples=3), "too few"),
        (lambda: sr.measure("lambert", tolerance="dE"), "is no tolerance"),
        (lambda: sr.reconstruct(3), "a measurement is needed"),
        (lambda: sr.load(None), "a name or a file is needed"),
        (lambda: sr.measure("lambert", plan=3), "the name of one is needed"),
        (lambda: sr.average("lambert"), "only a BTF has texels"),
        (lambda: sr.pareto(3), "one or a list of them"),
        (lambda: sr.scene("sphere", ["lambert"] * 4), "got a list"),
        (lambda: sr.scene("sphere", "lambert", rotation=float("nan")), "finite number"),
        (lambda: sr.critical_distance("twill_blue", spp=0), "spp must be a whole number"),
        (lambda: sr.render(sr.scene("sphere", "lambert", resolution=16), spp="a"), "got 'a'"),
        (lambda: sr.reconstruct("yellow_satin"), "a measurement is needed"),
        (lambda: sr.scene("spere", "lambert"), "did you mean 'sphere'"),
        (lambda: sr.scene("sphere", "lambert", resolutoin=3), "did you mean 'resolution'"),
        (lambda: sr.scene("sphere", "lambert", scale=3.0), "scale is that of a BTF"),
        (lambda: sr.render({"type": "scene"}, spp=1, tolerance="dE=1"), "replace the plan"),
        (lambda: sr.critical_distance("a.png"), "how wide it is"),
        (lambda: sr.critical_distance("fabric112"), "no structure to see"),
        (lambda: sr.critical_distance("twill_blu"), "did you mean 'twill_blue'"),
        (lambda: sr.critical_distance("twill_blue", size_mm=4.0), "only a picture needs it"),
        (lambda: sr.study("tabel-5-3"), "did you mean 'table-5-3'"),
        (lambda: sr.pareto("fabric112", methods=["slises"]), "did you mean 'slices'"),
    ],
)
def test_bad_input_is_refused_in_one_line(call, message: str) -> None:
    with pytest.raises(SimrigError, match=message) as refused:
        call()
    assert "\n" not in str(refused.value)


def test_the_example_of_the_door(tmp_path: Path) -> None:
    satin = sr.load("yellow_satin")
    scan = sr.measure(satin, samples=3230)
    assert scan.cost.samples == 3230
    assert "3,230 samples, 11 h of simulated hardware" in str(scan.cost)
    ours = sr.reconstruct(scan, method="slices")
    found = sr.compare(satin, ours, step_deg=10)
    assert 0.0 < found.mre < 30.0
    assert str(found).startswith(f"CIE ΔE 1976 {found.delta_e:.4g} ΔE, log error ")
    assert f"MRE {found.mre:.4g} %" in str(found)
    truth, image = (sr.render(sr.scene("sphere", m), spp=16) for m in (satin, ours))
    seen = sr.compare(truth, image)
    assert seen.delta_e == sr.compare(truth.image, np.asarray(image)).delta_e > 0.0
    sr.save(ours, tmp_path / "satin.h5")
    sr.save(image, tmp_path / "satin.exr")
    assert sr.compare(truth, tmp_path / "satin.exr").delta_e == seen.delta_e
    assert sr.compare("yellow_satin", tmp_path / "satin.h5", step_deg=10).mre == found.mre


@pytest.mark.usefixtures("in_empty_folder")
def test_the_readme_runs(capsys: pytest.CaptureFixture[str]) -> None:
    (block,) = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    assert len([line for line in block.splitlines() if line.strip()]) == 12
    exec(compile(block, "README.md", "exec"), {})
    printed = capsys.readouterr().out.splitlines()
    assert printed[0].startswith("8,911 samples, 25.5 h of simulated hardware")
    assert [line.split()[0] for line in printed[1:]] == ["CIE", "128", "CIE"]
    assert Path("ours.h5").is_file() and Path("ours.exr").is_file()


@pytest.mark.parametrize(
    ("wished", "method", "samples"),
    [
        ({"rig": "gantry"}, "gantry-b", 168),
        ({"plan": "uniform", "samples": 500, "tolerance": None}, "barycentric", 435),
        ({"plan": "regular-grid", "samples": 500, "tolerance": None}, "regular-grid", None),
    ],
)
def test_any_rig_and_plan_and_the_method_that_belongs_to_it(
    wished: dict, method: str, samples: int | None, tmp_path: Path
) -> None:
    scan = sr.measure("fabric112", **wished)
    assert samples in (None, len(scan))
    path = sr.save(scan, tmp_path / "scan.h5")
    by_default = np.asarray(sr.reconstruct(path))
    np.testing.assert_array_equal(by_default, np.asarray(sr.reconstruct(scan, method=method)))


def test_a_render_says_its_cost_and_its_error() -> None:
    scene = sr.scene("sphere", "fabric112", resolution=32)
    by_hand = sr.render(scene, spp=4)
    assert (by_hand.plan, by_hand.error) == (None, None)
    planned = sr.render(scene, tolerance="dE=1")
    assert planned.image.shape == (32, 32, 3)
    assert 0.0 <= planned.error <= 1.0
    assert planned.cost.compute_seconds > 0.0
    plan = sr.plan(scene, "dE=1", enable=["inter-reflection"])
    assert plan.on("inter-reflection")
    checked = sr.render(scene, plan=plan).plan
    assert checked.settings == plan.settings
    assert checked.about["verification"]["checked"]
    assert sr.render(scene, plan=plan, verify=False).plan is plan


def test_a_btf_renders_at_its_scale(btf: sr.Btf) -> None:
    with pytest.raises(SimrigError, match="needs its scale"):
        sr.scene("sphere", btf)
    seen = sr.render(sr.scene("sphere", btf, scale=200.0, resolution=32), spp=4)
    flat = sr.render(sr.scene("sphere", sr.average(btf), resolution=32), spp=4)
    assert np.ptp(seen.image[14:18, 14:18, 0]) > 2.0 * np.ptp(flat.image[14:18, 14:18, 0])


def shown() -> list[Shown]:
    truth, other = sr.load("fabric112"), sr.load("lambert")
    scene = sr.scene("sphere", "fabric112", resolution=16)
    pictures = [sr.render(scene, spp=1), sr.render(scene, spp=2)]
    return [
        truth,
        pictures[0],
        sr.plan(scene),
        sr.compare(truth, other, step_deg=20),
        sr.compare(*pictures),
        sr.measure("fabric112", rig="gantry"),
    ]


def test_results_show_themselves_in_a_notebook(btf: sr.Btf) -> None:
    for item in [*shown(), btf]:
        text, png = item._repr_html_(), item._repr_png_()
        assert text.startswith("<div>") and text.count("<") == text.count(">"), type(item)
        assert len(text) < 300_000
        assert png is None or png.startswith(b"\x89PNG")
        assert (png is None) == ("<img" not in text)
        assert "\n" not in str(item)
        assert len(repr(item)) < 2_000


def test_directions_are_seen_from_above() -> None:
    """phi = 0 is to the right and 90° at the top; the horizon is the edge."""
    red, green, blue = np.eye(3)
    theta, phi = np.radians([80.0, 80.0, 0.0]), np.radians([0.0, 90.0, 45.0])
    picture = disc(theta, phi, np.array([red, green, blue]), 101).astype(int)
    for colour, (row, column) in ((red, (50, 94)), (green, (6, 50)), (blue, (50, 50))):
        assert picture[row, column].tolist() == (255 * colour).astype(int).tolist()
    assert picture[0, 0].tolist() == [255, 255, 255]
    assert picture[80, 50].tolist() == [230, 230, 230]


def test_what_is_shown_is_escaped() -> None:
    lambert = Lambert(name="<script>alert('a')</script>")
    assert "<script" not in lambert._repr_html_()
    assert "&lt;script&gt;" in lambert._repr_html_()


def test_results_are_numpy_arrays(btf: sr.Btf) -> None:
    picture = sr.render(sr.scene("sphere", "lambert", resolution=16), spp=1)
    np.testing.assert_array_equal(np.asarray(picture), picture.image)
    assert np.asarray(picture, dtype=np.float64).dtype == np.float64
    assert np.asarray(btf).shape == btf.values.shape
    scan = sr.measure("lambert", rig="gantry")
    np.testing.assert_array_equal(np.asarray(scan), scan.values)
    grid = np.asarray(sr.load("lambert"))
    assert grid.shape == (6, 6, 24, 24, 3)
    assert np.ptp(grid) == 0.0
    found = sr.compare("lambert", "ward", step_deg=20)
    np.testing.assert_array_equal(
        np.asarray(found), [getattr(found, name) for name in BRDF_METRICS]
    )


def test_the_automatic_plan_measures_and_its_file_is_reconstructed(tmp_path: Path) -> None:
    satin = sr.load("purple_satin")
    scan = sr.measure(satin, samples=300, plan="auto", tolerance=None)
    path = sr.save(scan, tmp_path / "scan.h5")
    ours = sr.reconstruct(path)
    direction = np.array([[0.3, 0.1, 0.8], [0.1, -0.5, 0.6]])
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    truth = satin.eval(direction, direction[::-1])
    assert ours.eval(direction, direction[::-1]) == pytest.approx(truth, rel=0.1)
    with pytest.raises(SimrigError, match="measurement by plan"):
        sr.reconstruct(scan, "slices")
    with pytest.raises(SimrigError, match="plan"):
        sr.measure(satin, plan="autto")
    with pytest.raises(SimrigError, match="until"):
        sr.measure(satin, plan="slices", until=1.0)

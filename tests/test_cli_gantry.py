"""``simrig measure --rig gantry`` and what ``simrig reconstruct`` makes of its files."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from command_line import done, refusal
from simrig.files.load import load_material
from simrig.rigs.measurements.measurement import Measurement

pytestmark = pytest.mark.usefixtures("in_empty_folder")


@pytest.fixture
def gantry_file() -> str:
    done("measure", "wood01", "--rig", "gantry", "--output", "g.h5")
    return "g.h5"


def test_from_the_gantry_to_a_brdf(gantry_file: str) -> None:
    measurement = Measurement.load(gantry_file)
    assert measurement.plan.samples == 168
    assert measurement.cost.hardware_seconds == pytest.approx(360.0)
    found = done("reconstruct", gantry_file, "--output", "r.h5")
    assert (found["method"], found["options"]["interpolation"]) == ("gantry-b", "pchip")
    assert found["samples"] == 168 and "slices combined by 'sum'" in found["notes"]
    assert 0.0 < done("compare", "wood01", "r.h5", "--step", "20")["mre"] < 60.0
    assert "is a measurement" in refusal("compare", "wood01", gantry_file)


@pytest.mark.parametrize(("method", "note"), [("gantry-a", "condition"), ("gantry-bd", "sum")])
def test_the_other_methods_of_the_gantry(gantry_file: str, method: str, note: str) -> None:
    reconstruct = (
        "reconstruct",
        gantry_file,
        "--output",
        "r.h5",
        "--method",
        method,
        "--step",
        "30",
    )
    found = done(*reconstruct, "--interpolation", "linear")
    assert found["method"] == method and found["options"]["interpolation"] == "linear"
    assert any(note in text for text in found["notes"])
    assert load_material("r.h5").values.shape == (4, 4, 12, 12, 3)
    done("reconstruct", gantry_file, "--output", "b.h5", "--step", "30")
    assert done("compare", "b.h5", "r.h5", "--step", "30", "--theta-max", "60")["mre"] > 0.0


def test_isotropic_plans_and_numbers_of_samples() -> None:
    isotropic = done("measure", "lambert", "--rig", "gantry", "--isotropic", "--output", "i.h5")
    assert isotropic["cost"]["samples"] == 84
    assert isotropic["cost"]["hardware_seconds"] == pytest.approx(180.0)
    found = done("reconstruct", "i.h5", "--output", "r.h5")
    assert "slices combined by 'turning'" in found["notes"]
    many = done("measure", "wood01", "--rig", "gantry", "--samples", "3000", "--output", "m.h5")
    assert 168 < many["cost"]["samples"] <= 3000 and "52.5°" in many["layout"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--rig", "gantry", "--samples", "20"), "at least 32"),
        (("--rig", "gantry", "--plan", "uniform"), "records slices at fixed polar angles"),
        (("--rig", "gantry", "--theta-max", "60"), "'gantry' has no --theta-max"),
        (("--rig", "gantry", "--tolerance", "dE=1"), "no effects"),
        (("--isotropic",), "'slices' has no --isotropic, gantry has"),
    ],
)
def test_measurements_that_cannot_be(options: tuple[str, ...], message: str) -> None:
    assert message in refusal("measure", "wood01", "--output", "g.h5", *options)
    assert not Path("g.h5").exists()


def test_methods_that_cannot_use_a_measurement(
    gantry_file: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    reconstruct = ("reconstruct", gantry_file, "--output", "r.h5")
    for method in ("slices", "along-highlights"):
        assert "gantry-a or gantry-bd" in refusal(*reconstruct, "--method", method)
    for method in ("barycentric", "regular-grid"):
        assert "lacks" in refusal(*reconstruct, "--method", method)
    assert "must divide 360" in refusal(*reconstruct, "--step", "7")
    done("measure", "wood01", "--plan", "scheme", "--scheme", "1", "--ideal", "--output", "s.h5")
    of_scheme = ("reconstruct", "s.h5", "--output", "r.h5", "--method", "gantry-b")
    assert "needs a measurement by plan 'gantry', this one is by plan 'scheme'" in refusal(
        *of_scheme
    )
    monkeypatch.setitem(sys.modules, "ot", None)
    assert "pip install 'simrig[transport]'" in refusal(*reconstruct, "--method", "gantry-bd")
    assert not Path("r.h5").exists()

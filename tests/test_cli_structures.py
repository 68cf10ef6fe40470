"""``simrig materials`` for materials with structure: the list, one of them, its picture."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from simrig.cli import structures
from simrig.cli.app import app
from simrig.data.images import read_image
from simrig.mesostructure import PRESETS


def simrig(*arguments: str) -> Result:
    return CliRunner().invoke(app, ["materials", *arguments])


def refusal(*arguments: str) -> str:
    result = simrig(*arguments)
    assert result.exit_code == 2, result.output
    assert result.stderr.startswith("error: ") and result.stderr.count("\n") == 1
    return result.stderr


def test_the_list_has_all_of_them() -> None:
    listed = json.loads(simrig("--structures", "--json").stdout)["structures"]
    assert [entry["name"] for entry in listed] == list(PRESETS)
    assert {"group", "description", "element_mm", "size_mm"} < set(listed[0])


def test_one_is_described() -> None:
    about = json.loads(simrig("leather_tan", "--json").stdout)
    assert about["group"] == "leather meso" and about["element_mm"] == 1.9
    assert about["triangles"] == 2 * 256**2


@pytest.mark.slow
def test_one_is_drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(structures, "_PICTURE_PIXELS", 32)
    monkeypatch.setattr(structures, "_PICTURE_SPP", 4)
    path = tmp_path / "tile.png"
    done = simrig("tile_blue", "--picture", str(path))
    assert done.exit_code == 0, done.output
    red, _, blue = read_image(path).mean(axis=(0, 1))
    assert blue > 1.5 * red
    assert "exists: choose another" in refusal("tile_blue", "--picture", str(path))


def test_what_makes_no_sense_is_refused(tmp_path: Path) -> None:
    assert "lists all of them" in refusal("twill_blue", "--structures")
    assert ".png or .exr" in refusal("twill_blue", "--picture", str(tmp_path / "a.jpg"))

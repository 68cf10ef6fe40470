"""``simrig materials`` for materials with structure: the list, one of them, its picture."""

from __future__ import annotations

from pathlib import Path

import pytest

from command_line import done, refusal, simrig
from simrig.cli import structures
from simrig.files.images import read_image
from simrig.mesostructure import PRESETS


def test_the_list_has_all_of_them() -> None:
    listed = done("materials", "--structures")["structures"]
    assert [entry["name"] for entry in listed] == list(PRESETS)
    assert {"group", "description", "element_mm", "size_mm"} < set(listed[0])


def test_one_is_described() -> None:
    about = done("materials", "leather_tan")
    assert about["group"] == "leather meso" and about["element_mm"] == 1.9
    assert about["triangles"] == 2 * 256**2


@pytest.mark.slow
def test_one_is_drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(structures, "_PICTURE_PIXELS", 32)
    monkeypatch.setattr(structures, "_PICTURE_SPP", 4)
    path = tmp_path / "tile.png"
    drawn = simrig("materials", "tile_blue", "--picture", path)
    assert drawn.exit_code == 0, drawn.output
    red, _, blue = read_image(path).mean(axis=(0, 1))
    assert blue > 1.5 * red
    assert "exists: choose another" in refusal("materials", "tile_blue", "--picture", path)


def test_what_makes_no_sense_is_refused(tmp_path: Path) -> None:
    assert "lists all of them" in refusal("materials", "twill_blue", "--structures")
    assert ".exr or .png" in refusal("materials", "twill_blue", "--picture", tmp_path / "a.jpg")

"""``simrig stimuli``: tiny pictures, films that go on, and refusals in one line."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import pytest

from command_line import done, refusal, simrig
from simrig.core.errors import SimrigError
from simrig.directions.schemes import hemisphere_81, uniform_scheme
from simrig.files.images import read_image
from simrig.plans.listed import named_scheme
from simrig.viewing.stimuli import pictures as stimuli

SMALL = ("--texels", "4", "--directions", "1", "--spp", "1", "--resolution", "48")


made = partial(done, "stimuli")
refused = partial(refusal, "stimuli")


@pytest.mark.slow
def test_cylinders_become_a_picture(tmp_path: Path) -> None:
    path = tmp_path / "bumps.exr"
    about = made("cylinders", "bumps", "--output", path, *SMALL)
    picture = read_image(path)
    assert about["size"] == [48, 27] and picture.shape == (27, 48, 3)
    assert picture.max() > 0.0 and about["exposure"] == 1.0


@pytest.mark.slow
def test_a_material_is_measured_once(tmp_path: Path) -> None:
    how = ("cylinders", "wood_beech", *SMALL, "--measured", tmp_path / "measured")
    made(*how, "--output", tmp_path / "first.exr")
    (file,) = (tmp_path / "measured").iterdir()
    before = file.stat().st_mtime_ns
    made(*how, "--output", tmp_path / "second.exr")
    assert file.stat().st_mtime_ns == before
    first, second = (read_image(tmp_path / f"{name}.exr") for name in ("first", "second"))
    np.testing.assert_array_equal(first, second)
    other = [word if word != "4" else "8" for word in how]
    said = refused(*other, "--output", tmp_path / "third.exr")
    assert "another measurement, with other texels" in said


@pytest.mark.slow
def test_an_interrupted_film_goes_on_with_the_missing_frame(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    film = ("rotation", "bumps", "--output", tmp_path / "film", "--seconds", "0.05", *SMALL)
    written, write = [], stimuli.write_png

    def interrupted(path: Path, *arguments: object) -> None:
        if written:
            raise KeyboardInterrupt
        written.append(path.name)
        write(path, *arguments)

    with monkeypatch.context() as patch:
        patch.setattr(stimuli, "write_png", interrupted)
        result = simrig("stimuli", *film)
    assert result.exit_code == 130 and "goes on" in result.stderr
    assert made(*film)["rendered"] == 1
    assert len(list((tmp_path / "film").glob("frame_*.png"))) == 2


def test_a_folder_of_something_else_takes_no_film(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    message = refused("rotation", "bumps", "--output", tmp_path, *SMALL)
    assert "notes.txt" in message and "--overwrite" in message


def test_the_chessboard_comes_with_its_widths(tmp_path: Path) -> None:
    path = tmp_path / "chessboard.png"
    about = made("chessboard", "--output", path, "--resolution", "96", "--spp", "1")
    assert path.read_bytes().startswith(b"\x89PNG")
    assert len(about["widths"]) == 20 and about["exposure"] > 0.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("form", "options"), [("switched", ("--distance", "3")), ("brdf", ())], ids=lambda x: str(x)
)
def test_the_room_becomes_a_picture(tmp_path: Path, form: str, options: tuple[str, ...]) -> None:
    from simrig.scenes.room import ROOM_PARTS

    bumps = [word for part in ROOM_PARTS for word in ("--material", f"{part}=bumps")]
    path = tmp_path / "room.exr"
    about = made("room", "--output", path, "--form", form, *bumps, *SMALL, *options)
    assert read_image(path).shape == (27, 48, 3)
    assert set(about["distances_mm"].values()) == ({3000.0} if options else set())


def test_directions_are_named_as_for_a_measurement() -> None:
    for name in ("81x81", "hemisphere_81"):
        np.testing.assert_array_equal(named_scheme(name).vectors(), hemisphere_81().vectors())
    assert len(named_scheme("7")) == len(uniform_scheme(7))
    with pytest.raises(SimrigError, match=r"unknown scheme '80x80'.*81x81"):
        named_scheme("80x80")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("cylinders", "canvas_biege"), "did you mean 'canvas_beige'"),
        (("cylinders", "missing.h5"), "no file 'missing.h5'"),
        (("cylinders", "bumps", "--directions", "81x82"), "did you mean '81x81'"),
        (("cylinders", "bumps", "--experiment", "C"), "experiment"),
        (("rotation", "bumps", "--seconds", "0"), "at least one frame"),
        (("rotation", "bumps", "--seconds", "inf"), "an end, got inf"),
        (("chessboard", "--square", "-2"), "above 0, got -2"),
        (("rotation", "bumps", "--directions", "31"), "31"),
        (("room", "--form", "btff"), "did you mean 'btf'"),
        (("room", "--distances", "predict"), "did you mean 'predicted'"),
        (("room", "--distances", "groups", "--distance", "2"), "leave one of them out"),
        (("room", "--form", "btf", "--distance", "2"), "no switch"),
        (("room", "--form", "brdf", "--distances", "groups"), "no switch"),
        (("room", "--material", "walls"), "PART=MATERIAL"),
        (("room", "--material", "wals=bumps"), "did you mean 'walls'"),
        (("room", "--material", "walls=bumps", "--material", "walls=a.h5"), "twice for 'walls'"),
    ],
)
def test_bad_input_is_refused_and_leaves_nothing(
    tmp_path: Path, arguments: tuple[str, ...], message: str
) -> None:
    assert message in refused(*arguments, "--output", tmp_path / "new.png")
    assert not list(tmp_path.iterdir())


def test_a_file_is_not_measured_in_another_way(tmp_path: Path) -> None:
    file = tmp_path / "measured.h5"
    file.touch()
    for option in (("--texels", "4"), ("--directions", "1"), ("--measured", tmp_path)):
        for command, output in (("cylinders", "new.png"), ("rotation", "new")):
            said = refused(command, file, "--output", tmp_path / output, *option)
            assert "leave out --texels, --directions and --measured" in said


@pytest.mark.parametrize("command", [("cylinders", "bumps"), ("chessboard",), ("room",)])
def test_outputs_are_pictures_and_are_not_replaced_unasked(
    tmp_path: Path, command: tuple[str, ...]
) -> None:
    assert "ends in .exr or .png" in refused(*command, "--output", tmp_path / "new.jpg")
    path = tmp_path / "old.png"
    path.write_bytes(b"old")
    assert "--overwrite" in refused(*command, "--output", path)
    assert path.read_bytes() == b"old"

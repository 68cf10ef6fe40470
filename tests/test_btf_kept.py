"""BTFs that are measured once: read the next time, and never taken for another measurement."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from refusals import refused
from simrig.btf.stack import BtfStack
from simrig.directions.schemes import HemisphereScheme, Ring
from simrig.files.btf.hdf5 import read_btf
from simrig.mesostructure import build_tile
from simrig.rigs.btf import kept as btf_kept
from simrig.rigs.btf.kept import kept_btf
from simrig.rigs.btf.rig import btf_angles
from simrig.viewing.room import room_materials
from simrig.viewing.stimuli.materials import stimulus_stack

FEW = HemisphereScheme.from_rings("few", [Ring(0.0, 1), Ring(50.0, 3)])
FEWER = HemisphereScheme.from_rings("fewer", [Ring(0.0, 1), Ring(50.0, 2)])

pytestmark = pytest.mark.usefixtures("variant_llvm")


def kept(path: Path | None, name: str = "wood_beech", scheme: HemisphereScheme = FEW, **how):
    tile, texels = build_tile(name, resolution=16), how.pop("texels", 4)
    return kept_btf(path, tile, btf_angles(scheme), texels, **({"spp": 2, "bounces": 1} | how))


@pytest.fixture
def unmeasured(monkeypatch: pytest.MonkeyPatch):
    """From its call on nothing may be measured any more."""

    def forbid() -> None:
        monkeypatch.setattr(btf_kept, "measure_btf", lambda *_, **__: pytest.fail("measured"))

    return forbid


def test_it_is_measured_once(tmp_path: Path, unmeasured) -> None:
    path = tmp_path / "made" / "beech.h5"
    first = kept(path)
    in_memory = kept(None)
    unmeasured()
    for again in (kept(path), kept(path, bounces="auto")):
        for stack in (first, in_memory):
            np.testing.assert_array_equal(again.values[()], stack.values[()])
        assert again.provenance["bounces"] == 1


@pytest.mark.parametrize(
    ("other", "named"),
    [
        ({"spp": 4}, "samples per texel"),
        ({"bounces": 2}, "bounces"),
        ({"seed": 1}, "seed"),
        ({"texels": 8}, "texels"),
        ({"scheme": FEWER}, "directions"),
        ({"name": "leather_tan"}, "tile"),
        ({"spp": 4, "seed": 1}, "samples per texel and seed"),
    ],
)
def test_another_measurement_is_refused_and_stays(
    tmp_path: Path, unmeasured, other: dict, named: str
) -> None:
    path = tmp_path / "beech.h5"
    before = kept(path).values[()]
    unmeasured()
    refused(rf"another measurement, with other {named}: remove it", kept, path, **other)
    np.testing.assert_array_equal(read_btf(path).values[()], before)


def test_a_file_of_another_origin_is_refused(tmp_path: Path) -> None:
    from simrig.files.btf.hdf5 import write_btf

    path = tmp_path / "beech.h5"
    measured = kept(None)
    write_btf(path, BtfStack(measured.values, measured.angles, measured.size_mm, "beech"))
    refused("another measurement", kept, path)


def test_a_folder_that_cannot_be_is_refused(tmp_path: Path) -> None:
    (tmp_path / "folder").write_text("a file")
    refused(r"cannot write .*beech", kept, tmp_path / "folder" / "beech.h5")


def test_an_interrupted_measurement_goes_on(tmp_path: Path) -> None:
    path, calls = tmp_path / "beech.h5", []

    def interrupt(done: int, total: int) -> None:
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        kept(path, progress=interrupt)
    assert not path.exists()
    found = kept(path, progress=lambda *call: calls.append(call))
    assert calls[-1] == (4, 4)
    np.testing.assert_array_equal(found.values[()], kept(None).values[()])


@pytest.mark.slow
def test_the_materials_of_a_room_are_kept(tmp_path: Path, unmeasured) -> None:
    bumps = dict.fromkeys(("aisle", "carpet"), "bumps")
    names = {**dict.fromkeys(room_parts(), "wood_lime"), **bumps}
    how = {"texels": 4, "directions": FEW, "spp": 2, "tile_steps": 16, "bounces": 1}
    made = room_materials(names, folder=tmp_path, **how)
    assert [file.name for file in tmp_path.iterdir()] == ["wood_lime.h5"]  # bumps take no time
    unmeasured()
    again = stimulus_stack("wood_lime", folder=tmp_path, **how)
    np.testing.assert_array_equal(again.values[()], made["walls"].stack.values[()])


def room_parts() -> tuple[str, ...]:
    from simrig.scenes.room import ROOM_PARTS

    return tuple(ROOM_PARTS)

"""``simrig btf``: from a preset to a file, a folder and back, and a BRDF; refusals in one line."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from command_line import done, refusal, simrig
from simrig.brdf.protocol import evaluate
from simrig.btf.average import average_brdf
from simrig.btf.stack import BtfStack
from simrig.btf.synthetic import bumps
from simrig.core.errors import SimrigError
from simrig.directions.schemes import uniform_scheme
from simrig.files.btf import images as btf_images
from simrig.files.btf.hdf5 import read_btf, write_btf
from simrig.files.btf.source import find_pictures
from simrig.files.load import load_material
from simrig.mesostructure import build_tile
from simrig.plans.listed import named_scheme
from simrig.rigs.btf.rig import by_view
from simrig.rigs.measurements.measurement import Measurement
from simrig.rigs.registry import make_rig

made = partial(done, "btf")
refused = partial(refusal, "btf")


@pytest.fixture
def pairs(tmp_path: Path) -> Path:
    path = tmp_path / "pairs.csv"
    path.write_text("# degrees\n10, 0, 0, 0\n50.25, 30, 90, 45\n60 30 10 45\n")
    return path


def test_measure_info_convert_and_back(tmp_path: Path, pairs: Path) -> None:
    file, folder, again = tmp_path / "a.h5", tmp_path / "pictures", tmp_path / "b.h5"
    small = ("--resolution", "6", "--spp", "2", "--bounces", "2", "--pairs", pairs)
    said = made("measure", "leather_nappa", "--output", file, *small)
    assert said["images"] == 3
    assert said["provenance"]["bounces"] == 2
    assert said["standard_error"] > 0.0
    assert "leather_nappa" in simrig("btf", "info", file).stdout
    made("convert", file, folder)
    made("convert", folder, again)
    first, second = read_btf(file), read_btf(again)
    assert second.size_mm == first.size_mm
    order = [np.argmin(np.abs(first.angles - a).sum(axis=1)) for a in second.angles]
    np.testing.assert_allclose(second.angles, first.angles[order], atol=1e-12)
    np.testing.assert_array_equal(second.values[()], first.values[()][order])


def test_the_average_of_a_btf_renders_as_a_material(tmp_path: Path) -> None:
    stack = bumps((4, 4), (8.0, 8.0), "uniform_1")
    file, brdf = tmp_path / "bumps.h5", tmp_path / "brdf.h5"
    write_btf(file, stack)
    made("average", file, "--output", brdf)
    wi, wv = stack.directions
    found = evaluate(load_material(str(brdf)), wi, wv)
    expected = np.stack([np.asarray(v, dtype=np.float64).mean(axis=(0, 1)) for v in stack.values])
    # at 90° and beyond the light is gone; the scheme ends at 80°
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-7)


def test_the_order_of_pairs_does_not_change_the_average() -> None:
    stack = bumps((2, 2), (8.0, 8.0), "uniform_1")
    angles = by_view(stack.angles)
    where = np.lexsort(stack.angles.T)[np.argsort(np.lexsort(angles.T))]
    other = BtfStack(np.asarray(stack.values)[where], angles, stack.size_mm)
    wi, wv = stack.directions
    first, second = (evaluate(average_brdf(s), wi, wv) for s in (stack, other))
    np.testing.assert_allclose(first, second, rtol=1e-6)


def test_an_average_needs_all_pairs() -> None:
    stack = bumps((2, 2), (8.0, 8.0), "uniform_1")
    lacking = BtfStack(np.asarray(stack.values)[:-1], stack.angles[:-1], stack.size_mm)
    with pytest.raises(SimrigError, match=r"lacks 1 of 841 images \(theta_i .* theta_v .*btf fill"):
        average_brdf(lacking)
    one_view = BtfStack(np.asarray(stack.values)[::29], stack.angles[::29], stack.size_mm)
    with pytest.raises(SimrigError, match="other directions"):
        average_brdf(one_view)


def test_an_interrupted_folder_of_pictures_is_finished_by_the_same_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stack, folder = bumps((2, 2), (8.0, 8.0), "uniform_1"), tmp_path / "pictures"
    file = write_btf(tmp_path / "bumps.h5", BtfStack(stack.values[:9], stack.angles[:9], (8, 8)))
    write, done_before = btf_images.write_exr, []

    def interrupted(path: Path, *arguments: object) -> None:
        if len(done_before) == 5:
            raise KeyboardInterrupt
        write(path, *arguments)
        done_before.append(path)

    monkeypatch.setattr(btf_images, "write_exr", interrupted)
    assert simrig("btf", "convert", file, folder).exit_code == 130
    assert not folder.exists()
    monkeypatch.setattr(btf_images, "write_exr", write)
    assert made("convert", file, folder)["pictures"] == 9
    (folder / "mine.txt").write_text("kept")
    assert "--overwrite" in refused("convert", file, folder)
    made("convert", file, folder, "--overwrite")
    assert (folder / "mine.txt").read_text() == "kept"
    assert len(find_pictures(folder).names) == 9


def test_what_is_missing_is_filled_from_its_neighbours_on_request(tmp_path: Path) -> None:
    stack = bumps((2, 2), (8.0, 8.0), "uniform_1")
    values, kept = np.asarray(stack.values), np.delete(np.arange(841), [40, 500])
    lacking, whole = tmp_path / "lacking.h5", tmp_path / "whole.h5"
    write_btf(lacking, BtfStack(values[kept], stack.angles[kept], stack.size_mm))
    assert "lacks 2 of 841 images" in refused("average", lacking, "--output", tmp_path / "b.h5")
    said = made("fill", lacking, whole)
    assert len(said["filled"]) == 2 and said["images"] == 841
    assert said["provenance"]["filled"] == 2
    filled = read_btf(whole)
    np.testing.assert_array_equal(filled.values[:839], values[kept])
    np.testing.assert_allclose(filled.angles[839:], stack.angles[[40, 500]], atol=1e-9)
    # a ring of the same view is 60° wide: shading changes that much, but does not turn around
    ratio = filled.values[839:].mean(axis=(1, 2, 3)) / values[[40, 500]].mean(axis=(1, 2, 3))
    np.testing.assert_allclose(ratio, 1.0, atol=0.3)
    made("average", whole, "--output", tmp_path / "b.h5")
    assert "nothing to fill" in refused("fill", whole, tmp_path / "c.h5")


@pytest.mark.parametrize(
    ("text", "count"), [("81x81", 81), ("151x151", 151), ("1", 29), ("uniform_14", None)]
)
def test_directions_by_count_number_and_name(text: str, count: int | None) -> None:
    assert len(named_scheme(text)) == (count or len(uniform_scheme(14)))


def test_bad_input(tmp_path: Path, pairs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    there, new = tmp_path / "there.h5", tmp_path / "new.h5"
    there.write_text("something else")
    assert "exists" in refused("measure", "leather_nappa", "--output", there)
    assert "leather_nappa" in refused("measure", "leather_napa", "--output", new)
    assert "scheme" in refused("measure", "leather_nappa", "--output", new, "--directions", "x")
    assert "1 to 8" in refused("measure", "leather_nappa", "--output", new, "--bounces", "9")
    assert "number" in refused("measure", "leather_nappa", "--output", new, "--bounces", "few")
    pairs.write_text("95 0 0 0\n")
    assert "polar angles in" in refused(
        "measure", "leather_nappa", "--output", new, "--pairs", pairs
    )
    listed = ("measure", "leather_nappa", "--output", new, "--pairs", pairs)
    for text in ("theta phi\n", "10 0 0\n", "10 0 0 0\n10 0 0\n", "# nothing\n"):
        pairs.write_text(text)
        assert "no list of pairs" in refused(*listed)
    pairs.write_text("10 0 0 0\n20 0 0 0\n10 0 360 90\n")
    assert "pairs 1 and 3 of the plan are the same" in refused(*listed)
    assert "leave one of them out" in refused(*listed, "--directions", "81x81")
    assert "does not exist" in refused("measure", "leather_nappa", "--output", "/nowhere/a.h5")
    huge = ("measure", "leather_nappa", "--output", new, "--resolution", "16384")
    assert "21,134,460,321,792 bytes" in refused(*huge)
    assert refused("info", there)
    (tmp_path / "empty").mkdir()
    assert "no picture" in refused("convert", tmp_path / "empty", new)
    for option in (
        ("--size-mm", "3x3"),
        ("--factor", "2"),
        ("--colour", "rgb"),
        ("--with-cosine",),
    ):
        assert "for a folder" in refused("convert", there, tmp_path / "out", *option)
    assert not new.exists()


def test_measure_with_the_rig_is_the_same_measurement(tmp_path: Path) -> None:
    there, here = tmp_path / "there.h5", tmp_path / "here.h5"
    options = ("--resolution", "4", "--spp", "2", "--seed", "3", "--single")
    told = made("measure", "leather_nappa", "--output", there, "--directions", "1", *options)
    rig = ("--rig", "btf", "--scheme", "1")
    said = done("measure", "leather_nappa", *rig, "--output", here, *options)
    assert said["effects"]["settings"] == told["plan"]["settings"]
    first, second = read_btf(there), read_btf(here)
    np.testing.assert_array_equal(first.values[()], second.values[()])
    assert first.provenance["bounces"] == second.provenance["bounces"] > 1
    assert first.values.dtype == np.float32
    measurement = Measurement.load(here)
    np.testing.assert_allclose(measurement.values, first.mean().values, rtol=1e-12)
    assert measurement.plan.name == "scheme" and measurement.cost.hardware_seconds > 0.0
    assert measurement.uncertainty is not None and np.all(measurement.uncertainty >= 0.0)
    measurement.save(tmp_path / "copy.h5")
    assert (tmp_path / "copy.h5").read_bytes() == here.read_bytes()
    few, tile = first.angles[:40:7], build_tile("leather_nappa", seed=3)
    rig_alone: Any = make_rig("btf", resolution=4, spp=64, seed=3)
    recorded = rig_alone.record(tile, few)
    assert np.median(np.abs(recorded.values / measurement.values[:40:7] - 1.0)) < 0.2
    with pytest.raises(SimrigError, match="measures a Brdf, got Tile"):
        make_rig("gonioreflectometer").check(tile, measurement.plan)


def test_any_btf_file_is_a_measurement(tmp_path: Path) -> None:
    stack = bumps((4, 4), (8.0, 8.0), "uniform_1")
    measurement = Measurement.load(write_btf(tmp_path / "bumps.h5", stack))
    np.testing.assert_allclose(measurement.values, stack.mean().values, rtol=1e-12)
    assert measurement.uncertainty is None and measurement.plan.name == "directions"
    assert measurement.pictures is not None and len(measurement.pictures.stack()) == len(stack)

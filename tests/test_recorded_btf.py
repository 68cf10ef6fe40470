"""From a recording to principal components and a picture by plain commands, beside the truth."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from command_line import done, refusal
from simrig.btf.stack import BtfStack
from simrig.btf.synthetic import bumps
from simrig.evaluation.metrics.btfs import compare_btfs
from simrig.files.btf.hdf5 import write_btf

_RECORD = ("--sample-mm", "8", "--lens-mm", "180", "--pixels", "230x230", "--ideal")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a BTF of 29 × 29 directions."""
    place = tmp_path_factory.mktemp("btf")
    write_btf(place / "bumps.h5", bumps((8, 8)))
    return place


def test_a_recorded_btf_is_the_one_that_was_there(folder: Path) -> None:
    pairs = folder / "pairs.txt"
    pairs.write_text("28 0 60 0\n0 28 0 120\n56 28 36 180\n28 56 0 72\n")
    made = folder / "recorded.h5"
    done("record", folder / "bumps.h5", "--pairs", pairs, *_RECORD, "-o", folder / "pictures")
    done(
        "process", "recording", folder / "pictures", "-o", made, "--pixels", "8", "--plane", "marks"
    )
    # bilinear between texels, and a recorded texel is the mean over its square
    stack = bumps((8, 8))
    values = np.asarray(stack.values)
    for axis in (1, 2):
        beside = np.roll(values, 1, axis) + np.roll(values, -1, axis)
        values = 0.75 * values + 0.125 * beside
    write_btf(folder / "seen.h5", replace(stack, values=values))
    found = done("compare", folder / "seen.h5", made)
    assert (found["pairs"], found["alone"]) == (4, 29 * 29 - 4)
    assert found["average_error"] < 0.5  # light and view of a point are not those of the centre
    assert found["log_error"] < 3.0 and found["delta_e"] < 1.0
    assert {row["from_deg"] for row in found["rows"]} == {20.0, 40.0}


def test_both_orders_of_a_pair_are_recorded_unless_asked_otherwise(folder: Path) -> None:
    few = ("--scheme", "1", *_RECORD, "--json")
    refused = refusal("record", folder / "bumps.h5", *few, "--pixels", "1x9999", "-o", folder / "x")
    assert "sensor has" in refused
    from simrig.plans.registry import make_plan

    stack = bumps((2, 2))
    assert make_plan("scheme", stack, scheme="1").samples == 29 * 29
    assert make_plan("scheme", stack, scheme="1", reciprocal=True).samples == 29 * 15


def test_factors_by_number_or_error_and_their_picture(folder: Path) -> None:
    stack, factors = folder / "bumps.h5", folder / "factors.h5"
    eight = done("btf", "factor", stack, factors, "--components", "3")
    assert eight["components"] == 8 and 0.0 < eight["error"] < 0.3
    loose = done("btf", "factor", stack, folder / "loose.h5", "--tolerance", "0.9")
    assert loose["components"] == 8 and loose["error"] == eight["error"]
    shown = ("--scene", "cylinder", "--resolution", "12", "--scale-mm", "100", "--spp", "4")
    for name in ("bumps", "factors"):
        done("render", "--material", folder / f"{name}.h5", *shown, "-o", folder / f"{name}.exr")
    between = done("compare", folder / "bumps.exr", folder / "factors.exr", "--exposure", "2")
    assert 0.0 < between["delta_e"] < 6.0
    assert "needs its scale" in refusal(
        "render", "--material", stack, "--resolution", "12", "-o", folder / "no.exr"
    )
    assert "scale is that of a BTF" in refusal(
        "render", "--material", "lambert", "--scale-mm", "3", "-o", folder / "no.exr"
    )
    assert "at most 64" in refusal("btf", "factor", stack, folder / "no.h5", "--components", "65")


def test_btfs_are_compared_by_what_both_have() -> None:
    stack = bumps((4, 4))
    alike = compare_btfs(stack, stack)
    assert (alike.delta_e, alike.log_error, alike.average_error, alike.rmse) == (0.0, 0.0, 0.0, 0.0)
    turned = replace(stack, angles=stack.angles + np.array([0.0, 0.0, 2.0, -2.0]) * np.pi)
    brighter = replace(turned, values=np.asarray(stack.values) * np.float32(1.02))
    found = compare_btfs(stack, brighter)
    assert found.average_error == pytest.approx(2.0, abs=1e-3) and found.pairs == (841, 0)
    part = BtfStack(stack.values[100:200], stack.angles[100:200], stack.size_mm)
    assert compare_btfs(part, brighter).pairs == (100, 741)
    for other, message in (
        (bumps((4, 5)), "5 × 4 texels"),
        (replace(stack, size_mm=(9.0, 8.0)), "9 × 8 mm"),
        (replace(stack, angles=stack.angles + np.array([0.01, 0.0, 0.0, 0.0])), "no pair"),
    ):
        with pytest.raises(Exception, match=message):
            compare_btfs(stack, other)

"""What the plugin simrig_btf is told is used or refused, and its tables do not stay for ever."""

import gc
from pathlib import Path
from typing import Any

import mitsuba as mi
import pytest

from refusals import refused
from simrig.btf.factored import FactoredBtf
from simrig.btf.stack import BtfStack
from simrig.btf.synthetic import bumps
from simrig.files.btf.hdf5 import write_btf
from simrig.files.hdf5 import write_brdf
from simrig.plugins import btf as plugin
from simrig.plugins import one_line_errors


@pytest.fixture(scope="module")
def stack() -> BtfStack:
    return bumps((8, 12), (12.0, 4.0))


@pytest.fixture(scope="module")
def files(stack: BtfStack, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("btf")
    write_brdf(folder / "factored.h5", FactoredBtf.from_stack(stack, tolerance=0.5))
    return {"stack": write_btf(folder / "stack.h5", stack), "factors": folder / "factored.h5"}


def loaded(path: Path, **options: Any) -> Any:
    with one_line_errors():
        return mi.load_dict(
            {"type": "simrig_btf", "filename": str(path), "scale": 60.0, **options}
        ).brdf


@pytest.mark.parametrize(
    ("file", "options", "said"),
    [
        ("factors", {"tolerance": 0.1}, "'tolerance' can do nothing here"),
        ("factors", {"form": "full"}, "'form' can do nothing here"),
        ("factors", {"missing": "fill"}, "'missing' can do nothing here"),
        ("factors", {"over_budget": "coarsen"}, "'over_budget' can do nothing here"),
        ("factors", {"budget": 0.001}, r"the budget is 0\.0\d+ MiB: raise it"),
        ("stack", {"tolerance": 0.1}, "'tolerance' can do nothing here"),
        ("stack", {"form": "factored", "over_budget": "coarsen"}, "'over_budget' can do nothing"),
        ("stack", {"form": "factored", "missing": "refuse"}, "'missing' can do nothing"),
        ("stack", {"form": "factored", "budget": 0.001}, r"more than the budget of 0\.0\d+ MiB"),
        ("stack", {"budget": 0.001}, r"the budget is 0\.0\d+ MiB: raise it"),
    ],
)
def test_an_option_that_does_nothing_is_refused_and_a_budget_kept(
    files: dict[str, Path], file: str, options: dict, said: str, variant_llvm: Any
) -> None:
    refused(said, loaded, files[file], **options)


def test_options_are_used(files: dict[str, Path], variant_llvm: Any) -> None:
    assert (
        loaded(files["factors"], form="factored", anisotropy=3, pixel_angle=1.0).mipmap.anisotropy
        == 3
    )
    assert loaded(files["factors"]).mipmap.anisotropy == 8
    assert loaded(files["stack"], anisotropy=2, pixel_angle=1.0).mipmap.anisotropy == 2
    coarse = loaded(files["stack"], form="factored", tolerance=0.9)
    fine = loaded(files["stack"], form="factored", tolerance=0.05)
    assert coarse.error > fine.error and fine.error <= 0.05


def test_tables_are_shared_and_go_when_they_are_large(
    files: dict[str, Path], variant_llvm: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = loaded(files["stack"])
    assert loaded(files["stack"]) is first
    assert any(one is first for one in plugin._recent)
    monkeypatch.setattr(plugin, "_KEPT_BYTES", 1000)
    second = loaded(files["stack"], anisotropy=4, pixel_angle=1.0)
    assert not plugin._recent, "both are larger than what is kept"
    keys = len(plugin._shared)
    del first, second
    gc.collect()
    assert len(plugin._shared) < keys

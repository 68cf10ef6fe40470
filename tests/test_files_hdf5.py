"""simrig's own files: what is written comes back, and nothing else is read."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from refusals import refused
from simrig.brdf import Lambert, Ward, evaluate, kurt_material
from simrig.brdf.tables.dense import DenseTable
from simrig.brdf.tables.isotropic import IsotropicTable
from simrig.core.errors import SimrigError
from simrig.directions import to_vector
from simrig.files import hdf5
from simrig.reconstruction.slices.tables import reconstruct


def brdfs(rng: np.random.Generator) -> list:
    return [
        Lambert((0.1, 0.2, 0.3)),
        Ward((0.1, 0.2, 0.3), (0.3, 0.2, 0.1), 0.1, 0.4, "duer"),
        kurt_material("fabric041"),
        DenseTable(np.ones((3, 3, 4, 5, 3)), 0.5, 0.9, beyond="fade"),
        IsotropicTable(rng.uniform(0.1, 1.0, (6, 5, 4, 3)).astype(np.float32), "nearest"),
    ]


@pytest.fixture
def written(tmp_path):
    path = tmp_path / "material.h5"
    hdf5.write_brdf(path, Lambert())
    return path


@pytest.mark.parametrize("index", range(5))
def test_brdf_comes_back(tmp_path, rng, index):
    original = brdfs(rng)[index]
    path = tmp_path / "material.h5"
    hdf5.write_brdf(path, original)
    again = hdf5.read_brdf(path)
    assert type(again) is type(original) and again.name == original.name
    wi, wv = (to_vector(rng.uniform(0, 1.5, 200), rng.uniform(0, 6.28, 200)) for _ in range(2))
    np.testing.assert_array_equal(evaluate(again, wi, wv), evaluate(original, wi, wv))


def test_every_kind_names_a_storable_class():
    from importlib import import_module

    for kind, (module, name) in hdf5.KINDS.items():
        found = getattr(import_module(module), name)
        assert found.kind == kind
        assert callable(found.from_parts) and callable(found.structure)


def test_file_describes_itself(tmp_path):
    path = tmp_path / "material.h5"
    hdf5.write_brdf(path, kurt_material("wood01"), {"seed": 3, "rig": "direct"})
    with hdf5.open_checked(path, "brdf") as file:
        assert hdf5.provenance_of(file) == {"rig": "direct", "seed": 3}
        assert "linear RGB" in file.attrs["conventions"]
        assert file.attrs["kind"] == "kurt"
    assert hdf5.content_of(path) == "brdf"


def test_arrays_carry_units(tmp_path):
    path = tmp_path / "material.h5"
    hdf5.write_brdf(path, DenseTable(np.ones((3, 3, 4, 4, 3)), 0.5))
    with h5py.File(path) as file:
        assert file["data/values"].attrs["units"] == "1/sr"


@pytest.mark.parametrize(
    "key,value,message",
    [
        ("format_version", 99, "install a later simrig"),
        ("format_version", 0, "no valid format version"),
        ("format", "other", "not written by simrig"),
        ("content", "measurement", "holds a measurement, expected a brdf"),
        ("kind", "lamberd", "did you mean 'lambert'"),
        ("provenance", "{", None),
    ],
)
def test_attributes_are_checked(written, key, value, message):
    with h5py.File(written, "r+") as file:
        file.attrs[key] = value
    if message is None:
        with (
            pytest.raises(SimrigError, match="not JSON"),
            hdf5.open_checked(written, "brdf") as file,
        ):
            hdf5.provenance_of(file)
        return
    refused(message, hdf5.read_brdf, written)


def test_truncated_file_is_refused(written):
    content = written.read_bytes()
    written.write_bytes(content[: len(content) // 2])
    refused("damaged or truncated", hdf5.read_brdf, written)


def test_other_files_are_refused(tmp_path):
    path = tmp_path / "notes.h5"
    path.write_text("no HDF5 at all")
    refused("not an HDF5 file", hdf5.read_brdf, path)
    refused("there is no file", hdf5.read_brdf, tmp_path / "missing.h5")


@pytest.mark.parametrize("length", [2**20, 2**40])
def test_claimed_sizes_are_refused_before_reading(written, length):
    with h5py.File(written, "r+") as file:
        del file["data/albedo"]
        file["data"].create_dataset("albedo", (length, 1024), "f8", chunks=(1, 1024))
    refused("which its file cannot hold", hdf5.read_brdf, written)


def test_text_and_links_are_not_arrays(written):
    with h5py.File(written, "r+") as file:
        del file["data/albedo"]
        file["data"]["albedo"] = ["a", "b", "c"]
    refused("not a plain numeric array", hdf5.read_brdf, written)
    with h5py.File(written, "r+") as file:
        del file["data/albedo"]
        file["data/albedo"] = h5py.ExternalLink("elsewhere.h5", "x")
    refused(r"missing|damaged", hdf5.read_brdf, written)


@pytest.mark.parametrize("value", [np.nan, -1.0, np.inf])
def test_values_are_checked(written, value):
    with h5py.File(written, "r+") as file:
        file["data/albedo"][1] = value
    refused("albedo must be", hdf5.read_brdf, written)


def test_missing_parts_are_named(written):
    with h5py.File(written, "r+") as file:
        del file["data/albedo"]
    refused("do not make a 'lambert'", hdf5.read_brdf, written)
    with h5py.File(written, "r+") as file:
        del file["data"]
    refused("damaged", hdf5.read_brdf, written)


def test_array_of_another_shape_is_refused(tmp_path):
    path = tmp_path / "file.h5"
    with hdf5.create(path, "measurement") as file:
        hdf5.write_array(file, "values", np.zeros((4, 3)))
    with hdf5.open_checked(path, "measurement") as file:
        assert hdf5.read_array(file, "values", (None, 3)).shape == (4, 3)
        refused(r"has shape \(4, 3\), expected", hdf5.read_array, file, "values", (None, 4))


def test_failed_writing_leaves_nothing(tmp_path):
    path = tmp_path / "file.h5"
    with pytest.raises(RuntimeError), hdf5.create(path, "measurement"):
        raise RuntimeError("interrupted")
    assert list(tmp_path.iterdir()) == []


def test_unstorable_brdf_is_refused(tmp_path):
    class Odd(Lambert):
        kind = "odd"

    refused("no stored form", hdf5.write_brdf, tmp_path / "odd.h5", Odd())


def rename(attributes: h5py.AttributeManager, names: dict[str, str]) -> None:
    for now, then in names.items():
        attributes[then] = attributes[now]
        del attributes[now]


def test_files_of_version_0_1_still_open(tmp_path: Path, measured: Callable[..., Any]) -> None:
    """Written as version 0.1 named things: ``elevation_step``, ``reflectance``."""
    slices = reconstruct(measured())
    hdf5.write_brdf(tmp_path / "slices.h5", slices)
    with h5py.File(tmp_path / "slices.h5", "r+") as file:
        file.attrs["content"] = "reflectance"
        rename(file["structure"].attrs, {"theta_step": "elevation_step"})
        file["data"].move("intersections", "corners")
    assert hdf5.content_of(tmp_path / "slices.h5") == "brdf"
    back = hdf5.read_brdf(tmp_path / "slices.h5")
    for name, array in slices.data().items():
        np.testing.assert_array_equal(back.data()[name], array)

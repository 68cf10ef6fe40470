"""Databases of BRDFs: the collection, resampling, the virtual database, a user's own folder."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from simrig.brdf import Lambert, kurt_material
from simrig.brdf.tables.barycentric import BarycentricBrdf
from simrig.brdf.tables.dense import DenseTable
from simrig.brdf.tables.resample import resample_dense
from simrig.core.errors import SimrigError
from simrig.database.grid import SliceGrid
from simrig.database.resampling import resampled, shift_to, turned
from simrig.database.slices import Slices, compressed
from simrig.database.store import Database
from simrig.directions.schemes import hemisphere_81
from simrig.directions.spherical import to_vector
from simrig.evaluation.database.build import build_database
from simrig.evaluation.database.character import characterised
from simrig.evaluation.database.variety import variety
from simrig.files.hdf5 import write_brdf
from simrig.files.load import load_material
from simrig.mesostructure.collection import TABLE_A2, WHOLE, collection
from simrig.mesostructure.preset import Preset
from simrig.mesostructure.sheet import CubeCorners

NAMES = ("fabric112", "purple_satin", "fabric002", "fabric041")
STEP = np.radians(15.0)


def _table(name: str) -> DenseTable:
    return resample_dense(kurt_material(name), STEP, 24, np.radians(75.0))


@pytest.fixture
def folder(small_database: Path) -> Path:
    return small_database


def test_the_collection_counts_as_table_a2() -> None:
    recipes = collection()
    counts = Counter(recipe.category for recipe in recipes)
    assert counts == {name: row[0] for name, row in TABLE_A2.items()}
    assert len({recipe.name for recipe in recipes}) == WHOLE == 150
    few = collection(12)
    whole = {recipe.name: recipe for recipe in recipes}
    assert len({recipe.category for recipe in few}) == 9
    assert all(whole[recipe.name] == recipe for recipe in few)
    assert collection(3, 1)[0] != collection(3, 2)[0]


@pytest.mark.parametrize(("count", "seed"), [(0, 0), (151, 0), (3, -1), (2.5, 0)])
def test_a_collection_that_cannot_be_is_refused(count: int, seed: int) -> None:
    with pytest.raises(SimrigError, match="1 to 150 materials"):
        collection(count, seed)


@pytest.mark.parametrize("name", ["fabric112", "purple_satin", "fabric002"])
def test_resampling_is_nearer_to_the_truth_than_barycentric_interpolation(name: str) -> None:
    scheme, truth = hemisphere_81(), kurt_material(name)
    w = to_vector(scheme.theta, scheme.phi)
    values = truth.eval(w[:, None], w[None])
    whole = resample_dense(truth, STEP, 48, np.radians(75.0)).values
    linear = BarycentricBrdf(scheme.theta, scheme.phi, values)
    other = resample_dense(linear, STEP, 48, np.radians(75.0)).values
    floor = 1e-3 * whole.mean()

    def error(table: np.ndarray) -> float:
        return float(np.abs(np.log((table + floor) / (whole + floor))).mean())

    made = resampled(values, name)
    assert error(made.values) < 0.5 * error(other)
    assert made.reciprocal and np.array_equal(made.values, made.values.transpose(1, 0, 3, 2, 4))


def test_resampling_refuses_what_is_no_measurement() -> None:
    with pytest.raises(SimrigError, match="81 × 81"):
        resampled(np.zeros((3, 3, 3)), "few")
    with pytest.raises(SimrigError, match="not finite"):
        resampled(np.full((81, 81, 3), np.nan), "nan")
    assert not resampled(np.zeros((81, 81, 3)), "black").values.any()


@pytest.mark.parametrize("turn", [0, 3, 7])
def test_a_turned_table_is_turned_back(turn: int) -> None:
    table = _table("purple_satin")
    away = turned(table, -turn)
    assert shift_to(table.values, away.values) == turn % 12


def test_the_character_tells_a_satin_from_a_diffuser() -> None:
    assert characterised(_table("purple_satin").values)["strength"] == "strong"
    flat = resample_dense(Lambert(), STEP, 24, np.radians(75.0))
    assert characterised(flat.values) | {"brightness": 0} == {
        "anisotropy": 0.0, "strength": "none", "highlights": 0, "two_colours": False,
        "brightness": 0,
    }  # fmt: skip


def test_cube_corners_cover_their_tile_without_a_gap() -> None:
    tile = Preset("x", "other", "x", CubeCorners(2.0))()
    part = tile.parts[0]
    a, b, c = (part.vertices[part.faces[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a).astype(np.float64)
    assert np.all(normal[:, 2] > 0.0)  # all face up
    assert np.isclose(0.5 * normal[:, 2].sum(), np.prod(tile.size_mm), rtol=1e-6)
    unit = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    for corner in unit.reshape(-1, 3, 3):  # three mirrors at right angles
        assert np.allclose(corner @ corner.T, np.eye(3), atol=1e-5)


def test_a_users_folder_is_a_database(folder: Path) -> None:
    database = Database.open(folder)
    assert [entry.name for entry in database.entries] == sorted(
        NAMES, key=lambda name: ("satin" in name, name)
    )
    assert database["purple_satin"].category == "satins"
    assert database["fabric002"].category == "own"
    assert database.fingerprint == Database.open(folder).fingerprint
    assert len(database.without(["fabric002"])) == 3


def test_databases_that_cannot_be_are_refused(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(SimrigError, match="there is no database"):
        Database.open(tmp_path / "none")
    with pytest.raises(SimrigError, match="no file of a material"):
        Database.open(tmp_path)
    with pytest.raises(SimrigError, match="two materials"):
        Database.open(f"{folder},{folder}")
    with pytest.raises(SimrigError, match="empty folder"):
        Database.open(f"{folder},")
    with pytest.raises(SimrigError, match="fabric002"):
        _ = Database.open(folder)["fabric02"]
    (tmp_path / "database.json").write_text("{}")
    with pytest.raises(SimrigError, match="damaged"):
        Database.open(tmp_path)


def test_a_file_with_nan_is_named_in_one_line(folder: Path, tmp_path: Path) -> None:
    values = np.full((3, 6 * 12, 6 * 12), 0.1)
    values[1, 2, 3] = np.nan
    values.astype("<f8").tofile(tmp_path / "broken.bin")
    write_brdf(tmp_path / "good.h5", _table("fabric002"))
    with pytest.raises(SimrigError, match=r"broken\.bin") as caught:
        Slices.of(Database.open(tmp_path))
    assert "\n" not in str(caught.value)


def test_the_basis_holds_what_it_was_made_of(folder: Path) -> None:
    slices = Slices.of(Database.open(folder))
    assert len(list(folder.glob(".slices-*.npz"))) == 1
    again = Slices.of(Database.open(folder))
    assert all(np.array_equal(a, b) for a, b in zip(slices.factors, again.factors, strict=True))
    basis = slices.basis()
    k = basis.components.shape[1]
    assert np.allclose(basis.components.T @ basis.components, np.eye(k), atol=1e-5)
    assert np.all(np.diff(basis.deviations) <= 1e-6)
    truth = slices.grid.sampled(Database.open(folder).entries[0].load())
    made = np.einsum("pk,krc->prc", basis.components, basis.coefficients[0])
    made += basis.mean[:, None, None]
    assert np.sqrt(np.mean((made - truth) ** 2)) < 0.01 * truth.std()
    whole = np.concatenate([slices.logs(n).reshape(len(basis.mean), -1) for n in range(4)], axis=1)
    whole -= basis.mean[:, None].astype(np.float32)
    exact = np.sqrt(np.linalg.eigvalsh(whole.T @ whole)[::-1][:8])
    few = basis.deviations[:8] * np.sqrt(basis.columns)
    assert np.allclose(few, exact, rtol=2e-3)
    without = slices.basis([0])
    assert without.columns == 3 * 216 and not np.allclose(without.mean, basis.mean)
    with pytest.raises(SimrigError, match="no material is left"):
        slices.basis(range(4))


def test_rows_of_the_grid_interpolate_and_are_exact_at_nodes() -> None:
    grid = SliceGrid()
    chosen = np.arange(0, len(grid.angles), 97)
    weights = grid.rows(*grid.angles[chosen].T)
    assert np.allclose(weights.toarray()[np.arange(len(chosen)), chosen], 1.0)
    between = grid.rows(np.radians([2.0]), np.radians([33.0]), np.radians([179.0]))
    assert np.isclose(between.sum(), 1.0)
    low = grid.rows(np.radians([88.0]), np.radians([88.0]), np.radians([10.0]))
    assert np.isclose(low.sum(), 1.0)  # below the horizon: the nearest row above it
    wi, wv = grid.directions(0.3)
    assert min(wi[:, 2].min(), wv[:, 2].min()) > np.cos(np.radians(84.5))


def test_what_is_compressed_comes_back() -> None:
    rng = np.random.default_rng(0)
    matrix = rng.normal(size=(300, 4)) @ rng.normal(size=(4, 50))
    factor, loading = compressed(matrix.astype(np.float32))
    assert factor.shape[1] <= 5
    assert np.allclose(factor @ loading, matrix, atol=1e-2 * np.abs(matrix).max())
    black, _ = compressed(np.zeros((10, 6), dtype=np.float32))
    assert np.all(np.isfinite(black))


def test_a_database_of_one_black_material_has_a_basis(tmp_path: Path) -> None:
    black = DenseTable(np.zeros((6, 6, 12, 12, 3), dtype=np.float32), STEP, name="black")
    write_brdf(tmp_path / "black.h5", black)
    slices = Slices.of(Database.open(tmp_path))
    basis = slices.basis()
    assert np.all(np.isfinite(basis.components)) and np.all(basis.deviations < 1e-4)
    assert variety(slices)["entropy_rank"] >= 1.0


@pytest.mark.slow
def test_a_build_is_resumed_and_grows(tmp_path: Path) -> None:
    place = tmp_path / "db"
    assert len(build_database(place, 1, texels=4, spp=1)) == 1
    first = (place / "fabric001.h5").read_bytes()
    (place / "fabric001.h5").rename(tmp_path / "kept.h5")
    again = build_database(place, 2, texels=4, spp=1)
    assert [entry.name for entry in again.entries] == ["fabric001", "wood001"]
    assert load_material(place / "fabric001.h5").values.tobytes() == (
        load_material(tmp_path / "kept.h5").values.tobytes()
    )
    assert first
    own, utia = load_material(place / "wood001.h5"), load_material(place / "utia" / "wood001.exr")
    assert own.values.shape == (6, 6, 48, 48, 3)
    assert np.allclose(own.values, utia.values, rtol=1e-5)
    index = json.loads((place / "database.json").read_text())
    assert index["materials"][1]["strength"] in ("strong", "weak", "none")
    with pytest.raises(SimrigError, match="was built with"):
        build_database(place, 2, texels=8, spp=1)
    with pytest.raises(SimrigError, match="no database and not empty"):
        build_database(tmp_path, 1)

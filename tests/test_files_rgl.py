"""Tensor files and RGL BRDFs: Mitsuba agrees, conversions come back, damage is refused."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from refusals import refused
from simrig.brdf import Lambert, Ward, evaluate, kurt_material
from simrig.brdf.tables.dense import DenseTable
from simrig.brdf.tables.resample import resampling_error
from simrig.brdf.tables.warp2d import distribution, invert, sample, single, stack_at
from simrig.core import backend
from simrig.directions import to_vector
from simrig.files.load import load_material
from simrig.files.rgl.reader import read_rgl
from simrig.files.rgl.tensor_file import MAGIC, read_tensors, write_tensors
from simrig.files.rgl.writer import RglResolution, is_mirror_symmetric, write_rgl

COARSE = RglResolution(theta=6, phi=8, warp=33, colour=17)


def directions(rng: np.random.Generator, count: int, largest: float = 1.5) -> np.ndarray:
    return to_vector(rng.uniform(0.0, largest, count), rng.uniform(0.0, 2.0 * np.pi, count))


def by_mitsuba(path, light: np.ndarray, view: np.ndarray) -> np.ndarray:
    """f_r · cos of the light as Mitsuba's own plugin evaluates it, shape (n, 3)."""
    import drjit as dr
    import mitsuba as mi

    bsdf = mi.load_dict({"type": "measured", "filename": str(path)})
    interaction = dr.zeros(mi.SurfaceInteraction3f, len(view))
    interaction.wi = mi.Vector3f(*view.T.astype(np.float32).copy())
    outgoing = mi.Vector3f(*light.T.astype(np.float32).copy())
    return np.array(bsdf.eval(mi.BSDFContext(), interaction, outgoing), dtype=np.float64).T


@pytest.mark.parametrize(
    "name", ["aurora_white", "cc_iris_purple_gem", "chm_orange", "irid_flake_paint1"]
)
def test_measured_material_agrees_with_mitsuba(shared_data, variant_llvm, rng, name):
    path = shared_data(f"rgl/{name}_rgb.bsdf")
    light, view = directions(rng, 5000), directions(rng, 5000)
    ours = evaluate(read_rgl(path), light, view) * light[:, 2:]
    theirs = np.maximum(by_mitsuba(path, light, view), 0.0)
    relative = np.abs(ours - theirs) / (theirs + 1e-4)
    # float32 against float64: rounding of the sample moves steep places a little
    assert np.median(relative) < 3e-6
    assert np.quantile(relative, 0.99) < 3e-4
    assert relative.max() < 1e-2


@pytest.mark.parametrize("material", ["yellow_satin", "fabric041"])
def test_converted_material_agrees_with_mitsuba(tmp_path, variant_llvm, rng, material):
    path = tmp_path / "converted.bsdf"
    write_rgl(path, kurt_material(material), COARSE)
    light, view = directions(rng, 5000), directions(rng, 5000)
    ours = evaluate(read_rgl(path), light, view) * light[:, 2:]
    theirs = by_mitsuba(path, light, view)
    assert theirs.min() >= 0.0
    assert np.quantile(np.abs(ours - theirs) / (theirs + 1e-5), 0.99) < 1e-3


def test_non_reciprocal_table_renders_the_right_way_round(tmp_path, variant_llvm, rng):
    """The light's polar angle doubles the value and the camera's does not, in Mitsuba as here."""
    values = np.ones((3, 3, 1, 1, 3))
    values[2, :] = 2.0
    table = DenseTable(values, np.radians(40.0))
    path = tmp_path / "table.bsdf"
    write_rgl(path, table, RglResolution(theta=12, warp=65, colour=49))
    flat, steep = np.full(200, np.radians(15.0)), np.full(200, np.radians(60.0))
    phi = rng.uniform(0.0, 2.0 * np.pi, (2, 200))
    light, view = to_vector(steep, phi[0]), to_vector(flat, phi[1])
    theirs = by_mitsuba(path, light, view) / light[:, 2:]
    np.testing.assert_allclose(np.median(theirs, axis=0), 1.5, rtol=0.02)
    np.testing.assert_allclose(evaluate(table, light, view), 1.5)


@pytest.mark.parametrize(
    "material,median,weighted",
    [
        (Lambert(), 0.005, 0.01),
        (Ward((0.1, 0.1, 0.1), (0.3, 0.2, 0.1), 0.2, 0.2), 0.01, 0.05),
        (kurt_material("purple_satin"), 0.02, 0.05),
        (kurt_material("fabric041"), 0.02, 0.05),
    ],
)
def test_conversion_error_is_bounded(tmp_path, material, median, weighted):
    path = tmp_path / "converted.bsdf"
    size = write_rgl(path, material)
    assert size == path.stat().st_size
    error = resampling_error(material, read_rgl(path), pairs=4000)
    assert error.median_relative < median
    assert error.weighted_relative < weighted


@pytest.mark.slow
def test_every_kurt_material_survives_conversion(tmp_path):
    from simrig.brdf import KURT_MATERIALS

    for name in KURT_MATERIALS:
        path = tmp_path / f"{name}.bsdf"
        write_rgl(path, kurt_material(name))
        error = resampling_error(kurt_material(name), read_rgl(path))
        assert error.median_relative < 0.02 and error.weighted_relative < 0.08, name


def test_finer_tables_are_closer(tmp_path):
    material, errors, sizes = kurt_material("purple_satin"), [], []
    for resolution in (COARSE, RglResolution(12, 16, 65, 33)):
        sizes.append(write_rgl(tmp_path / "x.bsdf", material, resolution))
        errors.append(resampling_error(material, read_rgl(tmp_path / "x.bsdf"), pairs=4000))
    assert errors[1].median_relative < 0.6 * errors[0].median_relative
    assert sizes[1] > sizes[0]


def test_symmetry_decides_how_many_azimuths_are_stored(tmp_path, rng):
    values = rng.uniform(0.5, 1.0, (3, 3, 8, 8, 3))
    table = DenseTable(values, 0.5)
    expected = ((table, False, 9), (kurt_material("yellow_satin"), True, 5), (Lambert(), True, 1))
    for material, mirrored, azimuths in expected:
        assert is_mirror_symmetric(material) == mirrored
        write_rgl(tmp_path / "x.bsdf", material, COARSE)
        assert len(read_rgl(tmp_path / "x.bsdf").phi_nodes) == azimuths
    write_rgl(tmp_path / "x.bsdf", table, COARSE)
    error = resampling_error(table, read_rgl(tmp_path / "x.bsdf"), pairs=2000)
    assert error.median_relative < 0.06


def test_quarter_of_the_circle_is_read_by_mirroring(tmp_path, variant_llvm, rng):
    """Files of the database with four-fold symmetry: ours equals Mitsuba's reading."""
    write_rgl(tmp_path / "half.bsdf", kurt_material("yellow_satin"), COARSE)
    fields = dict(read_tensors(tmp_path / "half.bsdf"))
    for name in ("phi_i", "vndf", "luminance", "rgb"):
        fields[name] = fields[name][:3]  # from -180° to -90°
    write_tensors(tmp_path / "quarter.bsdf", fields)
    quarter = read_rgl(tmp_path / "quarter.bsdf")
    assert quarter.symmetry == 4
    light, view = directions(rng, 2000), directions(rng, 2000)
    ours = evaluate(quarter, light, view) * light[:, 2:]
    theirs = by_mitsuba(tmp_path / "quarter.bsdf", light, view)
    assert np.quantile(np.abs(ours - theirs) / (theirs + 1e-5), 0.99) < 1e-3


def test_rgl_on_device_agrees_with_numpy(tmp_path, rng):
    write_rgl(tmp_path / "x.bsdf", kurt_material("fabric041"), COARSE)
    brdf = read_rgl(tmp_path / "x.bsdf")
    grid = to_vector(np.array([0.0, 1e-6, 0.5, 1.2, 1.57]), np.array([0.0, 1.0, np.pi, -np.pi, 2]))
    light = np.concatenate((directions(rng, 1000), np.repeat(grid, 5, axis=0)))
    view = np.concatenate((directions(rng, 1000), np.tile(grid, (5, 1))))
    expected = evaluate(brdf, light, view)
    assert np.all(np.isfinite(expected)) and expected.min() >= 0.0
    double = evaluate(brdf, light, view, backend.types("float64").Float)
    np.testing.assert_allclose(double, expected, rtol=1e-6)
    single_precision = evaluate(brdf, light, view, backend.types().Float)
    relative = np.abs(single_precision - expected) / (expected + 1e-4)
    assert np.quantile(relative, 0.99) < 1e-3


def test_rgl_is_continuous_where_the_azimuth_folds(tmp_path):
    write_rgl(tmp_path / "x.bsdf", kurt_material("yellow_satin"), COARSE)
    brdf = read_rgl(tmp_path / "x.bsdf")
    light = to_vector(0.4, 0.7)
    for phi in (0.0, np.pi / 2, np.pi, -np.pi / 2):
        sides = [evaluate(brdf, light, to_vector(0.8, phi + e)) for e in (-1e-8, 0.0, 1e-8)]
        np.testing.assert_allclose(sides[0], sides[2], rtol=1e-5)
        np.testing.assert_allclose(sides[0], sides[1], rtol=1e-5)


def test_warp_and_its_inverse_agree(rng):
    table = rng.uniform(0.0, 1.0, (9, 7))
    u, v = rng.uniform(0.01, 0.99, (2, 500))
    density, marginal, conditional = distribution(table)
    x, y = sample(density, marginal, conditional, u, v)
    again = invert(density, marginal, conditional, single(x), table.shape, x, y)
    np.testing.assert_allclose(again, (u, v), atol=1e-9)


def test_warp_follows_its_density(rng):
    """A histogram of warped samples has the table's integral in every cell."""
    table = rng.uniform(0.2, 1.0, (5, 4))
    x, y = sample(*distribution(table), *rng.uniform(0.0, 1.0, (2, 400_000)))
    counts, _, _ = np.histogram2d(y, x, bins=(4, 3), range=((0, 1), (0, 1)))
    cells = table[:-1, :-1] + table[1:, :-1] + table[:-1, 1:] + table[1:, 1:]
    np.testing.assert_allclose(counts / counts.sum(), cells / cells.sum(), atol=0.003)


def test_stack_holds_beyond_its_nodes():
    for value, expected in ((-5.0, (0, 1.0)), (5.0, (2, 1.0)), (1.5, (1, 0.5))):
        stack = stack_at([((0.0, 1.0, 2.0), np.array([value]))])
        share = {int(index[0]): float(weight[0]) for index, weight in stack}
        assert share[expected[0]] == pytest.approx(expected[1])
        assert sum(share.values()) == pytest.approx(1.0)


def test_tensor_file_comes_back_and_mitsuba_reads_it(tmp_path, variant_llvm, rng):
    import mitsuba as mi

    fields = {
        "text": "a wörd",
        "half": rng.uniform(size=(2, 3)).astype(np.float16),
        "counts": np.arange(5, dtype=np.uint64),
        "empty": np.zeros((0, 4)),
    }
    path = tmp_path / "x.bsdf"
    assert write_tensors(path, fields) == path.stat().st_size
    again = read_tensors(path)
    assert bytes(again["text"]).decode() == "a wörd"
    for name in ("half", "counts", "empty"):
        np.testing.assert_array_equal(again[name], fields[name])
    theirs = mi.tensor_io.read(str(path))
    np.testing.assert_array_equal(theirs["counts"], fields["counts"])


def field(name: bytes, shape: tuple[int, ...], code: int = 10, offset: int = 64) -> bytes:
    entry = struct.pack("<H", len(name)) + name
    entry += struct.pack("<HBQ", len(shape), code, offset)
    return entry + struct.pack(f"<{len(shape)}Q", *shape)


def head(count: int, version: tuple[int, int] = (1, 0)) -> bytes:
    return MAGIC + struct.pack("<BBI", *version, count)


@pytest.mark.parametrize(
    "content,message",
    [
        (b"tensor", "not a tensor file"),
        (b"other_file\0\0" + b"\0" * 50, "not a tensor file"),
        (head(1, (2, 0)), "version 2.0"),
        (head(2**32 - 1), "claims 4294967295 fields"),
        (head(1), "truncated in its header"),
        (head(1) + field(b"rgb", (2**31, 2**31, 2**31)), "does not fit the file"),
        (head(1) + field(b"rgb", (2**63, 2)), "does not fit the file"),
        (head(1) + field(b"rgb", (4,), offset=2**60), "does not fit the file"),
        (head(1) + field(b"rgb", (4,), code=77), "unknown type 77"),
        (head(1) + struct.pack("<H", 3) + b"rgb" + struct.pack("<HBQ", 60000, 10, 0), "60000"),
    ],
)
def test_damaged_tensor_files_are_refused(tmp_path, content, message):
    path = tmp_path / "bad.bsdf"
    path.write_bytes(content)
    refused(message, read_tensors, path)


@pytest.fixture
def fields(tmp_path) -> dict[str, np.ndarray]:
    write_rgl(tmp_path / "good.bsdf", Lambert(), COARSE)
    return {name: array.copy() for name, array in read_tensors(tmp_path / "good.bsdf").items()}


def spoil(fields: dict, name: str, value: float) -> None:
    fields[name].reshape(-1)[7] = value


@pytest.mark.parametrize(
    "change,message",
    [
        (lambda f: f.pop("vndf"), "lacks vndf"),
        (lambda f: f.pop("rgb"), "lacks rgb"),
        (lambda f: spoil(f, "vndf", np.nan), "'vndf' .* values that are not finite"),
        (lambda f: spoil(f, "rgb", np.inf), "'rgb' .* values that are not finite"),
        (lambda f: spoil(f, "ndf", -1.0), "negative values"),
        (lambda f: f.update(theta_i=f["theta_i"][::-1]), "must increase"),
        (lambda f: f.update(theta_i=f["theta_i"][:-1]), "do not fit"),
        (lambda f: f.update(vndf=0.0 * f["vndf"]), "zero everywhere"),
        (lambda f: f.update(rgb=f["rgb"][0]), "must have five dimensions"),
    ],
)
def test_inconsistent_materials_are_refused(tmp_path, fields, change, message):
    change(fields)
    path = tmp_path / "bad.bsdf"
    write_tensors(path, fields)
    refused(message, read_rgl, path)


def test_spectral_material_becomes_rgb(tmp_path, fields):
    wavelengths = np.linspace(400.0, 700.0, 31).astype(np.float32)
    grey = fields.pop("rgb")[:, :, :1]
    fields.update(wavelengths=wavelengths, spectra=np.repeat(grey, 31, axis=2))
    write_tensors(tmp_path / "spectral.bsdf", fields)
    spectral, coloured = read_rgl(tmp_path / "spectral.bsdf"), read_rgl(tmp_path / "good.bsdf")
    pair = to_vector(0.3, 1.0), to_vector(0.6, 2.0)
    np.testing.assert_allclose(evaluate(spectral, *pair), evaluate(coloured, *pair), rtol=1e-5)


@pytest.mark.parametrize("size", [{"phi": 9}, {"warp": 64}, {"colour": 40}, {"theta": 1}])
def test_resolution_is_checked(size):
    refused("phi even, warp and colour odd", RglResolution, **size)


def test_spectra_without_wavelengths_ask_for_them(tmp_path, fields):
    wavelengths = np.linspace(400.0, 700.0, 31).astype(np.float32)
    grey = fields.pop("rgb")[:, :, :1]
    fields.update(spectra=np.repeat(grey, 31, axis=2))
    path = tmp_path / "spectral.bsdf"
    write_tensors(path, fields)
    refused(r"spectra of 31 samples.*--wavelengths FIRST:LAST", read_rgl, path)
    pair = to_vector(0.3, 1.0), to_vector(0.6, 2.0)
    expected = evaluate(read_rgl(tmp_path / "good.bsdf"), *pair)
    stated = load_material(path, wavelengths="400:700")
    np.testing.assert_allclose(evaluate(stated, *pair), expected, rtol=1e-5)
    refused("FIRST:LAST in nm such as 360:1000", load_material, path, wavelengths="400-700")
    write_tensors(path, {**fields, "wavelengths": wavelengths[:-1]})
    refused("30 wavelengths for spectra of 31 samples", read_rgl, path)


def test_double_precision_and_whole_numbers_are_read(tmp_path, fields):
    pair = to_vector(0.3, 1.0), to_vector(0.6, 2.0)
    expected = evaluate(read_rgl(tmp_path / "good.bsdf"), *pair)
    double = {
        name: array.astype(np.float64) if array.dtype.kind == "f" else array
        for name, array in fields.items()
    }
    write_tensors(tmp_path / "double.bsdf", double)
    found = read_rgl(tmp_path / "double.bsdf")
    np.testing.assert_allclose(evaluate(found, *pair), expected, rtol=1e-6)
    assert found.data()["rgb"].dtype == np.float64
    double["rgb"] = np.round(double["rgb"]).astype(np.int32)
    write_tensors(tmp_path / "whole.bsdf", double)
    assert read_rgl(tmp_path / "whole.bsdf").data()["rgb"].dtype == np.float32


def test_unusual_sizes_are_read(tmp_path, fields):
    """A single polar angle with tables, and colour tables that are not square."""
    one = {**fields, "theta_i": fields["theta_i"][:2], "vndf": fields["vndf"][:, :2]}
    one["rgb"] = fields["rgb"][:, :2, :, :3, :]
    write_tensors(tmp_path / "few.bsdf", one)
    found = read_rgl(tmp_path / "few.bsdf")
    assert found.data()["rgb"].shape[2] == 3
    values = evaluate(found, to_vector(0.3, 1.0), to_vector(0.6, 2.0))
    assert np.all(np.isfinite(values)) and values.min() >= 0.0

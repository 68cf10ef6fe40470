"""MERL and UTIA files: layouts, round trips, markers, noise and refusals."""

from __future__ import annotations

import numpy as np
import pytest

from refusals import refused
from simrig.brdf import Ward, evaluate, kurt_material
from simrig.brdf.tables.dense import DenseTable
from simrig.brdf.tables.isotropic import IsotropicTable
from simrig.brdf.tables.resample import resample_dense, resample_isotropic
from simrig.core.errors import SimrigError
from simrig.directions import to_vector
from simrig.files import merl, utia
from simrig.files.load import file_format

SMALL = utia.UtiaLayout(n_theta=3, n_phi=4, theta_step_deg=30.0)


def merl_bytes(planes: np.ndarray, dimensions=(90, 90, 180)) -> bytes:
    return np.array(dimensions, dtype="<i4").tobytes() + planes.astype("<f8").tobytes()


@pytest.fixture(scope="module")
def planes() -> np.ndarray:
    rng = np.random.default_rng(4)
    return rng.uniform(1.0, 100.0, (3, 90, 90, 180))


@pytest.fixture
def merl_file(tmp_path, planes):
    path = tmp_path / "paint.binary"
    path.write_bytes(merl_bytes(planes))
    return path


def reference_lookup(planes: np.ndarray, theta_h: float, theta_d: float, phi_d: float):
    """The database's own look-up of one value, by its published rule."""
    row = int(np.sqrt(np.degrees(theta_h) * 90.0))
    column = int(np.degrees(theta_d))
    turn = int(np.degrees(phi_d % np.pi))
    scale = np.array([1.0, 1.15, 1.66]) / 1500.0
    return planes.reshape(3, -1)[:, turn + 180 * column + 180 * 90 * row] * scale


def test_merl_nearest_is_the_published_lookup(merl_file, planes, rng):
    from simrig.directions.half_difference import from_half_difference

    table = IsotropicTable(merl.read_merl(merl_file).values, "nearest")
    for theta_h, theta_d, phi_d in rng.uniform(0.02, (0.6, 0.6, 6.2), (50, 3)):
        pair = from_half_difference(*np.array([theta_h, 1.0, theta_d, phi_d]))
        expected = reference_lookup(planes, theta_h, theta_d, phi_d)
        np.testing.assert_allclose(evaluate(table, *pair), expected, rtol=1e-6)


def test_merl_file_comes_back(merl_file, tmp_path):
    table = merl.read_merl(merl_file)
    assert table.name == "paint" and table.invalid_bins == 0
    merl.write_merl(tmp_path / "again.binary", table)
    again = merl.read_merl(tmp_path / "again.binary")
    np.testing.assert_allclose(again.values, table.values, rtol=1e-7)
    assert (tmp_path / "again.binary").stat().st_size == merl.SIZE == merl_file.stat().st_size


def test_merl_markers_are_filled(tmp_path, planes):
    marked = planes.copy()
    marked[:, 40, 50, 60] = -1.0
    marked[1, 10, 20, 179] = -0.5
    path = tmp_path / "marked.binary"
    path.write_bytes(merl_bytes(marked))
    filled = merl.read_merl(path)
    assert filled.invalid_bins == 2
    scale = merl.SCALE
    neighbours = [marked[:, 40, 50, 59], marked[:, 40, 50, 61], marked[:, 39, 50, 60]]
    neighbours += [marked[:, 41, 50, 60], marked[:, 40, 49, 60], marked[:, 40, 51, 60]]
    assert any(np.allclose(filled.values[40, 50, 60], n * scale, rtol=1e-6) for n in neighbours)


@pytest.mark.parametrize(
    "content,message",
    [
        (b"", "only 0 bytes"),
        (b"12345678", "only 8 bytes"),
        (merl_bytes(np.zeros(9), (2**31 - 1, 2**31 - 1, 2**31 - 1)), "its dimensions are"),
        (merl_bytes(np.zeros(9), (-90, 90, 180)), "its dimensions are"),
        (merl_bytes(np.zeros(99)), "is truncated"),
    ],
)
def test_merl_refuses_wrong_files(tmp_path, content, message):
    path = tmp_path / "bad.binary"
    path.write_bytes(content)
    refused(message, merl.read_merl, path)


def test_merl_refuses_trailing_bytes_and_damage(merl_file, planes):
    content = merl_file.read_bytes()
    merl_file.write_bytes(content + b"x")
    refused("trailing bytes", merl.read_merl, merl_file)
    for value in (np.nan, np.inf):
        bad = planes.copy()
        bad[2, 3, 4, 5] = value
        merl_file.write_bytes(merl_bytes(bad))
        refused("1 NaN or infinite", merl.read_merl, merl_file)
    merl_file.write_bytes(merl_bytes(-np.ones_like(planes)))
    refused("no measured bin", merl.read_merl, merl_file)


def test_merl_writer_refuses_other_bins(tmp_path):
    with pytest.raises(SimrigError, match="resample_isotropic"):
        merl.write_merl(tmp_path / "x.binary", IsotropicTable(np.ones((4, 4, 4, 3))))
    full_turn = IsotropicTable(np.ones((90, 90, 180, 3), dtype=np.float32), reciprocal=False)
    refused("is not and has", merl.write_merl, tmp_path / "x.binary", full_turn)
    assert list(tmp_path.iterdir()) == []


def test_merl_keeps_a_resampled_material(tmp_path, rng):
    material = Ward((0.1, 0.2, 0.3), (0.3, 0.2, 0.1), 0.2, 0.2)
    merl.write_merl(tmp_path / "ward.binary", resample_isotropic(material))
    table = merl.read_merl(tmp_path / "ward.binary")
    wi, wv = (to_vector(rng.uniform(0, 1.2, 500), rng.uniform(0, 6.28, 500)) for _ in range(2))
    np.testing.assert_allclose(evaluate(table, wi, wv), evaluate(material, wi, wv), rtol=0.02)


def small_table(rng: np.random.Generator) -> DenseTable:
    values = rng.uniform(0.1, 1.0, (3, 3, 4, 4, 3))
    values[0] = values[0, :, :1]
    values[:, 0] = values[:, 0, :, :1]
    values[0, 0] = values[0, 0, 0, 0]
    return DenseTable(values, np.radians(30.0))


def test_utia_layout_is_the_databases(tmp_path, rng):
    """Index = channel · nr · nc + nc · (npi · iti + ipi) + npv · itv + ipv."""
    table = small_table(rng)
    path = tmp_path / "x.bin"
    assert utia.write_utia(path, table) == SMALL
    flat = np.fromfile(path, dtype="<f8")
    for channel, iti, ipi, itv, ipv in ((0, 1, 2, 2, 3), (2, 2, 0, 1, 1), (1, 0, 3, 2, 2)):
        index = channel * 144 + 12 * (4 * iti + ipi) + 4 * itv + ipv
        assert flat[index] == table.values[iti, itv, ipi, ipv, channel]


@pytest.mark.parametrize("kind", ["bin", "exr"])
def test_utia_comes_back(tmp_path, rng, kind):
    table, path = small_table(rng), tmp_path / f"x.{kind}"
    write, read = {
        "bin": (utia.write_utia, utia.read_utia),
        "exr": (utia.write_utia_exr, utia.read_utia_exr),
    }[kind]
    layout = write(path, table)
    tolerance = 0.0 if kind == "bin" else 1e-7
    np.testing.assert_allclose(read(path, layout).values, table.values, rtol=tolerance)


def test_utia_picture_has_illumination_in_rows(tmp_path, rng):
    import OpenEXR

    table, path = small_table(rng), tmp_path / "x.exr"
    utia.write_utia_exr(path, table)
    with OpenEXR.File(str(path)) as file:
        picture = file.channels()["RGB"].pixels
    assert picture.shape == (12, 12, 3)
    np.testing.assert_allclose(picture[4 * 1 + 2, 4 * 2 + 3], table.values[1, 2, 2, 3], rtol=1e-6)


def test_utia_database_grid(tmp_path, rng):
    table = resample_dense(kurt_material("wood01"), np.radians(15.0), 48, np.radians(75.0))
    layout = utia.write_utia(tmp_path / "wood.bin", table)
    assert layout == utia.DATABASE
    again = utia.read_utia(tmp_path / "wood.bin")
    assert (tmp_path / "wood.bin").stat().st_size == 3 * 8 * 288**2
    wi, wv = (to_vector(rng.uniform(0, 1.3, 200), rng.uniform(0, 6.28, 200)) for _ in range(2))
    np.testing.assert_allclose(evaluate(again, wi, wv), evaluate(table, wi, wv), rtol=1e-6)


def test_utia_encodings_and_scale(tmp_path, rng):
    table, path = small_table(rng), tmp_path / "x.bin"
    utia.write_utia(path, table)
    decoded = utia.read_utia(path, SMALL, encoding="srgb", factor=2.0).values
    expected = 2.0 * ((table.values + 0.055) / 1.055) ** 2.4
    np.testing.assert_allclose(decoded, expected)
    refused("did you mean 'srgb'", utia.read_utia, path, SMALL, encoding="srbg")


def test_utia_noise_is_refused_or_clamped(tmp_path, rng):
    path = tmp_path / "x.bin"
    utia.write_utia(path, small_table(rng))
    flat = np.fromfile(path, dtype="<f8")
    flat[100] = -1e-3
    flat.tofile(path)
    refused(r"1 negative of 432 values.*clamp_negative=True", utia.read_utia, path, SMALL)
    assert utia.read_utia(path, SMALL, clamp_negative=True).values.min() == 0.0
    flat[100] = np.nan
    flat.tofile(path)
    refused("1 NaN", utia.read_utia, path, SMALL, clamp_negative=True)


def test_utia_refuses_wrong_sizes(tmp_path, rng):
    path = tmp_path / "x.bin"
    utia.write_utia(path, small_table(rng))
    refused("is truncated", utia.read_utia, path)
    path.write_bytes(path.read_bytes() + b"12345678")
    refused("is too long", utia.read_utia, path, SMALL)


def test_utia_refuses_wrong_pictures(tmp_path, rng):
    path = tmp_path / "x.exr"
    utia.write_utia_exr(path, small_table(rng))
    refused("12×12 pixels; the UTIA layout has 288×288", utia.read_utia_exr, path, utia.DATABASE)
    assert utia.read_utia_exr(path).values.shape == (3, 3, 4, 4, 3)  # it states its layout
    content = path.read_bytes()
    path.write_bytes(content[: len(content) - 200])
    refused(r"damaged|readable", utia.read_utia_exr, path, SMALL)
    path.write_bytes(b"\x76\x2f\x31\x01" + b"garbage" * 10)
    refused("not a readable OpenEXR file", utia.read_utia_exr, path, SMALL)


def test_utia_writer_refuses_other_grids(tmp_path):
    with pytest.raises(SimrigError, match="resample it with resample_dense"):
        utia.write_utia(tmp_path / "x.bin", DenseTable(np.ones((3, 3, 4, 5, 3)), 0.5))


@pytest.mark.parametrize("shape", [(45, 30, 60), (16, 16, 32), (2, 3, 4)])
def test_merl_of_other_sizes_is_read(tmp_path, rng, shape):
    planes = rng.uniform(1.0, 500.0, (3, *shape))
    path = tmp_path / "x.binary"
    path.write_bytes(merl_bytes(planes, shape))
    table = merl.read_merl(path)
    assert table.values.shape == (*shape, 3) and table.reciprocal
    np.testing.assert_allclose(table.values[1, 2, 3], planes[:, 1, 2, 3] * merl.SCALE, rtol=1e-6)
    assert file_format(path) == "merl"
    path.write_bytes(path.read_bytes()[:-8])
    refused(r"its dimensions are .* bytes do not fit them", merl.read_merl, path)


def test_utia_layouts_are_proposed_and_stated(tmp_path):
    path = tmp_path / "dense.bin"
    np.full((3, 360, 360), 0.1).astype("<f8").tofile(path)
    refused(r"--layout N_THETAxN_PHI \(.*12x30.* would fit\)", utia.read_utia, path)
    table = utia.read_utia(path, utia.parse_layout("12x30"))
    assert table.values.shape == (12, 12, 30, 30, 3)
    assert np.degrees(table.theta_max) == pytest.approx(82.5)
    for bad in ("12", "12x", "1x360", "12x30x3", "-12x30"):
        refused("a layout is N_THETAxN_PHI", utia.parse_layout, bad)
    refused("do not end at or before 90°", utia.parse_layout, "12x30", 15.0)

"""BTF stacks and their look-up: exact at what was measured, seamless, averaged right."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from refusals import refused
from simrig.brdf.protocol import evaluate
from simrig.brdf.tables.packed import RELATIVE_ERROR
from simrig.btf.full import FullBtf
from simrig.btf.mipmap import Footprint, Mipmap, box_average
from simrig.btf.stack import BtfStack
from simrig.btf.synthetic import bumps
from simrig.core import backend
from simrig.core.errors import SimrigError
from simrig.directions import to_vector
from simrig.files.btf.hdf5 import HALF_ERROR, read_btf, write_btf
from simrig.files.btf.recording import BtfWriter

# what the packed table keeps of a value, and a little for the sums
STORAGE = {"rtol": 1.01 * RELATIVE_ERROR, "atol": 1e-7}


@pytest.fixture(scope="module")
def stack() -> BtfStack:
    return bumps((8, 12), (12.0, 4.0))


@pytest.fixture(scope="module")
def btf(stack: BtfStack) -> FullBtf:
    return FullBtf.from_stack(stack)


def centre(stack: BtfStack, row: int, column: int) -> tuple[float, float]:
    (height, width), (size_x, size_y) = stack.resolution, stack.size_mm
    return (column + 0.5) / width * size_x, size_y - (row + 0.5) / height * size_y


def at(btf: FullBtf, wi: np.ndarray, wv: np.ndarray, x: float, y: float, *cone: float):
    numbers = [np.full(len(wi), value) for value in (x, y, *cone)]
    return btf.eval_at(wi, wv, Footprint(*numbers))


def random_pairs(rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
    theta, phi = np.arccos(rng.uniform(0.01, 1.0, (2, count))), rng.uniform(0.0, 7.0, (2, count))
    return to_vector(theta[0], phi[0]), to_vector(theta[1], phi[1])


def test_every_texel_is_exact_at_measured_pairs(stack: BtfStack, btf: FullBtf) -> None:
    wi, wv = stack.directions
    for row, column in ((0, 0), (7, 11), (3, 5)):
        found = at(btf, wi, wv, *centre(stack, row, column))
        np.testing.assert_allclose(found, stack.values[:, row, column], **STORAGE)


def test_row_0_is_at_the_top_and_texels_need_not_be_reciprocal(stack, btf) -> None:
    x, y = centre(stack, 0, 0)
    assert (x, y) == pytest.approx((0.5, 3.75))
    wi, wv = stack.directions
    assert np.abs(at(btf, wi, wv, x, y) - at(btf, wv, wi, x, y)).max() > 0.05


def test_the_average_is_that_of_the_images(stack: BtfStack, btf: FullBtf) -> None:
    wi, wv = stack.directions
    mean = stack.mean()
    np.testing.assert_allclose(mean.values, stack.values.mean(axis=(1, 2)), rtol=1e-5)
    np.testing.assert_allclose(evaluate(btf, wi, wv), mean.values, **STORAGE)
    # a footprint of the whole tile or more is the average wherever it lies
    for size in (12.0, 500.0):
        found = at(btf, wi, wv, 1.234, 7.0, size, 3.0 * size, size)
        np.testing.assert_allclose(found, mean.values, **STORAGE)


def test_an_abrdf_is_what_is_looked_up_there(stack: BtfStack, btf: FullBtf, rng) -> None:
    wi, wv = stack.directions
    for x, y in rng.uniform(-20.0, 20.0, (5, 2)).tolist():
        np.testing.assert_allclose(at(btf, wi, wv, x, y), stack.abrdf(x, y).values, **STORAGE)


@given(st.floats(-40.0, 40.0), st.floats(-40.0, 40.0))
def test_the_tile_repeats_without_a_seam(x: float, y: float) -> None:
    mipmap = Mipmap((5, 7), (7.0, 5.0))
    image = np.random.default_rng(3).random((5, 7, 1)).repeat(3, axis=2)
    levels = [box_average(image[None], shape)[0].reshape(-1, 3) for shape in mipmap.shapes]
    table = np.concatenate(levels)
    tables = mipmap.levels(np.ndarray)

    def value(x: float, y: float) -> float:
        footprint = Footprint(*(np.array([v]) for v in (x, y, 1.7, 0.3, 2.9)))
        look_up = lambda texel: table[texel.start + texel.index]  # noqa: E731
        return mipmap.average(footprint, tables, look_up)[0, 0]

    assert value(x, y) == pytest.approx(value(x + 7.0, y - 10.0), abs=1e-9)
    assert value(x, y) == pytest.approx(value(x + 1e-7, y + 1e-7), abs=1e-5)


@pytest.mark.parametrize("resolution", [(1, 1), (1, 9), (5, 3), (16, 16), (13, 27)])
def test_every_level_keeps_the_mean(resolution, rng) -> None:
    images = rng.random((2, *resolution, 3))
    for shape in Mipmap(resolution, (1.0, 1.0)).shapes:
        coarse = box_average(images, shape)
        assert coarse.shape == (2, *shape, 3)
        np.testing.assert_allclose(coarse.mean(axis=(1, 2)), images.mean(axis=(1, 2)), rtol=1e-12)


def test_a_footprint_averages_what_it_covers(rng) -> None:
    """Probes along a grazing footprint see the mean of the texels under it."""
    mipmap = Mipmap((4, 64), (64.0, 4.0), anisotropy=8)
    image = rng.random((4, 64, 3))
    levels = [box_average(image[None], shape)[0].reshape(-1, 3) for shape in mipmap.shapes]
    table = np.concatenate(levels)
    x = np.array([20.0])
    footprint = Footprint(x, np.array([1.5]), np.ones(1), np.array([8.0]), np.zeros(1))
    found = mipmap.average(
        footprint, mipmap.levels(np.ndarray), lambda texel: table[texel.start + texel.index]
    )
    np.testing.assert_allclose(found[0], image[2, 16:24].mean(axis=0), rtol=1e-9)


def test_a_single_texel_has_no_place(rng) -> None:
    single = FullBtf.from_stack(bumps((1, 1)))
    wi, wv = random_pairs(rng, 500)
    everywhere = evaluate(single, wi, wv)
    np.testing.assert_allclose(at(single, wi, wv, 3.3, -4.0), everywhere, rtol=1e-12)
    np.testing.assert_allclose(at(single, wi, wv, 0.1, 9.0, 2.0, 9.0, 3.0), everywhere, rtol=1e-12)


def test_a_constant_stack_is_its_brdf(rng) -> None:
    one = bumps((1, 1))
    values = np.broadcast_to(one.values, (len(one), 6, 5, 3)).copy()
    constant = FullBtf.from_stack(BtfStack(values, one.angles, (3.0, 3.0)))
    wi, wv = random_pairs(rng, 500)
    expected = evaluate(FullBtf.from_stack(one), wi, wv)
    for cone in ((), (0.4, 1.0, 5.0)):
        np.testing.assert_allclose(at(constant, wi, wv, 1.3, 0.7, *cone), expected, rtol=1e-9)


@pytest.mark.parametrize("theta_deg", [20.0, 75.0, 80.0, 85.0, 89.0])
def test_azimuths_have_no_seam(theta_deg: float, btf: FullBtf) -> None:
    phi = np.linspace(0.0, 2.0 * np.pi, 20001)
    moving = to_vector(np.full_like(phi, np.radians(theta_deg)), phi)
    fixed = np.broadcast_to(to_vector(0.6, 2.0), moving.shape)
    for wi, wv in ((moving, fixed), (fixed, moving)):
        circle = at(btf, wi, wv, 2.0, 1.0)
        assert np.isfinite(circle).all() and circle.min() >= 0.0
        np.testing.assert_allclose(circle[0], circle[-1], rtol=1e-9)
        assert np.abs(np.diff(circle, axis=0)).max() < 1e-3


def test_black_below_the_horizon(btf: FullBtf) -> None:
    up, down = np.array([[0.0, 0.0, 1.0]]), np.array([[0.6, 0.0, -0.8]])
    assert not at(btf, up, down, 0.0, 0.0).any()
    assert not at(btf, down, up, 0.0, 0.0).any()
    assert not evaluate(btf, np.full((1, 3), np.nan), up).any()


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_every_type_agrees(precision: str, btf: FullBtf, rng) -> None:
    types = backend.types(precision, "llvm")
    wi, wv = random_pairs(rng, 400)
    cone = [rng.uniform(*limits, 400) for limits in ((-9, 9), (-9, 9), (0.05, 9), (-9, 9), (-9, 9))]
    expected = btf.eval_at(wi, wv, Footprint(*cone))
    device = btf.eval_at(
        *(types.Array3(*w.T.copy()) for w in (wi, wv)), Footprint(*(types.Float(v) for v in cone))
    )
    # float32 moves directions and positions by 1e-7 of steep interpolants
    np.testing.assert_allclose(
        np.array(device).T, expected, atol=2e-5 if precision == "float32" else 1e-12
    )


def test_missing_images_are_named_refused_or_filled(stack: BtfStack) -> None:
    lost = [5, 100, 333]
    keep = np.setdiff1d(np.arange(len(stack)), lost)
    part = BtfStack(stack.values[keep], stack.angles[keep], stack.size_mm, "part")
    theta_i = np.degrees(stack.angles[5, 0])
    refused(rf"'part' lacks 3 of 841 images \(theta_i {theta_i:.1f}°", FullBtf.from_stack, part)
    filled = FullBtf.from_stack(part, missing="fill")
    wi, wv = stack.directions
    found = at(filled, wi, wv, *centre(stack, 2, 2))
    np.testing.assert_allclose(found[keep], stack.values[keep, 2, 2], **STORAGE)
    error = np.abs(found[lost] - stack.values[lost, 2, 2]).max()
    assert 0.0 < error < 0.25 * stack.values[:, 2, 2].max()


def test_a_pair_given_twice_is_refused(stack: BtfStack) -> None:
    twice = np.append(np.arange(len(stack)), 7)
    both = BtfStack(stack.values[twice], stack.angles[twice], stack.size_mm)
    refused("twice", FullBtf.from_stack, both)


def test_the_memory_budget_is_kept(stack: BtfStack) -> None:
    full = FullBtf.from_stack(stack)
    with pytest.raises(SimrigError, match=r"needs 0\.815 MiB as a full"):
        FullBtf.from_stack(stack, budget_bytes=full.device_bytes - 1)
    coarse = FullBtf.from_stack(stack, budget_bytes=full.device_bytes - 1, over_budget="coarsen")
    assert coarse.device_bytes < full.device_bytes
    assert coarse.mipmap.shapes == full.mipmap.shapes[1:]
    wi, wv = stack.directions
    np.testing.assert_allclose(evaluate(coarse, wi, wv), evaluate(full, wi, wv), rtol=2.5e-4)
    with pytest.raises(SimrigError, match="even as a single texel"):
        FullBtf.from_stack(stack, budget_bytes=8, over_budget="coarsen")


def test_values_that_cannot_be_are_refused(stack: BtfStack) -> None:
    values = stack.values.copy()
    values[10, 0, 0, 0] = np.nan
    refused("1 NaN", FullBtf.from_stack, BtfStack(values, stack.angles, stack.size_mm))
    for change, message in (
        ({"size_mm": (0.0, 1.0)}, "width, height"),
        ({"angles": stack.angles[1:]}, "needs angles"),
        ({"values": values.astype(np.float64)}, "float16 or float32"),
        ({"values": values[..., :2]}, "height, width, 3"),
    ):
        parts = {"values": values, "angles": stack.angles, "size_mm": stack.size_mm, **change}
        refused(message, BtfStack, **parts)


def test_a_stored_stack_stays_in_its_file(stack: BtfStack, btf: FullBtf, tmp_path) -> None:
    again = read_btf(write_btf(tmp_path / "stack.h5", stack))
    assert not isinstance(again.values, np.ndarray)
    assert (again.size_mm, again.name, again.provenance) == (
        stack.size_mm,
        stack.name,
        dict(stack.provenance),
    )
    np.testing.assert_array_equal(again.values[()], stack.values)
    wi, wv = stack.directions
    np.testing.assert_array_equal(
        evaluate(FullBtf.from_stack(again), wi, wv), evaluate(btf, wi, wv)
    )


def test_the_error_of_float16_is_as_stated(stack: BtfStack, tmp_path) -> None:
    half = read_btf(write_btf(tmp_path / "half.h5", stack, np.float16)).values[()]
    error = np.abs(half.astype(np.float64) - stack.values)
    assert np.all(error <= np.maximum(HALF_ERROR * stack.values, 2.0**-25))
    bright = BtfStack(stack.values * 1e6, stack.angles, stack.size_mm)
    refused("store it as float32", write_btf, tmp_path / "bright.h5", bright, np.float16)


def test_an_interrupted_measurement_is_continued(stack: BtfStack, tmp_path) -> None:
    path = tmp_path / "measured.h5"
    options = {"name": "measured", "provenance": {"seed": 1}, "dtype": np.float32}

    def writer(**change) -> BtfWriter:
        return BtfWriter(path, stack.angles, (8, 12), stack.size_mm, **{**options, **change})

    with pytest.raises(KeyboardInterrupt), writer() as first:
        first.write(0, stack.values[:500])
        raise KeyboardInterrupt
    assert not path.exists()
    refused("of another job, with seed = 1, asked for is 2", writer, provenance={"seed": 2})
    old = path.with_name("measured.h5.part")
    old.write_bytes(b"what version 0.1 left")
    refused(r"measured\.h5\.part' is .*cannot be continued: remove", writer)
    old.unlink()
    with writer() as second:
        assert second.missing.tolist() == list(range(500, 841))
        second.write(500, stack.values[500:])
    np.testing.assert_array_equal(read_btf(path).values[()], stack.values)
    assert [left.name for left in tmp_path.iterdir()] == ["measured.h5"]

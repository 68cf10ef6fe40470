"""Interpolation along highlights (thesis 5.7, extended) in two dimensions."""

import numpy as np
import pytest

from simrig.brdf import Lambert, Ward, kurt_material
from simrig.brdf.slices.along_highlights import (
    compressed,
    expanded,
    half_vector_turn,
    offsets,
    shift_strength,
)
from simrig.core import backend
from simrig.core.arrays import vector_type
from simrig.evaluation.stability.highlights import highlight_rows
from simrig.evaluation.stability.methods import signals
from simrig.plans.along_slices import SlicePlan, slice_samples
from simrig.plans.placement import SubspacePlacement
from simrig.reconstruction.slices.highlights import (
    HighlightSubspace,
    reconstruct_subspace_along_highlights,
)
from simrig.reconstruction.slices.subspace import reconstruct_subspace
from simrig.rigs.direct.gonioreflectometer import Gonioreflectometer

RIG = Gonioreflectometer()
TURN = 2.0 * np.pi


def place(theta_i, theta_v, step):
    return SubspacePlacement(*np.radians([theta_i, theta_v, step]))


def both(material, where, samples):
    found = slice_samples(RIG.measure(material, SlicePlan(where, samples, "axial-diagonal")))
    return reconstruct_subspace(found, where), reconstruct_subspace_along_highlights(found, where)


def truth(material, where, phi_i, phi_v):
    theta = (np.full(phi_i.shape, t) for t in (where.theta_i, where.theta_v))
    return RIG.record(material, np.stack([*theta, phi_i, phi_v], axis=1)).values


def slanted(theta_i, theta_v, a_n=2, exchanged=False):
    """Return a subspace of the slices of a smooth function, and the function."""
    rng = np.random.default_rng(3)
    count = 360
    position = np.arange(count) * (TURN / count)
    phases = rng.uniform(0.0, TURN, 4)

    def value(m, d):
        phi_i, phi_v = (m + d, m - d) if exchanged else (m - d, m + d)
        wave = np.sin(phi_i + phases[0]) + np.cos(phi_v + phases[1])
        wave = wave + np.sin(2 * phi_v - phi_i + phases[2]) + 3.1
        return np.stack([wave, 0.1 + 0 * wave, 2.0 * wave], axis=-1)

    rows = np.arange(a_n + 1) * np.pi / a_n
    axial = np.stack([value(position, row) for row in rows])
    diagonal = np.stack([value(row, position) for row in rows])
    corners = np.zeros((a_n + 1, 2 * a_n + 1, 3))
    return HighlightSubspace(corners, axial, diagonal, *np.radians([theta_i, theta_v])), value


@pytest.mark.parametrize("thetas", [(30, 75), (75, 30), (10, 12)])
def test_the_turn_of_the_half_vector_is_that_of_the_vectors(thetas, rng):
    theta_i, theta_v = np.radians(thetas)
    d, m = rng.uniform(0, np.pi, 500), rng.uniform(0, TURN, 500)
    x = np.sin(theta_i) * np.cos(m - d) + np.sin(theta_v) * np.cos(m + d)
    y = np.sin(theta_i) * np.sin(m - d) + np.sin(theta_v) * np.sin(m + d)
    turn = half_vector_turn(d, np.sin(theta_i) + 0 * d, np.sin(theta_v) + 0 * d)
    np.testing.assert_allclose(np.exp(1j * (m + turn)), (x + 1j * y) / np.hypot(x, y), atol=1e-12)


def test_strength_is_zero_for_equal_thetas_and_one_at_the_pole():
    equal, pole = np.radians([0.0, 1e-4, 30.0, 80.0]), np.radians([1e-4, 1.0, 60.0])
    assert np.all(shift_strength(equal, equal) == 0.0)
    assert np.all(shift_strength(0.0 * pole, pole)[1:] == 1.0)
    assert shift_strength(np.radians(30.0), np.radians(32.0)) == pytest.approx(1.0)


def test_compression_and_its_inverse_keep_small_and_large_values(rng):
    values = 10.0 ** rng.uniform(-12, 7, (200, 3))
    offset = np.array([1e-3, 1.0, 50.0])
    np.testing.assert_allclose(expanded(compressed(values, offset), offset), values, rtol=1e-12)
    types = backend.types("float32")
    device = vector_type(types.Float)(*(types.Float(channel) for channel in values.T))
    single = np.array(expanded(compressed(device, offset), offset)).T
    # what float32 keeps of a logarithm of up to 23
    np.testing.assert_allclose(single, values, rtol=1e-5)
    assert offsets(np.zeros((5, 3))).tolist() == [1.0, 1.0, 1.0]


@pytest.mark.parametrize("thetas", [(30, 75), (75, 30), (60, 60), (40, 40.5)])
@pytest.mark.parametrize("a_n", [1, 2, 3, 4])
def test_it_is_exact_on_the_slices(thetas, a_n):
    subspace, value = slanted(*thetas, a_n=a_n)
    position = np.radians(np.arange(0.0, 360.0, 1.0))
    for row in range(a_n):
        fixed = np.full(position.shape, row * np.pi / a_n)
        for m, d in ((position, fixed), (fixed, position)):
            np.testing.assert_allclose(
                subspace.eval(m - d, m + d), value(m, d), rtol=1e-9, err_msg=f"row {row}"
            )


@pytest.mark.parametrize("thetas", [(30, 75), (60, 60), (20, 21)])
@pytest.mark.parametrize("step", [360, 180, 90])
def test_it_is_section_5_3_for_an_isotropic_material(thetas, step):
    material = Ward((0.1, 0.2, 0.05), (0.3, 0.2, 0.1), 0.2, 0.2)
    former, along = both(material, place(*thetas, step), 480)
    # the splines along the slices are of other values, and so differ a little
    np.testing.assert_allclose(along.picture(90), former.picture(90), rtol=5e-3)


@pytest.mark.parametrize(
    ("thetas", "step"), [((15, 60), 360), ((30, 75), 360), ((30, 75), 180), ((45, 75), 180)]
)
def test_an_anisotropic_ward_highlight_comes_out_better_than_by_section_5_3(thetas, step):
    material = Ward((0.05, 0.05, 0.05), (0.3, 0.3, 0.3), 0.2, 0.8)
    where = place(*thetas, step)
    former, along = both(material, where, 96 if step == 360 else 192)
    phi = np.arange(0.0, TURN, TURN / 90)
    phi_i, phi_v = (a.ravel() for a in np.meshgrid(phi, phi, indexing="ij"))
    expected = truth(material, where, phi_i, phi_v)

    def error(subspace):
        return np.sqrt(np.mean((subspace.eval(phi_i, phi_v) - expected) ** 2))

    assert error(along) < 0.8 * error(former)


def test_many_slices_converge_to_the_material():
    material, errors = kurt_material("fabric112"), []
    phi = np.arange(0.0, TURN, TURN / 90)
    phi_i, phi_v = (a.ravel() for a in np.meshgrid(phi, phi, indexing="ij"))
    for step, samples in ((90, 300), (30, 1600)):
        where = place(30, 75, step)
        value = both(material, where, samples)[1].eval(phi_i, phi_v)
        errors.append(np.abs(value / truth(material, where, phi_i, phi_v) - 1.0).mean())
    assert errors[1] < 0.2 * errors[0] and errors[1] < 0.01


@pytest.mark.parametrize("a_n", [1, 2, 3])
@pytest.mark.parametrize("apart_deg", [0.0, 1e-9, 1e-3, 0.5, 5.0, 40.0])
def test_no_jump_anywhere_across_both_azimuths(a_n, apart_deg):
    subspace, _ = slanted(35.0, 35.0 + apart_deg, a_n=a_n)
    fine = np.arange(0.0, TURN + 0.01, TURN / 20_000)
    for fixed in (0.0, 1.0, np.pi):
        for phi_i, phi_v in ((fixed + 0 * fine, fine), (fine, fixed + 0 * fine)):
            steps = np.abs(np.diff(subspace.eval(phi_i, phi_v), axis=0))
            assert steps.max() < 0.05  # of values up to 12; a jump of one turn would be near 1


def test_no_jump_from_equal_to_different_thetas():
    phi_i, phi_v = np.random.default_rng(1).uniform(0, TURN, (2, 4000))
    mirror = phi_i + np.pi  # theta_h = 0 at equal polar angles
    for other in (phi_v, mirror):
        values = []
        for apart in (0.0, 1e-6, 1e-4):
            subspace, _ = slanted(50.0, 50.0 + apart, a_n=3)
            values.append(subspace.eval(phi_i, other))
        assert np.abs(values[1] - values[0]).max() < 1e-5
        assert np.abs(values[2] - values[0]).max() < 1e-3


def test_azimuths_one_ulp_beside_a_turn_give_the_same_value():
    subspace, _ = slanted(30.0, 70.0, a_n=3)
    base = subspace.eval(np.array([0.0]), np.array([1.0]))
    for azimuth in (TURN, np.nextafter(TURN, 0), np.nextafter(TURN, 7), np.nextafter(0, -1)):
        found = subspace.eval(np.array([azimuth]), np.array([1.0]))
        np.testing.assert_allclose(found, base, rtol=1e-12)


def test_exchange_of_light_and_view_at_equal_thetas():
    _, subspace = both(kurt_material("yellow_satin"), place(60, 60, 90), 200)
    phi_i, phi_v = np.random.default_rng(2).uniform(0, TURN, (2, 3000))
    np.testing.assert_allclose(subspace.eval(phi_i, phi_v), subspace.eval(phi_v, phi_i), rtol=1e-6)


@pytest.mark.parametrize("a_n", [1, 2, 3])
def test_exchange_of_light_and_view_mirrors_the_subspace(a_n):
    there, _ = slanted(30, 75, a_n)
    back, _ = slanted(75, 30, a_n, exchanged=True)
    phi_i, phi_v = np.random.default_rng(4).uniform(0, TURN, (2, 3000))
    np.testing.assert_allclose(there.eval(phi_i, phi_v), back.eval(phi_v, phi_i), rtol=1e-9)


def test_hard_values_stay_finite_and_not_negative():
    for spike in (0.0, 1e5):
        axial = np.zeros((2, 72, 3))
        axial[0, 10], axial[1, 46] = spike, spike
        subspace = HighlightSubspace(
            np.zeros((2, 3, 3)), axial, np.zeros((2, 72, 3)), *np.radians([20.0, 20.0])
        )
        picture = subspace.picture(72)
        assert np.all(np.isfinite(picture)) and picture.min() >= 0.0
        assert spike > 0.0 or picture.max() == 0.0


def test_one_slice_of_each_kind_needs_two_samples():
    material = Lambert((0.2, 0.3, 0.4))
    for pair in ((30, 60), (40, 40)):
        where = place(*pair, 360)
        found = slice_samples(
            RIG.measure(material, SlicePlan(where, where.intersections, "axial-diagonal"))
        )
        assert len(found.values) == 2
        picture = reconstruct_subspace_along_highlights(found, where, "linear").picture(24)
        expected = np.array([0.2, 0.3, 0.4]) / np.pi
        np.testing.assert_allclose(picture, np.broadcast_to(expected, picture.shape), rtol=1e-6)


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("thetas", [(30, 75), (60, 60), (30, 30.2)])
def test_dr_jit_equals_numpy(rng, precision, thetas):
    _, subspace = both(kurt_material("wood01"), place(*thetas, 120), 200)
    types = backend.types(precision)
    phi_i, phi_v = rng.uniform(-7, 7, (2, 5000))
    expected = subspace.eval(phi_i, phi_v)
    value = np.array(subspace.eval(types.Float(phi_i), types.Float(phi_v))).T
    limit = 2e-4 if precision == "float32" else 1e-10
    assert np.quantile(np.abs(value / expected - 1.0), 0.999) < limit


@pytest.mark.parametrize("name", ["all-zero", "spike", "six-to-minus-twelve", "single-denormal"])
def test_hard_subspaces_in_single_precision_are_explained(name):
    rows = highlight_rows({name: signals()[name]}, "llvm")
    assert len(rows) == 10
    assert all(row.explained and row.non_finite == row.negative == 0 for row in rows), rows

"""The two-dimensional subspace (thesis 5.3), against the four-dimensional form and closed forms."""

import numpy as np
import pytest

from refusals import refused
from simrig.brdf import Lambert, kurt_material
from simrig.core import backend
from simrig.core.errors import SimrigError
from simrig.plans.along_slices import SlicePlan, slice_samples
from simrig.plans.placement import SlicePlacement, SubspacePlacement
from simrig.reconstruction.slices.subspace import reconstruct_subspace
from simrig.reconstruction.slices.tables import reconstruct
from simrig.rigs.direct.gonioreflectometer import Gonioreflectometer

RIG = Gonioreflectometer()


def measured(material, where, samples):
    return slice_samples(RIG.measure(material, SlicePlan(where, samples, "axial-diagonal")))


def placement(theta_i=30, theta_v=75, step=30):
    return SubspacePlacement(*np.radians([theta_i, theta_v, step]))


def error(material, subspace, where, size=180):
    phi = np.arange(size) * (2 * np.pi / size)
    phi_i, phi_v = (a.ravel() for a in np.meshgrid(phi, phi, indexing="ij"))
    theta = (np.full(phi_i.shape, t) for t in (where.theta_i, where.theta_v))
    truth = RIG.record(material, np.stack([*theta, phi_i, phi_v], axis=1)).values
    return np.abs(subspace.picture(size).reshape(-1, 3) / truth - 1.0).mean()


@pytest.mark.parametrize("thetas", [(30, 75), (75, 30), (60, 60)])
def test_corners_and_counts(thetas):
    where = placement(*thetas)
    a_n = where.azimuth_count
    assert where.intersections == (a_n * a_n + a_n if thetas == (60, 60) else 2 * a_n * a_n)
    assert len(where.corner_angles()) == where.intersections
    assert where.corner_samples().max() == where.intersections - 1


@pytest.mark.parametrize("thetas", [(30, 75), (75, 30), (75, 75)])
def test_more_samples_come_closer_to_the_material(thetas):
    material, where = kurt_material("fabric112"), placement(*thetas)
    errors = []
    for samples in (400, 1600):
        found = measured(material, where, samples)
        assert len(found.values) == samples
        errors.append(error(material, reconstruct_subspace(found, where), where))
    assert errors[1] < errors[0] < 0.1
    assert errors[1] < 0.02


def test_slices_are_reproduced_exactly_where_they_were_measured():
    material, where = kurt_material("yellow_satin"), placement(60, 60, 36)
    found = measured(material, where, 900)
    subspace = reconstruct_subspace(found, where)
    phi = found.angles[: where.intersections, 2:]
    np.testing.assert_allclose(
        subspace.eval(phi[:, 0], phi[:, 1]), found.values[: where.intersections], rtol=2e-5
    )


def test_it_is_the_four_dimensional_form_without_the_thetas(rng):
    material, where = kurt_material("fabric135"), placement(40, 80, 36)
    full = SlicePlacement.from_degrees(40, 36)
    count = full.intersections  # only the intersections, so that both know the same samples
    four = reconstruct(RIG.measure(material, SlicePlan(full, count, "axial-diagonal")))
    two = reconstruct_subspace(
        slice_samples(
            RIG.measure(material, SlicePlan(where, where.intersections, "axial-diagonal"))
        ),
        where,
        azimuth_samples=360,
    )
    phi_i, phi_v = rng.uniform(0, 2 * np.pi, (2, 2000))
    theta = np.full(2000, where.theta_i), np.full(2000, where.theta_v)
    expected = four.eval_angles(theta[0], phi_i, theta[1], phi_v)
    found = two.eval(phi_i, phi_v)
    # the four-dimensional clamp looks at the neighbouring subspaces too
    same = np.abs(found - expected) <= 1e-5 * expected.max()
    assert np.mean(same) > 0.9
    assert np.all(found >= expected - 1e-5 * expected.max())


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_dr_jit_equals_numpy(rng, precision):
    where = placement()
    found = slice_samples(
        RIG.measure(kurt_material("wood01"), SlicePlan(where, 600, "axial-diagonal"))
    )
    subspace = reconstruct_subspace(found, where)
    types = backend.types(precision)
    phi_i, phi_v = rng.uniform(-7, 7, (2, 5000))
    expected = subspace.eval(phi_i, phi_v)
    value = np.array(subspace.eval(types.Float(phi_i), types.Float(phi_v))).T
    limit = 1e-4 if precision == "float32" else 1e-11
    assert np.quantile(np.abs(value / expected - 1.0), 0.999) < limit


def test_lambert_is_exact_and_impossible_subspaces_are_refused():
    where = placement(20, 50, 90)
    found = slice_samples(
        RIG.measure(Lambert((0.2, 0.3, 0.4)), SlicePlan(where, 40, "axial-diagonal"))
    )
    picture = reconstruct_subspace(found, where, "linear").picture(24)
    expected = np.array([0.2, 0.3, 0.4]) / np.pi
    np.testing.assert_allclose(picture, np.broadcast_to(expected, picture.shape), rtol=1e-6)
    for bad in ((0, 30, 30), (30, 90, 30), (30, 60, 50)):
        with pytest.raises(SimrigError):
            placement(*bad)
    refused("too few", measured, Lambert(), where, 10)
    refused("only axial and diagonal", where.slices, "all")

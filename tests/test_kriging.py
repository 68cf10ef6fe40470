"""Kriging of logarithms: against a dense solution, symmetries, the table, and left-out samples."""

from __future__ import annotations

import drjit as dr
import numpy as np
import pytest
from odd_materials import OneWay
from scipy.linalg import solve

from simrig.brdf import KURT_MATERIALS, Lambert, Ward, evaluate, kurt_material
from simrig.brdf.kriging.choice import choose_model, left_out_error, with_profile
from simrig.brdf.kriging.coordinates import (
    BACK,
    EVEN,
    Stretch,
    half_difference_angles,
    stretch_of_theta_d,
)
from simrig.brdf.kriging.displayed import displayed_pairs, even_pairs, lobe_pairs, shown
from simrig.brdf.kriging.images import contradicted
from simrig.brdf.kriging.local import covariance, kriging_weights, predict
from simrig.brdf.kriging.model import fit_model
from simrig.brdf.kriging.outliers import STANDS_OUT, WRONG, outstanding, trusted
from simrig.brdf.kriging.predicted import predicted_delta_e
from simrig.brdf.kriging.samples import Samples
from simrig.brdf.kriging.symmetry import Symmetry
from simrig.brdf.tables.half_difference import HalfDifferenceTable, node_angles
from simrig.core.errors import SimrigError
from simrig.directions.half_difference import from_half_difference, to_half_difference
from simrig.files.hdf5 import read_brdf, write_brdf
from simrig.reconstruction.kriging import tabulated

REACH = np.radians(80.0)
ISOTROPIC = Symmetry(isotropic=True, reciprocal=True, mirror=True, half_turn=True)
ORTHOTROPIC = Symmetry(reciprocal=True, mirror=True, half_turn=True, axis=0.4)
SYMMETRIES = (
    Symmetry(isotropic=True, reciprocal=True, mirror=True, half_turn=True, bivariate=True),
    ISOTROPIC,
    Symmetry(isotropic=True, mirror=True, half_turn=True),
    Symmetry(isotropic=True, half_turn=True),
    ORTHOTROPIC,
    Symmetry(mirror=True, axis=1.1),
    Symmetry(half_turn=True, reciprocal=True),
    Symmetry(),
)


def samples_of(brdf, count: int, seed: int = 3) -> Samples:
    wi, wv = displayed_pairs(count, REACH, REACH, seed)
    return Samples.of(wi, wv, brdf.eval(wi, wv), REACH, REACH)


def random_table(symmetry: Symmetry, profile: np.ndarray | None = None) -> HalfDifferenceTable:
    shape = (9, 1 if symmetry.isotropic else 6, 5, 6)
    logs = np.random.default_rng(1).normal(size=(*shape, 3)) - 2.0
    power = 0 if symmetry.reciprocal else 1
    stretches = Stretch(0.1, 0.3), Stretch(0.2, 0.6)
    return HalfDifferenceTable(
        logs, symmetry, stretches[0], 1e-3, power, REACH, "random", stretches[1], profile
    )


def test_weights_are_those_of_the_dense_system():
    rng = np.random.default_rng(0)
    samples, point = rng.random((1, 12, 3)), rng.random((1, 1, 3))
    weights, variance = kriging_weights(samples, point, 1e-3)
    distance = np.linalg.norm(samples[0][:, None] - samples[0], axis=-1)
    system = np.ones((13, 13))
    system[:12, :12] = covariance(distance) + 1e-3 * np.eye(12)
    system[12, 12] = 0.0
    to = covariance(np.linalg.norm(samples[0] - point[0], axis=-1))
    solved = solve(system, np.append(to, 1.0))
    assert weights[0, 0] == pytest.approx(solved[:12], abs=1e-9)
    assert variance[0, 0] == pytest.approx(1.001 - solved[:12] @ to - solved[12], abs=1e-9)
    assert weights.sum() == pytest.approx(1.0, abs=1e-9)


def test_predictions_meet_the_samples_and_stay_near_their_range():
    rng = np.random.default_rng(2)
    features, values = rng.random((40, 2)), rng.normal(size=(40, 3))
    near = np.argsort(np.linalg.norm(features[:, None] - features, axis=-1), axis=1)[:, :12]
    made, spread = predict(features, values, features[:, None], near, 1e-9)
    assert made[:, 0] == pytest.approx(values, abs=1e-3)
    assert spread.max() < 1e-2
    far = np.full((1, 1, 2), 50.0)
    made, _ = predict(features, values, far, near[:1], 1e-9, overshoot=0.0)
    assert np.all(made <= values[near[0]].max(axis=0) + 1e-12)
    assert np.all(made >= values[near[0]].min(axis=0) - 1e-12)


@pytest.mark.parametrize("stretch", [Stretch(0.001, 0.02), Stretch(0.3, 0.9)])
def test_stretch_is_inverted(stretch):
    theta = np.linspace(0.0, 0.5 * np.pi, 50)
    position = stretch(theta)
    assert position[[0, -1]] == pytest.approx([0.0, 1.0], abs=1e-12)
    assert np.all(np.diff(position) > 0.0)
    assert stretch.inverse(position) == pytest.approx(theta, abs=1e-11)


@pytest.mark.parametrize("symmetry", SYMMETRIES, ids=lambda s: s.describe())
def test_a_table_has_the_symmetries_that_it_states(symmetry):
    table = random_table(symmetry)
    wi, wv = even_pairs(300, REACH, REACH, 5)
    angles = half_difference_angles(wi, wv, symmetry.axis)
    value = table.eval(wi, wv)
    for image in symmetry.images(angles).reshape(-1, *angles.shape):
        theta_h, phi_h, theta_d, phi_d = image.T
        # only light's own cosine may tell the images apart, and the table divides by it
        i, v = from_half_difference(theta_h, phi_h + symmetry.axis, theta_d, phi_d)
        assert table.eval(i, v) == pytest.approx(value, rel=1e-9, abs=1e-12)
    if symmetry.isotropic:
        theta_h, phi_h, theta_d, phi_d = angles.T
        i, v = from_half_difference(theta_h, phi_h + 1.234, theta_d, phi_d)
        assert table.eval(i, v) == pytest.approx(value, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("symmetry", SYMMETRIES, ids=lambda s: s.describe())
def test_a_table_reads_its_nodes_and_survives_a_file(symmetry, tmp_path):
    table = random_table(symmetry)
    axes = node_angles(table.logs.shape[:4], symmetry, table.stretch, table.stretch_d)
    grid = np.meshgrid(*axes, indexing="ij")
    wi, wv = from_half_difference(grid[0], grid[1] + symmetry.axis, grid[2], grid[3])
    inside = (wi[..., 2] > 0.05) & (wv[..., 2] > 0.05) & (grid[0] > 0.0) & (grid[2] > 0.0)
    if symmetry.folded[0]:  # numbers at random do not agree in the plane of the mirror
        inside &= (grid[1] > axes[1][0]) & (grid[1] < axes[1][-1])
    expected = np.maximum(np.exp(np.float64(table.logs)) - 1e-3, 0.0)
    if table.power:
        expected = expected / np.maximum(wi[..., 2:], np.cos(REACH))
    got = table.eval(wi, wv)
    assert got[inside] == pytest.approx(expected[inside], rel=1e-5, abs=1e-7)
    path = tmp_path / "table.h5"
    write_brdf(path, table)
    again = read_brdf(path)
    assert np.array_equal(again.eval(wi, wv), got)
    assert again.symmetry == symmetry


@pytest.mark.parametrize("symmetry", SYMMETRIES[:5], ids=lambda s: s.describe())
def test_a_table_is_the_same_in_every_array_type(symmetry):
    table = random_table(symmetry)
    wi, wv = even_pairs(500, np.radians(89.0), np.radians(89.0), 6)
    expected = evaluate(table, wi, wv)
    single = evaluate(table, wi, wv, dr.llvm.ad.Float)
    double = evaluate(table, wi, wv, dr.llvm.ad.Float64)
    assert double == pytest.approx(expected, rel=1e-9, abs=1e-12)
    assert single == pytest.approx(expected, rel=2e-3, abs=1e-4)


def test_a_profile_multiplies_a_table_by_a_function_of_theta_h(tmp_path):
    profile = np.random.default_rng(4).normal(size=(40, 3))
    table, plain = random_table(ISOTROPIC, profile), random_table(ISOTROPIC)
    wi, wv = even_pairs(400, REACH, REACH, 8)
    got, without = table.eval(wi, wv) + table.floor, plain.eval(wi, wv) + table.floor
    shown_twice = np.minimum(got, without) > 2.0 * table.floor  # below it f_r is 0
    position = table.stretch(to_half_difference(wi, wv).theta_h)
    curve = [np.interp(position, np.linspace(0.0, 1.0, 40), own) for own in profile.T]
    expected = np.exp(np.stack(curve, axis=-1))
    assert (got / without)[shown_twice] == pytest.approx(expected[shown_twice], rel=1e-6)
    write_brdf(tmp_path / "table.h5", table)
    assert np.array_equal(read_brdf(tmp_path / "table.h5").eval(wi, wv), table.eval(wi, wv))
    single = evaluate(table, wi, wv, dr.llvm.ad.Float)
    assert single == pytest.approx(table.eval(wi, wv), rel=2e-3, abs=1e-4)


def test_fine_steps_that_all_angles_share_are_found():
    # a factor of theta_h alone, as measured distributions of normals have it
    steps = np.random.default_rng(5).normal(size=240) * 0.2

    def factor(angles: np.ndarray) -> np.ndarray:
        theta_h, _, theta_d, phi_d = angles.T
        others = np.sin(4.0 * theta_d) + 4.0 * np.sin(theta_d) ** 2 * np.cos(2.0 * phi_d)
        return np.exp(np.interp(theta_h, np.linspace(0.0, 1.5, 240), steps) + others)[:, None]

    wi, wv = displayed_pairs(2400, REACH, REACH, 3)
    new = displayed_pairs(500, REACH, REACH, 4)
    angles, at = half_difference_angles(wi, wv), half_difference_angles(*new)
    values = np.full((2400, 3), 0.1)
    even = fit_model(Samples.of(wi, wv, values, REACH, REACH), ISOTROPIC, steps=1)
    assert with_profile(even).profile is None
    values, truth = (0.1 * factor(a) * np.ones(3) for a in (angles, at))
    without = fit_model(Samples.of(wi, wv, values, REACH, REACH), ISOTROPIC)
    model = with_profile(without)
    assert model.profile is not None
    logs = model.transform.forward(truth, new[0][:, 2])
    off = [np.abs(logs - own.at(at)[0]).mean() for own in (without, model)]
    assert off[1] < 0.5 * off[0]
    table = tabulated(model, "steps")
    made = model.transform.forward(table.eval(*new), new[0][:, 2])
    assert np.abs(logs - made).mean() < 1.2 * off[1]


def test_a_table_is_finite_where_angles_are_undefined():
    table = random_table(ORTHOTROPIC)
    up, flat = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 1e-9])
    for wi, wv in ((up, up), (flat, up), (flat, flat), (flat, flat * [-1.0, 1.0, 1.0])):
        assert np.all(np.isfinite(table.eval(wi[None], wv[None])))
    assert np.all(table.eval(-up[None], up[None]) == 0.0)
    assert np.all(np.isfinite(table.eval(np.full((1, 3), np.nan), up[None])))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"logs": np.zeros((4, 2, 4, 4, 3))}, "phi_h has one node"),
        ({"logs": np.full((4, 1, 4, 4, 3), np.nan)}, "not finite"),
        ({"floor": -1.0}, "floor"),
        ({"power": 1}, "reciprocal"),
        ({"theta_max": 2.0}, "largest theta"),
        ({"profile": np.zeros((1, 3))}, "profile"),
        ({"profile": np.full((4, 3), np.inf)}, "not finite"),
    ],
)
def test_a_table_refuses_what_cannot_be(change, message):
    given = {
        "logs": np.zeros((4, 1, 4, 4, 3)),
        "symmetry": ISOTROPIC,
        "stretch": Stretch(0.1, 0.5),
        "floor": 0.0,
        "power": 0,
        "theta_max": 1.0,
        **change,
    }
    with pytest.raises(SimrigError, match=message):
        HalfDifferenceTable(**given)


def test_symmetries_are_found_by_left_out_samples():
    kurt = kurt_material("yellow_satin")
    choices = (ISOTROPIC, Symmetry(reciprocal=True, mirror=True, half_turn=True), Symmetry())
    assert choose_model(samples_of(kurt, 250), choices).symmetry == choices[1]
    assert choose_model(samples_of(Lambert(), 60), choices).symmetry == ISOTROPIC


def test_a_model_predicts_new_directions_and_how_well():
    kurt = kurt_material(KURT_MATERIALS[2])
    symmetry = Symmetry(reciprocal=True, mirror=True, half_turn=True)
    few, many = (fit_model(samples_of(kurt, n), symmetry) for n in (100, 800))
    wi, wv = displayed_pairs(500, REACH, REACH, 11)
    angles, truth = half_difference_angles(wi, wv), kurt.eval(wi, wv)
    off = [
        np.abs(model.transform.radiance(model.at(angles)[0]) / truth - 1.0).mean()
        for model in (few, many)
    ]
    assert off[1] < 0.01 < off[0]
    assert left_out_error(many) < 0.5 * left_out_error(few)
    assert predicted_delta_e(many) < 0.5 * predicted_delta_e(few)


def test_grain_of_channels_apart_is_predicted_to_show_more_than_grain_of_all():
    rng = np.random.default_rng(6)
    wi, wv = displayed_pairs(500, REACH, REACH, 3)
    alike, apart = (np.exp(0.1 * rng.normal(size=(500, n))) * np.full(3, 0.1) for n in (1, 3))
    predicted = [
        predicted_delta_e(fit_model(Samples.of(wi, wv, values, REACH, REACH), ISOTROPIC))
        for values in (alike, apart)
    ]
    assert predicted[1] > 1.3 * predicted[0]


def test_few_samples_are_not_trusted_to_have_seen_all():
    wi, wv = displayed_pairs(400, REACH, REACH, 3)
    values = 0.1 + 1e-4 * np.random.default_rng(7).normal(size=(400, 3))
    samples = Samples.of(wi, wv, values, REACH, REACH)
    few, many = (
        predicted_delta_e(fit_model(samples.only(np.arange(400) < n), ISOTROPIC)) for n in (24, 400)
    )
    assert few > 0.2  # all alike so far; yet so few have usually missed something
    assert many < 0.1


def test_a_tabulated_model_is_near_the_model():
    kurt = kurt_material("red_velvet")
    model = fit_model(samples_of(kurt, 300), ISOTROPIC)
    table = tabulated(model, "velvet")
    wi, wv = displayed_pairs(400, REACH, REACH, 12)
    direct = model.transform.radiance(model.at(half_difference_angles(wi, wv))[0])
    floor = model.transform.floor
    off = np.abs(np.log((table.eval(wi, wv) + floor) / (direct + floor)))
    assert off.mean() < 0.005
    assert off.max() < 0.1


def test_lobes_are_looked_at_closely_and_within_reach():
    wi, wv = lobe_pairs(400, REACH, 2)
    at = to_half_difference(wi, wv)
    assert min(wi[:, 2].min(), wv[:, 2].min()) > np.cos(REACH) - 1e-9
    for angle in (at.theta_h, at.theta_d):
        assert np.sum(angle < np.radians(1.0)) > 50


def test_light_that_goes_back_stretches_theta_d():
    wi, wv = lobe_pairs(200, REACH, 3)
    angles = half_difference_angles(wi, wv)
    body = np.full((200, 3), 0.1)
    back = body + 5.0 * np.exp(-((angles[:, 2:3] / np.radians(1.5)) ** 2))
    highlight = body + 5.0 * np.exp(-((angles[:, :1] / 0.3) ** 2))
    assert stretch_of_theta_d(angles, back) == BACK
    assert stretch_of_theta_d(angles, body) == EVEN
    assert stretch_of_theta_d(angles, highlight) == EVEN


def test_what_is_shown_falls_with_light_that_is_there_anyway():
    radiance = np.array([[0.01, 1.0, 100.0]])
    assert np.all(np.diff(shown(radiance, 1.0)) > 0.0)
    assert shown(10.0 * radiance, 1.0)[0, 2] == shown(radiance, 1.0)[0, 2]  # above white
    assert np.all(shown(radiance, 10.0) < shown(radiance, 1.0) + 5.0)


def test_images_are_pairs_of_the_hemisphere():
    wi, wv = displayed_pairs(50, REACH, REACH, 1)
    angles = half_difference_angles(wi, wv)
    images = ORTHOTROPIC.images(angles)
    assert len(images) == 8 * len(angles)
    i, v = from_half_difference(*images.T)
    assert min(i[:, 2].min(), v[:, 2].min()) > 0.1
    assert to_half_difference(i, v).theta_h == pytest.approx(images[:, 0], abs=1e-9)


def test_of_a_pair_that_is_measured_again_the_last_value_counts():
    wi, wv = displayed_pairs(6, REACH, REACH, 3)
    values = np.arange(18.0).reshape(6, 3)
    own = np.array([0, 1, 2, 1, 3, 0])
    samples = Samples.of(wi[own], wv[own], values, REACH, REACH)
    assert np.array_equal(samples.wi, wi[:4]) and np.array_equal(samples.wv, wv[:4])
    assert np.array_equal(samples.values, values[[5, 3, 2, 4]])
    assert samples.again.tolist() == [True, True, False, False]
    more = samples.with_more(wi[2:3], wv[2:3], values[:1])
    assert more.again.tolist() == [True, True, True, False]
    assert np.array_equal(more.values[2], values[0])


def test_what_stands_out_is_one_wrong_value_and_not_those_beside_it():
    samples = samples_of(Ward(m_x=0.2, m_y=0.2), 200)
    assert outstanding(fit_model(samples, ISOTROPIC)).max() < STANDS_OUT
    samples.values[77] *= 100.0
    model = fit_model(samples, ISOTROPIC)
    found = outstanding(model)
    assert np.flatnonzero(found > STANDS_OUT).tolist() == [77] and found[77] > WRONG
    assert len(trusted(model).samples) == 199
    samples.again[77] = True  # who measured it twice believes it
    assert outstanding(fit_model(samples, ISOTROPIC))[77] == 0.0


@pytest.mark.parametrize(("brdf", "differs"), [(Ward(m_x=0.2, m_y=0.2), False), (OneWay(), True)])
def test_a_symmetry_is_contradicted_where_images_differ(brdf, differs):
    model = fit_model(samples_of(brdf, 150), Symmetry(isotropic=True, mirror=True, half_turn=True))
    assert contradicted(model, "reciprocal") is differs
    assert not contradicted(model, "mirror")


class Ends(OneWay):
    """A BRDF whose data end at 72°: 0 beyond."""

    def look_up(self, wi, wv, tables):
        lit = np.minimum(wi[:, 2], wv[:, 2]) > np.cos(np.radians(72.0))
        return super().look_up(wi, wv, tables) * lit[:, None]


def test_data_that_end_before_the_rig_does_are_black_beyond_and_not_smeared(tmp_path):
    brdf = Ends()
    samples = samples_of(brdf, 400)
    lit = samples.lit()
    assert lit.dark_beyond and lit.values.min() > 0.0
    assert np.degrees(lit.theta_i_max) == pytest.approx(72.0, abs=0.5)
    path = tmp_path / "table.h5"
    write_brdf(path, tabulated(fit_model(lit, Symmetry(True, half_turn=True)), "ends"))
    table = read_brdf(path)
    wi, wv = even_pairs(2000, np.radians(88.0), np.radians(88.0), 6)
    beyond = np.minimum(wi[:, 2], wv[:, 2]) < np.cos(np.radians(72.5))
    before = np.minimum(wi[:, 2], wv[:, 2]) > np.cos(np.radians(71.0))
    got, truth = table.eval(wi, wv), brdf.eval(wi, wv)
    assert np.all(got[beyond] == 0.0)
    assert np.abs(np.log(got[before] / truth[before])).mean() < 0.02
    assert evaluate(table, wi, wv, dr.llvm.ad.Float64) == pytest.approx(got, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("brdf", [Ward(m_x=0.2, m_y=0.2), Lambert((0.0, 0.0, 0.0)), OneWay()])
def test_data_that_do_not_end_are_kept_whole(brdf):
    samples = samples_of(brdf, 200)
    assert samples.lit() is samples
    dark = samples.values * (np.arange(200) % 3 > 0)[:, None]  # black here and there, not beyond
    spotted = Samples.of(samples.wi, samples.wv, dark, REACH, REACH)
    assert spotted.lit() is spotted

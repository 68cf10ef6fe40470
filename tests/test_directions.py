"""Parameterisations: round trips, invariants, poles, wraps, and what they are by definition."""

from __future__ import annotations

from collections.abc import Callable

import drjit as dr
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from simrig.core import backend
from simrig.core.arrays import vector_type
from simrig.directions import (
    azimuth,
    cos_sin_of_turn,
    from_half_difference,
    from_meridian,
    from_onion,
    half_vector,
    to_angles,
    to_half_difference,
    to_meridian,
    to_onion,
    to_upper_angles,
    to_vector,
    wrap_angle,
)
from simrig.evaluation.stability.hard_cases import case_names, hard_case

# Measured over the hard cases: 1.3e-15 and 1.2e-6. Dr.Jit's float32 atan2 alone is off by 7e-7.
ROUND_TRIP = {"numpy": 4e-15, "float64": 4e-15, "float32": 3e-6}
PRECISIONS = tuple(ROUND_TRIP)


def _short_way(angle):
    """Return an azimuth difference in [-π, π)."""
    return wrap_angle(angle + np.pi) - np.pi


def _to_type(v: np.ndarray, precision: str):
    if precision == "numpy":
        return v
    return vector_type(backend.types(precision).Float)(*v.T.copy())


def _to_numpy(v) -> np.ndarray:
    return v if isinstance(v, np.ndarray) else np.array(v, dtype=np.float64).T


def _spherical(wi, wv):
    return (*to_angles(wi), *to_angles(wv))


def _from_spherical(theta_i, phi_i, theta_v, phi_v):
    return to_vector(theta_i, phi_i), to_vector(theta_v, phi_v)


PARAMETERISATIONS: dict[str, tuple[Callable, Callable]] = {
    "spherical": (_spherical, _from_spherical),
    "half-difference": (to_half_difference, from_half_difference),
    "onion": (to_onion, from_onion),
}

parameterisations = pytest.mark.parametrize("name", PARAMETERISATIONS)
precisions = pytest.mark.parametrize("precision", PRECISIONS)

theta = st.floats(0.0, np.pi / 2)
turn = st.floats(0.0, 2.0 * np.pi, exclude_max=True)
# from the smallest normal number up: tilts where a squared length underflows
tilt = st.floats(-300.0, 0.0).map(lambda exponent: 10.0**exponent)


def _vector(theta: float, phi: float) -> np.ndarray:
    return to_vector(np.float64(theta), np.float64(phi))


@parameterisations
@precisions
@pytest.mark.parametrize("case", case_names())
def test_round_trip_on_hard_cases(name, precision, case):
    directions = hard_case(case)
    pair = [_to_type(v, precision) for v in (directions.wi, directions.wv)]
    to, back = PARAMETERISATIONS[name]
    for given_direction, returned in zip(pair, back(*to(*pair)), strict=True):
        error = np.abs(_to_numpy(returned) - _to_numpy(given_direction)).max()
        assert error < ROUND_TRIP[precision]


@parameterisations
@given(theta, turn, theta, turn)
def test_round_trip_from_vectors(name, theta_i, phi_i, theta_v, phi_v):
    pair = _vector(theta_i, phi_i), _vector(theta_v, phi_v)
    to, back = PARAMETERISATIONS[name]
    for given_direction, returned in zip(pair, back(*to(*pair)), strict=True):
        assert np.abs(returned - given_direction).max() < ROUND_TRIP["numpy"]
        assert np.linalg.norm(returned) == pytest.approx(1.0, abs=1e-14)


@parameterisations
@given(theta, turn, tilt, turn)
def test_round_trip_next_to_each_special_direction(name, theta, phi, angle, aside):
    """Directions that nearly agree, nearly mirror, are nearly opposite, or nearly the normal."""
    wi = _vector(theta, phi)
    offset = angle * np.array([np.cos(aside), np.sin(aside), 0.0])
    to, back = PARAMETERISATIONS[name]
    for close_to in (wi, wi * [-1.0, -1.0, 1.0], -wi, np.array([0.0, 0.0, 1.0])):
        wv = close_to + offset
        wv /= np.linalg.norm(wv)
        for given_direction, returned in zip((wi, wv), back(*to(wi, wv)), strict=True):
            assert np.abs(returned - given_direction).max() < ROUND_TRIP["numpy"]


@parameterisations
def test_plain_floats_agree_with_numpy(name, rng):
    wi, wv = _random_pair(rng, 1)
    to, back = PARAMETERISATIONS[name]
    angles = [float(angle[0]) for angle in to(wi, wv)]
    assert np.allclose(np.array(back(*angles)), [wi[0], wv[0]], atol=4e-15)


def _random_pair(rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
    v = rng.normal(size=(2, count, 3))
    v[..., 2] = np.abs(v[..., 2])
    v /= np.linalg.norm(v, axis=-1, keepdims=True)
    return v[0], v[1]


# Spherical


@precisions
def test_pole_is_exact(precision):
    phi = np.array([0.0, 1.0, 3.0, 6.0])
    if precision == "numpy":
        v = to_vector(np.zeros(4), phi)
    else:
        number = backend.types(precision).Float
        v = to_vector(number(np.zeros(4)), number(phi))
    assert np.array_equal(_to_numpy(v), np.tile([0.0, 0.0, 1.0], (4, 1)))
    assert all(np.array_equal(np.array(angle), np.zeros(4)) for angle in to_angles(v))


@pytest.mark.parametrize("sign_x", [0.0, -0.0])
@pytest.mark.parametrize("sign_y", [0.0, -0.0])
def test_signed_zeros_have_azimuth_zero(sign_x, sign_y):
    x, y = np.array([sign_x]), np.array([sign_y])
    assert azimuth(x, y)[0] == 0.0
    number = backend.types("float64").Float
    assert azimuth(number(x), number(y))[0] == 0.0


@given(tilt, turn)
def test_angles_next_to_the_pole_keep_relative_precision(theta, phi):
    back_theta, back_phi = to_angles(_vector(theta, phi))
    if theta < 1e-36:  # taken for the pole
        assert back_theta < 1e-36
    else:
        assert back_theta == pytest.approx(theta, rel=1e-15)
        assert abs(_short_way(np.float64(back_phi - phi))) < 1e-14


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_wrap_stays_in_range_one_ulp_around_the_seam(dtype):
    period = dtype(2.0 * np.pi)
    for turns in range(-3, 4):
        seam = dtype(turns) * period
        around = np.array(
            [np.nextafter(seam, dtype(-np.inf)), seam, np.nextafter(seam, dtype(np.inf))]
        )
        wrapped = wrap_angle(around)
        assert wrapped.dtype == dtype
        assert np.all((wrapped >= 0.0) & (wrapped < period))
        # the same angle but for the rounding of the number of turns
        distance = np.minimum(wrapped, period - wrapped)
        assert np.all(distance <= 8 * np.spacing(max(abs(seam), period)))


@given(st.floats(-1e6, 1e6))
def test_wrap_keeps_the_angle(phi):
    wrapped = wrap_angle(np.float64(phi))
    assert 0.0 <= wrapped < 2.0 * np.pi
    assert np.cos(wrapped) == pytest.approx(np.cos(phi), abs=1e-9)
    assert np.sin(wrapped) == pytest.approx(np.sin(phi), abs=1e-9)


def test_integers_and_mixed_arguments_are_taken():
    assert np.allclose(np.array(to_vector(1, 2)), to_vector(np.float64(1), np.float64(2)))
    assert to_vector(0.5, np.zeros(3)).shape == (3, 3)
    assert np.allclose(to_vector(np.array([0.5]), 1)[0], np.array(to_vector(0.5, 1.0)))


def test_gradients_of_the_angles_are_finite_at_the_pole():
    number = backend.types("float64").Float
    x, y = number([0.0, 0.0, 1e-3]), number([0.0, 1e-300, 0.0])
    dr.enable_grad(x, y)
    theta, phi = to_angles(vector_type(number)(x, y, number(1.0)))
    dr.backward(theta + phi)
    assert np.isfinite(np.array(dr.grad(x))).all() and np.isfinite(np.array(dr.grad(y))).all()


# Half-difference


def _rotation(axis: str, angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    if axis == "y":
        return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def test_half_difference_follows_its_definition(rng):
    """H = normalised sum; D = rot_y(-theta_h) rot_z(-phi_h) ω_i, by matrices."""
    for wi, wv in zip(*_random_pair(rng, 200), strict=True):
        theta_h, phi_h, theta_d, phi_d = to_half_difference(wi, wv)
        h = (wi + wv) / np.linalg.norm(wi + wv)
        assert np.allclose(to_vector(theta_h, phi_h), h, atol=1e-14)
        assert np.allclose(half_vector(wi, wv), h, atol=1e-14)
        difference = _rotation("y", -theta_h) @ _rotation("z", -phi_h) @ wi
        assert np.allclose(to_vector(theta_d, phi_d), difference, atol=1e-13)


@given(theta, turn, theta, turn)
def test_swapping_the_directions_turns_phi_d_by_half(theta_i, phi_i, theta_v, phi_v):
    wi, wv = _vector(theta_i, phi_i), _vector(theta_v, phi_v)
    one, other = to_half_difference(wi, wv), to_half_difference(wv, wi)
    assume(np.linalg.norm(wi + wv) > 1e-12)  # H of opposite directions is a choice
    assert one[:3] == other[:3]
    if one.theta_d > 0.0:
        turned = _short_way(np.float64(other.phi_d - one.phi_d))
        assert abs(abs(turned) - np.pi) < 1e-14


@given(theta, turn, theta, turn, turn)
def test_turning_the_pair_changes_phi_h_only(theta_i, phi_i, theta_v, phi_v, angle):
    """What makes theta_h, theta_d, phi_d the coordinates of an isotropic material."""
    one = to_half_difference(_vector(theta_i, phi_i), _vector(theta_v, phi_v))
    other = to_half_difference(_vector(theta_i, phi_i + angle), _vector(theta_v, phi_v + angle))
    # elsewhere phi_h or phi_d is undefined or close to it
    assume(min(one.theta_h, one.theta_d) > 1e-3 and one.theta_d < 1.57)
    assert abs(_short_way(np.float64(other.phi_h - one.phi_h - angle))) < 1e-11
    assert other.theta_h == pytest.approx(one.theta_h, abs=1e-13)
    assert other.theta_d == pytest.approx(one.theta_d, abs=1e-13)
    assert abs(_short_way(np.float64(other.phi_d - one.phi_d))) < 1e-11


@precisions
def test_half_difference_where_angles_are_undefined(precision):
    up, side, low = [0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.6, 0.0, 0.8]
    wi = _to_type(np.array([up, low, side, up]), precision)
    wv = _to_type(np.array([up, low, [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]), precision)
    angles = np.array([np.array(a, dtype=np.float64) for a in to_half_difference(wi, wv)]).T
    half = np.arcsin(0.6)
    assert np.allclose(angles[0], 0.0, atol=0.0)
    assert np.allclose(angles[1], [half, 0.0, 0.0, 0.0], atol=1e-6)
    assert np.allclose(angles[2], [0.0, 0.0, np.pi / 2, 0.0], atol=1e-6)
    assert np.allclose(angles[3, [0, 2]], np.pi / 2, atol=1e-6)
    h = _to_numpy(half_vector(wi, wv))
    assert np.allclose(np.linalg.norm(h, axis=-1), 1.0, atol=1e-6)


@given(st.floats(-15.0, -3.0), turn, theta, turn)
def test_small_theta_d_is_not_lost_in_a_cosine(exponent, aside, theta, phi):
    """acos of the dot product would give 0 below 1e-8."""
    theta_d = 10.0**exponent
    wi, wv = from_half_difference(*map(np.float64, (theta, phi, theta_d, aside)))
    assert to_half_difference(wi, wv).theta_d == pytest.approx(theta_d, abs=5e-16)


# Onion


@given(theta, turn, st.floats(1e-30, np.pi / 2), st.floats(-50.0, 50.0))
def test_illumination_angles_do_not_change_when_the_pair_turns(theta_i, phi_i, theta_v, angle):
    one = to_onion(_vector(theta_i, phi_i), _vector(theta_v, 0.0))
    other = to_onion(_vector(theta_i, phi_i + angle), _vector(theta_v, angle))
    # compared as directions: alpha itself is undefined on the axis
    same = from_meridian(one.alpha_i, one.beta_i), from_meridian(other.alpha_i, other.beta_i)
    assert np.allclose(*same, atol=1e-13)


@given(st.floats(1e-6, np.pi / 2 - 1e-6), turn)
def test_plane_of_incidence_is_at_beta_zero(theta, phi):
    view = _vector(theta, phi)
    mirror, retro = to_onion(view * [-1.0, -1.0, 1.0], view), to_onion(view, view)
    assert mirror.beta_i == pytest.approx(0.0, abs=1e-15)
    assert mirror.alpha_i == pytest.approx(-theta, abs=1e-14)
    assert retro.beta_i == pytest.approx(0.0, abs=1e-15)
    assert retro.alpha_i == pytest.approx(theta, abs=1e-14)


@given(theta, turn, theta, turn)
def test_onion_angles_stay_in_the_half_turn(theta_i, phi_i, theta_v, phi_v):
    angles = to_onion(_vector(theta_i, phi_i), _vector(theta_v, phi_v))
    assert np.all(np.abs(angles) <= np.pi / 2 + 1e-15)


def test_onion_has_no_seam_at_azimuth_zero():
    """A small step across phi = 0 is a small step of all four angles, for both directions."""
    step, theta = 1e-6, np.radians(60.0)
    below, above = _vector(theta, 2.0 * np.pi - step), _vector(theta, step)
    other = _vector(np.radians(40.0), 2.0)
    for one, two in (((below, other), (above, other)), ((other, below), (other, above))):
        assert np.allclose(to_onion(*one), to_onion(*two), atol=4 * step)


def test_meridian_slices_are_half_circles_through_the_axis(rng):
    alpha = rng.uniform(-np.pi / 2, np.pi / 2, 20)
    ends = from_meridian(alpha, np.full(20, np.pi / 2))
    assert np.allclose(ends, [0.0, 1.0, 0.0], atol=1e-15)
    beta = np.linspace(-np.pi / 2, np.pi / 2, 20)
    slice_ = from_meridian(np.full(20, alpha[0]), beta)
    normal = np.array([np.cos(alpha[0]), 0.0, -np.sin(alpha[0])])
    assert np.allclose(slice_ @ normal, 0.0, atol=1e-15)
    assert np.allclose(np.diff(beta), np.arccos(np.sum(slice_[1:] * slice_[:-1], axis=-1)))


def test_meridian_at_the_axis_and_below_the_horizon():
    alpha, beta = to_meridian(np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [0.6, 0.0, -0.8]]))
    assert np.allclose(alpha, [0.0, 0.0, np.pi - np.arcsin(0.6)])
    assert np.allclose(beta, [np.pi / 2, -np.pi / 2, 0.0])


def test_short_formulas_are_as_right_as_single_precision(rng):
    types = backend.types()
    theta = np.concatenate([[0.0, 1e-6, np.pi / 4, 1.5707], rng.uniform(0.0, 1.5707, 5000)])
    w = to_vector(theta, rng.uniform(0.0, 2.0 * np.pi, theta.size))
    single = types.Array3(*w.T.astype(np.float32).copy())
    found, exact = to_upper_angles(single), to_angles(np.array(single, dtype=np.float64).T)
    np.testing.assert_allclose(np.array(found[0]), exact[0], rtol=1e-6, atol=1e-12)
    assert np.abs(_short_way(np.array(found[1]) - exact[1])).max() < 2e-6
    # with derivatives and in double precision they are those of every angle
    np.testing.assert_array_equal(to_upper_angles(w), to_angles(w))

    u = np.concatenate([np.linspace(0.0, 1.0, 5), rng.uniform(size=5000)]).astype(np.float32)
    cosine, sine = (np.array(part, np.float64) for part in cos_sin_of_turn(types.Float(u)))
    angle = 2.0 * np.pi * u.astype(np.float64)
    assert np.abs(cosine - np.cos(angle)).max() < 7e-7
    assert np.abs(sine - np.sin(angle)).max() < 7e-7

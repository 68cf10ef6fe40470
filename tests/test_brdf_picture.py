"""The BRDF as a picture: what is where, and the labelled figure."""

from __future__ import annotations

import io

import numpy as np
import pytest

from refusals import refused
from simrig.brdf import Brdf, Lambert, evaluate, kurt_material
from simrig.core.arrays import components, vector
from simrig.directions import to_angles, to_vector, wrap_angle
from simrig.plans.along_slices import SlicePlan
from simrig.plans.placement import SlicePlacement
from simrig.rigs.direct.gonioreflectometer import Gonioreflectometer
from simrig.viewing.brdf.figure import SLICE_COLOURS, brdf_figure, sample_positions
from simrig.viewing.brdf.picture import brdf_exposure, brdf_picture

THETAS = (15.0, 40.0, 70.0)
STEP = 30.0


class Angles(Brdf):
    """Answers the angles themselves: red theta_i, green theta_v, blue phi_i + 10·phi_v."""

    name = "angles"
    reciprocal = False

    def data(self):
        return {"one": np.asarray(1.0)}

    def look_up(self, wi, wv, tables):
        (theta_i, phi_i), (theta_v, phi_v) = to_angles(wi), to_angles(wv)
        zero = 0.0 * components(wi)[2]
        return vector(theta_i + zero, theta_v + zero, phi_i + 10.0 * phi_v, like=wi)


def _expected(theta_i, theta_v, phi_i, phi_v):
    angles = np.radians([theta_i, theta_v, phi_i, phi_v])
    return [angles[0], angles[1], angles[2] + 10.0 * angles[3]]


@pytest.mark.parametrize("i, v, p, q", [(0, 0, 0, 0), (0, 2, 1, 7), (2, 1, 11, 3), (1, 2, 5, 10)])
def test_where_each_direction_is(i, v, p, q):
    picture = brdf_picture(Angles(), THETAS, STEP)
    assert picture.shape == (36, 36, 3) and picture.dtype == np.float32
    expected = _expected(THETAS[i], THETAS[v], p * STEP, q * STEP)
    np.testing.assert_allclose(picture[i * 12 + p, v * 12 + q], expected, atol=1e-4)


def test_reciprocity_is_symmetry_about_the_diagonal():
    picture = brdf_picture(kurt_material("fabric112"), THETAS, 15.0)
    np.testing.assert_allclose(picture, picture.transpose(1, 0, 2), rtol=1e-4)


def test_the_brightest_pixel_is_the_mirror_direction():
    picture = brdf_picture(kurt_material("brushed_aluminium"), (45.0,), 3.0)
    row, column = np.unravel_index(picture[..., 1].argmax(), picture.shape[:2])
    assert abs((column - row) % 120 - 60) <= 1  # phi_v = phi_i + 180°
    wi, wv = (
        to_vector(np.pi / 4, np.radians(3.0 * row)),
        to_vector(np.pi / 4, np.radians(3 * column)),
    )
    value = evaluate(kurt_material("brushed_aluminium"), wi, wv)
    np.testing.assert_allclose(picture[row, column], value, rtol=1e-3)


def test_the_exposure_shows_the_brightest_as_white():
    picture = np.zeros((10, 10, 3))
    assert brdf_exposure(picture) == 1.0
    picture[0, 0] = 4.0  # one bright pixel of a hundred: above the percentile, but all there is
    assert brdf_exposure(picture) == 0.25
    picture[:, :, 1] = 0.5
    assert brdf_exposure(picture, 90.0) == pytest.approx(2.0)


@pytest.mark.parametrize(
    "thetas, step, message",
    [
        ((10.0, 90.0), 30.0, "must increase within"),
        ((20.0, 10.0), 30.0, "must increase within"),
        ((-5.0, 10.0), 30.0, "must increase within"),
        ((), 30.0, "must increase within"),
        ((10.0, float("nan")), 30.0, "must increase within"),
        ((10.0,), 7.0, "must divide 360"),
        ((10.0,), 0.0, "must divide 360"),
    ],
)
def test_wrong_grids(thetas, step, message):
    refused(message, brdf_picture, Lambert(), thetas, step)


def _pixels(png: bytes) -> np.ndarray:
    from matplotlib.image import imread

    return np.round(255 * imread(io.BytesIO(png))[..., :3]).astype(int)


def _coloured(pixels: np.ndarray, colour: str) -> int:
    """Count the pixels near a colour such as ``#ff2020``."""
    wanted = [int(colour[k : k + 2], 16) for k in (1, 3, 5)]
    return int((np.abs(pixels - wanted).max(axis=2) < 90).sum())


@pytest.fixture(scope="module")
def measurement():
    placement = SlicePlacement.from_degrees(40, 90)
    return Gonioreflectometer().measure(kurt_material("yellow_satin"), SlicePlan(placement, 300))


def test_samples_lie_where_the_picture_has_their_value(measurement):
    thetas = measurement.plan.placement.thetas
    columns, rows, inside = sample_positions(measurement, thetas)
    assert inside.any() and not inside.all()
    (fraction_i, tile_i), (fraction_v, tile_v) = np.modf(rows[inside]), np.modf(columns[inside])
    wi = to_vector(thetas[tile_i.astype(int)], 2.0 * np.pi * fraction_i)
    wv = to_vector(thetas[tile_v.astype(int)], 2.0 * np.pi * fraction_v)
    value = evaluate(kurt_material("yellow_satin"), wi, wv)
    np.testing.assert_allclose(value, measurement.values[inside], rtol=1e-6)
    # a sample between two polar angles lies between their tiles
    between = (columns - wrap_angle(measurement.phi_v) / (2.0 * np.pi))[~inside]
    lower, upper = (thetas[np.floor(between).astype(int)], thetas[np.ceil(between).astype(int)])
    theta_v = measurement.theta_v[~inside]
    assert ((lower < theta_v) & (theta_v < upper)).all()


def test_figure_shows_slices_and_samples_of_a_measurement(measurement):
    plain = brdf_figure(kurt_material("yellow_satin"))
    assert plain.startswith(b"\x89PNG")
    inner = (slice(200, -200), slice(200, -200))  # no legend, labels or margins
    before = _pixels(plain)[inner]
    after = _pixels(brdf_figure(kurt_material("yellow_satin"), measurement))[inner]
    for colour in SLICE_COLOURS.values():
        assert _coloured(after, colour) > 100 + _coloured(before, colour)
    _, _, inside = sample_positions(measurement, measurement.plan.placement.thetas)
    more = _coloured(after, "#ffffff") - _coloured(before, "#ffffff")
    assert more > inside.sum() / 2  # some lie under the margin or each other


def test_figure_leaves_matplotlib_as_it_was():
    import matplotlib
    import matplotlib.pyplot as pyplot

    before = dict(matplotlib.rcParams), matplotlib.get_backend()
    brdf_figure(Lambert())
    assert (dict(matplotlib.rcParams), matplotlib.get_backend()) == before
    assert pyplot.get_fignums() == []

"""Hemisphere schemes: published counts and angles, the pattern, and refusals."""

from __future__ import annotations

import numpy as np
import pytest

from refusals import refused
from simrig.directions import SCHEMES, HemisphereScheme, scheme, to_vector, uniform_scheme

# thesis Table D.2: polar angle and azimuth step in degrees of each ring, and number of directions
TABLE_D2 = {
    1: ([(0, 360), (28, 60), (56, 36), (80, 30)], 29, 435),
    14: (
        [(0, 360), (12, 60), (24, 36), (36, 30), (48, 20), (60, 18), (72, 12), (80, 10)],
        133,
        8911,
    ),
    19: (
        [(0, 360), (10, 60), (20, 36), (30, 30), (40, 20), (50, 18), (60, 12), (70, 10), (80, 6)],
        193,
        18721,
    ),
    30: ([(0, 360), *((t, 6) for t in range(6, 79, 6)), (80, 6)], 841, 354061),
}
uniform = [uniform_scheme(index) for index in range(1, 31)]


def _rings(directions: HemisphereScheme) -> list[tuple[float, np.ndarray]]:
    """Return (polar angle, azimuths) of each ring in degrees, in the order of the scheme."""
    theta, phi = np.degrees(directions.theta).round(6), np.degrees(directions.phi)
    starts = np.flatnonzero(np.diff(theta, prepend=-1.0))
    return [(float(theta[s]), p) for s, p in zip(starts, np.split(phi, starts[1:]), strict=True)]


@pytest.mark.parametrize("index", TABLE_D2)
def test_printed_uniform_schemes(index):
    rows, count, reciprocal = TABLE_D2[index]
    directions = uniform_scheme(index)
    rings = _rings(directions)
    assert [theta for theta, _ in rings] == [row[0] for row in rows]
    for (_, phi), (_, step) in zip(rings, rows, strict=True):
        assert np.allclose(phi, np.arange(0, 360, step))
    assert len(directions) == count
    assert directions.pair_count == count**2
    assert directions.reciprocal_count == reciprocal


def test_uniform_schemes_grow_from_29_to_841():
    counts = [len(directions) for directions in uniform]
    assert counts[0] == 29 and counts[-1] == 841 and len(counts) == 30
    assert np.all(np.diff(counts) > 0)
    # no step of the thirty is a jump
    assert np.max(np.divide(counts[1:], counts[:-1])) < 1.42


@pytest.mark.parametrize("directions", uniform, ids=lambda directions: directions.name)
def test_uniform_schemes_lie_on_the_grid_of_the_reference(directions):
    rings = _rings(directions)
    thetas = np.array([theta for theta, _ in rings])
    assert thetas[0] == 0.0 and thetas[-1] == 80.0
    assert np.allclose(thetas % 2.0, 0.0)
    assert np.all(np.diff(thetas[:-1]) == thetas[1])
    counts = [len(phi) for _, phi in rings]
    assert counts == sorted(counts), "rings outwards have no fewer directions"
    for count in counts[1:]:
        assert 360 % count == 0 and (360 // count) % 2 == 0 and 6 <= 360 // count <= 60


def test_81_directions():
    rings = _rings(scheme("hemisphere_81"))
    assert [theta for theta, _ in rings] == [0.0, 15.0, 30.0, 45.0, 60.0, 75.0]
    assert [len(phi) for _, phi in rings] == [1, 6, 12, 18, 20, 24]
    assert scheme("hemisphere_81").pair_count == 6561


def test_151_directions_have_the_published_rings():
    rings = _rings(scheme("hemisphere_151"))
    thetas = [0.0, 11.0, 23.5, 30.0, 37.5, 45.0, 52.5, 60.0, 67.5, 75.0]
    assert [theta for theta, _ in rings] == thetas
    assert [len(phi) for _, phi in rings] == [1, 6, 12, 12, 12, 18, 18, 24, 24, 24]
    assert scheme("hemisphere_151").pair_count == 22801


def test_151_directions_are_those_of_measured_data(shared_data):
    with np.load(shared_data("ubo2014/carpet07_mean_151x151.npz")) as data:
        measured = to_vector(data["theta"], data["phi"])
    # the data were stored in single precision
    assert np.abs(scheme("hemisphere_151").vectors() - measured).max() < 1e-6


@pytest.mark.parametrize("name", SCHEMES)
def test_every_scheme_covers_the_hemisphere_once(name):
    directions = scheme(name)
    assert directions.name == name
    v = directions.vectors()
    assert v.shape == (len(directions), 3)
    assert np.allclose(np.linalg.norm(v, axis=-1), 1.0)
    assert np.all(v[:, 2] > 0.0)
    assert np.all((directions.phi >= 0.0) & (directions.phi < 2.0 * np.pi))
    assert len(np.unique(v.round(9), axis=0)) == len(v)
    assert np.allclose(v[:, :2].sum(axis=0), 0.0, atol=1e-9), "rings are evenly spaced"


def test_schemes_are_read_only():
    directions = scheme("hemisphere_81")
    with pytest.raises(ValueError, match="read-only"):
        directions.theta[0] = 1.0
    with pytest.raises(AttributeError):
        directions.name = "other"  # type: ignore[misc]


@pytest.mark.parametrize("index", [0, 31, -1])
def test_uniform_index_out_of_range(index):
    refused("numbered 1 to 30", uniform_scheme, index)


def test_unknown_scheme_names_the_nearest():
    refused("did you mean 'hemisphere_81'", scheme, "hemispher_81")


@pytest.mark.parametrize(
    ("theta", "phi", "message"),
    [
        ([], [], "theta of scheme"),
        ([0.1, 2.0], [0.0, 0.0], "theta of scheme"),
        ([0.1, np.nan], [0.0, 0.0], "theta of scheme"),
        ([0.1, -0.1], [0.0, 0.0], "theta of scheme"),
        ([[0.1]], [[0.0]], "theta of scheme"),
        ([0.1], [7.0], "phi of scheme"),
        ([0.1, 0.2], [0.0], "as many phi as theta"),
    ],
)
def test_bad_schemes_are_refused(theta, phi, message):
    refused(message, HemisphereScheme, "own", np.array(theta), np.array(phi))


def test_scheme_keeps_its_own_copy():
    theta = np.array([0.1, 0.2])
    directions = HemisphereScheme("own", theta, np.zeros(2))
    theta[0] = 1.0
    assert directions.theta[0] == 0.1

"""The triangulated hemisphere: exact at nodes, continuous everywhere, alike for every type."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from refusals import refused
from simrig.core import backend
from simrig.core.arrays import gather
from simrig.directions import scheme, to_vector
from simrig.directions.triangulation import HemisphereTriangulation

SCHEMES = ("hemisphere_81", "hemisphere_151", "uniform_1", "uniform_30")


def interpolate(mesh: HemisphereTriangulation, values: np.ndarray, w: np.ndarray) -> np.ndarray:
    place = mesh.locate(w)
    return sum(values[n] * share for n, share in zip(place.nodes, place.weights, strict=True))


@pytest.mark.parametrize("name", SCHEMES)
def test_nodes_are_reproduced(name: str, rng: np.random.Generator) -> None:
    mesh = HemisphereTriangulation(scheme(name).vectors())
    values = rng.random(len(mesh.nodes))
    np.testing.assert_allclose(interpolate(mesh, values, mesh.nodes), values, atol=1e-9)


@pytest.mark.parametrize("name", SCHEMES)
def test_weights_are_shares_that_rebuild_the_direction(name: str, rng) -> None:
    mesh = HemisphereTriangulation(scheme(name).vectors())
    w = to_vector(np.arccos(rng.uniform(0.35, 1.0, 5000)), rng.uniform(0.0, 7.0, 5000))
    place = mesh.locate(w)
    weights = np.stack(place.weights)
    assert weights.min() >= 0.0
    np.testing.assert_allclose(weights.sum(axis=0), 1.0, atol=1e-12)
    mean = sum(
        mesh.nodes[n] * share[:, None] for n, share in zip(place.nodes, place.weights, strict=True)
    )
    np.testing.assert_allclose(mean / np.linalg.norm(mean, axis=1)[:, None], w, atol=1e-9)


@pytest.mark.parametrize("theta_deg", [0.001, 20.0, 60.0, 74.9, 75.0, 80.0, 89.999])
def test_circles_have_no_seam(theta_deg: float, rng: np.random.Generator) -> None:
    """No step between neighbouring azimuths is larger than the slope of the data allows."""
    mesh = HemisphereTriangulation(scheme("hemisphere_81").vectors())
    values = rng.random(81)
    phi = np.linspace(0.0, 2.0 * np.pi, 20001)
    circle = interpolate(mesh, values, to_vector(np.full_like(phi, np.radians(theta_deg)), phi))
    assert circle[0] == pytest.approx(circle[-1], abs=1e-12)
    assert np.abs(np.diff(circle)).max() < 3e-3


def test_values_are_held_beyond_the_last_ring(rng: np.random.Generator) -> None:
    mesh = HemisphereTriangulation(scheme("hemisphere_81").vectors())
    values = rng.random(81)
    ring = np.arange(57, 81)
    phi = np.arctan2(mesh.nodes[ring, 1], mesh.nodes[ring, 0])
    for theta_deg in (76.0, 85.0, 89.0, 90.0):
        w = to_vector(np.full(24, np.radians(theta_deg)), phi)
        np.testing.assert_allclose(interpolate(mesh, values, w), values[ring], atol=1e-7)


@pytest.fixture(scope="module")
def mesh_81() -> HemisphereTriangulation:
    return HemisphereTriangulation(scheme("hemisphere_81").vectors())


@given(theta=st.floats(0.0, np.pi / 2), phi=st.floats(0.0, 2.0 * np.pi))
def test_every_type_agrees(mesh_81: HemisphereTriangulation, theta: float, phi: float) -> None:
    mesh = mesh_81
    w = to_vector(np.array([theta]), np.array([phi]))
    values = np.arange(81.0)
    expected = interpolate(mesh, values, w)[0]
    place = mesh.locate(backend.types("float64", "llvm").Array3(*w[0].tolist()))
    found = sum(values[n] * share for n, share in zip(place.nodes, place.weights, strict=True))
    assert found == pytest.approx(expected, abs=1e-9)


def test_single_precision_on_the_device(rng: np.random.Generator) -> None:
    types = backend.types("float32", "llvm")
    mesh = HemisphereTriangulation(scheme("hemisphere_151").vectors())
    w = to_vector(np.arccos(rng.random(5000)), rng.uniform(0.0, 7.0, 5000))
    w[:151] = mesh.nodes
    values = rng.random(151)
    place = mesh.locate(types.Array3(*w.T.astype(np.float32).copy()))
    table = types.Float(values)
    found = sum(gather(table, n) * s for n, s in zip(place.nodes, place.weights, strict=True))
    # what float32 directions and coordinates leave of values up to 1
    np.testing.assert_allclose(found.numpy(), interpolate(mesh, values, w), atol=3e-6)


@pytest.mark.parametrize(
    ("nodes", "message"),
    [
        (np.eye(3)[:2], "at least three"),
        (-np.eye(3), "upper hemisphere"),
        (np.eye(3)[[0, 1, 2, 2]], "are the same"),
        (to_vector(np.full(5, 1.0), np.linspace(0.0, 1.0, 5)), "do not surround the normal"),
    ],
)
def test_bad_directions_are_refused(nodes: np.ndarray, message: str) -> None:
    refused(message, HemisphereTriangulation, nodes)

"""Regular grids: no more samples than are there, and exact where they were taken."""

from __future__ import annotations

import math

import numpy as np
import pytest

from refusals import refused
from simrig.brdf import kurt_material
from simrig.brdf.protocol import evaluate
from simrig.directions import to_vector
from simrig.plans.uniform import regular_grid
from simrig.reconstruction.scattered.regular_grid import reconstruct_regular_grid
from simrig.rigs.direct.gonioreflectometer import Gonioreflectometer


@pytest.mark.parametrize("reciprocal", [True, False])
@pytest.mark.parametrize("samples", [16, 300, 1034, 3230, 8911, 18721])
def test_a_regular_grid_has_at_most_as_many_samples(samples: int, reciprocal: bool) -> None:
    plan = regular_grid(samples, math.radians(80.0), reciprocal)
    assert 0.6 * samples <= plan.samples == len(plan.angles()) <= samples


def test_a_regular_grid_needs_ten_samples() -> None:
    refused("at least 10", regular_grid, 9, 1.0)
    refused("at least 16", regular_grid, 15, 1.0, False)


def test_the_regular_grid_is_exact_at_its_nodes() -> None:
    truth = kurt_material("yellow_satin")
    plan = regular_grid(3230, math.radians(80.0))
    measurement = Gonioreflectometer().measure(truth, plan)
    assert measurement.cost.samples == plan.samples
    table = reconstruct_regular_grid(measurement)
    rng = np.random.default_rng(5)
    theta = rng.integers(0, plan.thetas, (2, 200)) * plan.theta_step
    phi = rng.integers(0, plan.azimuths, (2, 200)) * (2.0 * np.pi / plan.azimuths)
    wi, wv = to_vector(theta[0], phi[0]), to_vector(theta[1], phi[1])
    np.testing.assert_allclose(evaluate(table, wi, wv), evaluate(truth, wi, wv), rtol=1e-5)

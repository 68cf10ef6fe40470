"""BTFs from the gantry's images: every texel as the gantry's own methods reconstruct a BRDF."""

from __future__ import annotations

import numpy as np
import pytest

from refusals import refused
from simrig.brdf import Lambert, kurt_material
from simrig.brdf.minnaert import fit_minnaert
from simrig.brdf.protocol import evaluate
from simrig.btf.full import FullBtf
from simrig.btf.stack import BtfStack
from simrig.btf.synthetic import grid_angles
from simrig.core.errors import SimrigError
from simrig.directions.schemes import HemisphereScheme, Ring
from simrig.directions.spherical import to_vector
from simrig.plans.gantry import GantryPlan
from simrig.reconstruction.gantry.brdfs import reconstruct_gantry
from simrig.reconstruction.gantry.btf import planned_images, reconstruct_btf
from simrig.reconstruction.gantry.polar_angles import interval_weights, line_weights
from simrig.reconstruction.gantry.texels import texel_method
from simrig.rigs.gantry.rig import Gantry
from simrig.rigs.measurements.measurement import Measurement

PLAN = GantryPlan()
# on the azimuths of the methods' own tables: nothing is interpolated a second time
RINGS = (Ring(0.0, 1), Ring(15.0, 4), Ring(45.0, 6, 15.0), Ring(75.0, 4))
ANGLES = grid_angles(HemisphereScheme.from_rings("some", RINGS))
MATERIALS = ("fabric112", "wood01", "yellow_satin")


def gantry(name: str) -> Measurement:
    return Gantry().measure(kurt_material(name), PLAN)


def images(rng: np.random.Generator) -> BtfStack:
    """Return three materials as the texels of a tile, the images in no order."""
    values = np.stack([gantry(name).values for name in MATERIALS], axis=1)[:, None]
    order = rng.permutation(PLAN.samples)
    return BtfStack(values[order].astype(np.float32), PLAN.angles()[order], (3.0, 1.0), "three")


@pytest.mark.parametrize(
    ("method", "tolerance"),
    [
        pytest.param("gantry-a", 2e-3, marks=pytest.mark.slow),
        ("gantry-b", 2e-6),
        ("gantry-bd", 5e-3),
    ],
)
def test_each_texel_is_what_its_brdf_becomes(method, tolerance, rng) -> None:
    """Method A blends its halves as logarithms where theta_i = theta_v, as values in the table.

    Where several transports cost the same, those of method BD may differ.
    """
    stack = reconstruct_btf(images(rng), method, angles=ANGLES)
    wi, wv = to_vector(ANGLES[:, 0], ANGLES[:, 2]), to_vector(ANGLES[:, 1], ANGLES[:, 3])
    for texel, name in enumerate(MATERIALS):
        table = reconstruct_gantry(gantry(name), method, theta_step_deg=15.0, azimuths=24)
        expected = evaluate(table.brdf, wi, wv)
        np.testing.assert_allclose(
            stack.values[:, 0, texel], expected, atol=tolerance * expected.max()
        )


def test_transport_one_by_one_is_that_of_the_tables(rng) -> None:
    measured, angles = images(rng), ANGLES[::7]
    stack = reconstruct_btf(measured, "gantry-bd", angles=angles, transport="rows")
    once = reconstruct_btf(measured, "gantry-bd", angles=angles)
    peak = stack.values.max(axis=(0, 1, 3))
    off = np.abs(stack.values - once.values) / peak[:, None]
    assert 0.0 < off.max() < 2e-2  # several transports of one cost
    assert off.mean() < 5e-4
    assert "transport 'rows'" in stack.provenance["method"]
    assert "transport 'circle'" in once.provenance["method"]


@pytest.mark.parametrize(
    "method", [pytest.param("gantry-a", marks=pytest.mark.slow), "gantry-b", "gantry-bd"]
)
def test_a_diffuser_stays_one_and_renders(method) -> None:
    measured = BtfStack(
        np.full((PLAN.samples, 2, 2, 3), 0.1, dtype=np.float32), PLAN.angles(), (1.0, 1.0)
    )
    stack = reconstruct_btf(measured, method, angles=ANGLES)
    np.testing.assert_allclose(stack.values, 0.1, rtol=1e-5)
    wi, wv = stack.directions
    np.testing.assert_allclose(evaluate(FullBtf.from_stack(stack), wi, wv), 0.1, rtol=2e-4)


def test_weights_are_those_of_the_fitted_model(rng) -> None:
    known, wanted = np.radians([30.0, 75.0]), np.radians([0.0, 30.0, 40.0, 60.0, 75.0])
    means = rng.uniform(0.05, 0.5, (2, 2, 5))
    means[0, :, 0] = 0.2  # flat: the limit
    means[1, 1, 1] = 0.0  # nothing is known of the exponent
    found = line_weights(means, known, wanted)
    for line in range(2):
        for texel in range(5):
            values = means[line, :, texel]
            exponent = fit_minnaert(known, np.full(2, 0.3), values).exponent
            second = interval_weights(wanted[1:], known, exponent)
            np.testing.assert_allclose(found[line, 1:, 1, texel], second, atol=2e-5)
            below = (1.0 / np.cos(known[0])) ** exponent
            assert found[line, 0, 0, texel] == pytest.approx(below, rel=1e-4)
    np.testing.assert_allclose(found[:, 1:].sum(axis=2), 1.0)


def test_more_thetas_follow_too() -> None:
    plan = GantryPlan.from_degrees(15, 45, 75)
    values = Gantry().measure(Lambert((0.3, 0.4, 0.5)), plan).values[:, None]
    found = texel_method(plan, "gantry-b", ANGLES)(values)
    np.testing.assert_allclose(found[:, 0] * np.pi, np.tile((0.3, 0.4, 0.5), (len(found), 1)))


def test_missing_images_and_other_requests_are_refused(rng) -> None:
    stack = images(rng)
    part = BtfStack(stack.values[2:], stack.angles[2:], stack.size_mm, "part")
    refused("'part' lacks 2 of the 168 images of the gantry", planned_images, part, PLAN)
    refused("unknown gantry method 'c'", texel_method, PLAN, "c", ANGLES)
    with pytest.raises(SimrigError, match="unknown transport of texels 'subspaces'"):
        texel_method(PLAN, "gantry-bd", ANGLES, "subspaces")
    with pytest.raises(SimrigError, match="ends at theta = 75 degrees and says nothing of 80"):
        texel_method(PLAN, "gantry-b", np.radians([[80.0, 10.0, 0.0, 0.0]]))
    with pytest.raises(SimrigError, match="use gantry-b"):
        texel_method(GantryPlan.from_degrees(15, 30, 45, 75), "gantry-a", ANGLES)

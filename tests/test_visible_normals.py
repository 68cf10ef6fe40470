"""Grids of visible normals: what the plan asks for, and what its values make."""

from __future__ import annotations

import numpy as np
import pytest

from refusals import refused
from simrig.brdf import Lambert, Ward, evaluate, kurt_material
from simrig.brdf.kriging.displayed import displayed_pairs
from simrig.directions.spherical import to_vector
from simrig.methods import METHODS
from simrig.plans.visible_normals import SIZES, TableSizes, VisibleNormalsPlan
from simrig.rigs.direct.gonioreflectometer import Gonioreflectometer
from simrig.rigs.measurements.measurement import Measurement

REACH = np.radians(75.0)


def measured(brdf, samples: int) -> Measurement:
    return Gonioreflectometer().measure(
        brdf, VisibleNormalsPlan.for_material(brdf, samples=samples)
    )


def error(brdf, made) -> float:
    """Return the mean error of cube roots at pairs that pictures show, in percent."""
    wi, wv = displayed_pairs(2000, REACH, REACH, 4)
    truth, found = (np.cbrt(evaluate(which, wi, wv)) for which in (brdf, made))
    return float(100.0 * np.abs(found - truth).mean() / truth.mean())


@pytest.mark.parametrize(
    ("brdf", "samples", "limit"),
    [
        (Lambert(), 400, 4.0),
        (Ward(), 3000, 2.0),
        (kurt_material("red_velvet"), 2000, 4.0),
        (kurt_material("fabric112"), 8000, 5.0),
    ],
    ids=["lambert", "ward", "red_velvet", "fabric112"],
)
def test_materials_are_rebuilt_from_grids(brdf, samples, limit, tmp_path):
    measurement = measured(brdf, samples)
    assert 0.7 * samples < len(measurement.values) <= samples
    made = METHODS["visible-normals"].reconstruct(measurement).brdf
    assert error(brdf, made) < limit
    measurement.save(tmp_path / "m.h5")
    again = METHODS["visible-normals"].reconstruct(Measurement.load(tmp_path / "m.h5")).brdf
    wi, wv = displayed_pairs(50, REACH, REACH, 5)
    assert np.array_equal(again.eval(wi, wv), made.eval(wi, wv))


def test_a_diffuse_body_loses_no_light_between_views():
    made = METHODS["visible-normals"].reconstruct(measured(Lambert((1.0, 1.0, 1.0)), 600))
    assert "f_r interpolated between views" in made.notes[1]
    light = to_vector(np.radians([0.0, 20.0, 40.0, 60.0]), 0.5)
    for view in np.radians([15.0, 35.0, 65.0, 75.0]):  # nodes lie at 0°, 54° and 85°
        found = made.brdf.eval(light, np.broadcast_to(to_vector(view, 0.0), (4, 3)))
        assert found == pytest.approx(1.0 / np.pi, rel=5e-3)


def test_a_highlight_is_interpolated_as_it_is_stored():
    shiny = Ward((0.1,) * 3, (0.3,) * 3, 0.05, 0.05)
    made = METHODS["visible-normals"].reconstruct(measured(shiny, 3000))
    assert "f_r interpolated" not in made.notes[1]
    assert error(shiny, made.brdf) < 8.0


def test_effects_are_bound_without_measuring_first():
    material = Ward(m_x=0.3, m_y=0.3)
    plan = VisibleNormalsPlan.for_material(material, samples=3000)
    probe = plan.probe(400)
    angles = np.concatenate(list(probe.batches()))
    assert 200 < len(angles) <= 400
    assert angles[:, 0].max() <= plan.theta_i_max + 1e-9
    assert angles[:, 1].max() <= plan.theta_v_max + 1e-9
    back = np.all(np.abs(angles[:, :2] - angles[:, 1::-1]) < 1e-9, axis=1)
    assert np.sum(back) > 50  # retro-reflection is where the plan looks first


def test_values_at_nodes_come_back():
    satin = kurt_material("purple_satin")
    measurement = measured(satin, 6000)
    made = METHODS["visible-normals"].reconstruct(measurement).brdf
    sizes = TableSizes.from_array(measurement.layout[SIZES])
    first = measurement.plan.first(sizes)
    angles, values = measurement.angles[first:], measurement.values[first:]
    inner = np.all(angles[:, :2] < REACH, axis=1)
    theta_i, theta_v, phi_i, phi_v = angles[inner].T
    found = made.eval(to_vector(theta_i, phi_i), to_vector(theta_v, phi_v))
    off = np.abs(found / values[inner] - 1.0)
    assert np.median(off) < 1e-3
    assert np.percentile(off, 95) < 0.05


def test_what_does_not_fit_is_refused():
    refused("too few", VisibleNormalsPlan, 50)
    refused("how its tables lie", TableSizes.from_array, np.array([1, 2]))
    refused("cannot be", TableSizes.from_array, np.array([1, 1, 2, 9, 3, 5, 9]))
    scan = Gonioreflectometer().measure(Lambert(), METHODS["auto"].plan(Lambert(), 30))
    refused("visible-normals", METHODS["visible-normals"].reconstruct, scan)

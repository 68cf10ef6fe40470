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

"""The chi-square test of ``sample`` against ``pdf``, for every plugin."""

from __future__ import annotations

import numpy as np
import pytest

from simrig.brdf.kurt_materials import KURT_MATERIALS, kurt_material
from simrig.plugins import make_bsdf

VIEWS_DEG = ((0.0, 0.0), (30.0, 200.0), (60.0, 45.0), (85.0, 110.0))
# the narrow lobes at the pole fill less than one cell of the test's grid in cos(theta)
OFF_POLE_DEG = ((20.0, 200.0), (60.0, 45.0), (85.0, 110.0))


@pytest.mark.parametrize("view_deg", VIEWS_DEG)
@pytest.mark.parametrize("name", ["lambert", "table", "barycentric", "slices", "ward", "fabric112"])
def test_samples_follow_the_density(name, view_deg, brdf, tools, variant_llvm):
    bsdf = make_bsdf(brdf(name), rotation_deg=20.0)
    test, accepted = tools.chi_square(bsdf, tools.direction(*view_deg))
    assert accepted, test.messages


@pytest.mark.parametrize("view_deg", OFF_POLE_DEG)
@pytest.mark.parametrize("name", ["brushed_aluminium", "narrow", "narrow_anisotropic"])
def test_samples_of_narrow_lobes_follow_the_density(name, view_deg, brdf, tools, variant_llvm):
    bsdf = make_bsdf(brdf(name), rotation_deg=20.0)
    test, accepted = tools.chi_square(bsdf, tools.direction(*view_deg), res=200, ires=32)
    assert accepted, test.messages


@pytest.mark.slow
@pytest.mark.parametrize("theta_deg", [5.0, 45.0, 70.0, 80.0, 85.0])
@pytest.mark.parametrize("name", KURT_MATERIALS)
def test_samples_of_the_built_in_materials_follow_the_density(name, theta_deg, tools, variant_llvm):
    bsdf = make_bsdf(kurt_material(name))
    for phi_deg in (0.0, 75.0, 160.0, 290.0):
        wi = tools.direction(theta_deg, phi_deg)
        test, accepted = tools.chi_square(bsdf, wi, res=200, ires=24, sample_count=4_000_000)
        assert accepted, test.messages


def test_a_wrong_density_is_rejected(brdf, tools, variant_llvm):
    """The test of the test: the lobes weigh 5 % less in the density than in the samples."""
    right = make_bsdf(brdf("ward"))
    wrong = make_bsdf(brdf("ward"))
    for lobe in wrong.mixture.lobes:
        object.__setattr__(lobe, "weight_normal", lobe.weight_normal * 0.95)
    right.pdf = wrong.pdf
    _, accepted = tools.chi_square(right, tools.direction(20.0))
    assert not accepted


def test_the_density_integrates_to_one_at_most(brdf, tools, variant_llvm):
    bsdf = make_bsdf(brdf("brushed_aluminium"))
    test, _ = tools.chi_square(bsdf, tools.direction(70.0, 30.0), res=200, ires=32)
    # what is missing are the samples below the horizon, which bounded lobes make rare
    assert 0.9 < float(np.ravel(test.pdf_sum)[0]) <= 1.001

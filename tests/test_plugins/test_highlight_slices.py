"""Slices along highlights as a Mitsuba BSDF."""

from __future__ import annotations

import numpy as np
import pytest

from simrig.brdf import kurt_material
from simrig.plans.along_slices import SlicePlan
from simrig.plans.placement import SlicePlacement
from simrig.plugins import make_bsdf
from simrig.reconstruction.slices.highlights import reconstruct_along_highlights
from simrig.rendering.render import render
from simrig.rigs.direct.gonioreflectometer import Gonioreflectometer
from simrig.scenes import build_scene


@pytest.fixture(scope="module")
def reconstructed():
    placement = SlicePlacement.from_degrees(20, 60)
    material = kurt_material("fabric112")
    return reconstruct_along_highlights(
        Gonioreflectometer().measure(material, SlicePlan(placement, 2200))
    )


@pytest.mark.parametrize("view_deg", [(0.0, 0.0), (30.0, 200.0), (85.0, 110.0)])
def test_samples_follow_the_density(view_deg, reconstructed, tools, variant_llvm):
    bsdf = make_bsdf(reconstructed, rotation_deg=20.0)
    test, accepted = tools.chi_square(bsdf, tools.direction(*view_deg))
    assert accepted, test.messages


def test_a_sphere_looks_like_the_material(reconstructed, variant_llvm):
    pictures = []
    for brdf in (kurt_material("fabric112"), reconstructed):
        scene = build_scene("sphere", make_bsdf(brdf), resolution=32)
        pictures.append(np.asarray(render(scene, 64, seed=0).image))
    lit = pictures[0].sum(axis=2) > 0.0
    error = np.abs(pictures[1] - pictures[0])[lit].mean() / pictures[0][lit].mean()
    assert error < 0.1

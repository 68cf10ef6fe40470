"""Spectra are transported where RGB cannot say what they look like, and only there."""

from __future__ import annotations

import pytest
from planning_scenes import POINT, bound_of, simple

from simrig.core import backend
from simrig.core.errors import SimrigError
from simrig.planning import plan_scene, planned_render

pytestmark = pytest.mark.usefixtures("variant_llvm")

# Mitsuba cannot evaluate it in RGB at all
REGULAR = {
    "type": "regular",
    "wavelength_min": 400.0,
    "wavelength_max": 700.0,
    "values": "0.1, 0.9",
}


def test_spectra_are_transported_and_the_variant_comes_back() -> None:
    gold = {"type": "roughconductor", "material": "Au", "alpha": 0.3}
    scene = simple(s={"type": "sphere", "bsdf": gold}, e=POINT)
    plan = plan_scene(scene, "dE=2")
    assert plan.on("spectral")
    why = plan.decision("spectral").why
    assert "cannot be bounded" in why and "'roughconductor'" in why
    assert plan.settings["variant"] == "llvm_ad_spectral"
    assert backend.current() == "llvm_ad_rgb"
    assert not plan_scene(scene, "dE=2", disable=["spectral"]).on("spectral")
    assert planned_render(scene, plan).variant == "llvm_ad_spectral"


def test_integrators_in_python_hold_no_spectra() -> None:
    scene = simple(s={"type": "sphere"}, e=POINT, integrator={"type": "prb"})
    assert plan_scene(scene, "dE=2").decision("spectral").bound.absent


def test_a_lamp_at_the_centre_of_a_body_is_planned() -> None:
    lamp = {"type": "point", "position": [0.0, 0.0, 0.0]}
    bodies = {"s": {"type": "sphere"}, "t": {"type": "sphere", "center": [0.0, 0.0, 3.0]}}
    assert plan_scene(simple(**bodies, e=lamp), "dE=2").on("shadowing")


def test_without_a_bound_nobody_knows_whether_a_tolerance_is_kept() -> None:
    gold = {"type": "roughconductor", "material": "Au", "alpha": 0.3}
    scene = simple(s={"type": "sphere", "bsdf": gold}, e=POINT)
    about = plan_scene(scene, "dE=2", disable=["spectral"]).about
    assert about["kept"] is None is about["expected_error"]
    assert "leaving out spectral changes cannot be bounded" in about["advice"]


@pytest.mark.parametrize(
    ("entry", "spectral"),
    [
        ({"type": "rgb", "value": [0.2, 0.3, 0.4]}, False),
        ({"type": "uniform", "value": 0.5}, False),
        ({"type": "spectrum", "value": 0.5}, False),
        ({"type": "spectrum", "value": [(400.0, 0.2), (700.0, 0.9)]}, True),
        (
            {"type": "regular", "wavelength_min": 400.0, "wavelength_max": 700.0, "values": "1 2"},
            True,
        ),
    ],
)
def test_the_variant_follows_from_what_is_spectral(entry: dict, spectral: bool) -> None:
    """In both directions: RGB data in a spectral variant are rendered in the RGB one."""
    scene = simple(s={"type": "sphere", "bsdf": {"type": "diffuse", "reflectance": entry}}, e=POINT)
    for chosen in ("llvm_ad_rgb", "llvm_ad_spectral"):
        backend.select(chosen)
        plan = plan_scene(scene, "dE=4", variant=chosen)
        assert plan.on("spectral") is spectral
        assert plan.settings["variant"] == f"llvm_ad_{'spectral' if spectral else 'rgb'}"
        assert (bound_of(plan, "spectral") == 0.0) is not spectral
        assert planned_render(scene, plan).variant == plan.settings["variant"]


def test_spectra_that_rgb_cannot_say_are_refused_without_spectral() -> None:
    bsdf = {"type": "diffuse", "reflectance": REGULAR}
    scene = simple(s={"type": "sphere", "bsdf": bsdf}, e=POINT)
    with pytest.raises(SimrigError, match="cannot be rendered in the variant 'llvm_ad_rgb'"):
        plan_scene(scene, "dE=4", disable=["spectral"])
    assert backend.current() == "llvm_ad_rgb"

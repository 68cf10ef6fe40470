"""Whole renders: energy, agreement of estimators, colours in the spectral variants."""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np
import pytest

from simrig.brdf.analytic import Lambert
from simrig.brdf.kurt_materials import kurt_material
from simrig.core import backend
from simrig.plugins import make_bsdf

SIZE = 8


def sphere_scene(bsdf: Any, emitter: dict, integrator: dict) -> Any:
    """Return a sphere that fills the picture."""
    view = mi.ScalarTransform4f().look_at([0, -5, 0], [0, 0, 0], [0, 0, 1])
    film = {"type": "hdrfilm", "width": SIZE, "height": SIZE, "rfilter": {"type": "box"}}
    film["pixel_format"] = "rgb"
    return mi.load_dict(
        {
            "type": "scene",
            "integrator": integrator,
            "emitter": emitter,
            "sphere": {"type": "sphere", "bsdf": bsdf},
            "sensor": {"type": "perspective", "fov": 14.0, "to_world": view, "film": film},
        }
    )


def renders(scene: Any, seeds: range, spp: int) -> np.ndarray:
    """Return independent renders, summed over RGB, shape (seeds, pixels)."""
    pictures = [mi.render(scene, spp=spp, seed=seed).numpy() for seed in seeds]
    return np.stack([p.astype(np.float64).sum(axis=-1).ravel() for p in pictures])


def area_light() -> dict:
    return {
        "type": "sphere",
        "center": [3.0, -3.0, 2.0],
        "radius": 1.2,
        "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [4.0, 3.0, 2.0]}},
    }


def test_a_white_furnace_stays_white(variant_llvm):
    bsdf = make_bsdf(Lambert((1.0, 1.0, 1.0)))
    scene = sphere_scene(bsdf, {"type": "constant"}, {"type": "path", "max_depth": 4})
    picture = renders(scene, range(8), 64) / 3.0
    error = picture.std(axis=0).mean() / np.sqrt(picture.size)
    assert picture.mean() == pytest.approx(1.0, abs=4.0 * error + 1e-6)
    assert error < 2e-3


@pytest.mark.parametrize("theta_deg", [0.0, 40.0, 75.0])
@pytest.mark.parametrize("name", ["lambert", "table", "slices", "ward", "brushed_aluminium"])
def test_the_samples_carry_the_albedo(name, theta_deg, brdf, tools, variant_llvm, rng):
    material = brdf(name)
    count = 200_000
    wi = np.broadcast_to(tools.direction(theta_deg, 25.0), (count, 3))
    u = rng.uniform(size=(3, count))
    _, weight = make_bsdf(material).sample(
        mi.BSDFContext(), tools.interaction(wi), mi.Float(u[0]), mi.Point2f(u[1], u[2])
    )
    weight = weight.numpy().astype(np.float64)
    error = weight.std(axis=1) / np.sqrt(count)
    expected = material.directional_albedo(np.radians(theta_deg), np.radians(25.0))
    # the quadrature itself is within 0.3 % for the built-in materials
    assert np.all(np.abs(weight.mean(axis=1) - expected) < 4.0 * error + 0.005 * expected)
    assert np.all(error < 0.01 * expected)


@pytest.mark.parametrize("name", ["table", "slices", "ward", "brushed_aluminium"])
def test_emitter_bsdf_and_combined_sampling_agree(name, brdf, tools, variant_llvm):
    bsdf = make_bsdf(brdf(name), rotation_deg=30.0)
    seeds, spp = 16, 2048  # with few samples the noise is too far from normal
    strategies = {"emitter": (1, 0), "bsdf": (0, 1), "both": (1, 1)}
    results = {}
    for number, (key, (emitter, from_bsdf)) in enumerate(strategies.items()):
        integrator = {"type": "direct", "emitter_samples": emitter, "bsdf_samples": from_bsdf}
        scene = sphere_scene(bsdf, area_light(), integrator)
        results[key] = renders(scene, range(100 * number, 100 * number + seeds), spp)
    assert tools.z_test(results["emitter"], results["bsdf"]) > 1e-3
    assert tools.z_test(results["emitter"], results["both"]) > 1e-3
    # the test of the test: a shift of two standard errors is seen
    shift = 2.0 * results["both"].std(axis=0, ddof=1) * np.sqrt(2.0 / seeds)
    assert tools.z_test(results["emitter"], results["both"] + shift) < 1e-3


def test_it_works_behind_a_twosided(brdf, variant_llvm):
    bsdf = mi.load_dict({"type": "twosided", "inner": make_bsdf(brdf("ward"))})
    light = {"type": "constant"}
    picture = renders(sphere_scene(bsdf, light, {"type": "path", "max_depth": 3}), range(1), 16)
    plain = make_bsdf(brdf("ward"))
    expected = renders(sphere_scene(plain, light, {"type": "path", "max_depth": 3}), range(1), 16)
    assert picture == pytest.approx(expected, rel=1e-3)


def test_light_tracing_agrees_with_path_tracing(tools, variant_llvm):
    """Importance mode end to end, with a BRDF that is not reciprocal."""
    bsdf = make_bsdf(tools.OneWay())
    light = {"type": "point", "position": [3.0, -4.0, 2.0], "intensity": 30.0}
    forward = sphere_scene(bsdf, light, {"type": "path", "max_depth": 2})
    backward = sphere_scene(bsdf, light, {"type": "ptracer", "max_depth": 3})
    paths = renders(forward, range(12), 64)
    particles = renders(backward, range(50, 62), 1024)
    assert tools.z_test(paths, particles) > 1e-3
    # seen the wrong way round, the picture would differ
    swapped = tools.OneWay()
    straight = tools.OneWay.look_up
    swapped.look_up = lambda wi, wv, tables: straight(swapped, wv, wi, tables)
    wrong = renders(
        sphere_scene(make_bsdf(swapped), light, {"type": "path", "max_depth": 2}), range(12), 64
    )
    assert tools.z_test(paths, wrong) < 1e-3


@pytest.mark.parametrize("material", ["fabric112", "brushed_aluminium", "yellow_satin"])
def test_spectral_renders_have_the_colours_of_rgb_renders(material):
    """Under D65 white. The spectral estimate is noisy in wavelength, hence the means."""
    colours = {}
    for variant in ("llvm_ad_rgb", "llvm_ad_spectral"):
        backend.select(variant)
        bsdf = make_bsdf(kurt_material(material))
        scene = sphere_scene(bsdf, {"type": "constant"}, {"type": "direct"})
        pictures = [mi.render(scene, spp=4096, seed=seed).numpy() for seed in range(2)]
        colours[variant] = np.mean(pictures, axis=(0, 1, 2))
    backend.select("llvm_ad_rgb")
    assert colours["llvm_ad_spectral"] == pytest.approx(colours["llvm_ad_rgb"], rel=5e-3)


def test_the_upsampling_keeps_every_colour_under_d65():
    """Integrated against the colour matching functions, without noise."""
    import colour

    from simrig.plugins.spectral import basis

    shape = colour.SpectralShape(380, 780, 5)
    observer = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"].copy().align(shape)
    light = colour.SDS_ILLUMINANTS["D65"].copy().align(shape).values
    weights = observer.values * light[:, None]
    to_rgb = colour.RGB_COLOURSPACES["sRGB"].matrix_XYZ_to_RGB
    matrix = to_rgb @ (weights.T @ basis()) / weights[:, 1].sum()
    assert matrix == pytest.approx(np.eye(3), abs=2e-3)
    assert basis().min() >= 0.0
    assert basis().sum(axis=1) == pytest.approx(np.ones(81), abs=1e-3)

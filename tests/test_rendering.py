"""Rendering: agreement with plain NumPy, exact sums over lights, passes, cost and refusals."""

from __future__ import annotations

import re

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from refusals import refused
from simrig.brdf.kurt_materials import kurt_material
from simrig.brdf.protocol import evaluate
from simrig.core.errors import SimrigError
from simrig.rendering import render as rendering
from simrig.rendering.render import automatic_exposure, display_exposure, pixel_directions, render
from simrig.scenes import DirectionalLights, cylinder, environment_sphere, four_spheres, sphere

GREY = {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.5, 0.3, 0.2]}}
CONTROL_SCENES = {
    "sphere": lambda bsdf: sphere(bsdf, pixel_centres=True),
    "four_spheres": lambda bsdf: four_spheres(bsdf, resolution=256, pixel_centres=True),
    "cylinder": lambda bsdf: cylinder(bsdf, "left", resolution=64, pixel_centres=True),
}
# Of the radiance. The directions pass through float32 (1e-7), and the narrowest lobe used here
# (roughness 0.035) has a relative slope of up to 2 tan/m² = 5,000 per radian where it still counts.
FLOAT32_TOLERANCE = 2e-3

pytestmark = pytest.mark.usefixtures("variant_llvm")


def random_lights(count: int, seed: int = 5) -> DirectionalLights:
    generator = np.random.default_rng(seed)
    directions = generator.standard_normal((count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return DirectionalLights(directions, generator.uniform(0.1, 1.0, (count, 3)))


@pytest.mark.parametrize("name", CONTROL_SCENES)
@pytest.mark.parametrize("material", ["yellow_satin", "brushed_aluminium", "fabric112"])
def test_control_samples_reproduce_the_render(name: str, material: str) -> None:
    """f_r evaluated in float64 over the directions of the pixels is Mitsuba's picture."""
    scene = CONTROL_SCENES[name]({"type": "simrig_kurt", "material": material})
    control = pixel_directions(scene)
    values = evaluate(kurt_material(material), control.omega_i, control.omega_v)
    picture = control.picture(values)
    rendered = render(scene)
    assert rendered.spp == 1
    # the outermost pixels of the shadow line may fall to either side in float32
    differs = (picture > 0.0).any(axis=-1) != (rendered.image > 0.0).any(axis=-1)
    assert differs.sum() <= 2
    np.testing.assert_allclose(
        rendered.image[~differs],
        picture[~differs],
        rtol=FLOAT32_TOLERANCE,
        atol=1e-6 * picture.max(),
    )


def test_control_samples_describe_the_sphere() -> None:
    control = pixel_directions(sphere(GREY))
    assert control.object_mask.sum() == 10_975
    assert len(control) == control.lit_mask.sum() < 10_975
    assert not np.any(control.lit_mask & ~control.object_mask)
    assert set(np.array(control.shape_names)[control.shape_index]) == {"sphere"}
    for theta, phi in ((control.theta_i, control.phi_i), (control.theta_v, control.phi_v)):
        assert theta.shape == phi.shape == (len(control),)
        assert theta.min() >= 0.0 and theta.max() <= np.pi / 2
        assert phi.min() >= 0.0 and phi.max() < 2.0 * np.pi
    np.testing.assert_allclose(np.linalg.norm(control.omega_i, axis=1), 1.0, rtol=1e-12)
    # the lamp stands to the upper right: seen from the middle it has a positive u and v
    middle = np.argmin(control.theta_v)
    assert 0.0 < control.phi_i[middle] < np.pi / 2


def test_control_samples_need_the_right_number_of_values() -> None:
    with pytest.raises(SimrigError, match="expected values of shape"):
        pixel_directions(sphere(GREY, resolution=8)).picture(np.ones((3, 3)))


def test_every_light_is_added_once() -> None:
    """The picture under many lights is the NumPy sum of the pictures under each of them."""
    lights = random_lights(12)
    material = "yellow_satin"
    scene = environment_sphere(
        {"type": "simrig_kurt", "material": material}, lights, resolution=32, pixel_centres=True
    )
    loaded = mi.load_dict(scene)
    total = np.zeros((32, 32, 3))
    for index in range(len(lights)):
        control = pixel_directions(loaded, light=index)
        values = evaluate(kurt_material(material), control.omega_i, control.omega_v)
        total += control.picture(values)
    image = render(loaded).image
    np.testing.assert_allclose(image, total, rtol=FLOAT32_TOLERANCE, atol=1e-5 * total.max())


def smallest_p_value(batches: list[np.ndarray], others: list[np.ndarray]) -> float:
    """Return the smallest p-value of Welch's test over all pixels, corrected for their number."""
    _, p = stats.ttest_ind(np.stack(batches), np.stack(others), axis=0, equal_var=False)
    p = p[np.isfinite(p)]
    return float(-np.expm1(p.size * np.log1p(-p.min())))  # Šidák


def test_sum_over_lights_agrees_with_mitsuba_direct() -> None:
    """Same mean as ``direct``, which picks one light per sample; a shift of 3 % is found."""
    scene = mi.load_dict(environment_sphere(GREY, random_lights(16), resolution=12))
    exact = [render(scene, spp=64, seed=seed).image for seed in range(16)]
    direct = {"type": "direct", "emitter_samples": 1, "bsdf_samples": 0}
    picked = [render(scene, 4096, seed, integrator=direct).image for seed in range(16, 32)]
    assert smallest_p_value(exact, picked) > 0.001
    assert smallest_p_value([1.03 * image for image in exact], picked) < 0.001


def test_sum_over_lights_has_no_noise() -> None:
    scene = environment_sphere(GREY, random_lights(16), resolution=12, pixel_centres=True)
    first, second = (render(scene, seed=seed).image for seed in (1, 2))
    np.testing.assert_array_equal(first, second)


def test_shadows_are_tested_when_asked() -> None:
    scene = four_spheres(GREY, resolution=128, light_distance=200.0, pixel_centres=True)
    shadowed = render(scene, integrator={"type": "simrig_all_lights"}).image
    np.testing.assert_allclose(shadowed, render(scene).image, rtol=1e-5, atol=1e-7)
    open_air = render(scene, integrator={"type": "simrig_all_lights", "shadows": False}).image
    assert (open_air - shadowed).min() > -1e-6
    assert (open_air - shadowed).max() > 0.01


def test_area_lights_get_one_unbiased_sample_each() -> None:
    scene = {
        **sphere(GREY, resolution=8),
        "lamp": {"type": "sphere", "center": [0.0, 80.0, 200.0], "radius": 20.0,
                 "emitter": {"type": "area", "radiance": 20.0}},
    }  # fmt: skip
    ours = render(scene, 4096, integrator="simrig_all_lights").image
    theirs = render(scene, 4096, seed=1, integrator={"type": "path", "max_depth": 2}).image
    np.testing.assert_allclose(ours.mean(), theirs.mean(), rtol=0.01)


def test_gradient_through_the_sum_over_lights() -> None:
    """Reverse mode against a finite difference, which is exact for a linear parameter."""
    # fixed samples: reverse mode would otherwise look through other places than the primal
    scene = mi.load_dict(
        environment_sphere(GREY, random_lights(9), resolution=8, pixel_centres=True)
    )
    parameters = mi.traverse(scene)
    key = "material.reflectance.value"

    def mean(value: mi.Color3f) -> mi.Float:
        parameters[key] = value
        parameters.update()
        return dr.mean(mi.render(scene, parameters, spp=1), axis=None)

    value = mi.Color3f(0.5, 0.3, 0.2)
    dr.enable_grad(value)
    dr.backward(mean(value))
    gradient = np.array(dr.grad(value)).ravel()
    for channel in range(3):
        changed = [0.5, 0.3, 0.2]
        changed[channel] += 0.1
        up = mean(mi.Color3f(*changed)).item()
        changed[channel] -= 0.2
        down = mean(mi.Color3f(*changed)).item()
        assert gradient[channel] == pytest.approx((up - down) / 0.2, rel=1e-3)


@given(spp=st.integers(1, 5000), pixels=st.integers(1, 10**6), limit=st.integers(10**6, 2**33))
def test_passes_hold_every_sample_within_the_limit(spp: int, pixels: int, limit: int) -> None:
    passes = rendering._passes(spp, pixels, limit)
    assert sum(passes) == spp
    assert all(0 < p * pixels <= min(limit, 2**32 - 1) for p in passes)
    assert len(passes) == 1 or all(p & (p - 1) == 0 for p in passes[:-1])  # share one kernel


def test_passes_are_averaged() -> None:
    calls: list[tuple[int, int]] = []
    scene = mi.load_dict(sphere(GREY, resolution=32))
    parts = render(scene, 21, samples_per_pass=8 * 32 * 32, progress=lambda *c: calls.append(c))
    assert calls == [(8, 21), (16, 21), (21, 21)]
    whole = render(scene, 2048)
    inside = pixel_directions(scene).object_mask
    noise = np.abs(parts.image - whole.image)[inside]
    assert noise.mean() < 0.005
    single = np.abs(render(scene, 8).image - whole.image)[inside]
    assert noise.mean() < 0.8 * single.mean(), "the passes repeat the same random numbers"


def test_seeds_decide_the_picture() -> None:
    scene = mi.load_dict(sphere(GREY, resolution=16))
    first = render(scene, 4, seed=1).image
    np.testing.assert_array_equal(first, render(scene, 4, seed=1).image)
    assert np.any(first != render(scene, 4, seed=2).image)


def test_passes_of_neighbouring_seeds_are_different(monkeypatch: pytest.MonkeyPatch) -> None:
    """Seeds 0, 1, 2, ... must not share passes, or pictures of several seeds would correlate."""
    used: list[int] = []
    monkeypatch.setattr(
        mi, "render", lambda *_, seed, **__: used.append(seed) or np.zeros((8, 8, 3))
    )
    monkeypatch.setattr(rendering, "_colours", lambda film, picture: (picture, ""))
    scene = mi.load_dict(sphere(GREY, resolution=8))
    for seed in range(8):
        render(scene, 32, seed=seed, samples_per_pass=4 * 64)
    assert len(used) == len(set(used)) == 8 * 8


def test_an_interrupt_stops_between_passes() -> None:
    def interrupt(done: int, total: int) -> None:
        assert done < total
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        render(sphere(GREY, resolution=16), 8, samples_per_pass=256, progress=interrupt)


def test_result_reports_what_it_was() -> None:
    result = render(sphere(GREY, resolution=16), 4)
    assert result.image.dtype == np.float32 and result.image.shape == (16, 16, 3)
    assert (result.spp, result.variant, result.integrator) == (4, "llvm_ad_rgb", "DirectIntegrator")
    assert result.compile_seconds >= 0.0 and result.run_seconds > 0.0
    assert result.cost.compute_seconds == result.run_seconds
    assert render(sphere(GREY, resolution=16), integrator="path").integrator == "path"


def test_compilation_is_told_from_running(monkeypatch: pytest.MonkeyPatch) -> None:
    """What Dr.Jit reports as generated and compiled (ms) is apart from the rest of the time."""
    history = [
        {"codegen_time": 0.1, "backend_time": 0.2, "execution_time": 9.0},
        {"execution_time": 5.0},  # a memory operation: nothing to compile
    ]
    monkeypatch.setattr(dr, "kernel_history", lambda: history)
    result = render(sphere(GREY, resolution=8), 4)
    assert result.compile_seconds == pytest.approx(0.0003)
    assert not dr.flag(dr.JitFlag.KernelHistory), "the flag must be left as it was"


def test_passes_and_samples_per_pixel_share_their_kernels(monkeypatch: pytest.MonkeyPatch) -> None:
    """Only the first picture compiles; powers of two from 4 on need nothing new."""
    kernels: list[dict] = []
    read = dr.kernel_history

    def record() -> list[dict]:
        kernels[:] = [kernel for kernel in read() if "cache_hit" in kernel]
        return kernels

    monkeypatch.setattr(dr, "kernel_history", record)
    scene = mi.load_dict(sphere(GREY, resolution=8))
    render(scene, 4)
    for spp, samples_per_pass in ((4, 2**20), (16, 2**20), (32, 8 * 64)):
        render(scene, spp, seed=spp, samples_per_pass=samples_per_pass)
        assert kernels and all(kernel["cache_hit"] for kernel in kernels)


def test_pixels_that_are_not_finite_are_named() -> None:
    scene = mi.load_dict(sphere(GREY, resolution=8))
    parameters = mi.traverse(scene)
    parameters["material.reflectance.value"] = mi.Color3f(float("nan"), 0.5, 0.5)
    parameters.update()
    refused(r"pixels .* not finite, at \(row, column\) \(\d+, \d+\)", render, scene, 4)


def test_display_exposure_fits_the_bright_part() -> None:
    image = np.zeros((10, 10, 3))
    image[:5] = [0.01, 0.02, 0.005]
    assert display_exposure(image) == pytest.approx(40.0)
    refused("black", display_exposure, np.zeros((2, 2, 3)))


def test_a_highlight_does_not_leave_the_body_in_the_dark() -> None:
    picture = np.full((10, 10, 3), 0.5)
    assert automatic_exposure(picture) == pytest.approx(1.6)
    picture[:2] = 8.0
    assert automatic_exposure(picture) == pytest.approx(0.2)
    picture[:2] = 1e3
    assert automatic_exposure(picture) == pytest.approx(8.0 * 0.8e-3)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: render(sphere(GREY), 0), "spp must be"),
        (lambda: render(sphere(GREY), 1.5), "spp must be"),
        (lambda: render(sphere(GREY), seed=-1), "seed"),
        (lambda: render(sphere(GREY), integrator="pth"), '"pth" not found'),
        (lambda: render(sphere({"type": "dffuse"})), '"dffuse" not found'),
        (lambda: render(sphere({"type": "simrig_kurt", "material": "velvt"})), "did you mean"),
        (lambda: render(sphere(GREY), samples_per_pass=100), "100 samples"),
        (lambda: pixel_directions(sphere(GREY), light=1), "there is no light 1"),
        (
            lambda: pixel_directions({**sphere(GREY), "light": {"type": "constant"}}),
            "no point or directional light",
        ),
    ],
)
def test_bad_arguments_are_refused_in_one_line(make, message: str) -> None:
    refused(re.escape(message), make)

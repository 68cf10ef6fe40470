"""``simrig_btf``: the material at the right place, the right way round, at the right size."""

from __future__ import annotations

import re
from pathlib import Path

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from refusals import refused
from simrig.brdf.tables.packed_bfloat16 import RELATIVE_ERROR
from simrig.btf.factored import FactoredBtf
from simrig.btf.full import FullBtf
from simrig.btf.mipmap import Footprint
from simrig.btf.stack import BtfStack
from simrig.btf.synthetic import bumps
from simrig.core import backend
from simrig.core.errors import SimrigError
from simrig.directions import to_vector
from simrig.files.btf.hdf5 import read_btf, write_btf
from simrig.files.hdf5 import write_brdf
from simrig.plugins import make_bsdf, make_btf, one_line_errors
from simrig.plugins.footprint import pixel_angle_deg

SIZE = (12.0, 4.0)
VIEWS_DEG = ((0.0, 0.0), (40.0, 200.0), (75.0, 45.0), (89.0, 110.0))


@pytest.fixture(scope="module")
def stack() -> BtfStack:
    return bumps((8, 12), SIZE)


@pytest.fixture(scope="module")
def btf(stack: BtfStack) -> FullBtf:
    return FullBtf.from_stack(stack)


@pytest.fixture
def stored(stack: BtfStack, tmp_path: Path) -> str:
    return str(write_btf(tmp_path / "stack.h5", stack))


def surface(tools, wi: np.ndarray, uv: np.ndarray, t: float = 0.0):
    si = tools.interaction(wi)
    si.uv = mi.Point2f(np.ascontiguousarray(uv.T))
    si.t = t
    return si


def pairs(rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
    theta, phi = np.arccos(rng.uniform(0.05, 1.0, (2, count))), rng.uniform(0.0, 7.0, (2, count))
    return to_vector(theta[0], phi[0]), to_vector(theta[1], phi[1])


def test_the_value_is_that_of_the_texel_times_the_cosine(btf, tools, rng, variant_llvm) -> None:
    """Light and view keep their roles in both transport modes: the texels are not reciprocal."""
    bsdf = make_btf(btf, scale=60.0, scale_v=20.0)
    first, second = pairs(rng, 300)
    uv = rng.uniform(-2.0, 2.0, (300, 2))
    where = Footprint(uv[:, 0] * 60.0, uv[:, 1] * 20.0)
    wo = mi.Vector3f(np.ascontiguousarray(second.T))
    for mode, light, view in (
        (mi.TransportMode.Radiance, second, first),
        (mi.TransportMode.Importance, first, second),
    ):
        value = bsdf.eval(mi.BSDFContext(mode), surface(tools, first, uv), wo)
        expected = btf.eval_at(light, view, where) * second[:, 2:]
        np.testing.assert_allclose(np.array(value).T, expected, atol=2e-5)
        assert np.abs(btf.eval_at(view, light, where) * second[:, 2:] - expected).max() > 0.05


def test_rotation_turns_texture_and_directions_together(btf, tools, rng, variant_llvm) -> None:
    bsdf = make_btf(btf, scale=10.0, rotation=30.0, pixel_angle=1.0)
    wv, wi = pairs(rng, 200)
    uv = rng.uniform(-2.0, 2.0, (200, 2))
    cos, sin = np.cos(np.radians(30.0)), np.sin(np.radians(30.0))

    def turned(v: np.ndarray) -> np.ndarray:
        return np.column_stack([v[:, :2] @ np.array([[cos, -sin], [sin, cos]]), v[:, 2:]])

    x, y = turned(uv * 10.0).T
    width = np.full(200, 50.0 * np.radians(1.0))
    major = turned(wv)[:, :2] * (width / wv[:, 2] / np.hypot(*wv.T[:2]))[:, None]
    value = bsdf.eval(
        mi.BSDFContext(), surface(tools, wv, uv, 50.0), mi.Vector3f(np.ascontiguousarray(wi.T))
    )
    expected = btf.eval_at(turned(wi), turned(wv), Footprint(x, y, width, *major.T))
    np.testing.assert_allclose(np.array(value).T, expected * wi[:, 2:], atol=2e-5)


def test_far_away_it_is_its_brdf(btf, tools, rng, variant_llvm) -> None:
    far, brdf = make_btf(btf, scale=60.0, pixel_angle=0.1), make_bsdf(btf)
    wv, wi = pairs(rng, 300)
    si = surface(tools, wv, rng.uniform(-2.0, 2.0, (300, 2)), 1e5)
    wo = mi.Vector3f(np.ascontiguousarray(wi.T))
    values = [np.array(b.eval(mi.BSDFContext(), si, wo)) for b in (far, brdf)]
    np.testing.assert_allclose(*values, rtol=1e-5)
    assert dr.all(far.pdf(mi.BSDFContext(), si, wo) == brdf.pdf(mi.BSDFContext(), si, wo))


@pytest.mark.parametrize("view_deg", VIEWS_DEG)
def test_samples_follow_the_density(view_deg, btf, tools, variant_llvm) -> None:
    bsdf = make_btf(btf, scale=60.0, rotation=20.0)
    test, accepted = tools.chi_square(bsdf, tools.direction(*view_deg))
    assert accepted, test.messages


@pytest.mark.parametrize("theta_deg", [0.0, 45.0, 75.0, 85.0, 89.0])
def test_the_albedo_by_samples_is_that_by_quadrature(theta_deg, btf, tools, variant_llvm) -> None:
    """A white furnace: what importance sampling collects is the integral of f_r times cosine."""
    bsdf = make_btf(btf, scale=60.0)
    count = 1 << 16
    wv = np.broadcast_to(tools.direction(theta_deg, 20.0), (count, 3))
    uv = np.broadcast_to([0.13, 0.71], (count, 2))
    sampler = mi.PCG32(size=count)
    numbers = [sampler.next_float32() for _ in range(3)]
    si = surface(tools, wv, uv)
    _, weight = bsdf.sample(mi.BSDFContext(), si, numbers[0], mi.Point2f(*numbers[1:]))
    weight = np.array(weight)
    uniform = mi.warp.square_to_cosine_hemisphere(mi.Point2f(*numbers[1:]))
    value = np.array(bsdf.eval(mi.BSDFContext(), si, uniform)) * np.pi / np.array(uniform.z)
    error = 4.0 * np.sqrt((weight.var(axis=1) + value.var(axis=1)) / count)
    assert np.all(np.abs(weight.mean(axis=1) - value.mean(axis=1)) < error)
    assert np.all(weight.mean(axis=1) < 1.0)


def test_the_spectral_variant_agrees(stored, btf, tools, rng) -> None:
    wv, wi = pairs(rng, 5)
    expected = btf.eval_at(wi, wv, Footprint(np.full(5, 6.0), np.full(5, 3.0))) * wi[:, 2:]
    backend.select("llvm_ad_spectral")
    bsdf = mi.load_dict({"type": "simrig_btf", "filename": stored, "scale": 12.0})
    for k in range(5):
        si = dr.zeros(mi.SurfaceInteraction3f)
        si.wi, si.uv = mi.Vector3f(*wv[k].tolist()), mi.Point2f(0.5, 0.25)
        si.wavelengths = mi.Spectrum(450.0, 500.0, 550.0, 600.0)
        value = np.ravel(bsdf.eval(mi.BSDFContext(), si, mi.Vector3f(*wi[k].tolist())))
        assert np.isfinite(value).all() and value.max() <= 1.05 * expected[k].max()
    backend.select("llvm_ad_rgb")


def test_the_gain_is_differentiable(btf, tools, variant_llvm) -> None:
    bsdf = make_btf(btf, scale=60.0)
    parameters = mi.traverse(bsdf)
    gain = parameters["gain"]
    dr.enable_grad(gain)
    parameters["gain"] = gain
    parameters.update()
    si = surface(tools, np.array([[0.0, 0.0, 1.0]]), np.array([[0.1, 0.2]]))
    value = bsdf.eval(mi.BSDFContext(), si, mi.Vector3f(0.0, 0.6, 0.8))
    dr.backward(dr.sum(value))
    np.testing.assert_allclose(np.array(dr.grad(parameters["gain"])), np.array(value), rtol=1e-5)


def test_the_angle_of_a_pixel_comes_from_the_sensor(variant_llvm) -> None:
    film = {"type": "hdrfilm", "width": 200, "height": 100}
    sensor = mi.load_dict({"type": "perspective", "fov": 60.0, "fov_axis": "x", "film": film})
    half = np.tan(np.radians(30.0))
    assert pixel_angle_deg(sensor) == pytest.approx(np.degrees(2.0 * half / 200), rel=1e-5)
    refused("give 'pixel_width' in mm", pixel_angle_deg, mi.load_dict({"type": "orthographic"}))


def test_less_alias_with_distance(btf, variant_llvm) -> None:
    """One sample per pixel of a far plane: filtered, it has no more noise than its own detail."""

    def spread(**options: float) -> float:
        scene = {
            "type": "scene",
            "integrator": {"type": "direct"},
            "plane": {
                "type": "rectangle",
                "to_world": mi.ScalarTransform4f().scale(500.0),
                "bsdf": make_btf(btf, scale=1000.0, **options),
            },
            "light": {"type": "directional", "direction": [0.6, 0.0, -1.0]},
            "sensor": {
                "type": "perspective",
                "fov": 10.0,
                "to_world": mi.ScalarTransform4f().look_at([0, 0, 4000], [0, 0, 0], [0, 1, 0]),
                "film": {"type": "hdrfilm", "width": 32, "height": 32, "rfilter": {"type": "box"}},
            },
        }
        picture = np.array(mi.render(mi.load_dict(scene), spp=1))[..., 1]
        return float(picture.std() / picture.mean())

    # a pixel is 22 mm wide, the tile 12 × 4 mm
    assert spread() > 0.2
    assert spread(pixel_angle=10.0 / 32) < 0.02


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"scale": 0.0}, "'scale' must be above 0 mm"),
        ({"scale": "big"}, "'scale' must be a number"),
        ({"pixel_angle": -1.0}, "'pixel_angle' must be in"),
        ({"missing": "ignore"}, "known: fill, refuse"),
        ({"budget": 1e-3}, "MiB as a full stack"),
        ({"anisotropy": 0, "pixel_angle": 1.0}, "anisotropy must be"),
        ({"filename": "nowhere.h5"}, "there is no file 'nowhere.h5'"),
    ],
)
def test_bad_properties_are_refused_in_one_line(change, message, stored, variant_llvm) -> None:
    properties = {"type": "simrig_btf", "filename": stored, "scale": 10.0, **change}
    with pytest.raises(SimrigError, match=message), one_line_errors():
        mi.load_dict(properties)
    with pytest.raises(SimrigError, match="'scale' is missing"), one_line_errors():
        mi.load_dict({"type": "simrig_btf", "filename": stored})


def test_the_examples_of_the_page_run(variant_llvm, tmp_path, monkeypatch) -> None:
    page = Path(__file__).resolve().parents[2] / "docs" / "btf.md"
    monkeypatch.chdir(tmp_path)
    namespace: dict = {}
    for block in re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), flags=re.S):
        exec(block, namespace)
    assert type(namespace["material"]).__name__ == "simrig_btf"


def test_the_factored_form_renders_from_a_stack_and_from_its_own_file(
    stored, tools, rng, tmp_path, variant_llvm
) -> None:
    factors = FactoredBtf.from_stack(read_btf(stored), tolerance=0.1)
    write_brdf(tmp_path / "factors.h5", factors)
    wv, wi = pairs(rng, 200)
    uv = rng.uniform(-2.0, 2.0, (200, 2))
    wo = mi.Vector3f(np.ascontiguousarray(wi.T))
    where = Footprint(uv[:, 0] * 60.0, uv[:, 1] * 60.0)
    expected = factors.eval_at(wi, wv, where) * wi[:, 2:]
    for source in (
        {"filename": stored, "form": "factored", "tolerance": 0.1},
        {"filename": str(tmp_path / "factors.h5")},
    ):
        bsdf = mi.load_dict({"type": "simrig_btf", "scale": 60.0, **source})
        value = bsdf.eval(mi.BSDFContext(), surface(tools, wv, uv), wo)
        tolerance = RELATIVE_ERROR * expected.max()
        np.testing.assert_allclose(np.array(value).T, expected, atol=tolerance)


def test_a_brdf_is_no_btf(tools, tmp_path, variant_llvm) -> None:
    write_brdf(tmp_path / "table.h5", tools.small_table())
    properties = {"type": "simrig_btf", "filename": str(tmp_path / "table.h5"), "scale": 1.0}
    with pytest.raises(SimrigError, match="holds a BRDF: use simrig_table"), one_line_errors():
        mi.load_dict(properties)

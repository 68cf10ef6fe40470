"""The adapter: values, the two transport modes, rotation, sides, variants, hard cases."""

from __future__ import annotations

from pathlib import Path

import mitsuba as mi
import numpy as np
import pytest

from simrig.brdf.protocol import evaluate
from simrig.core import backend
from simrig.core.errors import SimrigError
from simrig.directions import to_vector
from simrig.evaluation.stability.hard_cases import case_names, hard_case
from simrig.plugins import make_bsdf, one_line_errors
from simrig.plugins.named import PLUGINS

NAMES = [
    "lambert",
    "one_way",
    "table",
    "slices",
    "ward",
    "brushed_aluminium",
    "fabric112",
    "narrow",
]


def random_pairs(rng: np.random.Generator, count: int = 200) -> tuple[np.ndarray, np.ndarray]:
    theta = rng.uniform(0.0, 1.5, (2, count))
    wi, wo = to_vector(theta, rng.uniform(0.0, 2.0 * np.pi, (2, count)))
    return wi, wo


def value_of(bsdf, tools, wi, wo, context=None) -> np.ndarray:
    """Return ``eval`` for directions of shape (n, 3), as an array of that shape."""
    context = context or mi.BSDFContext()
    value = bsdf.eval(context, tools.interaction(wi), mi.Vector3f(wo.T.copy()))
    return np.broadcast_to(value.numpy().T, wo.shape)


@pytest.mark.parametrize("name", NAMES)
def test_eval_is_the_brdf_times_the_cosine(name, brdf, tools, variant_llvm, rng):
    material = brdf(name)
    wi, wo = random_pairs(rng)
    expected = evaluate(material, wo, wi) * wo[:, 2:]  # Mitsuba's wi is the view here
    # float32: the exponent of narrow lobes loses what the half vector's slope divides by m;
    # slices add and subtract values that are packed to 13 and 12 bits
    tolerance = 3e-3 if name in ("narrow", "slices") else 2e-4
    actual = value_of(make_bsdf(material), tools, wi, wo)
    assert actual == pytest.approx(expected, rel=tolerance, abs=1e-7)


def test_importance_mode_swaps_the_roles(tools, variant_llvm, rng):
    material = tools.OneWay()
    wi, wo = random_pairs(rng)
    context = mi.BSDFContext(mi.TransportMode.Importance)
    actual = value_of(make_bsdf(material), tools, wi, wo, context)
    assert actual == pytest.approx(evaluate(material, wi, wo) * wo[:, 2:], rel=1e-5)
    assert not np.allclose(actual, evaluate(material, wo, wi) * wo[:, 2:], rtol=0.05)


def test_a_reciprocal_brdf_is_reciprocal_through_the_plugin(brdf, tools, variant_llvm, rng):
    wi, wo = random_pairs(rng)
    bsdf = make_bsdf(brdf("fabric112"), rotation_deg=33.0)
    forward = value_of(bsdf, tools, wi, wo) / wo[:, 2:]
    backward = value_of(bsdf, tools, wo, wi) / wi[:, 2:]
    assert forward == pytest.approx(backward, rel=1e-4)


@pytest.mark.parametrize("mode", [mi.TransportMode.Radiance, mi.TransportMode.Importance])
@pytest.mark.parametrize("name", ["one_way", "table", "slices", "brushed_aluminium"])
def test_the_methods_agree(name, mode, brdf, tools, variant_llvm, rng):
    bsdf = make_bsdf(brdf(name), rotation_deg=70.0)
    context = mi.BSDFContext(mode)
    wi, _ = random_pairs(rng, 2000)
    si = tools.interaction(wi)
    u = rng.uniform(size=(3, len(wi)))
    bs, sampled = bsdf.sample(context, si, mi.Float(u[0]), mi.Point2f(u[1], u[2]))
    value, pdf = bsdf.eval_pdf(context, si, bs.wo)
    hit = bs.pdf.numpy() > 0.0
    assert hit.mean() > 0.9
    assert bs.pdf.numpy()[hit] == pytest.approx(pdf.numpy()[hit], rel=2e-3)
    weight = (value / pdf).numpy()[:, hit]
    assert sampled.numpy()[:, hit] == pytest.approx(weight, rel=5e-3, abs=1e-6)
    assert not sampled.numpy()[:, ~hit].any()
    assert bsdf.eval(context, si, bs.wo).numpy() == pytest.approx(value.numpy())
    assert bsdf.pdf(context, si, bs.wo).numpy() == pytest.approx(pdf.numpy())
    assert np.linalg.norm(bs.wo.numpy(), axis=0) == pytest.approx(np.ones(len(wi)), abs=1e-5)


@pytest.mark.parametrize("rotation_deg", [-40.0, 25.0, 90.0, 400.0])
def test_turning_the_material_is_turning_the_directions_back(
    rotation_deg, tools, variant_llvm, rng
):
    wi, wo = random_pairs(rng)
    angle = np.radians(rotation_deg)
    c, s = np.cos(angle), np.sin(angle)
    back = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    material = tools.OneWay()
    turned = value_of(make_bsdf(material, rotation_deg), tools, wi, wo)
    plain = value_of(make_bsdf(material), tools, wi @ back.T, wo @ back.T)
    assert turned == pytest.approx(plain, rel=1e-5, abs=1e-7)
    assert not np.allclose(turned, value_of(make_bsdf(material), tools, wi, wo), rtol=0.02)


def test_the_back_is_black_and_twosided_lights_it(brdf, tools, variant_llvm, rng):
    wi, wo = random_pairs(rng)
    bsdf = make_bsdf(brdf("ward"))
    both = mi.load_dict({"type": "twosided", "material": bsdf})
    front = value_of(bsdf, tools, wi, wo)
    down = np.array([1.0, 1.0, -1.0])
    for a, b in ((down, 1.0), (1.0, down), (down, down)):
        assert not value_of(bsdf, tools, wi * a, wo * b).any()
    assert value_of(both, tools, wi * down, wo * down) == pytest.approx(front)
    assert value_of(both, tools, wi, wo) == pytest.approx(front)
    si = tools.interaction(wi * down)
    bs, weight = bsdf.sample(mi.BSDFContext(), si, 0.5, mi.Point2f(0.5, 0.5))
    assert not weight.numpy().any() and not bs.pdf.numpy().any()


def test_flags_and_context(brdf, tools, variant_llvm, rng):
    bsdf = make_bsdf(brdf("ward"))
    for flag in ("GlossyReflection", "DiffuseReflection", "Anisotropic", "FrontSide"):
        assert mi.has_flag(bsdf.flags(), getattr(mi.BSDFFlags, flag))
    assert not mi.has_flag(bsdf.flags(), mi.BSDFFlags.BackSide)
    assert bsdf.component_count() == 1
    wi, wo = random_pairs(rng, 4)

    def seen(**settings) -> bool:
        context = mi.BSDFContext()
        for key, value in settings.items():
            setattr(context, key, value)
        si = tools.interaction(wi)
        bs, weight = bsdf.sample(context, si, 0.5, mi.Point2f(0.3, 0.3))
        value, pdf = bsdf.eval_pdf(context, si, mi.Vector3f(wo.T.copy()))
        results = (bs.pdf, weight, value, pdf, bsdf.pdf(context, si, mi.Vector3f(wo.T.copy())))
        lit = {bool(np.any(result.numpy() > 0.0)) for result in results}
        assert len(lit) == 1
        return lit.pop()

    assert seen()
    assert seen(component=0) and not seen(component=1)
    assert seen(type_mask=int(mi.BSDFFlags.GlossyReflection))
    # not twice for someone who adds the types up
    assert not seen(type_mask=int(mi.BSDFFlags.DiffuseReflection))


@pytest.mark.parametrize("case", case_names())
@pytest.mark.parametrize(
    "name", ["table", "slices", "ward", "brushed_aluminium", "fabric112", "narrow"]
)
def test_the_hard_cases_stay_finite(name, case, brdf, tools, variant_llvm, rng):
    bsdf = make_bsdf(brdf(name), rotation_deg=15.0)
    pairs = hard_case(case)
    si = tools.interaction(pairs.wv)
    value, pdf = bsdf.eval_pdf(mi.BSDFContext(), si, mi.Vector3f(pairs.wi.T.copy()))
    u = rng.uniform(size=(3, len(pairs.wv)))
    bs, weight = bsdf.sample(mi.BSDFContext(), si, mi.Float(u[0]), mi.Point2f(u[1], u[2]))
    for result in (value, pdf, bs.wo, bs.pdf, weight):
        assert np.isfinite(result.numpy()).all()
        assert result is bs.wo or result.numpy().min() >= 0.0


def test_a_direction_that_is_not_a_number_is_black(brdf, tools, variant_llvm):
    bsdf = make_bsdf(brdf("table"))
    wi = np.array([[np.nan, np.nan, np.nan], [0.0, 0.0, 1.0]])
    value, pdf = bsdf.eval_pdf(mi.BSDFContext(), tools.interaction(wi), mi.Vector3f(0, 0, 1))
    _, weight = bsdf.sample(
        mi.BSDFContext(), tools.interaction(wi), mi.Float(0.2), mi.Point2f(0.4, 0.4)
    )
    for result in (value, pdf, weight):
        assert not np.any(result.numpy()[..., 0])
        assert np.all(result.numpy()[..., 1] > 0.0)


@pytest.mark.parametrize(
    "plugin",
    [
        {"type": "simrig_kurt", "material": "wood01"},
        {"type": "simrig_lod", "near": {"type": "diffuse"}, "far": {"type": "diffuse"}},
    ],
)
@pytest.mark.parametrize("variant", ["scalar_rgb", "scalar_spectral"])
def test_a_scalar_variant_is_refused_with_what_to_choose(plugin, variant, variant_llvm):
    try:
        mi.set_variant(variant)
        with pytest.raises(SimrigError) as caught, one_line_errors():
            mi.load_dict(plugin)
        assert plugin["type"] in str(caught.value)
        assert variant.replace("scalar", "llvm_ad") in str(caught.value)
    finally:
        backend.select("llvm_ad_rgb")


def test_no_name_shadows_a_plugin_of_mitsuba():
    built_in = {path.stem for path in (Path(mi.__file__).parent / "plugins").iterdir()}
    assert "roughconductor" in built_in
    assert not built_in & set(PLUGINS)
    assert all(name.startswith("simrig_") for name in PLUGINS)


def test_it_says_what_it_is(brdf, variant_llvm):
    text = str(make_bsdf(brdf("table"), 30.0))
    for part in ("DenseTable", "small table", "values[4, 4, 8, 8, 3]", "rotation = 30"):
        assert part in text

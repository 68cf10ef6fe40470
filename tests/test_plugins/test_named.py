"""The plugins by name: properties, XML, files, and errors."""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np
import pytest

from simrig.brdf.kurt_materials import KURT_MATERIALS, RESCALED_MATERIALS, kurt_material
from simrig.core import backend
from simrig.core.errors import SimrigError
from simrig.files.load import save_material
from simrig.plugins import make_bsdf, one_line_errors

XML = """<scene version="3.0.0">
  <shape type="sphere"><bsdf type="simrig_kurt">
    <rgb name="k_d" value="0.05, 0.02, 0.01"/> <rgb name="k_s" value="0.1, 0.2, 0.3"/>
    <float name="f_0" value="0.4"/> <float name="m_x" value="0.3"/> <float name="m_y" value="0.1"/>
    <float name="alpha" value="0.5"/> <float name="k_s_2" value="0.02"/>
    <float name="m_x_2" value="0.7"/> <float name="rotation" value="35"/>
  </bsdf></shape>
  <shape type="sphere"><bsdf type="simrig_ward">
    <string name="variant" value="duer"/>
  </bsdf></shape>
</scene>"""


def check_xml_scene(scene: Any) -> None:
    kurt, ward = (shape.bsdf() for shape in scene.shapes())
    assert kurt.brdf.k_d == pytest.approx((0.05, 0.02, 0.01))
    first, second = kurt.brdf.lobes
    assert first.k_s == pytest.approx((0.1, 0.2, 0.3))
    assert (first.f_0, first.m_x, first.m_y, first.alpha) == pytest.approx((0.4, 0.3, 0.1, 0.5))
    assert second.k_s == pytest.approx((0.02, 0.02, 0.02))
    assert (second.f_0, second.m_x, second.m_y, second.alpha) == pytest.approx((1.0, 0.7, 0.2, 0.0))
    assert np.ravel(kurt.rotation)[0] == pytest.approx(35.0)
    assert ward.brdf.variant == "duer"


@pytest.mark.parametrize("variant", ["llvm_ad_rgb", "llvm_ad_spectral"])
def test_xml_scenes(variant, tmp_path):
    backend.select(variant)
    path = tmp_path / "scene.xml"
    path.write_text(XML)
    check_xml_scene(mi.load_string(XML))
    check_xml_scene(mi.load_file(str(path)))
    backend.select("llvm_ad_rgb")


@pytest.mark.parametrize("name", KURT_MATERIALS + RESCALED_MATERIALS)
def test_built_in_materials_by_name(name, variant_llvm):
    bsdf = mi.load_dict({"type": "simrig_kurt", "material": name})
    assert bsdf.brdf.name == name
    assert {k: v.tolist() for k, v in bsdf.brdf.data().items()} == {
        k: v.tolist() for k, v in kurt_material(name).data().items()
    }


def test_every_way_to_write_a_colour(variant_llvm):
    for value in ([0.3, 0.2, 0.1], {"type": "rgb", "value": [0.3, 0.2, 0.1]}):
        bsdf = mi.load_dict({"type": "simrig_ward", "k_s": value})
        assert bsdf.brdf.k_s == pytest.approx([0.3, 0.2, 0.1])
    bsdf = mi.load_dict({"type": "simrig_ward", "k_s": 0.25})
    assert bsdf.brdf.k_s == pytest.approx([0.25, 0.25, 0.25])


@pytest.mark.parametrize(
    ("properties", "expected"),
    [
        ({"type": "simrig_kurt", "material": "fabric12"}, "did you mean 'fabric112'?"),
        ({"type": "simrig_kurt", "material": "wood01", "m_x": 0.2}, "'material' or 'm_x'"),
        ({"type": "simrig_kurt", "m_x": 0.001}, "m_x must lie in [0.005, 3]"),
        ({"type": "simrig_kurt", "k_d": "red"}, "'k_d' must be an rgb or a number"),
        ({"type": "simrig_kurt", "m_x_2": 0.1}, "'m_x_2' belongs to a second lobe"),
        ({"type": "simrig_ward", "variant": "bound"}, "did you mean 'bounded'?"),
        ({"type": "simrig_ward", "m_x": "wide"}, "'m_x' must be a number"),
        ({"type": "simrig_ward", "rotation": float("nan")}, "rotation must be finite"),
        ({"type": "simrig_table"}, "'filename' is missing"),
        ({"type": "simrig_table", "filename": "no/such.h5"}, "there is no file 'no/such.h5'"),
    ],
)
def test_bad_properties_give_one_line(properties, expected, variant_llvm):
    with pytest.raises(SimrigError) as caught, one_line_errors():
        mi.load_dict(properties)
    assert expected in str(caught.value)
    assert "\n" not in str(caught.value) and "Traceback" not in str(caught.value)


def test_a_table_is_not_slices(tools, variant_llvm, tmp_path):
    path = tmp_path / "table.h5"
    save_material(path, tools.small_table())
    assert mi.load_dict({"type": "simrig_table", "filename": str(path)}).brdf.kind == "dense"
    with (
        pytest.raises(SimrigError, match="holds dense, not slices: use simrig_table"),
        one_line_errors(),
    ):
        mi.load_dict({"type": "simrig_slices", "filename": str(path)})


def test_files_are_found_beside_the_scene(tools, variant_llvm, tmp_path):
    save_material(tmp_path / "slices.h5", tools.slices())
    scene = tmp_path / "scene.xml"
    scene.write_text(
        '<scene version="3.0.0"><shape type="sphere"><bsdf type="simrig_slices">'
        '<string name="filename" value="slices.h5"/></bsdf></shape></scene>'
    )
    (shape,) = mi.load_file(str(scene)).shapes()
    expected, loaded = tools.slices().data(), shape.bsdf().brdf.data()
    assert loaded.keys() == expected.keys()
    assert all(np.array_equal(loaded[key], expected[key]) for key in expected)


@pytest.mark.parametrize(
    "name", ["rgl/chm_orange_rgb.bsdf", "cornell/cayman.brdf", "ubo2014/carpet07_mean_151x151.npz"]
)
def test_measured_files(name, shared_data, tools, variant_llvm, rng):
    bsdf = mi.load_dict({"type": "simrig_table", "filename": str(shared_data(name))})
    wi = np.tile(tools.direction(30.0, 10.0), (2000, 1))
    u = rng.uniform(size=(3, 2000))
    _, weight = bsdf.sample(
        mi.BSDFContext(), tools.interaction(wi), mi.Float(u[0]), mi.Point2f(u[1], u[2])
    )
    weight = weight.numpy().astype(np.float64)
    expected = bsdf.brdf.directional_albedo(np.radians(30.0), np.radians(10.0), 96, 192)
    error = weight.std(axis=1) / np.sqrt(2000)
    assert np.all(np.abs(weight.mean(axis=1) - expected) < 4.0 * error + 0.01 * expected)
    grey = weight.mean(axis=0)  # one channel may be black where the others are not
    assert grey.std() / np.sqrt(2000) < 0.02 * grey.mean()


def test_an_unknown_property_is_refused_by_mitsuba(variant_llvm):
    with pytest.raises(RuntimeError, match="roughness"), one_line_errors():
        mi.load_dict({"type": "simrig_ward", "roughness": 0.2})


def test_a_brdf_in_memory_is_a_value_in_a_scene(brdf, variant_llvm):
    bsdf = make_bsdf(brdf("table"), rotation_deg=12.0)
    scene = mi.load_dict({"type": "scene", "ball": {"type": "sphere", "material": bsdf}})
    assert scene.shapes()[0].bsdf() is bsdf


def test_registration_again_keeps_the_classes(variant_llvm):
    from simrig.plugins.register import register

    assert register() is register()
    before = type(mi.load_dict({"type": "simrig_ward"}))
    backend.select("llvm_ad_rgb")
    assert type(mi.load_dict({"type": "simrig_ward"})) is before

"""Our BSDFs inside Mitsuba's adapters: what they sample is what they evaluate.

``blendbsdf`` weighs whatever direction a nested sample returns, so a failed one has to point below
the surface.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from simrig.btf.full import FullBtf
from simrig.btf.synthetic import bumps
from simrig.plugins import make_bsdf
from simrig.plugins.make import make_btf

from .conftest import small_table

ANGLES_DEG = (0.0, 70.0, 85.0)
COUNT = len(ANGLES_DEG) << 16
PLUGINS: dict[str, Callable[[], Any]] = {
    "kurt": lambda: mi.load_dict({"type": "simrig_kurt", "material": "yellow_satin"}),
    "ward": lambda: mi.load_dict({"type": "simrig_ward", "rotation": 30.0}),
    "table": lambda: make_bsdf(small_table()),
    "btf": lambda: make_btf(FullBtf.from_stack(bumps((4, 4))), scale=1.0),
    "lod": lambda: mi.load_dict(
        {
            "type": "simrig_lod",
            "distance": 5.0,
            "fade": 8.0,
            "near": {"type": "simrig_kurt", "material": "fabric112"},
            "far": {"type": "simrig_kurt", "material": "yellow_satin"},
        }
    ),
}
FLAT = np.full((2, 2, 3), (0.5, 0.5, 1.0), dtype=np.float32)


def texture(values: np.ndarray) -> dict:
    return {"type": "bitmap", "bitmap": mi.Bitmap(values), "raw": True, "filter_type": "nearest"}


ADAPTERS: dict[str, Callable[[Any], dict]] = {
    "alone": lambda bsdf: bsdf,
    "twosided": lambda bsdf: {"type": "twosided", "nested": bsdf},
    "blend with itself": lambda bsdf: {"type": "blendbsdf", "weight": 0.4, "a": bsdf, "b": bsdf},
    "normalmap": lambda bsdf: {"type": "normalmap", "normalmap": texture(FLAT), "nested": bsdf},
    "bumpmap": lambda bsdf: {"type": "bumpmap", "map": texture(FLAT[..., :1]), "nested": bsdf},
    "mask": lambda bsdf: {"type": "mask", "opacity": 1.0, "nested": bsdf},
}


def seen(bsdf: Any) -> tuple[Any, Any]:
    """Return points of a plate with a BSDF on it, seen from all angles in turn, and the BSDF."""
    plate = mi.load_dict({"type": "scene", "plate": {"type": "rectangle", "bsdf": bsdf}})
    angles = mi.Float(np.radians(ANGLES_DEG))
    theta = dr.gather(mi.Float, angles, dr.arange(mi.UInt32, COUNT) % len(ANGLES_DEG))
    towards = mi.Vector3f(dr.sin(theta), 0.0, dr.cos(theta))
    place = mi.Point3f(mi.PCG32(size=COUNT).next_float32() - 0.5, 0.1, 0.0)
    si = plate.ray_intersect(mi.RayDifferential3f(mi.Ray3f(place + 2.0 * towards, -towards)))
    return si, plate.shapes()[0].bsdf()


def numbers(seed: int) -> tuple[Any, Any]:
    source = mi.PCG32(size=COUNT, initseq=seed)
    return source.next_float32(), mi.Point2f(source.next_float32(), source.next_float32())


def albedos(bsdf: Any) -> tuple[np.ndarray, np.ndarray, float]:
    """Return the albedos (angles, 3) by ``sample`` and by ``eval``, and their standard error."""
    si, made = seen(bsdf)
    drawn, weight = made.sample(mi.BSDFContext(), si, *numbers(1))
    wo = mi.warp.square_to_cosine_hemisphere(numbers(2)[1])
    value = made.eval(mi.BSDFContext(), si, wo) / mi.warp.square_to_cosine_hemisphere_pdf(wo)
    looks = [
        np.array(one).T.reshape(-1, len(ANGLES_DEG), 3)
        for one in (weight & (drawn.wo.z > 0.0), value & (wo.z > 1e-3))
    ]
    error = max(float(one.std(axis=0).max()) for one in looks) / np.sqrt(len(looks[0]))
    return looks[0].mean(axis=0), looks[1].mean(axis=0), error


@pytest.mark.parametrize("adapter", ADAPTERS)
@pytest.mark.parametrize("plugin", PLUGINS)
def test_what_is_sampled_is_what_is_evaluated(plugin, adapter, variant_llvm) -> None:
    alone = albedos(PLUGINS[plugin]())
    inside = albedos(ADAPTERS[adapter](PLUGINS[plugin]()))
    allowed = 5.0 * inside[2] + 1e-4
    np.testing.assert_allclose(inside[0], inside[1], atol=allowed)
    np.testing.assert_allclose(inside[1], alone[1], atol=allowed)


@pytest.mark.parametrize("plugin", PLUGINS)
def test_a_blend_of_two_materials_samples_what_it_evaluates(plugin, variant_llvm) -> None:
    """The case of the public report: seven tenths of satin, three of a diffuser, 9 % too bright."""
    blend = {
        "type": "blendbsdf",
        "weight": 0.3,
        "first": PLUGINS[plugin](),
        "second": {"type": "diffuse", "reflectance": 0.5},
    }
    sampled, evaluated, error = albedos(blend)
    np.testing.assert_allclose(sampled, evaluated, atol=5.0 * error + 1e-4)


@pytest.mark.parametrize("plugin", PLUGINS)
def test_a_failed_sample_points_below_the_surface(plugin, variant_llvm) -> None:
    si, bsdf = seen(PLUGINS[plugin]())
    drawn, weight = bsdf.sample(mi.BSDFContext(), si, *numbers(3))
    failed = np.array(drawn.pdf == 0.0)
    assert failed.any(), "none failed: nothing is tested"
    assert (np.array(drawn.wo)[:, failed].T == [0.0, 0.0, -1.0]).all()
    assert (np.array(weight)[:, failed] == 0.0).all()


@pytest.mark.parametrize("plugin", ["kurt", "btf"])
def test_instances_and_batches_show_the_same(plugin, variant_llvm) -> None:
    """A shape, an instance of it, and one sensor of a batch see the same picture."""
    ball = {"type": "sphere", "bsdf": PLUGINS[plugin]()}
    group = {"type": "shapegroup", "ball": ball}
    instance = {"type": "instance", "group": {"type": "ref", "id": "group"}}
    film = {"type": "hdrfilm", "width": 8, "height": 8, "rfilter": {"type": "box"}}
    view = mi.ScalarTransform4f().look_at([0, -4, 1], [0, 0, 0], [0, 0, 1])
    camera = {"type": "perspective", "fov": 30.0, "to_world": view, "film": film}
    wide = {"type": "batch", "one": camera, "two": camera, "film": {**film, "width": 16}}
    light = {"type": "point", "position": [2.0, -3.0, 3.0], "intensity": 20.0}
    rest = {"type": "scene", "light": light, "integrator": {"type": "direct"}}
    pictures = [
        np.array(mi.render(mi.load_dict({**rest, **more}), spp=256))
        for more in (
            {"ball": ball, "camera": camera},
            {"group": group, "ball": instance, "camera": camera},
            {"ball": ball, "camera": wide},
        )
    ]
    for picture in (pictures[1], pictures[2][:, :8], pictures[2][:, 8:]):
        np.testing.assert_allclose(picture, pictures[0], rtol=0.2, atol=0.02)


def test_a_frozen_evaluation_is_the_same(variant_llvm) -> None:
    si, bsdf = seen(PLUGINS["kurt"]())
    wo = mi.warp.square_to_cosine_hemisphere(numbers(4)[1])

    def evaluate(wo: Any) -> Any:
        return bsdf.eval(mi.BSDFContext(), si, wo)

    frozen = dr.freeze(evaluate)
    expected = np.array(evaluate(wo))
    for _ in range(3):
        np.testing.assert_array_equal(np.array(frozen(wo)), expected)

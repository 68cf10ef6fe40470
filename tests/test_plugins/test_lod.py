"""``simrig_lod``: exactly the one material near, exactly the other far, a blend between."""

from __future__ import annotations

import mitsuba as mi
import numpy as np
import pytest

from simrig.brdf.kurt_materials import kurt_material
from simrig.btf.full import FullBtf
from simrig.btf.synthetic import bumps
from simrig.core.errors import SimrigError
from simrig.plugins import make_bsdf, make_btf, one_line_errors

DISTANCE = 1000.0


def plane(bsdf, integrator: str = "direct", distance: float = DISTANCE) -> np.ndarray:
    """Return the picture of a plane under a constant sky, seen from a distance in mm."""
    scene = {
        "type": "scene",
        "integrator": {"type": integrator, "hide_emitters": True},
        "plane": {
            "type": "rectangle",
            "to_world": mi.ScalarTransform4f().rotate([1, 0, 0], -50).scale(60.0),
            "bsdf": bsdf,
        },
        "sky": {"type": "constant"},
        "sensor": {
            "type": "perspective",
            "fov": 5.0,
            "to_world": mi.ScalarTransform4f().look_at([0, 0, distance], [0, 0, 0], [0, 1, 0]),
            "film": {"type": "hdrfilm", "width": 24, "height": 24, "rfilter": {"type": "box"}},
        },
    }
    return np.array(mi.render(mi.load_dict(scene), spp=32, seed=3))[..., :3]


def lod(near, far, **options):
    return {"type": "simrig_lod", "near": near, "far": far, **options}


@pytest.fixture
def near(variant_llvm):
    return make_btf(FullBtf.from_stack(bumps((8, 8))), scale=40.0)


@pytest.fixture
def far(variant_llvm):
    return make_bsdf(kurt_material("yellow_satin"))


@pytest.mark.parametrize("fade", [0.0, 10.0])
def test_on_either_side_it_is_the_one_material(near, far, fade) -> None:
    """The same samples are drawn, so the pictures are equal but for the rounding of a variate."""
    for distance, only in ((2000.0, near), (500.0, far)):
        both = plane(lod(near, far, distance=distance, fade=fade))
        np.testing.assert_allclose(both, plane(only), rtol=1e-4, atol=1e-5)


def test_the_switch_is_made_at_each_point(near, far) -> None:
    picture, alone = plane(lod(near, far, distance=DISTANCE)), (plane(near), plane(far))
    # the tilted plane's upper half is beyond the distance; rows in the middle are mixed
    np.testing.assert_allclose(picture[:11], alone[1][:11], rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(picture[13:], alone[0][13:], rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("integrator", ["direct", "path"])
def test_a_fade_blends_the_pictures(near, far, integrator) -> None:
    """Half way, with a fade so long that the share hardly changes over the plane."""
    picture = plane(lod(near, far, distance=DISTANCE, fade=1e6), integrator)
    expected = 0.5 * (plane(near, integrator) + plane(far, integrator))
    np.testing.assert_allclose(picture.mean(axis=(0, 1)), expected.mean(axis=(0, 1)), rtol=0.02)


class At:
    """A BSDF whose interactions lie at a distance (those of the tool are at infinity)."""

    def __init__(self, bsdf, t: float):
        self.bsdf, self.t = bsdf, t

    def sample(self, context, si, *arguments):
        si.t = self.t
        return self.bsdf.sample(context, si, *arguments)

    def pdf(self, context, si, wo):
        si.t = self.t
        return self.bsdf.pdf(context, si, wo)


def test_samples_follow_the_density(near, far, tools) -> None:
    bsdf = mi.load_dict(lod(near, far, distance=10.0, fade=10.0))
    test, accepted = tools.chi_square(At(bsdf, 9.0), tools.direction(40.0, 100.0))  # 0.6 near
    assert accepted, test.messages


def test_a_mirror_can_fade(far, tools) -> None:
    """A delta lobe has no density, so it keeps its own weight."""
    bsdf = mi.load_dict(lod(far, {"type": "conductor"}, distance=0.0, fade=10.0))
    si = tools.interaction(np.broadcast_to(tools.direction(30.0), (4000, 3)))
    si.t = 0.0
    sampler = mi.PCG32(size=4000)
    u = [sampler.next_float32() for _ in range(3)]
    bs, weight = bsdf.sample(mi.BSDFContext(), si, u[0], mi.Point2f(u[1], u[2]))
    mirrored = np.array(mi.has_flag(bs.sampled_type, mi.BSDFFlags.Delta))
    assert 0.45 < mirrored.mean() < 0.55
    np.testing.assert_allclose(np.array(weight)[:, mirrored], 1.0, rtol=1e-5)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"far": 1.0}, "'far' must be a nested BSDF"),
        ({"distance": -1.0}, "at least 0 mm"),
        ({"fade": "long"}, "'fade' must be a number"),
    ],
)
def test_bad_properties_are_refused(change, message, variant_llvm) -> None:
    parts = lod({"type": "diffuse"}, {"type": "diffuse"}, distance=1.0)
    with pytest.raises(SimrigError, match=message), one_line_errors():
        mi.load_dict({**parts, **change})

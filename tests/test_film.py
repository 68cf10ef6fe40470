"""Films of every pixel format, with further channels, and spectral films, as linear RGB."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import mitsuba as mi
import numpy as np
import pytest

from simrig.core import backend
from simrig.core.colour import LUMINANCE
from simrig.evaluation.metrics.comparison import compare_images
from simrig.rendering.render import render

SIZE = {"width": 16, "height": 12}


def scene(film: dict[str, Any], aovs: bool = False) -> Any:
    inner: dict[str, Any] = {"type": "path", "max_depth": 3}
    outer = {"type": "aov", "aovs": "n:sh_normal,d:depth", "inner": inner} if aovs else inner
    colour = {"type": "rgb", "value": [0.7, 0.2, 0.1]}
    return mi.load_dict(
        {
            "type": "scene",
            "integrator": outer,
            "light": {"type": "constant"},
            "body": {"type": "sphere", "bsdf": {"type": "diffuse", "reflectance": colour}},
            "sensor": {
                "type": "perspective",
                "to_world": mi.ScalarTransform4f().look_at([0, -4, 2], [0, 0, 0], [0, 0, 1]),
                "film": {**film, **SIZE},
            },
        }
    )


@pytest.mark.parametrize("aovs", [False, True])
@pytest.mark.parametrize("form", ["rgba", "xyz", "xyza", "luminance", "luminance_alpha"])
def test_pixel_formats_give_the_rgb_picture(variant_llvm, form, aovs) -> None:
    reference = render(scene({"type": "hdrfilm", "pixel_format": "rgb"}), spp=16)
    result = render(scene({"type": "hdrfilm", "pixel_format": form}, aovs), spp=16)
    expected = reference.image
    if form.startswith("luminance"):
        expected = np.repeat(expected @ LUMINANCE.astype(np.float32)[:, None], 3, axis=-1)
    np.testing.assert_allclose(result.image, expected, atol=2e-3)
    assert (result.film == "") == (form == "rgba") and reference.film == ""


def test_spectral_films_become_rgb() -> None:
    """Of 31 bands of 10 nm; the rest is the width of the bands."""
    backend.select("llvm_ad_spectral")
    reference = render(scene({"type": "hdrfilm", "pixel_format": "rgb"}), spp=256).image
    edges = np.linspace(400.0, 700.0, 32).tolist()
    bands = {
        f"band{k:02d}": {"type": "spectrum", "value": [(low, 1.0), (high, 1.0)]}
        for k, (low, high) in enumerate(pairwise(edges))
    }
    result = render(scene({"type": "specfilm", **bands}), spp=256)
    assert compare_images(reference, result.image).delta_e < 1.0
    assert result.film.startswith("spectral film: 31 bands centred from 405 to 695 nm")

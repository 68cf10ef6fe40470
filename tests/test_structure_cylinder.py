"""The cylinder of section B.2 as a stimulus: its mask, its shading, its structure."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from command_line import done, refusal
from simrig.btf.stack import BtfStack
from simrig.files.btf.hdf5 import write_btf
from simrig.files.images import decode_srgb
from simrig.perception import PUBLISHED_MODELS
from simrig.rendering.render import render
from simrig.rigs.btf.rig import btf_angles
from simrig.scenes.cylinder_layout import cylinder_row, positions_mm
from simrig.scenes.perspective import focal_pixels
from simrig.scenes.receding_cylinders import receding_cylinders
from simrig.scenes.stimuli import CYLINDER_RADIUS
from simrig.viewing.structure.cylinder import UPRIGHT, cylinder_stimulus, lower_half
from simrig.viewing.structure.probe import PREDICTING, probe

ALBEDO = 0.5
WHITE = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 1.0}}
BLACK = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}}


def diffuse(albedo: np.ndarray, size_mm: tuple[float, float]) -> BtfStack:
    """Return a flat painted material: an albedo (height, width) under all directions."""
    angles = btf_angles(UPRIGHT)
    image = np.repeat(albedo[..., None] / np.pi, 3, axis=2).astype(np.float32)
    return BtfStack(np.broadcast_to(image, (len(angles), *image.shape)), angles, size_mm)


def stripes(period_mm: float) -> BtfStack:
    wave = ALBEDO + 0.2 * np.sin(2.0 * np.pi * (np.arange(16) + 0.5) / 16.0)
    return diffuse(np.tile(wave, (2, 1)), (period_mm, period_mm / 8.0))


def grown(pixels: int) -> np.ndarray:
    """Return the lower half of white cylinders on black, that many pixels beyond the mask."""
    scene = receding_cylinders({"upper": BLACK, "lower": WHITE}, "B", pixel_centres=True)
    crop = lower_half()
    for offset, size in (("crop_offset_x", "crop_width"), ("crop_offset_y", "crop_height")):
        crop[offset] -= pixels
        crop[size] += 2 * pixels
    scene["sensor"]["film"] |= crop
    return render(scene).image.max(axis=2) > 0.0


@pytest.mark.usefixtures("variant_llvm")
def test_the_mask_is_the_lower_half_and_nothing_else() -> None:
    seen = grown(2)
    assert seen[2:-2, 2:-2].all()
    assert not seen[:2].any(), "above is the upper half"
    assert not seen[:, [0, -1]].any(), "beside it is the background"
    assert not seen[-1, 2:-2].all(), "below the rim, too"


@pytest.mark.usefixtures("variant_llvm")
def test_a_plain_material_is_shaded_as_the_formula_says() -> None:
    stimulus = cylinder_stimulus(diffuse(np.full((4, 4), ALBEDO), (3.0, 3.0)))
    assert stimulus.textured == pytest.approx(stimulus.plain, abs=1e-4)
    seen = probe(stimulus, structure_mm=1.0)
    for name in ("contrast", "ssim", "flip"):
        assert seen.features[name] == pytest.approx(0.0, abs=1e-4)
    assert seen.distances_m["ssim"] == pytest.approx(PUBLISHED_MODELS["ssim"].k_1, abs=1e-3)
    assert seen.features["saliency"] > 0.01, "which the shading alone has"

    row, crop = cylinder_row("B"), lower_half()
    x, distance = positions_mm(row)[0], row.distances_mm[0]
    centres = crop["crop_offset_x"] + 0.5 + np.arange(crop["crop_width"])
    slope = (centres - 0.5 * row.size[0]) / focal_pixels(row.size[1])
    ray = np.stack([slope, np.ones_like(slope)]) / np.hypot(slope, 1.0)  # to the right, away
    along = ray[0] * x + ray[1] * distance
    half = np.sqrt(CYLINDER_RADIUS**2 - (x * x + distance**2 - along**2))
    normal = ((along - half) * ray - np.array([[x], [distance]])) / CYLINDER_RADIUS
    lit = np.zeros_like(slope)
    for strength, side in ((1.0, 1.0), (0.3, -1.0)):
        light = np.array([side * np.sin(np.pi / 3.0), -np.cos(np.pi / 3.0)])
        lit += strength * np.maximum(light @ normal, 0.0)
    found = decode_srgb(stimulus.plain).mean(axis=0)
    np.testing.assert_allclose(found, ALBEDO * lit, rtol=0.01, atol=0.002)


@pytest.mark.usefixtures("variant_llvm")
@pytest.mark.parametrize("period_mm", [2.5, 5.0])
def test_stripes_have_their_size(period_mm: float) -> None:
    stimulus = cylinder_stimulus(stripes(period_mm))
    seen = probe(stimulus)
    # aslant, towards the outlines, stripes look narrower and their shading is not even
    assert seen.structure_mm == pytest.approx(period_mm, rel=0.15)
    turned = probe(cylinder_stimulus(stripes(period_mm), rotation_deg=90.0))
    assert turned.structure_mm == pytest.approx(period_mm, rel=0.1)


def test_a_cylinder_from_the_command_line(tmp_path: Path) -> None:
    write_btf(tmp_path / "paint.h5", stripes(4.0))
    seen = done("distance", tmp_path / "paint.h5", "--stimulus", "cylinder")
    assert seen["stimulus"] == "cylinder" and set(seen["distances_m"]) == set(PREDICTING)
    crop = lower_half()
    assert seen["pixels"] == [crop["crop_width"], crop["crop_height"]]
    assert "cylinder, flat" in refusal("distance", tmp_path / "paint.h5", "--stimulus", "ball")
    picture = ("distance", tmp_path / "paint.png", "--size-mm", "4", "--stimulus", "cylinder")
    assert "needs a BTF" in refusal(*picture)


@pytest.mark.slow
def test_a_preset_is_measured_for_the_cylinder() -> None:
    options = ("--stimulus", "cylinder", "--texels", "12", "--spp", "4")
    seen = done("distance", "leather_tan", *options)
    assert seen["structure_mm"] == 1.9 and seen["structure_source"] == "of the preset"
    assert seen["distances_m"]["saliency"] > PUBLISHED_MODELS["saliency"].k_1

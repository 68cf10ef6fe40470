"""Critical distances of materials and scenes: stimuli, maps, the study and the commands."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from command_line import done, refusal, simrig
from refusals import refused
from simrig.btf.stack import BtfStack
from simrig.evaluation.studies import STUDIES, critical_distance
from simrig.evaluation.studies.engine.run import run_study
from simrig.files.btf.hdf5 import write_btf
from simrig.files.images import decode_srgb, read_image, write_png
from simrig.mesostructure import PRESETS, build_tile
from simrig.perception import PUBLISHED_MODELS, pixels_per_degree
from simrig.viewing.distance_map import (
    CLASSES,
    DistanceMap,
    distance_map,
    draw_distance_map,
    load_as_written,
)
from simrig.viewing.structure.probe import (
    FEATURES,
    PIXEL_MM,
    PREDICTING,
    btf_stimulus,
    image_stimulus,
    probe,
    tile_stimulus,
)

LIT = 0.5 * (1.0 + 0.3)  # of a white diffuser under both lights at 60°
SMALL = {"pixels": 64, "spp": 4}


def striped(period_mm: float, width_mm: float = 40.0, texels: int = 800) -> np.ndarray:
    wave = np.sin(2.0 * np.pi * np.arange(texels) / texels * width_mm / period_mm)
    return np.tile((0.3 + 0.2 * wave)[None, :, None], (texels // 2, 1, 3)).astype(np.float32)


def lit_stack(image: np.ndarray, size_mm: tuple[float, float]) -> BtfStack:
    """Return a diffuse BTF of an albedo, under the two lights and from the normal only."""
    angles = np.radians([[60.0, 0.0, 0.0, 0.0], [60.0, 0.0, 180.0, 0.0]])
    values = np.broadcast_to((image / np.pi).astype(np.float32), (2, *image.shape))
    return BtfStack(values, angles, size_mm)


def test_the_display_is_that_of_experiment_b() -> None:
    """A vertical view of about 30° on 1868 rows (thesis sections 3.3.1 and B.2)."""
    assert 1868 / pixels_per_degree(PIXEL_MM, 600.0) == pytest.approx(30.0, abs=0.7)


def test_a_picture_is_seen_at_its_size() -> None:
    stimulus = image_stimulus(striped(2.5), 40.0)
    assert stimulus.textured.shape == (round(20.0 / PIXEL_MM), round(40.0 / PIXEL_MM))
    seen = probe(stimulus)
    assert set(seen.features) == set(FEATURES) and set(seen.distances_m) == set(PREDICTING)
    assert seen.structure_mm == seen.found_mm["spectrum"] == pytest.approx(2.5, abs=PIXEL_MM)
    assert seen.found_mm["autocorrelation"] == pytest.approx(2.5, abs=PIXEL_MM)
    twice = probe(stimulus, structure_mm=5.0)
    assert twice.features == seen.features
    model = PUBLISHED_MODELS["ssim"]
    assert twice.distances_m["ssim"] == model.distance(5.0, twice.features["ssim"])
    assert seen.cost.compute_seconds > 0.0


def test_large_pictures_are_cut_and_small_ones_refused() -> None:
    assert image_stimulus(striped(20.0), 400.0).textured.shape == (256, 256)
    refused("larger picture", probe, image_stimulus(striped(2.5), 1.0))
    refused("> 0 mm", image_stimulus, striped(2.5), 0.0)
    refused("NaN", image_stimulus, np.full((40, 40, 3), np.nan), 40.0)
    refused("> 0 mm", probe, image_stimulus(striped(2.5), 40.0), structure_mm=-1.0)


@pytest.mark.parametrize("shape", [(1, 1), (8, 8), (8, 20)])
def test_a_plain_btf_has_nothing_to_see(shape: tuple[int, int]) -> None:
    stimulus = btf_stimulus(lit_stack(np.full((*shape, 3), 0.4), (3.0, 2.0)), pixels=64)
    assert stimulus.textured == pytest.approx(stimulus.plain)
    assert decode_srgb(np.array(stimulus.plain)) == pytest.approx(0.4 * LIT, rel=1e-3)
    seen = probe(stimulus)
    assert seen.structure_mm == 0.0
    for name in PREDICTING:
        assert seen.features[name] == pytest.approx(0.0, abs=1e-6)
        assert seen.distances_m[name] == pytest.approx(PUBLISHED_MODELS[name].k_1, abs=1e-6)


def test_a_btf_is_repeated_at_its_size() -> None:
    """Non-square texels and tiles: 3 mm stripes across, whatever the rows are."""
    tile = np.where(np.arange(30)[None, :, None] < 15, 0.2, 0.6) * np.ones((7, 1, 3))
    seen = probe(btf_stimulus(lit_stack(tile, (3.0, 1.1)), pixels=128))
    assert seen.structure_mm == pytest.approx(3.0, abs=PIXEL_MM)


def test_a_btf_without_the_directions_is_refused() -> None:
    stack = BtfStack(np.ones((1, 4, 4, 3), dtype=np.float32), np.zeros((1, 4)), (1.0, 1.0))
    refused("within 10°", btf_stimulus, stack)


@pytest.mark.slow
@pytest.mark.usefixtures("variant_llvm")
def test_a_tile_is_as_bright_as_its_mean_and_repeats() -> None:
    tile = build_tile("canvas_beige", resolution=48)
    stimulus = tile_stimulus(tile, **SMALL)
    assert stimulus.textured.shape == (64, 64) and stimulus.cost.compute_seconds > 0.0
    linear = decode_srgb(stimulus.textured).mean()
    assert linear == pytest.approx(decode_srgb(np.array(stimulus.plain)), rel=1e-6)
    rough, fine = (
        probe(
            tile_stimulus(build_tile(name, resolution=48), **SMALL),
            PRESETS[name].structure.element_mm,
        )
        for name in ("sweater_cream", "nylon_orange")
    )
    assert rough.distances_m["saliency"] > 2.0 * fine.distances_m["saliency"]


SQUARES_XML = """<scene version="3.0.0">
  <integrator type="direct"/>
  <sensor type="perspective">
    <float name="fov" value="60"/>
    <transform name="to_world"><lookat origin="0,0,0" target="0,0,-1" up="0,1,0"/></transform>
    <film type="hdrfilm">
      <integer name="width" value="32"/><integer name="height" value="8"/><rfilter type="box"/>
    </film>
  </sensor>
  <bsdf type="diffuse" id="cloth"/>
  <bsdf type="diffuse" id="wood"/>
  <shape type="rectangle" id="near">
    <transform name="to_world"><scale value="500"/><translate x="-500" z="-1000"/></transform>
    <ref id="cloth"/>
  </shape>
  <shape type="rectangle" id="far">
    <transform name="to_world"><scale value="1500"/><translate x="1500" z="-3000"/></transform>
    <ref id="wood"/>
  </shape>
  <emitter type="constant"/>
</scene>"""


def two_squares() -> dict[str, Any]:
    """Two squares that face the camera, 1 m and 3 m away, each filling a half of the picture."""
    import mitsuba as mi

    to = mi.ScalarTransform4f
    bsdf = {"type": "diffuse", "id": "cloth"}
    near = to().translate([-500.0, 0.0, -1000.0]).scale(500.0)
    far = to().translate([1500.0, 0.0, -3000.0]).scale(1500.0)
    return {
        "type": "scene",
        "integrator": {"type": "direct"},
        "sensor": {
            "type": "perspective",
            "fov": 60.0,
            "near_clip": 100.0,
            "far_clip": 1e5,
            "to_world": to().look_at(origin=[0, 0, 0], target=[0, 0, -1], up=[0, 1, 0]),
            "film": {"type": "hdrfilm", "width": 32, "height": 8, "rfilter": {"type": "box"}},
        },
        "near": {"type": "rectangle", "to_world": near, "bsdf": bsdf},
        "far": {"type": "rectangle", "to_world": far, "bsdf": {"type": "diffuse", "id": "wood"}},
        "light": {"type": "constant"},
    }


@pytest.mark.usefixtures("variant_llvm")
def test_a_map_compares_every_pixel_by_its_own_distance() -> None:
    scene = load_as_written(two_squares())
    found = distance_map(scene, {"near": 2.5, "far": 3.05})
    left, right = np.s_[:, :16], np.s_[:, 16:]
    across = (np.arange(32) + 0.5) / 16.0 - 1.0
    down = ((np.arange(8) + 0.5) / 4.0 - 1.0) / 4.0
    slope = np.tan(np.radians(30.0)) * np.hypot(across, down[:, None])
    ray = np.sqrt(1.0 + slope**2)
    np.testing.assert_allclose(found.distance_m[left], ray[left], rtol=1e-5)
    np.testing.assert_allclose(found.distance_m[right], 3.0 * ray[right], rtol=1e-5)
    assert found.surface.all() and found.visible[left].all()
    np.testing.assert_array_equal(found.visible[right], 3.0 * ray[right] < 3.05)
    assert 0 < found.visible[right].sum() < found.visible[right].size
    assert (found.classes()[left] == 0).all(), "below half of 2.5 m"
    assert sum(found.shares().values()) == pytest.approx(1.0)

    of_materials = distance_map(scene, {"cloth": 0.5, "near": 2.5}, metres_per_unit=2e-3)
    assert of_materials.visible[left].all(), "a shape's own distance goes before its material's"
    assert not of_materials.visible[right].any()
    assert (of_materials.classes()[right] == 3).all(), "no distance given"
    np.testing.assert_allclose(of_materials.distance_m, 2.0 * found.distance_m, rtol=1e-6)


@pytest.mark.usefixtures("variant_llvm")
def test_bad_maps_are_refused() -> None:
    scene = load_as_written(two_squares())
    refused("did you mean 'cloth'", distance_map, scene, {"clott": 1.0})
    for bad in (0.0, -1.0, np.nan):
        refused("above 0", distance_map, scene, {"near": bad})
    refused("above 0", distance_map, scene, {}, metres_per_unit=0.0)
    refused("no camera", distance_map, {"type": "scene", "near": {"type": "sphere"}}, {})


def test_a_drawn_map_has_every_class_and_what_is_no_surface(tmp_path: Path) -> None:
    distance = np.array([[1.0, 3.0, 9.0, 2.0, np.inf]]).repeat(4, axis=0)
    critical = np.array([[4.0, 4.0, 4.0, np.nan, np.nan]]).repeat(4, axis=0)
    found = DistanceMap(distance, critical, ("a",))
    assert found.classes()[0].tolist() == [0, 1, 2, 3, -1]
    assert list(found.shares().values()) == [0.25] * len(CLASSES)
    draw_distance_map(found, np.full((4, 5, 3), 0.5), tmp_path / "map.png")
    colours = {tuple(c) for c in (255 * read_image(tmp_path / "map.png").reshape(-1, 3)).round()}
    assert len(colours) > 50, "a legend and a bar of distances are there"
    refused("size of the map", draw_distance_map, found, np.zeros((5, 4, 3)), tmp_path / "map.png")


def test_the_study_covers_the_seven_groups() -> None:
    full = critical_distance.PRESETS["full"]["materials"]
    assert len(full) >= 25
    assert {PRESETS[name].group for name in full} == set(critical_distance.GROUP_DISTANCES_M)


@pytest.mark.slow
def test_a_small_study_says_published_beside_ours(tmp_path: Path) -> None:
    study = STUDIES["critical-distance"]
    config = {**study.presets["quick"], **SMALL, "materials": ["canvas_beige", "leather_tan"]}
    found = run_study(study, config, tmp_path)
    assert [row["material"] for row in found.rows] == config["materials"]
    groups = {row["group"]: row for row in found.summary["groups"]}
    assert set(groups) == {"fabric meso", "leather meso"}
    cloth, row = groups["fabric meso"], found.rows[0]
    assert cloth["published_m"] == 4.0 and cloth["saliency_m"] == row["saliency_m"]
    needed = PUBLISHED_MODELS["saliency"].distance(cloth["structure_mm"], cloth["saliency_needed"])
    assert needed == pytest.approx(4.0)
    assert found.summary["fits"] == {}, "two materials are too few for a line"
    assert {file.name for file in found.files if file.suffix == ".png"} == {
        "distances.png",
        "csf.png",
    }
    assert study.table(found.summary)


def test_fits_of_the_study_find_a_planted_model() -> None:
    pytest.importorskip("statsmodels")
    groups = critical_distance.GROUP_DISTANCES_M
    rows = [
        {
            "group": group,
            "structure_mm": metres,
            "found_spectrum_mm": 2.0 * metres,
            **dict.fromkeys(FEATURES, 0.5),
            **{f"{name}{tail}": 1.0 for name in PREDICTING for tail in ("_m", "_found_m")},
        }
        for group, metres in groups.items()
    ]
    summary = critical_distance.summarise({"spp": 1}, rows)
    assert summary["found_over_given"] == pytest.approx(2.0)
    for fit in summary["fits"].values():
        assert (fit["k_1"], fit["k_2"]) == pytest.approx((0.0, 2.0), abs=1e-9)
        assert fit["correlation"] == pytest.approx(1.0)
    assert critical_distance.table(summary)


def test_the_distance_of_a_picture_and_of_a_btf(tmp_path: Path) -> None:
    write_png(tmp_path / "cloth.png", striped(2.5))
    seen = done("distance", tmp_path / "cloth.png", "--size-mm", "40")
    assert seen["structure_mm"] == pytest.approx(2.5, abs=PIXEL_MM)
    assert set(seen["distances_m"]) == set(PREDICTING) and seen["compute_seconds"] > 0.0
    sizes = ("--size-mm", "40", "--structure-mm", "5")
    by_hand = simrig("distance", tmp_path / "cloth.png", *sizes)
    assert "S = 5 mm, given" in by_hand.stdout

    write_btf(tmp_path / "cloth.h5", lit_stack(striped(2.5)[:4, :50], (2.5, 0.2)))
    btf = done("distance", tmp_path / "cloth.h5")
    assert btf["structure_mm"] == pytest.approx(2.5, abs=PIXEL_MM)
    stack = lit_stack(striped(2.5)[:4, :50], (2.5, 0.2))
    write_btf(tmp_path / "measured.h5", replace(stack, name="leather_nappa"))
    own = done("distance", tmp_path / "measured.h5")
    assert (own["structure_mm"], own["structure_source"]) == (1.4, "of the preset")


def test_bad_distances_are_refused(tmp_path: Path) -> None:
    write_png(tmp_path / "cloth.png", striped(2.5))
    assert "is a picture: say with size_mm" in refusal("distance", tmp_path / "cloth.png")
    assert "--size-mm" in refusal("distance", "twill_blue", "--size-mm", "4")
    assert "did you mean 'twill_blue'" in refusal("distance", "twil_blue")
    assert "no" in refusal("distance", tmp_path / "missing.h5")
    assert "> 0 mm" in refusal("distance", tmp_path / "cloth.png", "--size-mm", "0")
    sizes = ("--size-mm", "40", "--structure-mm", "0")
    assert "> 0 mm" in refusal("distance", tmp_path / "cloth.png", *sizes)


def test_a_map_from_the_command_line(tmp_path: Path, variant_llvm: str) -> None:
    scene, output = tmp_path / "squares.xml", tmp_path / "map.png"
    scene.write_text(SQUARES_XML)
    common = ("distance-map", scene, "--output", output)
    assert "NAME=DISTANCE" in refusal(*common, "--critical", "wood")
    assert "above 0" in refusal(*common, "--critical", "wood=-3")
    assert "twice for 'wood'" in refusal(*common, "--critical", "wood=3", "--critical", "wood=4")
    found = done(*common, "--critical", "wood=2", "--critical", "cloth=4", "--spp", "1")
    assert found["critical_m"] == {"wood": 2.0, "cloth": 4.0}
    assert found["shares"]["not visible: a BRDF is enough"] == pytest.approx(0.5)
    assert output.stat().st_size > 1000
    assert "--overwrite" in refusal(*common)
    assert ".png" in refusal("distance-map", scene, "--output", tmp_path / "map.exr")

"""The room of chairs: what stands where, its scale, its forms and the study."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from refusals import refused
from simrig.btf.stack import BtfStack
from simrig.btf.synthetic import bumps, chessboard
from simrig.evaluation.studies import STUDIES
from simrig.evaluation.studies.engine.run import run_study
from simrig.evaluation.studies.room_switch.study import table
from simrig.files.btf.hdf5 import write_btf
from simrig.mesostructure import PRESETS
from simrig.rendering.render import render
from simrig.scenes import room
from simrig.scenes.chair import cushions, frame
from simrig.scenes.meshes import rounded_box
from simrig.scenes.room import CHAIRS, ROOM_PARTS, ROWS, chair_places
from simrig.viewing.room import (
    GROUP_DISTANCES_M,
    Room,
    distances_mm,
    far_share,
    group_distances_mm,
    range_map_m,
    room_materials,
)
from simrig.viewing.stimuli import materials as stimuli_materials
from simrig.viewing.stimuli.materials import StimulusMaterial
from simrig.viewing.structure.probe import btf_stimulus, probe

WHITE = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 1.0}}
# squares that a small picture resolves
BOARDS = dict.fromkeys(ROOM_PARTS, "chessboard-150")

pytestmark = pytest.mark.usefixtures("variant_llvm")


def test_it_holds_what_the_thesis_says() -> None:
    """Section 3.3.5: six rows of twelve chairs, 14 materials, of these two carpets."""
    assert len(chair_places()) == ROWS * CHAIRS == 72
    assert len(ROOM_PARTS) == len(set(ROOM_PARTS.values())) == 14
    groups = {part: PRESETS[name].group for part, name in ROOM_PARTS.items()}
    assert [part for part, name in ROOM_PARTS.items() if "carpet" in name] == ["carpet", "aisle"]
    for part, group in groups.items():
        if part.startswith("cushion"):
            assert group.startswith(("fabric", "leather"))
        elif part.startswith(("frame", "walls")):
            assert group.startswith("wood")
    assert set(GROUP_DISTANCES_M) >= set(groups.values())


def test_neighbours_do_not_touch_and_neighbouring_chairs_differ() -> None:
    places = chair_places()
    assert len({(x, z) for _, x, z in places}) == len(places)
    for (kind, x, z), (other, next_x, next_z) in itertools.pairwise(places):
        if z == next_z:
            assert kind != other and abs(next_x - x) > 575.0  # the outer sides of the arms


@pytest.mark.parametrize(
    "surface",
    [rounded_box((400.0, 300.0, 100.0), 30.0), cushions(), frame()],
    ids=["box", "cushions", "frame"],
)
def test_uv_are_millimetres_and_normals_point_outwards(surface) -> None:
    """The texture is squeezed at corners only: almost all of the area has its true size."""
    corners, uv = surface.vertices[surface.faces], surface.uv[surface.faces]
    edges, uv_edges = corners[:, 1:] - corners[:, :1], uv[:, 1:] - uv[:, :1]
    across = np.cross(edges[:, 0], edges[:, 1])
    area = 0.5 * np.linalg.norm(across, axis=1)
    uv_area = 0.5 * (uv_edges[:, 0, 0] * uv_edges[:, 1, 1] - uv_edges[:, 0, 1] * uv_edges[:, 1, 0])
    assert np.all(uv_area > 0.0)  # u, v and the normal are right-handed
    true = np.abs(area / uv_area - 1.0) < 0.08
    assert area[true].sum() > 0.9 * area.sum()
    facing = np.einsum("ij,ij->i", across, surface.normals[surface.faces[:, 0]])
    assert np.all(facing > 0.0)
    np.testing.assert_allclose(np.linalg.norm(surface.normals, axis=1), 1.0, atol=1e-9)


def test_the_range_is_twelve_metres() -> None:
    distance = range_map_m(96)
    assert distance.shape == (54, 96)
    seen = distance[distance > 0.0]
    assert 2.0 < seen.min() < 3.5 and 12.0 < seen.max() < 14.0


def scaled(factor: float) -> dict[str, float]:
    return {part: factor * distance for part, distance in group_distances_mm().items()}


def test_a_larger_distance_shows_fewer_brdfs() -> None:
    shares = [far_share(scaled(factor), 64) for factor in (0.0, 1.0, 10.0)]
    assert shares[0] == 1.0 and shares[2] == 0.0
    assert 0.1 < shares[1] < 0.9


def test_distances_are_predicted_from_the_images_at_hand() -> None:
    """As ``simrig distance`` does; a material of several parts is looked at once."""
    shown = StimulusMaterial(bumps((16, 16)))
    coarse = StimulusMaterial(replace(shown.stack, name="twill_blue"))
    parts = {"walls": shown, "aisle": coarse, "carpet": shown}
    probed = []
    found = distances_mm("predicted", parts, lambda *call: probed.append(call))
    assert probed == [(0, 2, shown.stack.name), (1, 2, "twill_blue"), (2, 2)]
    stimulus, known = btf_stimulus(shown.stack), PRESETS["twill_blue"].structure.element_mm
    free, given = (1000.0 * probe(stimulus, size).distances_m["saliency"] for size in (None, known))
    assert found == {"walls": free, "aisle": given, "carpet": free}
    assert distances_mm("groups", parts) == group_distances_mm()


def test_a_board_with_few_images_has_no_predicted_distance(materials) -> None:
    refused(r"no image within 10° .* distances of the groups", distances_mm, "predicted", materials)


@pytest.mark.parametrize(
    ("bad", "message"), [("missing.h5", "no file"), ("lacking.h5", "lacks 2 of 9 images")]
)
def test_what_cannot_be_used_is_refused_before_anything_is_measured(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, bad: str, message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(stimuli_materials, "kept_btf", lambda *_, **__: pytest.fail("measured"))
    board = chessboard(150.0)
    angles = np.array([[0.2 * i, 0.2 * v, i, v] for i in range(3) for v in range(3)])[:7]
    values = np.zeros((7, *board.values.shape[1:]), dtype=np.float16)
    write_btf("lacking.h5", BtfStack(values, angles, board.size_mm))
    refused(message, room_materials, {"walls": bad})


@pytest.fixture(scope="module")
def materials():
    return room_materials(BOARDS)


def test_switched_is_the_btf_near_and_the_brdf_far(materials) -> None:
    near, far, btf, brdf = (
        render(Room(materials, scaled(factor), 64, 1).scene(form)).image
        for factor, form in ((100.0, "switched"), (0.0, "switched"), (1.0, "btf"), (1.0, "brdf"))
    )
    np.testing.assert_allclose(near, btf, atol=1e-4)
    np.testing.assert_allclose(far, brdf, atol=1e-4)
    assert np.abs(btf - brdf).max() > 0.1


@pytest.mark.slow
def test_the_study_says_what_switching_costs_and_saves(tmp_path) -> None:
    config = {
        **STUDIES["room-switch"].presets["quick"],
        "materials": BOARDS,
        "distances": "groups",
        "resolution": 96,
        "spp": 1,
        "rounds": 1,
        "texels": 8,
    }
    found = run_study(STUDIES["room-switch"], config, tmp_path)
    forms = found.summary["forms"]
    assert forms["btf"]["faster"] == 1.0 and forms["btf"]["psnr"] is None
    assert forms["brdf"]["psnr"] < forms["switched"]["psnr"]
    assert 0.0 < forms["switched"]["far_share"] < 1.0
    assert forms["switched"]["published_psnr"] == 58.6
    for form in forms.values():
        low, high = form["range_seconds"]
        assert 0.0 < low <= form["seconds"] <= high and form["tracing_seconds"] > 0.0
    # the planner keeps its word
    planned = forms["planned"]
    assert planned["psnr"] is None or planned["psnr"] >= 58.6
    assert planned["planning_seconds"] > 0.0 and 0.0 <= planned["far_share"] < 1.0
    assert found.summary["parts"]["walls"]["distance_m"] == 4.0
    assert table(found.summary)
    names = {path.name for path in found.files}
    assert {"range_map.png", "switched_difference.png", "brdf_difference.png"} <= names


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: room({"wals": WHITE}), "did you mean 'walls'"),
        (lambda: room({"walls": WHITE}), "'carpet' has no material"),
        (lambda: distances_mm("group", {}), "did you mean 'groups'"),
        (lambda: room_materials({"flor": "bumps"}), "unknown part of the room"),
        (lambda: Room({}, {}).scene("btff"), "did you mean 'btf'"),
    ],
)
def test_bad_arguments_are_refused_in_one_line(make, message: str) -> None:
    refused(message, make)

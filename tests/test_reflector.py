"""The reflector's mirror and folded pictures against closed forms; anisotropy found in them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from simrig.brdf import kurt_material
from simrig.brdf.analytic import Lambert, Ward
from simrig.cli.app import app
from simrig.core.effects import Overrides, parse_tolerance
from simrig.core.errors import SimrigError
from simrig.evaluation.studies import reflector_axes
from simrig.imaging.anisotropy import analyse
from simrig.imaging.anisotropy_opening import Opening, cut_out, find_opening
from simrig.instruments.description import shipped
from simrig.rigs.reflector.effects import plan_picture, simulated
from simrig.rigs.reflector.folded import Folded, fold, picture
from simrig.rigs.reflector.lighting import lighting_of
from simrig.rigs.reflector.mirror import CONJUGATE, Reflector, follow
from simrig.rigs.reflector.photograph import analyse_photograph
from simrig.rigs.reflector.traced import trace
from simrig.rigs.tolerances import measured_change

PERFECT = Reflector(reflectance=(1.0, 1.0, 1.0))


@pytest.fixture(scope="module")
def folded() -> Folded:
    """Return the instrument of the thesis, solved for a picture of 192 pixels."""
    return fold(PERFECT, 192)


def test_light_of_one_focus_meets_in_the_other() -> None:
    rng = np.random.default_rng(5)
    entry = rng.uniform(-38.0, 38.0, (1000, 2))
    entry = entry[np.hypot(*entry.T) > 14.0]
    paths = follow(CONJUGATE, CONJUGATE.lens, entry, 1)
    assert np.abs(paths.landing).max() < 1e-6
    # the lowest polar angle that the thesis names, "around 30°"
    assert np.degrees(np.arctan2(55.0, CONJUGATE.height_mm)) == pytest.approx(24.5, abs=3.0)


def test_reflection_keeps_paths_stationary() -> None:
    """Fermat: the length from flash to mirror to sample does not change to first order."""
    mirror, entry = PERFECT, np.array([[40.0, 7.0], [-20.0, 30.0], [3.0, -45.0]])
    paths = follow(mirror, mirror.flash, entry, 1)
    landing = np.concatenate([paths.landing, np.zeros((3, 1))], axis=1)
    centre = np.array([0.0, 0.0, mirror.centre_mm])
    axes = np.array([mirror.across_mm, mirror.across_mm, mirror.along_mm])
    along = (landing + 0.0 - centre) / axes
    step = paths.towards / axes
    a, b = np.sum(step**2, 1), np.sum(along * step, 1)
    reach = (-b + np.sqrt(b * b - a * (np.sum(along**2, 1) - 1.0))) / a
    at = landing + reach[:, None] * paths.towards

    def length(point: np.ndarray) -> np.ndarray:
        on = centre + (point - centre) / np.linalg.norm((point - centre) / axes, axis=1)[:, None]
        return np.asarray(
            np.linalg.norm(on - mirror.flash, axis=1) + np.linalg.norm(on - landing, axis=1)
        )

    for shift in np.eye(3) * 1e-3:
        assert np.abs(length(at + shift) - length(at - shift)).max() < 1e-9


def test_flux_on_the_sample_is_that_of_cones() -> None:
    """A flash on the axis: the solid angles of the cones whose light lands, in closed form."""
    mirror = replace(PERFECT, flash_mm=0.0)

    radius = np.linspace(0.0, 55.0, 20_001)
    paths = follow(mirror, mirror.lens, np.stack([radius, 0.0 * radius], axis=-1), 1)
    lands = np.flatnonzero(paths.valid)  # one ring, as one branch follows the other
    assert len(lands) == lands[-1] - lands[0] + 1
    inner, outer = radius[lands[[0, -1]]]
    away = mirror.distance_mm - mirror.height_mm
    cosines = away / np.hypot(away, np.array([inner, outer]))
    expected = 2.0 * np.pi * mirror.distance_mm**2 * (cosines[0] - cosines[1])
    solved = fold(mirror, 256, flash_points=1)
    kept = solved.bounces == 1
    found = solved.irradiance[kept, 0].sum() * (solved.width_mm / solved.pixels) ** 2
    assert found == pytest.approx(expected, rel=5e-3)


def test_lambertian_picture_is_irradiance(folded: Folded) -> None:
    image = picture(folded, Lambert((0.3, 0.6, 0.9)))
    assert image[..., 0] == pytest.approx(folded.total * 0.3 / np.pi, rel=1e-12)
    assert np.nanmean(folded.polar_angles()) == pytest.approx(np.radians(50.0), abs=0.04)


def test_two_branches_come_from_opposite_sides() -> None:
    solved = fold(replace(PERFECT, flash_mm=0.0), 64, flash_points=1)
    pixel = 32 * 64 + 44
    mine = solved.towards[(solved.pixel == pixel) & (solved.bounces == 1)]
    azimuth = np.arctan2(mine[:, 1], mine[:, 0])
    assert len(mine) == 2
    assert abs(abs(azimuth[1] - azimuth[0]) - np.pi) < 1e-6


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"sample_mm": 80.0}, "inside the mirror"),
        ({"large_opening_mm": 140.0}, "do not fit"),
        ({"reflectance": (1.2, 1.0, 1.0)}, "reflectance"),
        ({"dust": float("nan")}, "finite"),
        ({"tilt_mrad": (500.0, 0.0)}, "tilted"),
        ({"distance_mm": 100.0}, "away"),
    ],
)
def test_impossible_instruments_are_refused(changes: dict, says: str) -> None:
    with pytest.raises(SimrigError, match=says):
        replace(PERFECT, **changes)


def test_sample_in_the_focus_is_refused_by_the_folded_model() -> None:
    with pytest.raises(SimrigError, match="out of the focus"):
        fold(CONJUGATE, 64, flash_points=1)


@pytest.mark.parametrize(
    "changes",
    [
        {"sample_mm": 11.266},  # near the near focus of a mirror whose other one is elsewhere
        {"slope_rms_mrad": 1.0, "tilt_mrad": (2.0, 1.0), "shift_mm": (0.5, 0.0), "dust": 0.05},
        {"flash_mm": 0.0},
        {"across_mm": 55.0},
    ],
)
def test_hard_pictures_are_finite(changes: dict) -> None:
    try:
        image = picture(
            fold(replace(PERFECT, **changes), 64, flash_points=1), kurt_material("wood01")
        )
    except SimrigError as error:
        assert "focus" in str(error)
    else:
        assert np.isfinite(image).all()
        assert image.min() >= 0.0


def test_left_out_effects_change_less_than_their_bounds() -> None:
    """Every subset of a planned picture at finer pixels than the bounds look at."""
    mirror = Reflector(
        slope_rms_mrad=0.05, tilt_mrad=(0.3, 0.0), dust=0.02, reflectance=(0.8, 0.85, 0.86)
    )
    material = kurt_material("fabric112")
    for text in ("relative=0.05", "dE=0.5"):
        tolerance = parse_tolerance(text)
        plan = plan_picture(mirror, material, 20.0, tolerance)
        on = tuple(plan.settings["effects"])
        assert 0.0 < plan.left_out <= tolerance.amount
        assert {d.effect for d in plan.effects if d.bound is not None and d.bound.absent} == {
            "shift"
        }
        whole, part = (
            picture(fold(m, 96), material, 20.0) for m in (mirror, simulated(mirror, on))
        )
        inside = whole.sum(axis=-1) > 0.0
        scale = 0.9 / np.quantile(whole[inside], 0.985) / np.pi
        values = [image[inside] * scale for image in (part, whole)]
        found = measured_change(*values, np.zeros(len(values[0])), tolerance)
        assert 0.0 < found <= tolerance.amount
    every = plan_picture(mirror, material, 20.0, tolerance, Overrides(everything=True))
    assert simulated(mirror, tuple(every.settings["effects"])) == mirror


def test_shipped_instrument_is_the_thesis_s() -> None:
    mirror = Reflector.from_description(shipped("reflector"))
    assert mirror.large_opening_mm == pytest.approx(110.0, abs=0.01)
    assert (mirror.opening_mm, mirror.flash_mm, mirror.distance_mm) == (26.0, 75.0, 1500.0)


@pytest.mark.parametrize(
    ("name", "axis", "count"),
    [("fabric135", 0.0, 1), ("purple_satin", 90.0, 1), ("fabric139", 90.0, 2), ("wood01", 90.0, 1)],
)
def test_axes_are_found(folded: Folded, name: str, axis: float, count: int) -> None:
    rotation = 37.3
    image = picture(folded, kurt_material(name), rotation)
    modes = analyse(image, lighting_of(folded)).modes.found
    error = np.degrees(modes[0].axis) - axis - rotation
    assert abs((error + 90.0) % 180.0 - 90.0) < 0.05
    assert len(modes) == count


def test_noise_is_no_anisotropy(folded: Folded) -> None:
    rng = np.random.default_rng(8)
    for roughness in (0.1, 0.3):
        image = picture(folded, Ward(m_x=roughness, m_y=roughness))
        noisy = image * (1.0 + rng.normal(0.0, 0.01, image.shape))
        assert not analyse(image, lighting_of(folded)).modes.found
        assert not analyse(noisy, lighting_of(folded)).modes.found


def test_uncertainty_covers_the_error(folded: Folded) -> None:
    rng = np.random.default_rng(9)
    image = picture(folded, kurt_material("fabric135"), 20.0)
    errors, told = [], []
    for _ in range(12):
        noisy = image * (1.0 + rng.normal(0.0, 0.02, image.shape))
        mode = analyse(noisy, lighting_of(folded)).modes.found[0]
        errors.append(np.degrees(mode.axis) - 20.0)
        told.append(np.degrees(mode.axis_uncertainty))
    ratio = np.sqrt(np.mean(np.square(errors))) / np.mean(told)
    assert 0.3 < ratio < 2.5


def test_unusable_pictures_are_refused(folded: Folded) -> None:
    lighting = lighting_of(folded)
    image = picture(folded, kurt_material("fabric135"))
    with pytest.raises(SimrigError, match="black"):
        analyse(np.zeros_like(image), lighting)
    with pytest.raises(SimrigError, match="unusable"):
        analyse(np.where(folded.total[..., None] > 5.0, np.nan, image), lighting)
    with pytest.raises(SimrigError, match="shape"):
        analyse(image[1:], lighting)


def test_specks_and_a_saturated_middle_do_no_harm(folded: Folded) -> None:
    rng = np.random.default_rng(11)
    image = picture(folded, kurt_material("fabric135"), 20.0)
    image[image > np.quantile(image, 0.99)] = np.nan
    image.reshape(-1, 3)[rng.choice(192 * 192, 100, replace=False)] *= 5.0
    mode = analyse(image, lighting_of(folded)).modes.found[0]
    assert np.degrees(mode.axis) == pytest.approx(20.0, abs=0.5)


def test_opening_is_found_and_cut_out() -> None:
    rows, columns = np.mgrid[:400, :500]
    inside = np.hypot(columns - 230.3, rows - 190.7) < 120.0
    photograph = np.where(inside, 0.5 + 0.001 * columns, 0.001)[..., None].repeat(3, axis=-1)
    found = find_opening(photograph)
    assert (found.x, found.y, found.diameter) == pytest.approx((230.3, 190.7, 240.0), abs=0.2)
    cut = cut_out(photograph, found, 96)
    assert cut[48, 48, 0] == pytest.approx(0.5 + 0.2315, abs=0.01)
    with pytest.raises(SimrigError, match="no round opening"):
        find_opening(np.where(columns > 250, 1.0, 0.0)[..., None].repeat(3, axis=-1))
    wide = np.hypot((columns - 230.3) / 1.04, rows - 190.7) < 120.0
    with pytest.raises(SimrigError, match=r"an ellipse, 1\.0"):
        find_opening(np.where(wide, 0.5, 0.001)[..., None].repeat(3, axis=-1))
    for level, says in ((np.nan, "saturated"), (0.0, "black")):
        with pytest.raises(SimrigError, match=says):
            find_opening(np.where(inside, level, 0.0)[..., None].repeat(3, axis=-1))
    with pytest.raises(SimrigError, match="too small"):
        cut_out(photograph, Opening(100.0, 100.0, 12.0), 96)


def test_photograph_whose_flash_and_place_are_unknown(folded: Folded) -> None:
    turned = fold(replace(PERFECT, flash_azimuth_deg=70.0), 192)
    image = picture(turned, kurt_material("yellow_satin"), 15.0)
    photograph = np.zeros((260, 300, 3))
    photograph[31:223, 62:254] = image
    found = analyse_photograph(photograph, PERFECT)
    assert found.mirror.flash_azimuth_deg == pytest.approx(70.0, abs=0.3)
    assert np.degrees(found.anisotropy.modes.found[0].axis) == pytest.approx(105.0, abs=0.3)
    assert (found.opening.x, found.opening.y) == pytest.approx((157.5, 126.5), abs=0.1)


def test_commands(tmp_path: Path) -> None:
    shot, sheet = tmp_path / "shot.exr", tmp_path / "sheet.png"
    run = CliRunner().invoke
    instrument = tmp_path / "even.toml"
    text = (Path(__file__).parents[1] / "simrig/instruments/reflector.toml").read_text()
    instrument.write_text(text.replace("slope_rms_mrad = 1", "slope_rms_mrad = 0"))
    own = ["--instrument", str(instrument)]
    made = run(
        app, ["reflector", "picture", "fabric135", "-o", str(shot), "--rotation", "30", *own]
    )
    assert made.exit_code == 0, made.output
    asked = ["reflector", "analyse", str(shot), "--sheet", str(sheet), "--json", *own]
    found = run(app, asked)
    assert found.exit_code == 0, found.output
    told = json.loads(found.stdout)
    assert told["count"] >= 1
    assert told["highlights"][0]["axis_deg"] == pytest.approx(30.0, abs=0.5)
    assert "--reference" in told["note"]
    assert sheet.stat().st_size > 10_000
    assert run(app, ["reflector", "analyse", str(shot), "--opening", "1,2"]).exit_code == 2
    assert run(app, ["reflector", "analyse", str(tmp_path / "none.exr")]).exit_code == 2
    assert (
        run(
            app, ["reflector", "picture", "wood01", "-o", str(sheet), "--instrument", "utia"]
        ).exit_code
        == 2
    )


def test_traced_picture_agrees_within_its_noise() -> None:
    mirror, material = Reflector(), kurt_material("purple_satin")
    traced = trace(mirror, material, 30.0, 8, batches=6)
    fine = picture(fold(mirror, 128, flash_points=1), material, 30.0)
    coarse = fine.reshape(8, 16, 8, 16, 3).mean(axis=(1, 3))
    assert coarse.mean() == pytest.approx(traced.picture.mean(), rel=0.01)
    outer = traced.picture[..., 0] < 3.0 * np.median(traced.picture[..., 0])  # not the caustic
    away = np.abs(coarse - traced.picture)[outer]
    assert away.mean() < 2.0 * traced.uncertainty[outer].mean() + 0.005 * traced.picture.mean()
    with pytest.raises(SimrigError, match="even, upright"):
        trace(replace(mirror, dust=0.1), material)


@pytest.mark.slow
def test_a_reference_tells_where_flash_and_opening_are(folded: Folded) -> None:
    """A plain search by area is off by a third of a pixel; light gathers on one side."""
    paper = np.zeros((260, 300, 3))
    paper[31:223, 62:254] = picture(folded, Lambert((0.04,) * 3))
    found = analyse_photograph(paper, PERFECT, paper)
    assert found.mirror.flash_azimuth_deg == pytest.approx(PERFECT.flash_azimuth_deg, abs=0.1)
    assert found.mirror.flash_mm == pytest.approx(PERFECT.flash_mm, abs=0.5)
    assert (found.opening.x, found.opening.y) == pytest.approx((157.5, 126.5), abs=0.1)
    assert found.opening.diameter == pytest.approx(192 / 1.1, abs=0.2)
    assert not found.anisotropy.modes.found


def test_study_knows_woven_and_measured_materials(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (woven,) = reflector_axes.run_cell({"rotations": 1}, {"material": "weave2", "camera": "ideal"})
    assert woven["count"] == woven["true_count"] == 2
    assert woven["axis_error_deg"] < 0.5
    monkeypatch.chdir(tmp_path)
    (absent,) = reflector_axes.run_cell(
        {"rotations": 1}, {"material": "carpet07", "camera": "ideal"}
    )
    assert "there is no file" in absent["refused"]

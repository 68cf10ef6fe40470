"""Colours outside sRGB: said, clipped unless asked for, and kept without a NaN from end to end."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import simrig as sr
from command_line import done, refusal
from simrig.brdf import kurt_material
from simrig.brdf.protocol import evaluate
from simrig.brdf.tables.from_samples import assemble
from simrig.brdf.tables.scattered import ScatteredSamples
from simrig.core import backend
from simrig.core.errors import SimrigError
from simrig.core.gamut import KEEP, outside
from simrig.directions.spherical import to_vector
from simrig.files import formats
from simrig.files.load import load_material, read_material, save_material
from simrig.files.rgl.reader import read_rgl
from simrig.files.rgl.tensor_file import read_tensors, write_tensors
from simrig.files.rgl.writer import RglResolution, write_rgl
from simrig.methods import METHODS
from simrig.plans.registry import make_plan
from simrig.rigs.measurements.measurement import Measurement
from simrig.rigs.registry import make_rig

IDEAL = make_rig("gonioreflectometer")


@pytest.fixture(scope="module")
def saturated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An RGL file whose red is negative in part."""
    path = tmp_path_factory.mktemp("rgl") / "saturated.bsdf"
    write_rgl(path, kurt_material("fabric112"), RglResolution(4, 8, 17, 9))
    fields = dict(read_tensors(path))
    rgb = fields["rgb"].copy()
    rgb[:, :, 0] = rgb[:, :, 0] - 1.5 * rgb[:, :, 1]
    write_tensors(path, {**fields, "rgb": rgb})
    return path


def directions(count: int = 400) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(5)
    z = rng.uniform(0.2, 1.0, (2, count))
    phi = rng.uniform(0.0, 2.0 * np.pi, (2, count))
    size = np.sqrt(1.0 - z**2)
    both = np.stack([size * np.cos(phi), size * np.sin(phi), z], axis=-1)
    return both[0], both[1]


def test_kept_colours_are_the_stored_ones_and_clipped_ones_without_what_is_negative(
    saturated: Path,
) -> None:
    wi, wv = directions()
    clipped, kept = (evaluate(load_material(saturated, gamut=g), wi, wv) for g in (None, "keep"))
    assert kept.min() < 0.0 <= clipped.min()
    np.testing.assert_array_equal(np.maximum(kept, 0.0), clipped)
    for name in ("float32", "float64"):
        again = evaluate(read_rgl(saturated, gamut=KEEP), wi, wv, backend.types(name).Float)
        np.testing.assert_allclose(again, kept, rtol=2e-3, atol=2e-4 * np.abs(kept).max())


def test_it_is_said_where_a_material_is_read(
    saturated: Path, caplog: pytest.LogCaptureFixture
) -> None:
    formats._say_once.cache_clear()
    with caplog.at_level(logging.WARNING):
        notes = read_material(saturated).notes
        read_material(saturated)
    found = outside(np.moveaxis(read_tensors(saturated)["rgb"], 2, -1))
    assert found is not None and notes == [found.text("clip")]
    assert [record.getMessage() for record in caplog.records] == [f"'{saturated}': {notes[0]}"]
    assert "set to 0 (gamut 'keep' keeps them)" in notes[0] and f"{found.lowest:.3g}" in notes[0]
    assert load_material(saturated, gamut="keep").outside == found


def test_a_file_of_ours_keeps_what_was_kept(saturated: Path, tmp_path: Path) -> None:
    kept = load_material(saturated, gamut="keep")
    save_material(tmp_path / "kept.h5", kept)
    again = load_material(tmp_path / "kept.h5")
    assert again.gamut == "keep" and again.outside == kept.outside
    wi, wv = directions()
    np.testing.assert_allclose(evaluate(again, wi, wv), evaluate(kept, wi, wv), rtol=1e-12)
    for format in ("merl", "utia", "rgl", "klems"):
        with pytest.raises(SimrigError, match=f"which '{format}' does not hold: write .h5"):
            save_material(tmp_path / "other", kept, format)


@pytest.mark.parametrize("method", ["barycentric", "regular-grid"])
def test_negative_channels_survive_measurement_and_linear_methods(
    saturated: Path, tmp_path: Path, method: str
) -> None:
    truth = load_material(saturated, gamut="keep")
    plan = METHODS[method].plan(truth, 500)
    IDEAL.measure(truth, plan).save(tmp_path / "m.h5")
    measurement = Measurement.load(tmp_path / "m.h5")
    assert measurement.values.min() < 0.0 and measurement.gamut == "keep"
    assert measurement.exhibit().picture is not None
    made = METHODS[method].reconstruct(measurement).brdf
    t, p = measurement.angles[:, :2], measurement.angles[:, 2:]
    found = made.eval(*(to_vector(t[:, k], p[:, k]) for k in (0, 1)))
    np.testing.assert_allclose(found, measurement.values, rtol=1e-4, atol=1e-5)
    compared = sr.compare(truth, made, step_deg=15.0)
    numbers = [v for v in vars(compared).values() if isinstance(v, float)]
    assert numbers and np.isfinite(numbers).all()


def test_what_cannot_hold_them_says_so(saturated: Path) -> None:
    truth = load_material(saturated, gamut="keep")
    with pytest.raises(SimrigError, match="plan 'auto' works with logarithms"):
        IDEAL.measure(truth, make_plan("auto", truth))
    measurement = IDEAL.measure(truth, make_plan("uniform", truth, samples=900))
    for name, method in METHODS.items():
        if not method.linear and method.any_plan:
            with pytest.raises(
                SimrigError, match=f"{name} works with values >= 0.*use barycentric"
            ):
                method.reconstruct(measurement)
    with pytest.raises(SimrigError, match="a sensor has no negative exposures"):
        sr.measure(truth, plan="scheme", scheme="1")
    with pytest.raises(SimrigError, match="negative"):
        Measurement(measurement.angles, measurement.values, "x")
    for gamut, message in (("kep", "did you mean 'keep'"), ("keep", "'gamut' is for")):
        with pytest.raises(SimrigError, match=message):
            load_material(saturated if gamut == "kep" else merl_file(saturated), gamut=gamut)


def merl_file(beside: Path) -> Path:
    from simrig.brdf.tables.isotropic import MERL_SHAPE, IsotropicTable
    from simrig.files.merl import write_merl

    path = beside.with_name("grey.binary")
    if not path.exists():
        write_merl(path, IsotropicTable(np.full((*MERL_SHAPE, 3), 0.25)))
    return path


def test_tables_of_samples_keep_or_clip() -> None:
    theta, phi = np.radians([0.0, 30.0, 60.0]), np.radians([0.0, 90.0, 180.0, 270.0])
    grid = [(0.0, 0.0), *((t, p) for t in theta[1:] for p in phi)]
    light, view = (
        np.array(side) for side in zip(*((a, b) for a in grid for b in grid), strict=True)
    )
    values = np.random.default_rng(1).uniform(-0.2, 1.0, (len(light), 3))
    samples = dict(
        theta_i=light[:, 0], phi_i=light[:, 1], theta_v=view[:, 0], phi_v=view[:, 1], values=values
    )
    kept = assemble(ScatteredSamples(**samples, gamut="keep")).brdf  # type: ignore[arg-type]
    clipped = assemble(ScatteredSamples(**samples)).brdf  # type: ignore[arg-type]
    assert kept.outside == clipped.outside == outside(values)
    assert kept.data()["values"].min() < 0.0 <= clipped.data()["values"].min()


def test_the_plugin_and_the_command_line_take_it(
    saturated: Path, tmp_path: Path, variant_llvm: None
) -> None:
    import mitsuba as mi

    table: dict[str, Any] = {"type": "simrig_table", "filename": str(saturated)}
    ball = {"type": "scene", "shape": {"type": "sphere"}, "light": {"type": "constant"}}
    sensor = {
        "type": "perspective",
        "to_world": mi.ScalarTransform4f().look_at([0, 0, 4], [0, 0, 0], [0, 1, 0]),
        "film": {"type": "hdrfilm", "width": 8, "height": 8, "pixel_format": "rgb"},
        "sampler": {"type": "independent", "sample_count": 16},
    }
    pictures = []
    for gamut in ("clip", "keep"):
        bsdf = {**table, "gamut": gamut}
        scene: Any = mi.load_dict(
            {**ball, "shape": {"type": "sphere", "bsdf": bsdf}, "sensor": sensor,
             "integrator": {"type": "direct", "hide_emitters": True}}
        )  # fmt: skip
        pictures.append(np.array(mi.render(scene, seed=1)))
    assert all(np.isfinite(picture).all() for picture in pictures)
    assert pictures[1].min() < 0.0 <= pictures[0].min()
    file = tmp_path / "kept.h5"
    said = done("convert", saturated, file, "--gamut", "keep")
    assert any("outside sRGB" in note and "kept" in note for note in said["read"]["notes"])
    done("measure", file, "--ideal", "--plan", "scheme", "--scheme", "1", "-o", tmp_path / "m.h5")
    assert "logarithms" in refusal("measure", file, "--plan", "auto", "-o", tmp_path / "n.h5")

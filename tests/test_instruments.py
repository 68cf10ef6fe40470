"""Instrument files: what they say, what is refused, and that a user's own is measured with."""

from __future__ import annotations

import copy
import tomllib
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

from command_line import done, refusal
from refusals import refused
from simrig.brdf import Lambert, kurt_material
from simrig.core.effects import Overrides, Tolerance
from simrig.core.errors import SimrigError
from simrig.instruments.description import SHIPPED, described, read_description, shipped
from simrig.instruments.instrument import Instrument, utia
from simrig.plans.along_slices import SlicePlan
from simrig.plans.listed import Directions
from simrig.plans.placement import SlicePlacement
from simrig.rigs.direct.gonioreflectometer import Gonioreflectometer
from simrig.rigs.direct.recording import positioning_errors
from simrig.rigs.registry import RIGS, make_rig, rig_of

UTIA_TEXT = files("simrig.instruments").joinpath("utia.toml").read_text(encoding="utf-8")
PLAN = SlicePlan(SlicePlacement.from_degrees(28, 60), 700)


def changed(old: str, new: str) -> str:
    assert old in UTIA_TEXT
    return UTIA_TEXT.replace(old, new, 1)


def with_key(table: str, key: str, value: object) -> dict:
    """Return the UTIA's file with one key changed, added, or (None) left out."""
    made = copy.deepcopy(tomllib.loads(UTIA_TEXT))
    where = made["axis"][1] if table == "axis" else made.setdefault(table, {})
    if value is None:
        del where[key]
    else:
        where[key] = value
    return made


@pytest.mark.parametrize("name", SHIPPED)
def test_what_comes_with_simrig_is_a_rig(name: str) -> None:
    description = shipped(name)
    assert described(description.model_dump(mode="json")) == description
    if description.instrument.kind not in RIGS:
        refused("no rig measures with", rig_of, description)
        return
    rig = rig_of(description)
    assert rig.name == description.instrument.kind
    assert rig.instrument_facts()["name"] == description.instrument.name


def test_the_numbers_of_the_thesis() -> None:
    rig = utia()
    assert rig.positioning_deg == (0.03,) * 4 and rig.offset_deg == (0.0,) * 4
    assert (rig.sensor_distance, rig.bits, rig.pixels) == (2000.0, 14, 2500)
    assert rig.bits + rig.exposure_range_ev == pytest.approx(28.4)


@pytest.mark.parametrize(
    ("table", "key", "value", "message"),
    [
        ("camera", "bitss", 14, "unknown key in [camera] 'bitss': did you mean 'bits'?"),
        ("camera", "bits", None, "'bits' is missing in [camera]"),
        ("camera", "bits", 14.5, "'bits' in [camera]"),
        ("camera", "bits", True, "'bits' in [camera]"),
        ("camera", "bits", 0, "greater than or equal to 1, got 0"),
        ("camera", "mu_sat_e", float("nan"), "'mu_sat_e' in [camera]: input should be a finite"),
        ("camera", "mu_sat_e", float("inf"), "'mu_sat_e' in [camera]: input should be a finite"),
        ("camera", "mu_sat_e", -1, "must be >= 1, got -1"),
        ("camera", "mu_sat_e", "many", "must be a number or {value, u, dist, group}, got 'many'"),
        ("camera", "mu_sat_e", {"value": 3e4, "uu": 1}, "unknown key in [camera] 'uu': did you"),
        ("camera", "mu_sat_e", {"value": 3e4, "u": -1}, "must be >= 0, got -1"),
        ("camera", "mu_sat_e", {"value": 3e4, "dist": "flat"}, "'normal', 'uniform' or 'tri"),
        ("camera", "mu_sat_e", {"u": 1}, "'value' is missing in [camera]"),
        ("axis", "rang_deg", [0, 90], "unknown key in [[axis]] number 2 'rang_deg': did you mean"),
        ("axis", "range_deg", [90, 0], "'range_deg' in [[axis]] number 2: must be two ascending"),
        ("axis", "range_deg", [0], "'range_deg' in [[axis]] number 2"),
        ("axis", "name", "theta_i", "one [[axis]] named 'theta_i' is needed, got 2"),
        ("axis", "name", "theta", "'name' in [[axis]] number 2"),
        ("sample", "spot_diameter_mm", 50, "the spot of a rig must lie on the sample"),
        ("mirror", "reflectance", 0.5, "'coverage' is missing in [mirror]"),
        ("lens", "f_number", 0, "must be above 0, got 0"),
        ("light", "distance_mm", 20, "must be farther away"),
        ("timing", "adaptive_overhead", 0.5, "must be >= 1"),
        ("lense", "f_mm", 180, "unknown key in the file 'lense': did you mean 'lens'?"),
        ("instrument", "kind", "goniometer", "did you mean 'gonioreflectometer'?"),
        ("instrument", "kind", 3, "[instrument] needs a 'kind'"),
        ("instrument", "name", "", "'name' in [instrument]"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(table, key, value, message) -> None:
    with pytest.raises(SimrigError) as caught:
        rig_of(described(with_key(table, key, value)))
    assert message in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "needs a 'kind'"),
        ("name = ", "no valid TOML"),
        ("x = " + "[" * 100_000, "no valid TOML"),
        ("[instrument]\nname = 'a'\nkind = 'gantry'\n", "'timing' is missing in the file"),
        (changed("bits = 14", "bits = 14\nbits = 15"), "no valid TOML"),
        (UTIA_TEXT + "#" * (1 << 20), "too large"),
    ],
)
def test_files_that_are_no_instruments_are_refused(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    path.write_text(text)
    with pytest.raises(SimrigError, match=message) as caught:
        read_description(path)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)
    path.write_bytes(b"\xff\xfe\x00")
    refused("no valid TOML", read_description, path)
    refused("there is no file", read_description, tmp_path / "b.toml")


def test_a_number_may_have_an_uncertainty_and_a_group() -> None:
    lamp = {"value": 31.5, "u": 0.2, "dist": "uniform", "group": "lamp"}
    description = described(with_key("light", "diameter_mm", lamp))
    assert description.light.diameter_mm.model_dump() == lamp  # type: ignore[attr-defined]
    assert Instrument.of(description).light_diameter == 31.5  # type: ignore[arg-type]


def test_unknown_rigs_and_options_are_refused() -> None:
    refused("did you mean 'gonioreflectometer'", make_rig, "gonioreflectmeter")
    refused("'gantry' has no --seed, .*, btf, imaging, reflector have", make_rig, "gantry", seed=3)
    refused("--seed must be a whole number of at least 0", make_rig, "utia", seed=-1)
    assert make_rig("utia", seed=3).instrument.seed == 3  # type: ignore[attr-defined]
    assert {type(make_rig(name)) for name in RIGS} == set(RIGS.values())


def test_axes_stop_where_they_reach(tmp_path: Path) -> None:
    path = tmp_path / "short.toml"
    path.write_text(changed("range_deg = [0, 360]", "range_deg = [-90, 90]"))
    rig = make_rig(path)
    angles = np.radians([[10.0, 20.0, -80.0, 200.0], [10.0, 20.0, 280.0, 0.0]])
    assert rig.reaches(angles).all()  # azimuths are periodic
    beyond = np.radians([[10.0, 20.0, 100.0, 0.0]])
    assert not rig.reaches(beyond).any()
    refused(r"does not reach .* = 10.00°, 20.00°, 100.00°, 0.00°", rig.record, Lambert(), beyond)
    path.write_text(changed("range_deg = [0, 90]", "range_deg = [0, 60]"))
    with pytest.raises(SimrigError, match=r"reaches theta_i 0 to 60°, .*: lower theta_max"):
        make_rig(path).measure(Lambert(), PLAN)


def test_an_offset_of_an_axis_moves_every_sample_alike() -> None:
    description = described(with_key("axis", "offset_deg", 0.4))
    rig = rig_of(description)
    angles = np.radians(np.random.default_rng(3).uniform(5.0, 60.0, (400, 4)))
    moved = np.degrees(positioning_errors(angles, rig.instrument))  # type: ignore[attr-defined]
    np.testing.assert_allclose(moved.mean(axis=0), [0.0, 0.4, 0.0, 0.0], atol=0.005)
    assert np.abs(moved - [0.0, 0.4, 0.0, 0.0]).max() <= 0.03
    material, plan, allowed = kurt_material("yellow_satin"), Directions(angles), 1e9
    moving = Overrides(enable=("positioning",))
    ideal = Gonioreflectometer().measure(material, plan).values
    changes, bounds = [], []
    for one in (Gonioreflectometer(), rig):
        planned = one.planned(material, plan, Tolerance("relative", allowed), moving)
        bounds.append(planned.effect_plan.decision("positioning").bound.value)  # type: ignore[union-attr]
        change = np.abs(planned.measure(material, plan).values - ideal)
        changes.append(change.sum() / ideal.sum())
    assert changes[1] > 2.0 * changes[0] and np.all(np.array(changes) <= bounds)


def test_the_stated_uncertainty_is_that_of_the_noise() -> None:
    """Residuals over the stated standard uncertainty have a standard deviation of 1."""
    angles = np.radians(np.random.default_rng(4).uniform(0.0, 75.0, (4000, 4)))
    material = Lambert((0.5, 0.3, 0.1))
    for effects in (("noise",), ("noise", "quantisation")):
        found = Gonioreflectometer(effects=effects).measure(material, Directions(angles))
        ideal = Gonioreflectometer().measure(material, Directions(angles))
        assert ideal.uncertainty is None and found.uncertainty is not None
        pull = (found.values - ideal.values) / found.uncertainty
        assert pull.std() == pytest.approx(1.0, abs=0.03) and abs(pull.mean()) < 0.03
        assert found.cost.bytes == len(found) * 10 * 8


@pytest.mark.usefixtures("in_empty_folder")
def test_a_users_own_file_is_measured_with_at_the_command_line() -> None:
    Path("mine.toml").write_text(
        changed("per_sample_s = 8.35454661173902", "per_sample_s = 100").replace(
            "UTIA gonioreflectometer", "mine"
        )
    )
    small = ("-n", "300", "--theta-step", "40", "--azimuth-step", "120", "-o", "m.h5")
    found = done("measure", "wood01", "--rig", "mine.toml", *small)
    assert found["cost"]["hardware_seconds"] == pytest.approx((9107.159156594238 + 30_000) * 1.1)
    assert found["provenance"]["instrument"]["name"] == "mine"
    Path("bad.toml").write_text(changed("bits = 14", "bitts = 14"))
    said = refusal("measure", "wood01", "--rig", "bad.toml", *small, "--overwrite")
    assert "'bad.toml': unknown key in [camera] 'bitts': did you mean 'bits'?" in said
    pareto = ("pareto", "wood01", "--method", "slices", "--samples", "100")
    assert "bad.toml" in refusal(*pareto, "--rig", "bad.toml")
    assert "two rigs are of kind" in refusal(*pareto, "--rig", "utia", "--rig", "mine.toml")
    assert "none of the methods" in refusal(*pareto, "--rig", "gantry")


@pytest.mark.slow
@pytest.mark.usefixtures("in_empty_folder")
def test_a_users_own_file_is_measured_with_in_experiments_and_studies() -> None:
    from simrig.evaluation.experiment.config import Experiment
    from simrig.evaluation.studies.pareto import study

    Path("mine.toml").write_text(changed("per_sample_s = 8.35454661173902", "per_sample_s = 100"))
    Path("e.toml").write_text('material = "wood01"\n[measurement]\nrig = "mine.toml"\n')
    read = Experiment.from_toml("e.toml")
    assert make_rig(read.measurement.rig).timing.per_sample == 100.0  # type: ignore[attr-defined]
    config = study.configuration(["wood01"], ["slices"], [100], ["mine.toml"], "dE=1")
    config |= {"directions": 2000, "grid_step_deg": 10.0, "pixels": 16}
    cell = {"material": "wood01", "method": "slices", "wished": 100}
    (row,) = study.run_cell(config, cell)
    assert row["hardware_hours"] == pytest.approx((9107.159156594238 + 10_000) * 1.1 / 3600.0)
    Path("e.toml").write_text('material = "wood01"\n[measurement]\nrig = "none.toml"\n')
    refused("there is no file", Experiment.from_toml, "e.toml")

"""Plans, rigs and the one measurement: a plan of one's own, and files of version 0.1."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

import h5py
import numpy as np
import pytest

from command_line import done, refusal, simrig
from refusals import refused
from simrig.brdf import Lambert, kurt_material
from simrig.core.errors import SimrigError
from simrig.core.options import Option
from simrig.files import hdf5
from simrig.methods import METHODS, method_for
from simrig.plans.along_slices import SlicePlan, slice_samples
from simrig.plans.listed import Directions, read_pairs
from simrig.plans.placement import SlicePlacement, SubspacePlacement
from simrig.plans.protocol import Batches, Plan, Recorded
from simrig.plans.registry import PLANS, make_plan, restored_plan
from simrig.rigs.direct.gonioreflectometer import Gonioreflectometer
from simrig.rigs.gantry.rig import Gantry
from simrig.rigs.measurements.measurement import Measurement
from simrig.rigs.registry import make_rig

RIG = Gonioreflectometer()
PLAN_OPTIONS: dict[str, dict[str, object]] = {
    "directions": {"pairs": "pairs.txt"},
    "tailored": {"axes": "30,120"},
    "tailored-slices": {"axes": "30", "samples": 700},
    "subspace": {"azimuths": 24},
    "minimal": {"database": "mine", "samples": 24},
    "template": {"database": "mine", "samples": 150},
    "large-sample": {"centres": "2", "spacing_mm": 138.0, "oblique_azimuths": 2},
}
RIGS_OF = {"large-sample": "utia-large"}  # plans that the sample of 30 mm is too small for
QUICK_PLANS = [name for name in PLANS if name != "auto"]  # it has tests of its own


@dataclass(frozen=True)
class TwoStages(Plan):
    """A pilot, then as many samples as asked for where it was brightest."""

    name: ClassVar[str] = "two-stages"
    about: ClassVar[str] = "a pilot, then more around its brightest sample"
    adaptive: ClassVar[bool] = True
    options: ClassVar[tuple[Option, ...]] = (
        Option("more", int, "In the second stage.", 20, least=1, most=1000),
    )

    more: int = 20
    theta_max: float = 1.2

    @classmethod
    def for_material(cls, material=None, *, more: int = 20):  # type: ignore[override]
        return cls(more)

    @property
    def samples(self) -> int:  # type: ignore[override]
        return 30 + self.more

    def describe(self) -> str:
        return f"two stages, {self.more} in the second"

    def batches(self) -> Batches:
        rng = np.random.default_rng(1)
        pilot = rng.uniform(0.0, 1.1, (30, 4))
        recorded = yield pilot
        best = pilot[np.argmax(recorded.values.mean(axis=1))]
        yield np.clip(best + rng.normal(0.0, 0.05, (self.more, 4)), 0.0, 1.2)
        return {"brightest": best}


def test_a_plan_of_ones_own_is_an_addition(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, in_empty_folder: None
) -> None:
    monkeypatch.setitem(PLANS, TwoStages.name, TwoStages)
    satin = kurt_material("yellow_satin")
    whole = RIG.measure(satin, TwoStages())
    assert len(whole) == 50 and whole.layout["brightest"].shape == (4,)
    whole.save(tmp_path / "m.h5")
    again = Measurement.load(tmp_path / "m.h5")
    assert again.plan == TwoStages()
    np.testing.assert_array_equal(again.layout["brightest"], whole.layout["brightest"])
    assert "--more" in simrig("measure", "--help").output
    found = done("measure", "yellow_satin", "--plan", "two-stages", "--more", "7", "-o", "a.h5")
    assert (found["plan"], found["cost"]["samples"]) == ("two-stages", 37)
    spline = ("--method", "rbf-global", "--step", "30")
    assert done("reconstruct", "a.h5", "-o", "b.h5", *spline)["samples"] == 37
    assert "from 1 to 1000" in refusal(
        "measure", "wood01", "--plan", "two-stages", "--more", "0", "-o", "c.h5"
    )
    monkeypatch.delitem(PLANS, TwoStages.name)
    refused("unknown plan 'two-stages'", Measurement.load, tmp_path / "m.h5")


@pytest.mark.parametrize("name", QUICK_PLANS)
def test_every_plan_is_measured_saved_and_restored(
    name: str, tmp_path: Path, in_empty_folder: None, small_database: Path
) -> None:
    Path("mine").symlink_to(small_database)
    Path("pairs.txt").write_text("10 20 30 40\n1, 2; 3 4  # a comment\n\n0 0 0 0\n")
    material = kurt_material("wood01")
    plan = make_plan(name, material, **PLAN_OPTIONS.get(name, {}))
    rig = make_rig(RIGS_OF[name]) if name in RIGS_OF else RIG
    measured = rig.measure(material, plan)
    assert 0 < len(measured) == measured.cost.samples <= plan.samples
    assert measured.angles[:, :2].max() <= plan.theta_max + 1e-9
    measured.save(tmp_path / "m.h5")
    again = Measurement.load(tmp_path / "m.h5")
    assert type(again.plan) is type(plan) and again.plan.settings() == plan.settings()
    assert again.plan.describe() == plan.describe()
    assert again.provenance == measured.provenance
    assert method_for(again) is METHODS[method_for(measured).name]
    probed = rig.measure(material, plan.probe(100))
    assert 0 < len(probed) <= max(len(measured), 700)


@pytest.mark.parametrize("name", QUICK_PLANS)
def test_a_plan_sent_the_same_values_asks_the_same(
    name: str, in_empty_folder: None, small_database: Path
) -> None:
    """What a checkpoint relies on."""
    Path("mine").symlink_to(small_database)
    Path("pairs.txt").write_text("10 20 30 40\n")
    plan = make_plan(name, **PLAN_OPTIONS.get(name, {}))
    asked: list[list[np.ndarray]] = []
    for _ in range(2):
        work, recorded, own = plan.batches(), None, []
        while True:
            try:
                angles = work.send(recorded)  # type: ignore[arg-type]
            except StopIteration:
                break
            assert angles.shape == (len(angles), 4) and len(angles) > 0
            own.append(angles)
            bright = np.exp(np.sin(5.0 * angles).sum(axis=1))
            recorded = Recorded(np.repeat(bright[:, None], 3, axis=1))
        asked.append(own)
    assert len(asked[0]) == len(asked[1])
    assert all(np.array_equal(*pair) for pair in zip(*asked, strict=True))


def test_uncertainties_are_saved_and_resumed(tmp_path: Path) -> None:
    rig = Gonioreflectometer(effects=("noise",))
    plan = make_plan("uniform", samples=2000)
    whole = rig.measure(kurt_material("wood01"), plan)

    def stop(done: int, total: int) -> None:
        if done > 600:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        rig.measure(kurt_material("wood01"), plan, checkpoint=tmp_path / "kept", progress=stop)
    again = rig.measure(kurt_material("wood01"), plan, checkpoint=tmp_path / "kept")
    again.save(tmp_path / "m.h5")
    loaded = Measurement.load(tmp_path / "m.h5")
    assert whole.uncertainty is not None and loaded.uncertainty is not None
    np.testing.assert_array_equal(loaded.uncertainty, whole.uncertainty)
    with h5py.File(tmp_path / "m.h5", "r+") as file:
        file["uncertainty"][3, 1] = -1.0
    refused("negative, infinite or NaN uncertainties", Measurement.load, tmp_path / "m.h5")


def test_a_subspace_is_measured_like_everything_else(tmp_path: Path) -> None:
    where = SubspacePlacement(*np.radians([30.0, 60.0, 60.0]).tolist())
    measured = RIG.measure(kurt_material("wood01"), SlicePlan(where, 200, "axial-diagonal"))
    measured.save(tmp_path / "m.h5")
    again = Measurement.load(tmp_path / "m.h5")
    assert again.plan == measured.plan
    np.testing.assert_array_equal(
        slice_samples(again).knots.first, slice_samples(measured).knots.first
    )
    refused("in one subspace alone", METHODS["slices"].reconstruct, again)


def test_lists_of_pairs(tmp_path: Path) -> None:
    path = tmp_path / "p.txt"
    path.write_text("# theta_i theta_v phi_i phi_v\n10 20 30 40\n1,2,3,4\n5;6;7;8 # here\n")
    np.testing.assert_allclose(
        np.degrees(read_pairs(path)), [[10, 20, 30, 40], [1, 2, 3, 4], [5, 6, 7, 8]]
    )
    for text in ("", "1 2 3\n", "1 2 3 4\n1 2 3\n", "a b c d\n", "\0\0\0\0"):
        path.write_text(text)
        refused("is no list of pairs", read_pairs, path)
    for text in ("1 2 nan 4\n", "90 1 2 3\n", "-1 1 2 3\n", "1 2 inf 4\n"):
        path.write_text(text)
        with pytest.raises(SimrigError, match=r"finite directions with polar angles in \[0, 90\)"):
            Directions.for_material(pairs=path)
    path.write_bytes(b"\xff\xfe 1 2 3")
    refused("is no list of pairs", read_pairs, path)


# --- files of version 0.1 ------------------------------------------------------------------------


def slices_of_0_1(file: h5py.File, measured: Measurement) -> None:
    settings = measured.plan.settings()
    for then, now in (("elevation_step", "theta_step"), ("azimuth_step", "azimuth_step")):
        file.attrs[then] = settings[now]
    file.attrs["theta_max"] = settings["theta_max"]
    file.attrs["slice_types"] = settings["slice_types"].replace("-", "_")
    for name, array in measured.layout.items():
        hdf5.write_array(file, name, array)


def gantry_of_0_1(file: h5py.File, measured: Measurement) -> None:
    settings = measured.plan.settings()
    settings["elevations"] = settings.pop("thetas")
    file.attrs["plan"] = json.dumps(settings)


@pytest.mark.parametrize(
    ("content", "measure", "more"),
    [
        (
            "measurement",
            lambda m: RIG.measure(
                m, SlicePlan(SlicePlacement.from_degrees(28, 60), 700, "axial-diagonal", k=0.7)
            ),
            slices_of_0_1,
        ),
        (
            "measurement of directions",
            lambda m: RIG.measure(m, make_plan("uniform", m, samples=435)),
            lambda file, measured: None,
        ),
        ("gantry measurement", lambda m: Gantry().measure(m), gantry_of_0_1),
    ],
)
def test_files_of_version_0_1_still_open(
    content: str, measure: Callable, more: Callable, tmp_path: Path, in_empty_folder: None
) -> None:
    measured = measure(kurt_material("wood01"))
    parameters = {key: value for key, value in measured.plan.settings().items() if key in "kp_1p_2"}
    about = {"plan": measured.plan.describe(), "parameters": parameters}
    with hdf5.create("old.h5", content, about) as file:
        file.attrs["material"] = measured.material
        file.attrs["cost"] = json.dumps(measured.cost.as_dict())
        hdf5.write_array(file, "angles", measured.angles, "radian")
        hdf5.write_array(file, "values", measured.values, "1/sr")
        more(file, measured)
    again = Measurement.load("old.h5")
    np.testing.assert_array_equal(again.values, measured.values)
    assert again.cost == measured.cost
    assert method_for(again) is method_for(measured)
    if content != "measurement of directions":
        assert again.plan == measured.plan
    made = method_for(again).reconstruct(again).brdf.data()
    for name, array in method_for(measured).reconstruct(measured).brdf.data().items():
        np.testing.assert_array_equal(made[name], array)
    assert done("reconstruct", "old.h5", "-o", "r.h5")["samples"] == len(measured)


def test_measurements_that_cannot_be_are_refused(in_empty_folder: None) -> None:
    measured = RIG.measure(Lambert(), make_plan("uniform", samples=435))
    refused("uncertainties", replace, measured, uncertainty=np.full((435, 3), np.inf))
    refused(r"uncertainties \(435, 3\)", replace, measured, uncertainty=np.ones((434, 3)))
    refused("unknown plan", restored_plan, "nothing", {}, measured.angles)
    refused("--samples must be a whole number of at least 1", make_plan, "uniform", samples=0)
    refused("--samples must be a whole number", make_plan, "uniform", samples=True)
    refused("from 0 to 90 degrees, got nan", make_plan, "slices", theta_max_deg=float("nan"))
    refused("together", make_plan, "slices", theta_step_deg=10.0)

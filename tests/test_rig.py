"""The gonioreflectometer: reach, time, interruption, files."""

import json
import shutil
import subprocess
import sys
import time
from pathlib import Path

import h5py
import numpy as np
import pytest

from refusals import refused
from simrig.brdf import Lambert
from simrig.core.errors import SimrigError
from simrig.plans.along_slices import SlicePlan
from simrig.plans.placement import SlicePlacement
from simrig.reconstruction.slices.tables import reconstruct
from simrig.rigs.direct.gonioreflectometer import Gonioreflectometer
from simrig.rigs.measurements.measurement import Measurement

RIG = Gonioreflectometer()


def test_a_published_time_follows_from_the_other_two():
    """The timing is a line fitted to all three, so each is held against the line without it."""
    hours = {6561: 18.0, 8911: 25.0 / 1.1, 18721: 51.0 / 1.1}
    for left_out, published in hours.items():
        others = [(n, h) for n, h in hours.items() if n != left_out]
        slope, start = np.polyfit(*np.array(others).T, 1)
        predicted = start + slope * left_out
        assert predicted == pytest.approx(published, rel=0.1)
        ours = RIG.timing.seconds(left_out, adaptive=False) / 3600
        assert min(predicted, published) * 0.99 < ours < max(predicted, published) * 1.01


def test_timing_is_the_line_through_the_published_hours():
    published = [(6561, 18.0), (8911, 25.0 / 1.1), (18721, 51.0 / 1.1)]  # adaptive ones 10 % longer
    n, seconds = np.array([(samples, 3600.0 * hours) for samples, hours in published]).T
    matrix = np.stack([1.0 / seconds, n / seconds], axis=1)
    line = np.linalg.lstsq(matrix, np.ones(3), rcond=None)[0]
    timing = RIG.timing
    np.testing.assert_allclose([timing.set_up, timing.per_sample], line, rtol=1e-12)
    assert timing.seconds(8911, True) / timing.seconds(8911, False) == pytest.approx(1.1)


def test_thetas_out_of_reach_are_refused():
    with pytest.raises(SimrigError, match=r"\[0, 90\) degrees, got 90"):
        RIG.record(Lambert(), np.radians([[90.0, 10.0, 0.0, 0.0]]))
    limited = Lambert()
    limited.theta_max = np.radians(60.0)
    with pytest.raises(SimrigError, match="data up to theta = 60"):
        RIG.measure(limited, SlicePlan(SlicePlacement.from_degrees(14, 36), 4000))


def test_negative_material_is_refused():
    class Negative(Lambert):
        def look_up(self, wi, wv, tables):
            return -super().look_up(wi, wv, tables)

    with pytest.raises(SimrigError, match="negative or not finite at theta_i"):
        RIG.measure(Negative(), SlicePlan(SlicePlacement.from_degrees(28, 180), 100))


def test_interrupted_measurement_resumes_to_the_same_result(tmp_path: Path, measured):
    whole = measured(samples=2000)
    checkpoint = tmp_path / "unfinished.h5"

    def interrupt(done, total):
        if done > 1200:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        measured(samples=2000, checkpoint=checkpoint, progress=interrupt)
    kept = [np.load(piece)["values"] for piece in checkpoint.glob("*.npz")]
    assert 512 <= sum(map(len, kept)) < 2000
    counted = []
    resumed = measured(
        samples=2000, checkpoint=checkpoint, progress=lambda done, total: counted.append(done)
    )
    assert counted[0] > 600 and counted[-1] == 2000
    np.testing.assert_array_equal(resumed.values, whole.values)
    np.testing.assert_array_equal(resumed.angles, whole.angles)
    assert not checkpoint.exists()


SLOW_MEASUREMENT = """
import sys, time
from pathlib import Path
from simrig.brdf import kurt_material
from simrig.rigs.direct.gonioreflectometer import Gonioreflectometer
from simrig.plans.along_slices import SlicePlan
from simrig.plans.placement import SlicePlacement

plan = SlicePlan(SlicePlacement.from_degrees(20, 60), 2272)
Gonioreflectometer().measure(
    kurt_material("fabric112"), plan, checkpoint=Path(sys.argv[1]),
    progress=lambda done, total: time.sleep(0.0 if done < 1000 else 60.0),
)
"""


def test_killed_measurement_resumes_to_the_same_result(tmp_path: Path, measured):
    checkpoint = tmp_path / "unfinished.h5"
    process = subprocess.Popen([sys.executable, "-c", SLOW_MEASUREMENT, str(checkpoint)])
    try:
        deadline = time.monotonic() + 60.0
        while not list(checkpoint.glob("*.npz")) and time.monotonic() < deadline:
            time.sleep(0.02)
    finally:
        process.kill()
        process.wait()
    kept = [np.load(piece)["values"] for piece in checkpoint.glob("*.npz")]
    assert 0 < sum(map(len, kept)) < 2272
    resumed = measured(checkpoint=checkpoint)
    np.testing.assert_array_equal(resumed.values, measured().values)
    assert [p.name for p in tmp_path.iterdir() if not p.name.startswith(".")] == []


def test_checkpoint_of_another_measurement_is_refused(tmp_path: Path, measured):
    checkpoint = tmp_path / "unfinished.h5"

    def interrupt(done, total):
        if done > 800:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        measured(samples=2000, checkpoint=checkpoint, progress=interrupt)
    for change in ({"samples": 2001}, {"name": "fabric135"}, {"k": 0.8}):
        with pytest.raises(SimrigError, match="unfinished part of another job, with"):
            measured(**({"samples": 2000} | change), checkpoint=checkpoint)
    shutil.rmtree(checkpoint)
    checkpoint.write_bytes(b"a checkpoint of version 0.1 was a file")
    refused("cannot be continued: remove it", measured, samples=2000, checkpoint=checkpoint)


def test_measurement_survives_saving(tmp_path: Path, measured):
    found = measured(samples=700)
    path = tmp_path / "m.h5"
    found.save(path)
    loaded = Measurement.load(path)
    np.testing.assert_array_equal(loaded.values, found.values)
    assert loaded.plan.placement == found.plan.placement and loaded.cost == found.cost
    assert loaded.provenance == found.provenance
    again = reconstruct(loaded)
    for key, value in reconstruct(found).data().items():
        np.testing.assert_array_equal(again.data()[key], value)


def change_plan(file: h5py.File, **settings) -> None:
    plan = json.loads(file.attrs["plan"])
    plan["settings"].update(settings)
    file.attrs["plan"] = json.dumps(plan)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda f: f.attrs.__setitem__("format_version", 99), "format version 99"),
        (lambda f: f.attrs.__setitem__("content", "holiday pictures"), "expected a measurement"),
        (lambda f: f.__delitem__("values"), "damaged"),
        (lambda f: f["values"].__setitem__(3, np.nan), "NaN"),
        (lambda f: f["layout/knot_sample"].__setitem__(0, 10**9), "do not fit"),
        (lambda f: f["layout/knot_position"].__setitem__(1, 0.0), "do not ascend"),
        (lambda f: f["layout/knot_position"].__setitem__(slice(1, 3), np.inf), "do not ascend"),
        (lambda f: change_plan(f, azimuth_step=0.3), "divide 360"),
        (lambda f: change_plan(f, theta_step="wide"), "malformed"),
        (lambda f: change_plan(f, nonsense=1), "malformed"),
        (lambda f: f.attrs.__setitem__("plan", "[" * 100_000), "malformed"),
        (lambda f: f.attrs.__setitem__("plan", '{"name": "slises"}'), "malformed"),
        (lambda f: f.__delitem__("layout"), "damaged"),
    ],
)
def test_damaged_measurements_are_refused(tmp_path: Path, change, message, measured):
    path = tmp_path / "m.h5"
    measured(samples=700).save(path)
    with h5py.File(path, "r+") as file:
        change(file)
    refused(message, Measurement.load, path)


def test_truncated_measurement_is_refused(tmp_path: Path, measured):
    path = tmp_path / "m.h5"
    measured(samples=700).save(path)
    path.write_bytes(path.read_bytes()[:5000])
    refused("damaged", Measurement.load, path)

"""BTFs that change with time (thesis appendix E), and the materials that do."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from command_line import done, refusal
from refusals import refused
from simrig.btf.stack import BtfStack
from simrig.btf.synthetic import bumps
from simrig.btf.varying import METHODS, VaryingBtf
from simrig.files.btf.hdf5 import write_btf
from simrig.files.btf.sequence import read_sequence, write_sequence
from simrig.mesostructure import build_tile
from simrig.mesostructure.changes import CHANGES


def front(time: float, side: int = 48) -> BtfStack:
    """Return a dark disc on a bright tile, whose radius shrinks evenly from 20 texels to 0."""
    y, x = np.mgrid[:side, :side] - 0.5 * (side - 1)
    shown = np.where(np.hypot(x, y) < 20.0 * (1.0 - time), 0.1, 0.3)
    texture = 1.0 + 0.1 * np.sin(x * 1.3) * np.cos(y * 0.9)
    angles = np.radians([[30.0, 0, 0, 0], [60.0, 30, 0, 90]])
    values = np.repeat((shown * texture)[None, ..., None], 3, axis=-1).repeat(2, axis=0)
    return BtfStack(values.astype(np.float32), angles, (5.0, 5.0), f"front {time}")


@pytest.mark.parametrize("method", METHODS)
def test_measured_times_come_back_and_others_lie_between(method: str) -> None:
    times = (0.0, 0.4, 1.0)
    btf = VaryingBtf(times, [front(t) for t in times])
    for time, stack in zip(times, btf.stacks, strict=True):
        assert np.array_equal(btf.at(time, method).values, stack.values)
        beside = np.asarray(btf.at(min(time + 1e-7, 1.0), method).values)
        assert np.abs(beside - stack.values).mean() < 0.01
    between = np.asarray(btf.at(0.7, method).values)
    assert np.isfinite(between).all() and between.min() >= 0.0
    whole = [np.asarray(btf.stacks[k].values).mean() for k in (1, 2)]
    assert min(whole) - 0.01 < between.mean() < max(whole) + 0.01


def test_fronts_move_where_texels_tell_their_moment() -> None:
    """At a left-out time the space-time factorisation has the front, a blend has two faint ones."""
    btf = VaryingBtf((0.0, 0.4, 1.0), [front(t) for t in (0.0, 0.4, 1.0)])
    for time in (0.2, 0.7):
        truth = np.asarray(front(time).values)
        error = {m: float(np.sqrt(np.mean((np.asarray(btf.at(time, m).values) - truth) ** 2)))
                 for m in ("linear", "staf")}  # fmt: skip
        assert error["staf"] < 0.85 * error["linear"]


def test_what_cannot_be_interpolated_is_refused() -> None:
    one, other = front(0.0), front(1.0, side=32)
    refused("must ascend", VaryingBtf, (1.0, 1.0), [one, one])
    refused("must ascend", VaryingBtf, (0.0, np.nan), [one, one])
    refused("two times or more", VaryingBtf, (0.0,), [one])
    refused("differ in pairs, texels or size", VaryingBtf, (0.0, 1.0), [one, other])
    btf = VaryingBtf((0.0, 1.0), [one, front(1.0)])
    refused("from 0 to 1, asked for is 2", btf.at, 2.0)
    refused("asked for is nan", btf.at, np.nan)
    refused("linear", btf.at, 0.5, "cubic")


@pytest.mark.parametrize("change", CHANGES)
def test_materials_change_from_what_they_were(change: str) -> None:
    before, after = (build_tile(f"leather_tan+{change}@{t}", resolution=32) for t in ("0", "1"))
    still = build_tile("leather_tan", resolution=32)
    colours = [np.concatenate([p.colours for p in t.parts]).mean() for t in (still, before, after)]
    dry = 2 if change == "drying" else 1
    assert colours[dry] == pytest.approx(colours[0], abs=0.02)
    assert abs(colours[1] - colours[2]) > 0.01
    assert sum(len(part.faces) for part in before.parts) == still.triangles
    half = build_tile(f"leather_tan+{change}@0.5", resolution=32)
    assert half.name == f"leather_tan+{change}@0.5" and half.origin["change"] == change
    refused("goes from 0 to 1", build_tile, f"leather_tan+{change}@2", resolution=32)
    refused("says no time", build_tile, f"leather_tan+{change}", resolution=32)
    refused("change", build_tile, "leather_tan+melting@0.5", resolution=32)


def test_simrig_btf_has_a_time(tmp_path: Path) -> None:
    import mitsuba as mi

    from simrig.core import backend
    from simrig.plugins.make import one_line_errors

    dark, bright = bumps(resolution=(8, 8)), bumps(resolution=(8, 8))
    bright = BtfStack(2.0 * bright.values, bright.angles, bright.size_mm, "bright")
    for name, stack in (("a.h5", dark), ("b.h5", bright)):
        write_btf(tmp_path / name, stack)
    path = tmp_path / "s.toml"
    write_sequence(path, [(0.0, tmp_path / "a.h5"), (10.0, tmp_path / "b.h5")], "glow")
    assert 'file = "a.h5"' in path.read_text()
    assert read_sequence(path).times == (0.0, 10.0)
    backend.select("auto")

    def value(**more: object) -> float:
        with one_line_errors():
            bsdf = mi.load_dict({"type": "simrig_btf", "filename": str(path), "scale": 8.0, **more})
        si = mi.SurfaceInteraction3f()
        si.wi, si.uv, si.t = mi.Vector3f(0, 0, 1), mi.Point2f(0.3, 0.3), 1.0
        shown = bsdf.eval(mi.BSDFContext(), si, mi.Vector3f(0.1, 0, 0.995))
        return float(np.ravel(shown)[0])

    base = value(time=0.0)
    assert value(time=5.0) == pytest.approx(1.5 * base, rel=1e-3)
    assert value(time=2.5, interpolation="staf") == pytest.approx(1.25 * base, rel=0.3)
    refused("'time' is missing", value)
    refused("asked for is 11", value, time=11.0)
    at = ("btf", "at", str(path), str(tmp_path / "m.h5"))
    assert done(*at, "--time", "5")["images"] == len(dark)
    assert "exists" in refusal(*at, "--time", "5")
    sequence = ("btf", "sequence", str(tmp_path / "t.toml"))
    assert "TIME:FILE" in refusal(*sequence, "wet.h5")
    assert "must ascend" in refusal(*sequence, f"1:{tmp_path / 'a.h5'}", f"0:{tmp_path / 'b.h5'}")
    assert not (tmp_path / "t.toml").exists()
    path.write_text("[[frame]]\ntime = true\nfile = 'a.h5'\n")
    refused("'time' and a 'file'", read_sequence, path)


def test_the_study_compares_at_times_left_out(tmp_path: Path) -> None:
    from simrig.evaluation.studies import STUDIES

    study = STUDIES["time-varying"]
    config = {**study.presets["quick"], "texels": 12, "spp": 1, "left_out": [0.25]}
    cell = study.cells(config)[0]
    rows = [{**cell, **row} for row in study.run_cell(config, cell)]
    summary = study.summarise(config, rows)
    assert [row["method"] for row in summary["rows"]] == list(METHODS)
    assert all(row["delta_e"] > 0.0 and row["psnr"] > 10.0 for row in summary["rows"])
    assert all(path.is_file() for path in study.plots(summary, rows, tmp_path))

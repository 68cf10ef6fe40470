"""Trap scenes: none is broken in silence, and a planner that is wrong is told so by the study."""

from __future__ import annotations

from pathlib import Path

import mitsuba as mi
import numpy as np
import pytest
from rich.console import Console

from simrig.core import backend
from simrig.core.effects import Bound
from simrig.evaluation.studies import STUDIES, traps
from simrig.evaluation.studies.engine.run import run_study
from simrig.planning import effects, planner
from simrig.planning.light_tracing import trace_light
from simrig.planning.view import View
from simrig.scenes.traps import TRAPS


@pytest.mark.parametrize("name", TRAPS)
def test_a_trap_is_a_scene_in_which_something_is_lit(name: str) -> None:
    backend.select("llvm_ad_spectral" if TRAPS[name].spectral else "auto")
    loaded = mi.load_dict(TRAPS[name].build())
    integrator = mi.load_dict({"type": TRAPS[name].converges, "max_depth": -1})
    picture = np.array(mi.render(loaded, integrator=integrator, spp=4))
    assert np.isfinite(picture).all() and picture.max() > 0.0


def test_particles_are_not_asked_under_a_map() -> None:
    """Those of Mitsuba carry another amount of light than the map sends."""
    sky, even = (View(mi.load_dict(TRAPS[n].build())) for n in ("sun_in_a_map", "nested_glass"))
    assert trace_light(sky, 1) is None and trace_light(even, 1) is not None


def run(folder: Path, scenes: list[str]) -> dict:
    config = {**traps.PRESETS["quick"], "scenes": scenes}
    return dict(run_study(STUDIES["traps"], config, folder).summary)


@pytest.mark.slow
def test_the_study_judges_a_planner_that_is_right_and_one_that_is_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    names = ["leaves", "hot_texel", "bumps", "tiny"]
    right = run(tmp_path / "right", names)
    assert right["summary"][traps.KEPT] == len(names), [r["verdict"] for r in right["rows"]]
    console = Console(width=200)
    with console.capture() as shown:
        console.print(traps.table(right))
    assert "0 broken" in shown.get()
    monkeypatch.setattr(effects.InterReflection, "bound", lambda *_: Bound(0.0, "dE", "planted"))
    monkeypatch.setattr(planner, "why_unlooked", lambda *_: "")
    monkeypatch.setattr(planner, "quicker_with_everything", lambda *_: False)
    found = run(tmp_path / "wrong", ["bright_corner"])
    (row,) = found["rows"]
    assert row["off"], "the planted defect changes nothing: no test"
    assert row["spoke"] and row["switched_on"] == ["inter-reflection"]
    assert found["summary"]["spoke_rightly"] == 1 and row["verdict"] == traps.KEPT

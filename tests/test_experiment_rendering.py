"""Pictures of experiments: planned alike, so that they differ by the material only."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from simrig.brdf import Lambert, kurt_material
from simrig.brdf.tables.resample import resample_dense
from simrig.evaluation.experiment.checkpoint import Parts, Steps
from simrig.evaluation.experiment.config import Experiment, RenderingSettings, SceneSettings
from simrig.evaluation.experiment.plans import experiment_scene
from simrig.evaluation.experiment.scenes import SceneRenderer
from simrig.evaluation.metrics.images import delta_e_map, foreground_mask
from simrig.plugins.importance_sampling import sample_alike
from simrig.rendering.render import render


def renderer(tmp_path: Path, rendering: RenderingSettings) -> SceneRenderer:
    """Return where the pictures of a small sphere are made."""
    scene = SceneSettings("sphere", {"resolution": 16})
    config = Experiment(material="fabric112", rendering=rendering, scenes=(scene,))
    (tmp_path / "pictures" / "sphere").mkdir(parents=True)
    return SceneRenderer("sphere", scene, config, tmp_path, Parts(tmp_path, {}), Steps(1, None))


@pytest.mark.usefixtures("variant_llvm")
def test_noise_that_a_plan_allows_is_no_difference(tmp_path: Path) -> None:
    """One plan and the same random numbers: what is reconstructed exactly has no error at all."""
    made = renderer(tmp_path, RenderingSettings(tolerance="dE=10"))
    truth = kurt_material("fabric112")
    reference = made.reference(truth)
    assert reference["plan"]["tolerance"] == "dE=10"
    assert reference["spp"] == reference["plan"]["settings"]["spp"] < 4
    errors = made.reconstruction("same", "the same", truth)["errors"]
    assert errors["delta_e"] == errors["flip"] == 0.0
    assert made.reconstruction("black", "black", Lambert((0.01,) * 3))["errors"]["delta_e"] > 5.0


@pytest.mark.usefixtures("variant_llvm")
def test_effects_of_an_experiment_can_be_decided(tmp_path: Path) -> None:
    forced = renderer(tmp_path / "all", RenderingSettings(everything=True, disable=("shadowing",)))
    plan = forced.reference(Lambert())["plan"]
    on = {entry["effect"]: entry["on"] for entry in plan["effects"]}
    assert on["bsdf-sampling"] and not on["shadowing"] and not on["inter-reflection"]
    unplanned = renderer(tmp_path / "none", RenderingSettings(tolerance="none"))
    reference = unplanned.reference(Lambert())
    assert (reference["plan"], reference["spp"]) == (None, 16)


@pytest.mark.usefixtures("variant_llvm")
def test_noise_of_paths_is_no_difference_either() -> None:
    """Drawn alike, few paths find the difference that many find; drawn apart far too much."""
    truth = kurt_material("fabric002")
    settings = SceneSettings("four_spheres", {"columns": 2, "resolution": 32})
    paths = {"type": "path", "max_depth": 4, "hide_emitters": True}

    def difference(spp: int, alike: bool) -> float:
        reconstructed = resample_dense(truth, np.radians(7.5), 48, np.radians(82.5))
        if alike:
            sample_alike(reconstructed, truth)
        first, second = (
            render(experiment_scene(settings, one), spp, 0, paths).image
            for one in (truth, reconstructed)
        )
        return float(delta_e_map(first, second)[foreground_mask(first, second)].mean())

    converged = difference(2048, True)
    assert difference(2048, False) == pytest.approx(converged, rel=0.1), "both are right"
    assert difference(64, False) > 1.8 * converged
    assert difference(64, True) < 1.4 * converged

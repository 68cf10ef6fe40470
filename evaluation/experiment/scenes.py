"""The pictures of an experiment: the truth and every reconstruction on every scene, compared."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from simrig.brdf.protocol import Brdf
from simrig.evaluation.experiment.checkpoint import Parts, Steps
from simrig.evaluation.experiment.config import Experiment, SceneSettings
from simrig.evaluation.experiment.plans import experiment_scene, plan_experiment_scene
from simrig.evaluation.experiment.rendering import USUAL_SPP
from simrig.evaluation.metrics import images as metrics
from simrig.evaluation.metrics.comparison import compare_images
from simrig.files.images import read_image, write_exr, write_png
from simrig.planning import planned_integrator
from simrig.rendering import render as rendering

TRUTH = "truth"


@dataclass(frozen=True)
class SceneRenderer:
    """Renders one scene with different BRDFs and compares them with the truth.

    Attributes:
        key: name of the scene for files.
        experiment: samples per pixel, exposure, scale of differences, seed.
        parts, steps: what is finished, and who is told.
    """

    key: str
    scene: SceneSettings
    experiment: Experiment
    folder: Path
    parts: Parts
    steps: Steps
    _cache: dict[str, np.ndarray] = field(default_factory=dict)

    def reference(self, truth: Brdf) -> dict[str, Any]:
        """Render the truth; return the record of the scene.

        Returns:
            The scene's name, options, size, exposure, files and cost as plain values.
        """
        name = self._part_name(TRUTH)
        self.steps.begin(f"rendering {self.key}, reference")
        record = self.parts.get(name)
        if record is None:
            settings, plan = self._settings(truth)
            result = self._render(truth, settings)
            self._cache[TRUTH] = result.image
            exposure = self.experiment.rendering.exposure
            if exposure is None:
                exposure = rendering.automatic_exposure(result.image)
            files = self._write(TRUTH, result.image, exposure)
            height, width, _ = result.image.shape
            record = self.parts.put(
                name,
                {
                    "name": self.scene.name,
                    "options": dict(self.scene.options),
                    "width": width,
                    "height": height,
                    "exposure": exposure,
                    "spp": result.spp,
                    "integrator": result.integrator,
                    "settings": settings,
                    "plan": plan,
                    "cost": result.cost.as_dict(),
                    "files": files,
                },
            )
        self.steps.end()
        return record

    def reconstruction(self, key: str, label: str, brdf: Brdf) -> dict[str, Any]:
        """Render a reconstruction and compare it with the reference, which was rendered before.

        Returns:
            The errors, files and cost as plain values.
        """
        name = self._part_name(key)
        self.steps.begin(f"rendering {self.key}, {label}")
        record = self.parts.get(name)
        if record is None:
            reference, about = self._reference_image()
            result = self._render(brdf, about["settings"])
            compared = compare_images(
                reference,
                result.image,
                metrics.foreground_mask(reference, result.image),
                about["exposure"],
                self.experiment.rendering.difference_scale,
            )
            files = self._write(key, result.image, about["exposure"])
            files["difference"] = f"pictures/{self.key}/{key}-difference.png"
            write_png(self.folder / files["difference"], compared.maps.difference)
            errors = compared.to_dict()
            record = self.parts.put(
                name, {"errors": errors, "cost": result.cost.as_dict(), "files": files}
            )
        self.steps.end()
        return record

    def _part_name(self, key: str) -> str:
        return f"picture {self.key} {key}"

    def _reference_image(self) -> tuple[np.ndarray, dict[str, Any]]:
        about = self.parts.get(self._part_name(TRUTH))
        assert about is not None, "the reference is rendered first"
        if TRUTH not in self._cache:
            self._cache[TRUTH] = read_image(self.folder / about["files"]["exr"])
        return self._cache[TRUTH], about

    def _settings(self, truth: Brdf) -> tuple[dict[str, Any], dict[str, Any] | None]:
        """Return how all pictures of the scene are rendered, and the plan that says so.

        One plan, that of the truth, serves all of them with the same random numbers: noise that
        the plan allows is alike in pictures that are compared.
        """
        wanted = self.experiment.rendering
        spp = self.scene.options.get("spp", wanted.spp)
        if not wanted.planned:
            return {"spp": spp or USUAL_SPP, "integrator": None}, None
        plan = plan_experiment_scene(self.experiment, self.scene, truth)
        scene = rendering.load(experiment_scene(self.scene, truth))
        settings = {
            "spp": spp or plan.settings["spp"],
            "integrator": planned_integrator(scene, plan),
        }
        return settings, plan.as_dict()

    def _render(self, brdf: Brdf, settings: dict[str, Any]) -> rendering.RenderResult:
        scene = experiment_scene(self.scene, brdf)
        return rendering.render(
            scene, seed=self.experiment.seed, progress=self.steps.within, **settings
        )

    def _write(self, key: str, image: np.ndarray, exposure: float) -> dict[str, str]:
        """Write a picture as EXR and PNG; return their names relative to the folder."""
        about: dict[str, str | int | float | bool] = {
            "scene": self.key,
            "brdf": key,
            "exposure": exposure,
        }
        files = {kind: f"pictures/{self.key}/{key}.{kind}" for kind in ("exr", "png")}
        write_exr(self.folder / files["exr"], image, about)
        write_png(self.folder / files["png"], image, exposure)
        return files

"""The scene at hand, as the effects ask about it; each answer is computed once, when asked for."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from simrig.effects import Tolerance
from simrig.errors import SimrigError
from simrig.evaluation import rendering
from simrig.evaluation.planning.change import Display
from simrig.evaluation.planning.integrators import direct_integrator
from simrig.evaluation.planning.noise import samples_needed, sampling_change
from simrig.evaluation.planning.occlusion import can_shadow
from simrig.evaluation.planning.probe import SAMPLES, CameraLook, look
from simrig.evaluation.planning.source import SceneSource
from simrig.evaluation.planning.survey import Survey
from simrig.evaluation.planning.transport import MOST_ORDERS, transport


class SceneSubject:
    """A loaded scene with what the planner found out about it.

    Attributes:
        source: where the scene comes from.
        scene: the scene, loaded in the current variant.
        survey: its bodies and lights.
        exposure: of the display; that of ``rendering.display_exposure`` by default.
    """

    def __init__(self, source: SceneSource, exposure: float | None = None) -> None:
        self.source = source
        self.scene = rendering.load(source.build())
        if not self.scene.sensors():
            raise SimrigError("the scene has no camera: add a sensor")
        self.survey = Survey(self.scene)
        self._exposure = exposure

    @property
    def pixels(self) -> int:
        """How many pixels the picture has."""
        return int(np.prod(np.array(self.scene.sensors()[0].film().crop_size())))

    @cached_property
    def direct(self) -> dict[str, Any]:
        """The integrator of direct light, with shadows."""
        return direct_integrator(self.scene)

    @cached_property
    def look(self) -> CameraLook:
        """Some pixels in direct light."""
        return look(self.scene, self.direct, SAMPLES)

    @cached_property
    def exposure(self) -> float:
        """The factor from radiance to displayed values."""
        if self._exposure is not None:
            return self._exposure
        picture = self.look.picture
        return rendering.display_exposure(picture[:, None]) if picture.any() else 1.0

    def display(self, tolerance: Tolerance) -> Display:
        """Return what measures changes of the picture in the unit of a tolerance."""
        return Display(tolerance, self.exposure)

    @cached_property
    def shadows_possible(self) -> bool:
        """Whether anything can stand between a surface and a light."""
        return can_shadow(self.survey)

    @cached_property
    def indirect(self) -> np.ndarray:
        """Bound of what the looked-at pixels gain by order, (MOST_ORDERS, n, 3) radiance."""
        return transport(self.survey, self.direct).seen(self.look, self.survey.bodies)

    def indirect_change(self, tolerance: Tolerance, first: int = 0) -> float:
        """Return the most that leaving out all orders from ``first`` on changes."""
        display = self.display(tolerance)
        picture = self.look.picture
        # the lower orders would only brighten the picture, and so make it less sensitive
        changes = display.worst(picture, self.indirect[first:].sum(axis=0))
        return display.total(changes, picture)

    def orders_needed(self, tolerance: Tolerance, allowed: float) -> int | None:
        """Return after how many indirect orders the rest is allowed to be left out.

        None where even the rest beyond ``MOST_ORDERS`` may change more.
        """
        low, high = 0, MOST_ORDERS
        while low < high:
            middle = (low + high) // 2
            if self.indirect_change(tolerance, middle) <= allowed:
                high = middle
            else:
                low = middle + 1
        return low if low < MOST_ORDERS else None

    def unshadowed_change(self, tolerance: Tolerance) -> float:
        """Return how far the looked-at pixels change when nothing casts a shadow."""
        without = look(self.scene, direct_integrator(self.scene, shadows=False), SAMPLES)
        display = self.display(tolerance)
        before, after = self.look.picture, without.picture
        return display.total(display.per_pixel(before, after), before)

    def black_change(self, tolerance: Tolerance) -> float:
        """Return how far the picture is from a black one."""
        display = self.display(tolerance)
        picture = self.look.picture
        return display.total(display.per_pixel(picture, np.zeros_like(picture)), picture)


class SampledSubject:
    """Pixels as the planned integrator samples them, for the choice of samples per pixel.

    Attributes:
        subject: the scene.
        look: its pixels, sampled by the integrator that renders it.
    """

    def __init__(self, subject: SceneSubject, looked: CameraLook) -> None:
        self.subject = subject
        self.look = looked

    def change(self, tolerance: Tolerance, spp: int) -> float:
        """Return the expected change of a picture with ``spp`` samples per pixel."""
        if self.subject.source.pixel_centres:
            return 0.0
        return sampling_change(self.look.radiance, self.subject.display(tolerance), spp)

    def needed(self, tolerance: Tolerance, allowed: float) -> tuple[int, float]:
        """Return the samples per pixel that keep the change within what is allowed."""
        return samples_needed(self.look.radiance, self.subject.display(tolerance), allowed)

"""How an experiment makes its pictures: planned for a tolerance, or as the scenes say."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from simrig.core.effects import DEFAULT_TOLERANCE, Overrides, parse_tolerance
from simrig.evaluation.experiment.schema import (
    Section,
    flag,
    integer,
    names,
    number,
    optional,
    setting,
    text,
)

UNPLANNED = "none"  # a tolerance; the scenes' own integrators and samples render then
USUAL_SPP = 16  # where nothing is planned


@dataclass(frozen=True)
class RenderingSettings(Section):
    """How pictures are made.

    Attributes:
        tolerance: for which each scene is planned (``dE=0.5``, see
            ``simrig.planning``); ``"none"`` renders it by its own integrator.
        enable, disable, everything: effects that are decided before the planner.
        spp: samples per pixel in place of the planned ones; 16 where nothing is planned.
        exposure: factor before a picture is shown, the same for all pictures of a scene; by
            default what brings the bright parts of the reference near white.
        difference_scale: s of the difference images 255 − s·|I1 − I2|.
    """

    section: ClassVar[str] = "rendering"

    tolerance: str = setting(text, DEFAULT_TOLERANCE)
    enable: tuple[str, ...] = setting(names, ())
    disable: tuple[str, ...] = setting(names, ())
    everything: bool = setting(flag, False)
    spp: int | None = setting(optional(integer(1, 1 << 20), "auto"), None)
    exposure: float | None = setting(optional(number(1e-6, 1e6), "auto"), None)
    difference_scale: float = setting(number(0.1, 255.0), 10.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.planned:
            parse_tolerance(self.tolerance)
        Overrides(self.enable, self.disable, self.everything)

    @property
    def planned(self) -> bool:
        """Whether the scenes are planned."""
        return self.tolerance != UNPLANNED

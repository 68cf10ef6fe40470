"""How long the simulated hardware takes; the numbers are those of instrument files."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from simrig.instruments.description import SampleTiming, SliceTiming


@dataclass(frozen=True)
class GonioreflectometerTiming:
    """Linear model: seconds = (set_up + per_sample · samples) · overhead.

    Attributes:
        set_up: seconds before the first sample.
        per_sample: seconds to position, expose and transfer one sample.
        adaptive_overhead: factor for adaptive plans (processing between the iterations).
    """

    set_up: float
    per_sample: float
    adaptive_overhead: float = 1.0

    @classmethod
    def of(cls, said: SampleTiming) -> GonioreflectometerTiming:
        """Return what an instrument file says."""
        numbers = (said.set_up_s, said.per_sample_s, said.adaptive_overhead)
        return cls(*(number.value for number in numbers))

    def seconds(self, samples: int, adaptive: bool) -> float:
        """Return the simulated duration of a measurement, in seconds."""
        uniform = self.set_up + self.per_sample * samples
        return uniform * (self.adaptive_overhead if adaptive else 1.0)


@dataclass(frozen=True)
class GantryTiming:
    """A gantry records whole slices as video, so time goes by slices and not by samples.

    Cameras at several polar angles record side by side, one light after the other.

    Attributes:
        slice_seconds: one recording, a full turn of the arms.
        change_seconds: between two recordings, on average (lights, gears, camera).
        cameras: how many record at once; None is one at every polar angle.
    """

    slice_seconds: float
    change_seconds: float
    cameras: int | None = 1

    @classmethod
    def of(cls, said: SliceTiming) -> GantryTiming:
        """Return what an instrument file says."""
        cameras = said.cameras if isinstance(said.cameras, int) else None
        return cls(said.slice_s.value, said.change_s.value, cameras)

    def seconds(self, thetas: int, slices_per_subspace: int) -> float:
        """Return the simulated duration at all pairs of polar angles, in seconds."""
        cameras = min(self.cameras or thetas, thetas)
        recordings = thetas * math.ceil(thetas / cameras) * slices_per_subspace
        return recordings * (self.slice_seconds + self.change_seconds)

"""The virtual BTF rig as a ``Rig``: a plan's directions, an image for each."""

from __future__ import annotations

import math
import shutil
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

from simrig.core.cost import Cost, stopwatch
from simrig.core.effects import EffectPlan, Overrides, Tolerance
from simrig.core.errors import SimrigError
from simrig.core.options import Option
from simrig.core.progress import Progress
from simrig.files.checkpoint import kept_bytes
from simrig.instruments.description import BtfDescription, shipped
from simrig.mesostructure import Tile, build_tile
from simrig.plans.listed import Directions, SchemePlan
from simrig.plans.protocol import ListedPlan, Plan, Recorded
from simrig.rigs.btf.orders import ORDERS
from simrig.rigs.measurements.measurement import Measurement
from simrig.rigs.protocol import Rig
from simrig.rigs.timing import GonioreflectometerTiming

if TYPE_CHECKING:
    from simrig.files.btf.recording import BtfRecording

_STEEPEST_DEG = 89.0


def _utia_timing() -> GonioreflectometerTiming:
    return GonioreflectometerTiming.of(shipped("utia-btf").timing)  # type: ignore[attr-defined]


@dataclass(frozen=True)
class BtfRig(Rig):
    """Light and camera far away from a tile: a registered image for each pair of directions.

    A measurement holds the mean of each image and the images themselves (``pictures``).

    Attributes:
        instrument_name: what the instrument is called.
        resolution: texels along x, or (height, width).
        seed: of the tile and of the samples.
        single: store float32 in place of float16.
        bounces: how often light is reflected at most.
        effect_plan: how the bounces were chosen.
    """

    name: ClassVar[str] = "btf"
    about: ClassVar[str] = "light and camera far away: an image of a structure per pair"
    options: ClassVar[tuple[Option, ...]] = (
        Option("resolution", int, "Texels along x.", 128, least=1, most=16384),
        Option("spp", int, "Samples per texel.", 16, least=1, most=4096),
        Option("seed", int, "Of the tile and of the samples.", 0, least=0),
        Option("single", bool, "Store float32 in place of float16.", False),
    )
    effect_names: ClassVar[tuple[str, ...]] = ORDERS
    default_plan: ClassVar[str] = SchemePlan.name
    measures: ClassVar[type] = Tile

    timing: GonioreflectometerTiming = field(default_factory=_utia_timing)
    instrument_name: str = "UTIA gonioreflectometer, images"
    resolution: int | tuple[int, int] = 128
    spp: int = 16
    seed: int = 0
    single: bool = False
    bounces: int = 1
    effect_plan: EffectPlan | None = None

    @classmethod
    def from_description(cls, description: BtfDescription, **options: Any) -> Self:  # type: ignore[override]
        """Return the rig of an instrument file: direct light alone."""
        timing = GonioreflectometerTiming.of(description.timing)
        return cls(timing, description.instrument.name, **options)

    def material(self, source: str | Path) -> Tile:
        """Return the tile of a preset.

        Raises:
            SimrigError: there is none of this name.
        """
        return build_tile(str(source), seed=self.seed)

    def check(self, material: Any, plan: Plan) -> None:
        """Refuse plans whose directions are not known before, steep ones, what ``Rig`` refuses."""
        from simrig.rigs.btf.rig import checked_plan

        super().check(material, plan)
        if not isinstance(plan, ListedPlan):
            raise SimrigError(
                f"a BTF rig needs directions that are known before, not plan '{plan.name}': "
                "use plan 'scheme' or 'directions'"
            )
        checked_plan(plan.angles())

    def reaches(self, angles: np.ndarray) -> np.ndarray:
        """Return which of (n, 4) directions in radians it reaches, (n,) of bool."""
        inside: np.ndarray = np.all(angles[:, :2] <= np.radians(_STEEPEST_DEG), axis=1)
        return inside

    def seconds(self, plan: Plan, angles: np.ndarray) -> float:
        """Return how long the hardware takes for directions of a plan, in seconds."""
        return self.timing.seconds(len(angles), adaptive=plan.adaptive)

    def planned(
        self, material: Any, plan: Plan, tolerance: Tolerance, overrides: Overrides | None = None
    ) -> Self:
        """Return the rig with as many bounces as a tolerance calls for (see ``Rig.planned``)."""
        from simrig.core import backend
        from simrig.rigs.btf.bounces import plan_bounces
        from simrig.rigs.btf.rig import by_view, resolution_of

        self.check(material, plan)
        backend.select("auto")
        chosen = plan_bounces(
            material,
            by_view(plan.angles()),  # type: ignore[attr-defined]
            tolerance,
            overrides,
            resolution=resolution_of(material, self.resolution),
            spp=self.spp,
            seed=self.seed,
        )
        return replace(self, bounces=int(chosen.settings["bounces"]), effect_plan=chosen)

    def instrument_facts(self) -> dict[str, Any]:
        """Return the instrument's name."""
        return {"name": self.instrument_name}

    def record(self, material: Any, angles: np.ndarray) -> Recorded:
        """Return the means of the images at directions (see ``Rig.record``)."""
        from simrig.rigs.btf.rig import view_order

        order = view_order(angles)
        recorded = _recorded(self._recording(material, angles[order], None, None))
        back = np.argsort(order)
        sure = recorded.uncertainty
        return Recorded(recorded.values[back], None if sure is None else sure[back])

    def carry_out(
        self, material: Any, plan: Plan, checkpoint: Path | None, progress: Progress | None
    ) -> tuple[Measurement, BtfRecording]:
        """Record an image for each pair of a plan, view by view (see ``Rig.carry_out``)."""
        from simrig.rigs.btf.rig import by_view

        elapsed = stopwatch()
        angles = by_view(plan.angles())  # type: ignore[attr-defined]
        recording = self._recording(material, angles, checkpoint, progress)
        recorded = _recorded(recording)
        size = recording.layout.bytes
        cost = Cost(
            samples=len(angles),
            hardware_seconds=self.seconds(plan, angles),
            compute_seconds=elapsed(),
            bytes=size,
        )
        about = dict(recording.layout.said)
        if self.effect_plan is not None:
            about["effects"] = self.effect_plan.as_dict()
        made = Measurement(
            recording.layout.angles,
            recorded.values,
            material.name,
            cost,
            replace(plan, listed=angles)
            if isinstance(plan, Directions)
            else Directions(angles, plan.describe()),
            recorded.uncertainty,
            pictures=recording,
            provenance=about,
        )
        return made, recording

    def _recording(
        self,
        tile: Tile,
        angles: np.ndarray,
        checkpoint: Path | None,
        progress: Progress | None,
    ) -> BtfRecording:
        """Record images of pairs that stand view by view."""
        from simrig.core import backend
        from simrig.rigs.btf.rig import btf_layout, record_btf, resolution_of

        shape = resolution_of(tile, self.resolution)
        dtype = np.float32 if self.single else np.float16
        backend.select("auto")
        layout = btf_layout(tile, angles, shape, self.spp, self.bounces, self.seed, dtype)
        if checkpoint is not None:
            _check_room(checkpoint, layout.bytes)
        return record_btf(tile, layout, checkpoint, progress)


def _recorded(recording: BtfRecording) -> Recorded:
    """Return the means of images and their standard uncertainty; texels err independently."""
    from simrig.rigs.btf.rig import STANDARD_ERROR

    error = recording.notes[STANDARD_ERROR] / math.sqrt(math.prod(recording.layout.resolution))
    sure = None if np.isnan(error).any() else np.repeat(error[:, None], 3, axis=1)
    return Recorded(recording.means, sure)


def _check_room(checkpoint: Path, size: int) -> None:
    """Refuse a measurement that the disk has no room for."""
    free = shutil.disk_usage(checkpoint.parent).free + kept_bytes(checkpoint)
    size *= 2  # the images as they come, then the file that is made of them
    if size > free:
        raise SimrigError(
            f"the images and their file take up to {size:,} bytes and '{checkpoint.parent}' has "
            f"{free:,}: ask for fewer directions or a smaller resolution"
        )

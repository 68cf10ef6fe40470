"""A virtual gonioreflectometer at the direct level: f_r is evaluated where the rig would look."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

import simrig
from simrig.brdf.protocol import Brdf
from simrig.core.cost import Cost, stopwatch
from simrig.core.errors import SimrigError
from simrig.directions.schemes import HemisphereScheme
from simrig.instruments.instrument import UTIA, Instrument
from simrig.plans.adaptive import AdaptiveSamples, sample_adaptively
from simrig.plans.auto.plan import AutomaticPlan
from simrig.plans.placement import SlicePlacement, SubspacePlacement
from simrig.rigs.direct.effects import check_effects
from simrig.rigs.direct.recording import at, record
from simrig.rigs.measurements.directions import DirectionsMeasurement
from simrig.rigs.measurements.replay import ReplayLog
from simrig.rigs.measurements.slices import Measurement, fingerprint
from simrig.rigs.timing import UTIA_TIMING, GonioreflectometerTiming

REACH_TOLERANCE = 1e-6  # radians; files often hold angles as float32


@dataclass(frozen=True, eq=False)
class Recorded:
    """What is sent back to a plan: (n, 3) values of f_r in 1/sr."""

    values: np.ndarray


Progress = Callable[[int, int], None]  # samples done, samples in total


@dataclass(frozen=True)
class Gonioreflectometer:
    """Two arms that place one light and one detector anywhere above the sample.

    The direct level forms no image. Without effects every value is f_r at exactly one pair of
    directions; with effects it is what optics, mechanics and sensor make of f_r around it.

    Attributes:
        timing: how long the hardware takes.
        instrument: optics and sensor; only the effects read it.
        effects: names of the effects that are simulated (``simrig.rigs.direct.effects``); none by
            default.
        plan: how the effects were chosen, as plain values; kept in the provenance.

    Raises:
        SimrigError: an unknown effect.
    """

    timing: GonioreflectometerTiming = UTIA_TIMING
    instrument: Instrument = UTIA
    effects: tuple[str, ...] = ()
    plan: Mapping[str, Any] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "effects", check_effects(self.effects))

    def measure_directions(self, brdf: Brdf, angles: np.ndarray) -> np.ndarray:
        """Return f_r at given directions, as the rig's effects let it appear.

        Args:
            brdf: the material.
            angles: (m, 4) theta_i, theta_v, phi_i, phi_v in radians.

        Returns:
            (m, 3) linear RGB in 1/sr.

        Raises:
            SimrigError: a polar angle outside [0, 90°), or a value that is negative or not finite.
        """
        angles = np.asarray(angles, dtype=np.float64)
        theta = angles[:, :2]
        if not np.all((theta >= 0.0) & (theta < np.pi / 2)):
            worst = np.degrees(theta.flat[np.argmax(np.abs(theta - np.pi / 4))])
            raise SimrigError(f"polar angles must lie in [0, 90) degrees, got {worst:g}")
        if self.effects:
            values = record(brdf, angles, self.instrument, self.effects)
        else:
            values = at(brdf, angles)
        bad = ~np.all(np.isfinite(values) & (values >= 0.0), axis=1)
        if np.any(bad):
            where = ", ".join(f"{a:.2f}°" for a in np.degrees(angles[bad][0]))
            raise SimrigError(
                f"'{brdf.name}' is negative or not finite at theta_i, theta_v, phi_i, "
                f"phi_v = {where}: repair the material's data"
            )
        return values

    def measure(
        self,
        brdf: Brdf,
        placement: SlicePlacement,
        samples: int,
        *,
        slice_types: str = "all",
        k: float = 0.9,
        p_1: int = 5,
        p_2: int = 5,
        checkpoint: Path | None = None,
        progress: Progress | None = None,
    ) -> Measurement:
        """Measure one material adaptively along slices.

        Args:
            brdf: the material.
            placement: where the slices lie.
            samples: number of distinct direction pairs.
            slice_types: ``"all"`` or ``"axial_diagonal"``.
            k, p_1, p_2: parameters of thesis algorithm 5.1.
            checkpoint: folder that keeps what was measured so far; an interrupted measurement
                resumes from it with the same result, and it is removed at the end.
            progress: called with the number of samples done and in total.

        Raises:
            SimrigError: a plan that cannot hold the samples, a placement beyond the material's
                data, a checkpoint of another measurement.
        """
        self._check_reach([brdf], placement.theta_max)
        setting = {
            **asdict(placement),
            "samples": samples,
            "slice_types": slice_types,
            "k": k,
            "p_1": p_1,
            "p_2": p_2,
            "material": fingerprint(brdf),
            **self._conditions(),
        }
        log = ReplayLog(checkpoint, setting)
        take = self._taker(brdf, log, samples, progress)
        elapsed = stopwatch()
        found = sample_adaptively(
            lambda angles, _: log.measure(angles, take, 512 if checkpoint else len(angles)),
            placement,
            samples,
            slice_types=slice_types,
            k=k,
            p_1=p_1,
            p_2=p_2,
        )[0]
        seconds = elapsed()
        log.remove()
        return self._measurement(found, placement, slice_types, brdf, setting, seconds)

    def measure_many(
        self,
        brdfs: Sequence[Brdf],
        placement: SlicePlacement,
        samples: int,
        *,
        slice_types: str = "all",
    ) -> list[Measurement]:
        """Measure several materials at once, each with the same number of samples.

        The result equals ``measure`` for each of them; the slices of all are refined together.
        The time of computing is shared out evenly.

        Args:
            brdfs: the materials.
            placement, samples, slice_types: as ``measure``, the same for all.

        Raises:
            SimrigError: as ``measure``.
        """
        self._check_reach(brdfs, placement.theta_max)

        def take(angles: np.ndarray, owner: np.ndarray) -> np.ndarray:
            values = np.empty((len(angles), 3))
            for number, brdf in enumerate(brdfs):
                mine = owner == number
                values[mine] = self.measure_directions(brdf, angles[mine])
            return values

        elapsed = stopwatch()
        found = sample_adaptively(
            take, placement, samples, materials=len(brdfs), slice_types=slice_types
        )
        seconds = elapsed() / len(brdfs)
        setting = {"samples": samples, **self._conditions()}
        return [
            self._measurement(own, placement, slice_types, material, setting, seconds)
            for own, material in zip(found, brdfs, strict=True)
        ]

    def measure_subspace(
        self, brdf: Brdf, placement: SubspacePlacement, samples: int
    ) -> AdaptiveSamples:
        """Measure one subspace of two polar angles adaptively along its slices.

        Args:
            brdf: the material.
            placement: the polar angles and the slices.
            samples: number of distinct direction pairs.

        Raises:
            SimrigError: too few or too many samples, or polar angles beyond the material's data.
        """
        if max(placement.theta_i, placement.theta_v) > brdf.theta_max + REACH_TOLERANCE:
            raise SimrigError(
                f"'{brdf.name}' has data up to theta = {np.degrees(brdf.theta_max):g} degrees only"
            )
        return sample_adaptively(
            lambda angles, _: self.measure_directions(brdf, angles),
            placement,
            samples,
            slice_types="axial_diagonal",
        )[0]

    def measure_scheme(
        self,
        brdf: Brdf,
        scheme: HemisphereScheme,
        *,
        reciprocal: bool | None = None,
        checkpoint: Path | None = None,
        progress: Progress | None = None,
    ) -> DirectionsMeasurement:
        """Measure all pairs of the directions of a scheme (thesis section D.3).

        Args:
            brdf: the material.
            scheme: n directions, the same for illumination and view.
            reciprocal: measure each unordered pair once, n(n + 1)/2 samples, the direction that
                the scheme names first (with rings: the steeper one) as illumination; or all n²
                ordered pairs. By default as the material is.
            checkpoint, progress: as in ``measure_list``.

        Raises:
            SimrigError: as ``measure_list``.
        """
        once = brdf.reciprocal if reciprocal is None else reciprocal
        pairs = "each unordered pair once" if once else "all ordered pairs"
        return self.measure_list(
            brdf,
            scheme.pair_angles(once),
            plan=f"scheme {scheme.name}, {len(scheme)} directions, {pairs}",
            checkpoint=checkpoint,
            progress=progress,
        )

    def measure_list(
        self,
        brdf: Brdf,
        angles: np.ndarray,
        *,
        plan: str = "list of directions",
        checkpoint: Path | None = None,
        progress: Progress | None = None,
    ) -> DirectionsMeasurement:
        """Measure one material at direction pairs that are known in advance.

        Args:
            brdf: the material.
            angles: (n, 4) theta_i, theta_v, phi_i, phi_v in radians.
            plan: what the provenance calls the list.
            checkpoint: folder that keeps what was measured so far, as in ``measure``.
            progress: called with the number of samples done and in total.

        Raises:
            SimrigError: directions beyond the material's data or at the horizon, values that
                cannot be, a checkpoint of another measurement.
        """
        angles = np.asarray(angles, dtype=np.float64)
        self._check_reach([brdf], float(angles[:, :2].max(initial=0.0)))
        total = len(angles)
        setting = {
            "plan": plan,
            "samples": total,
            "material": fingerprint(brdf),
            **self._conditions(),
        }
        log = ReplayLog(checkpoint, setting)
        take = self._taker(brdf, log, total, progress)
        elapsed = stopwatch()
        chunk = max(512, total // 50) if checkpoint or progress else total  # fifty files, or fewer
        values = log.measure(angles, take, chunk)
        seconds = elapsed()
        log.remove()
        cost = self._cost(total, seconds, adaptive=False)
        provenance = self._provenance(plan, setting)
        return DirectionsMeasurement(angles, values, brdf.name, cost, provenance)

    def measure_plan(
        self,
        brdf: Brdf,
        plan: AutomaticPlan,
        *,
        checkpoint: Path | None = None,
        progress: Progress | None = None,
    ) -> DirectionsMeasurement:
        """Measure one material by a plan that asks for directions as it learns.

        What the plan found is kept in the provenance, for the reconstruction and for reports.

        Args:
            brdf: the material.
            plan: where to look; it is kept within the material's data.
            checkpoint: file that keeps what was measured so far, as in ``measure``.
            progress: called with the number of samples done and in total.

        Raises:
            SimrigError: as ``measure_list``.
        """
        plan = plan.within(brdf.theta_max)
        setting = {
            **plan.settings(),
            "plan": plan.describe(),
            "material": fingerprint(brdf),
            **self._conditions(),
        }
        log = ReplayLog(checkpoint, setting)
        take = self._taker(brdf, log, plan.samples, progress)
        chunk = max(512, plan.samples // 50)
        elapsed = stopwatch()
        asked, recorded = [], []
        work, sent = plan.batches(), None
        while True:
            try:
                angles = work.send(sent)
            except StopIteration as end:
                layout = end.value
                break
            asked.append(angles)
            recorded.append(log.measure(angles, take, chunk))
            sent = Recorded(recorded[-1])
        seconds = elapsed()
        log.remove()
        found = {name: array.tolist() for name, array in layout.items()}
        provenance = {**self._provenance(plan.describe(), setting), "found": found}
        every = np.concatenate(asked)
        cost = self._cost(len(every), seconds, adaptive=True)
        values = np.concatenate(recorded)
        return DirectionsMeasurement(every, values, brdf.name, cost, provenance)

    def _taker(
        self, brdf: Brdf, log: ReplayLog, total: int, progress: Progress | None
    ) -> Callable[[np.ndarray], np.ndarray]:
        """Return what measures directions and says how many are then done, replayed ones too."""

        def take(angles: np.ndarray) -> np.ndarray:
            values = self.measure_directions(brdf, angles)
            if progress is not None:
                progress(len(log) + len(values), total)
            return values

        return take

    def _conditions(self) -> dict[str, Any]:
        """Return the effects and what they depend on, as plain values; nothing without effects."""
        if not self.effects:
            return {}
        return {"effects": list(self.effects), "instrument": asdict(self.instrument)}

    def _check_reach(self, brdfs: Sequence[Brdf], theta_max: float) -> None:
        for brdf in brdfs:
            # files often hold angles as float32: 80° is then 79.99998°
            if theta_max > brdf.theta_max + REACH_TOLERANCE:
                own, asked = np.degrees([brdf.theta_max, theta_max])
                raise SimrigError(
                    f"'{brdf.name}' has data up to theta = {own:g} degrees, the plan asks "
                    f"for {asked:g}: lower theta_max"
                )

    def _measurement(
        self,
        found: AdaptiveSamples,
        placement: SlicePlacement,
        slice_types: str,
        brdf: Brdf,
        setting: dict,
        seconds: float,
    ) -> Measurement:
        cost = self._cost(len(found.values), seconds, adaptive=True)
        plan = f"adaptive along slices, {placement.describe()}, {slice_types}"
        provenance = self._provenance(plan, setting)
        return Measurement(found, placement, slice_types, brdf.name, cost, provenance)

    def _cost(self, count: int, seconds: float, adaptive: bool) -> Cost:
        return Cost(
            samples=count,
            hardware_seconds=self.timing.seconds(count, adaptive=adaptive),
            compute_seconds=seconds,
            bytes=count * 7 * 8,
        )

    def _provenance(self, plan: str, setting: Mapping[str, Any]) -> dict[str, Any]:
        provenance: dict[str, Any] = {
            "rig": "gonioreflectometer, direct level",
            "plan": plan,
            "parameters": setting,
            "simrig_version": simrig.__version__,
        }
        if self.plan is not None:
            provenance["effects"] = dict(self.plan)
        return provenance

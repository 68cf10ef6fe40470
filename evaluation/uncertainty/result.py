"""The budget of an instrument and a material as one result."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from simrig.brdf.protocol import Brdf
from simrig.core.errors import SimrigError
from simrig.core.shown import Exhibit, Shown
from simrig.evaluation.uncertainty.budget import (
    THETAS_DEG,
    TRIALS,
    Instruments,
    K,
    Spread,
    Table,
    check_angles,
    check_subject,
    check_trials,
    directions,
    silent_numbers,
    table_of_albedos,
    table_of_values,
)
from simrig.evaluation.uncertainty.costs import (
    SAMPLES,
    Levers,
    curves,
    exposure_seconds,
    halving,
)
from simrig.evaluation.uncertainty.renderer import renderer_part
from simrig.evaluation.uncertainty.sources import SOURCES, chosen
from simrig.instruments.description import Description
from simrig.rigs.direct.recording import exposure
from simrig.rigs.timing import GonioreflectometerTiming

AZIMUTHS = 8
_ALBEDO_SHARE = 4  # of the trials
_MOST_GROUPS = 10

# expanded uncertainties in per cent that laboratories publish of theirs (k = 2)
PUBLISHED = {
    "NPL, reference reflectometer": 0.2,
    "NIST, five-axis goniometer": 0.5,
    "a budget of aperture and distance 0.85, noise 0.35, light 0.23": 1.03,
    "KRISS (less than)": 3.0,
}


@dataclass(frozen=True, eq=False)
class Budget(Shown):
    """How well an instrument knows what it measures of a material.

    Attributes:
        material, instrument: their names.
        thetas_deg: polar angle of each group of values.
        values: the budget of f_r. albedos: of the albedo seen from each polar angle; None where
            it was not asked for.
        unstated: numbers whose uncertainty the file does not state, by source.
        saturated: how many of the values are beyond what the sensor can hold.
        dominant: what halving the dominant source costs; None where nothing is uncertain.
        curves: uncertainty over hours, exposures and price.
        renderer: noise and bias of the simulation itself.
        settings: trials, seed, samples, exposures, whether against a standard.
    """

    material: str
    instrument: str
    thetas_deg: tuple[float, ...]
    values: Table
    albedos: Table | None
    unstated: dict[str, list[str]]
    saturated: int
    dominant: dict[str, Any] | None
    curves: list[dict[str, Any]]
    renderer: dict[str, Any]
    settings: dict[str, Any]

    @property
    def expanded(self) -> float:
        """Median relative expanded uncertainty of f_r in per cent; 1/sr where all is black."""
        return K * float(np.median(self.values.parts(self.values.total.rms)))

    def __str__(self) -> str:
        """Return the expanded uncertainty and the dominant source."""
        source = self.dominant["source"] if self.dominant else "nothing"
        return (
            f"{self.material}, {self.instrument}: U = {self.expanded:.3g} {self.values.unit} "
            f"(k = 2), most of it by {source}"
        )

    def exhibit(self) -> Exhibit:
        """Return the line and the cost of halving."""
        facts = {"uncertainty": str(self)}
        if self.dominant:
            facts["halving"] = self.dominant["line"]
        facts["not stated"] = ", ".join(self.unstated) or "none"
        return Exhibit(f"Uncertainty budget of {self.material}", facts)

    def rows(self) -> list[dict[str, Any]]:
        """Return one row for each quantity, source and polar angle, and ``total``.

        Expanded uncertainties (k = 2) and the bias in it, in per cent of the value (``unit``
        1/sr where all is black): ``U`` is the median, ``U_worst`` the largest of the values there.
        """
        found = []
        for quantity, table in (("f_r", self.values), ("albedo", self.albedos)):
            if table is not None:
                for name, spread in {**table.alone, "total": table.total}.items():
                    for which, theta in enumerate(self.thetas_deg):
                        found.append(_row(quantity, name, table, spread, which, theta))
        return found

    def to_dict(self) -> dict[str, Any]:
        """Return all of it as plain values."""
        table = self.values
        return {
            "material": self.material,
            "instrument": self.instrument,
            **self.settings,
            "unit": table.unit,
            "expanded_uncertainty": self.expanded,
            "rows": self.rows(),
            "values": [
                {
                    "angles_deg": np.degrees(table.angles[n]).tolist(),
                    "f_r": table.truth[n].tolist(),
                    "U": (K * table.total.rms[n]).tolist(),
                    "bias": table.total.bias[n].tolist(),
                    "interval_95": [
                        (table.truth[n] - table.total.high[n]).tolist(),
                        (table.truth[n] - table.total.low[n]).tolist(),
                    ],
                }
                for n in range(len(table.angles))
            ],
            "not_stated": self.unstated,
            "saturated_values": self.saturated,
            "dominant": self.dominant,
            "curves": self.curves,
            "renderer": self.renderer,
            "published_percent": PUBLISHED,
        }


def _row(
    quantity: str, name: str, table: Table, spread: Spread, which: int, theta: float
) -> dict[str, Any]:
    without = table.without.get(name)
    rest = None if without is None else table.typical(without.rms, which)
    typical, worst = table.typical(spread.rms, which), table.worst(spread.rms, which)
    return {
        "quantity": quantity,
        "source": name,
        "theta_deg": theta,
        "unit": table.unit,
        "U": None if typical is None else K * typical,
        "U_worst": None if worst is None else K * worst,
        "bias": table.typical(np.abs(spread.bias), which),
        "U_without": None if rest is None else K * rest,
    }


def make_budget(
    material: Brdf,
    description: Description,
    *,
    thetas_deg: Sequence[float] | None = None,
    pairs: np.ndarray | None = None,
    trials: int = TRIALS,
    seed: int = 0,
    samples: int = SAMPLES,
    exposures: int = 1,
    sources: Sequence[str] | None = None,
    albedo: bool = True,
    spp: int = 64,
    progress: Callable[..., None] | None = None,
) -> Budget:
    """Return the uncertainty budget of an instrument and a material.

    Args:
        material: under the instrument.
        description: the instrument, a gonioreflectometer.
        thetas_deg: polar angles of light and view alike; ``THETAS_DEG`` as far as the material's
            data and the axes go, unless given. At each eight azimuths apart.
        pairs: (n, 4) directions in radians in their place.
        trials: virtual instruments that are drawn.
        seed: of the draws.
        samples: of the measurement whose hours are stated.
        exposures: of every value.
        sources: names of those that count; all unless given.
        albedo: also the budget of the albedo.
        spp: samples per pixel of a rendered recording, for the renderer's own part.
        progress: called with steps done and in total.

    Raises:
        SimrigError: an instrument that is no gonioreflectometer, directions out of reach, numbers
            out of range, an unknown source.
    """
    instrument = check_subject(material, description)
    on = chosen(sources)
    for what, number in (("samples", samples), ("exposures", exposures), ("spp", spp)):
        if number < 1:
            raise SimrigError(f"--{what} must be at least 1, got {number}")
    if seed < 0:
        raise SimrigError(f"--seed must be >= 0, got {seed}")
    if pairs is not None and thetas_deg is not None:
        raise SimrigError("--theta and --pairs contradict each other: give only one of them")
    if pairs is None:
        thetas = _thetas(material, instrument, thetas_deg)
        angles, group = directions(thetas, AZIMUTHS)
    else:
        angles = np.asarray(pairs, dtype=np.float64)
        thetas, group = _grouped(angles)
    check_angles(angles, material, instrument)
    check_trials(trials, len(angles))
    drawn = Instruments(material, instrument, trials, seed, None, exposures)
    table = table_of_values(drawn, angles, group, on, progress)
    albedos = None
    if albedo:
        fewer = replace(drawn, trials=max(trials // _ALBEDO_SHARE, 100))
        albedos = table_of_albedos(fewer, thetas, on)
    timing = GonioreflectometerTiming.of(instrument.timing)
    levers = Levers(table, timing, samples, exposure_seconds(drawn, table))
    dominant = table.dominant()
    shot = exposure(table.truth, angles, drawn.bench.instrument)
    return Budget(
        material.name,
        instrument.instrument.name,
        tuple(thetas),
        table,
        albedos,
        {name: keys for name, keys in silent_numbers(instrument).items() if name in on},
        int(np.sum(np.any(table.truth > shot.saturation, axis=1))),
        halving(levers, drawn, dominant) if dominant else None,
        curves(levers, drawn),
        renderer_part(drawn, angles, spp),
        {
            "trials": trials,
            "seed": seed,
            "samples": samples,
            "exposures": exposures,
            "hours": levers.hours(),
            "against_standard": drawn.bench.reference is not None,
            "sources": {name: SOURCES[name].about for name in on},
            "coverage_factor": K,
        },
    )


def _thetas(material: Brdf, instrument: Any, wished: Sequence[float] | None) -> tuple[float, ...]:
    if wished is not None:
        if not wished:
            raise SimrigError("a budget needs at least one polar angle")
        return tuple(float(theta) for theta in wished)
    end = float(np.degrees(material.theta_max)) + 1e-4
    ends = [axis.range_deg for axis in instrument.axis if axis.name in ("theta_i", "theta_v")]
    low, high = max(r[0] for r in ends), min([end, *(r[1] for r in ends)])
    return tuple(t for t in THETAS_DEG if low <= t <= high) or (min(high, 89.0),)


def _grouped(pairs: np.ndarray) -> tuple[tuple[float, ...], np.ndarray]:
    """Return polar angles of light, and which of them each pair belongs to; bins of 10° of many."""
    if pairs.ndim != 2 or pairs.shape[1] != 4 or len(pairs) == 0:
        raise SimrigError(f"a budget needs directions (n, 4), n >= 1, got {pairs.shape}")
    theta = np.round(np.degrees(pairs[:, 0]), 1)
    if len(np.unique(theta)) > _MOST_GROUPS:
        theta = 10.0 * np.floor(theta / 10.0) + 5.0
    thetas, group = np.unique(theta, return_inverse=True)
    return tuple(thetas.tolist()), group

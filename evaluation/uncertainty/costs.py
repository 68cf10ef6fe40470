"""What accuracy costs: the expanded uncertainty over hours, over exposures and over price.

A measurement that is repeated halves with four times the hours what is drawn for every value, and
nothing else; more exposures of a value average photons, read-out and steps; a standard read more
often lets the light drift less; all else has to be bought. What can be bought stands in the file
(``[[alternative]]``), with its price.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np

from simrig.core.errors import SimrigError
from simrig.evaluation.uncertainty.budget import Instruments, K, Spread, Table
from simrig.evaluation.uncertainty.sources import SOURCES
from simrig.instruments.calibration import Alternative
from simrig.rigs.direct.recording import exposure
from simrig.rigs.timing import GonioreflectometerTiming
from simrig.viewing.plots import pareto_front

REPEATS = (1, 2, 4, 8, 16, 32)
EXPOSURES = (1, 2, 4, 8, 16, 32, 64)
SAMPLES = 6561  # of the measurement that hours are of: 81 x 81 directions
_MOST_ALTERNATIVES = 8  # whose combinations are tried
_BY_EXPOSURE = ("noise", "quantisation")


@dataclass(frozen=True, eq=False)
class Levers:
    """A budget whose sources can be made smaller.

    Attributes:
        table: of f_r.
        timing: of the instrument.
        samples: of the measurement.
        exposure_s: that one more exposure takes; None where the file does not say it.
    """

    table: Table
    timing: GonioreflectometerTiming
    samples: int
    exposure_s: float | None = None

    def mean_square(
        self,
        repeats: float = 1.0,
        exposures: float = 1.0,
        factors: Mapping[str, float] | None = None,
        spreads: Mapping[str, Spread] | None = None,
    ) -> np.ndarray:
        """Return the mean square error of every value, (n, 3): the sum over independent sources.

        What the sources do together beyond that sum stays as it is.

        Args:
            repeats, exposures: by which what averages is divided; not its bias.
            factors: on the errors of sources.
            spreads: in the place of those of the table.
        """
        alone = {**self.table.alone, **(spreads or {})}
        rest = self.table.total.rms**2 - sum(s.rms**2 for s in self.table.alone.values())
        total = np.zeros_like(rest)
        for name, spread in alone.items():
            variance, bias = spread.variance, spread.bias**2
            if SOURCES[name].averages:
                variance = variance / repeats
            if name in _BY_EXPOSURE:
                variance = variance / exposures
            total = total + (factors or {}).get(name, 1.0) ** 2 * (bias + variance)
        return np.maximum(total + rest, 0.0)

    def expanded(self, mean_square: np.ndarray) -> float:
        """Return the median expanded uncertainty of all values, in the table's unit."""
        return K * float(np.median(self.table.parts(np.sqrt(mean_square))))

    def hours(self, repeats: float = 1.0, exposures: float = 1.0) -> float | None:
        """Return the hours of the measurement; None where exposures have no stated time."""
        values = round(self.samples * repeats)
        seconds = self.timing.seconds(values, adaptive=False)
        if exposures > 1.0:
            if self.exposure_s is None:
                return None
            seconds += values * (exposures - 1.0) * self.exposure_s
        return seconds / 3600.0


def exposure_seconds(instruments: Instruments, table: Table) -> float | None:
    """Return what one more exposure takes in the mean; None where a file has no ``exposures_s``."""
    times = instruments.description.camera.exposures_s
    if not times:
        return None
    shot = exposure(table.truth, table.angles, instruments.bench.instrument)
    longer = shot.saturation / (shot.step * 2.0**instruments.bench.instrument.bits)
    seconds = times[0].value * instruments.description.light.levels[0] * longer
    # the light is brightened first, then the exposure gets longer
    return float(np.mean(np.clip(seconds, times[0].value, times[1].value)))


def curves(levers: Levers, instruments: Instruments) -> list[dict[str, Any]]:
    """Return the expanded uncertainty over each cost, with what nothing else beats marked.

    Returns:
        Rows with ``over`` (``hours``, ``exposures`` or ``price``), ``what``, ``repeats``,
        ``exposures``, ``hours``, ``price_eur``, ``U`` and ``front``.
    """
    rows = [
        _row(levers, "hours", f"{n} ×", repeats=n, square=levers.mean_square(repeats=n))
        for n in REPEATS
    ]
    rows += [
        _row(levers, "exposures", f"{n}", exposures=n, square=levers.mean_square(exposures=n))
        for n in EXPOSURES
    ]
    rows += _bought(levers, instruments)
    for over, key in (("hours", "hours"), ("exposures", "exposures"), ("price", "price_eur")):
        own = [row for row in rows if row["over"] == over]
        front = set(map(int, pareto_front([row[key] for row in own], [row["U"] for row in own])))
        for index, row in enumerate(own):
            row["front"] = index in front
    return rows


def _row(
    levers: Levers,
    over: str,
    what: str,
    square: np.ndarray,
    repeats: int = 1,
    exposures: int = 1,
    price_eur: float = 0.0,
) -> dict[str, Any]:
    return {
        "over": over,
        "what": what,
        "repeats": repeats,
        "exposures": exposures,
        "hours": levers.hours(repeats, exposures),
        "price_eur": price_eur,
        "U": levers.expanded(square),
    }


def _bought(levers: Levers, instruments: Instruments) -> list[dict[str, Any]]:
    """Return a row for every combination of the file's alternatives that agree."""
    own = instruments.description.alternative
    if len(own) > _MOST_ALTERNATIVES:
        raise SimrigError(
            f"the file has {len(own)} [[alternative]]: the price of all combinations is worked out "
            f"for at most {_MOST_ALTERNATIVES}, leave some out"
        )
    spreads = {one.name: alternative_spreads(levers.table, instruments, one) for one in own}
    rows = [_row(levers, "price", "as it is", levers.mean_square())]
    for size in range(1, len(own) + 1):
        for some in combinations(own, size):
            merged: dict[str, Spread] = {}
            for one in some:
                merged |= spreads[one.name]
            if len(merged) < sum(len(spreads[one.name]) for one in some):
                continue  # two of them change one source: not both can be bought
            price = sum(one.price_eur.value for one in some)
            what = " + ".join(one.name for one in some)
            square = levers.mean_square(spreads=merged)
            rows.append(_row(levers, "price", what, square, price_eur=price))
    return rows


def alternative_spreads(
    table: Table, instruments: Instruments, alternative: Alternative
) -> dict[str, Spread]:
    """Return the sources that an alternative changes, each alone, with it bought."""
    bought = replace(instruments, changes=alternative.replaces)
    changed = [
        name
        for name in table.alone
        if any(
            bought.quantities[path] != instruments.quantities[path]
            for path in SOURCES[name].paths(instruments.quantities)
        )
    ]
    return {name: Spread.of(bought.errors(table.angles, [name])) for name in changed}


def halving(
    levers: Levers, instruments: Instruments, source: str, repeats: float = 4.0
) -> dict[str, Any]:
    """Say what it would cost to halve one source.

    Returns:
        ``source``, ``share_percent`` of the squared uncertainty, ``U`` now and
        ``U_halved``, ``ways`` (each ``how``, ``hours`` more, ``price_eur`` more,
        ``U`` then) and ``line``.
    """
    table = levers.table
    part = table.share(source)
    now = levers.expanded(levers.mean_square())
    half = levers.expanded(levers.mean_square(factors={source: 0.5}))
    before = levers.hours()
    ways: list[dict[str, Any]] = []
    kind = SOURCES[source]
    if source in _BY_EXPOSURE:
        square = levers.mean_square(exposures=repeats)
        then = levers.hours(exposures=repeats)
        how = f"{repeats:g} exposures of every value"
        ways.append(_way(how, levers.expanded(square), _more(then, before), 0.0))
    elif kind.averages:
        square = levers.mean_square(repeats=repeats)
        how = f"every value measured {repeats:g} times"
        ways.append(_way(how, levers.expanded(square), _more(levers.hours(repeats), before), 0.0))
    if source == "drift":
        readings = _readings(levers, instruments)
        ways.append(_way("the standard read twice as often", half, readings, 0.0))
    own = table.alone[source]
    centred = replace(own, rms=np.sqrt(own.variance), bias=0.0 * own.bias)
    if _halves(table, centred, source):
        square = levers.mean_square(spreads={source: centred})
        how = "values corrected for its mean, which is known"
        ways.append(_way(how, levers.expanded(square), 0.0, 0.0))
    for one in instruments.description.alternative:
        changed = alternative_spreads(table, instruments, one)
        if source in changed and _halves(table, changed[source], source):
            square = levers.mean_square(spreads=changed)
            ways.append(_way(one.name, levers.expanded(square), 0.0, one.price_eur.value))
    line = f"{source} has {100.0 * part:.0f} % of the squared uncertainty; halving it "
    line += f"takes U from {now:.3g} to {half:.3g} {table.unit}: "
    keys = ", ".join(SOURCES[source].keys)
    line += (
        "; or ".join(_said(way, table.unit) for way in ways)
        or f"no repetition lowers it, halve {keys}"
    )
    if not any(way["price_eur"] for way in ways):
        line += " (no [[alternative]] of the file halves it)"
    return {
        "source": source,
        "share_percent": 100.0 * part,
        "U": now,
        "U_halved": half,
        "ways": ways,
        "line": line,
    }


def _readings(levers: Levers, instruments: Instruments) -> float | None:
    """Return the hours that as many readings of the standard take again."""
    interval = instruments.quantities.get("calibration.interval_h")
    hours = levers.hours()
    if interval is None or hours is None:
        return None
    return hours / interval.value * levers.timing.per_sample / 3600.0


def _halves(table: Table, then: Spread, source: str) -> bool:
    now, small = (np.median(table.parts(s.rms)) for s in (table.alone[source], then))
    return bool(small <= 0.51 * now)


def _more(then: float | None, before: float | None) -> float | None:
    return None if then is None or before is None else then - before


def _way(how: str, expanded: float, hours: float | None, price_eur: float) -> dict[str, Any]:
    return {"how": how, "U": expanded, "hours": hours, "price_eur": price_eur}


def _said(way: Mapping[str, Any], unit: str) -> str:
    cost = f"{way['price_eur']:,.0f} EUR" if way["price_eur"] else ""
    if not cost:
        hours = way["hours"]
        cost = "time not stated" if hours is None else f"{hours:.3g} h more" if hours else "free"
    return f"{way['how']}, {cost}, U {way['U']:.3g} {unit}"

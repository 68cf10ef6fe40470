"""The sources of an uncertainty budget, and which numbers of an instrument file feed each."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

from simrig.core.errors import check_known
from simrig.instruments.quantity import Quantity

PER_INSTRUMENT, PER_VALUE = "instrument", "value"


@dataclass(frozen=True)
class Source:
    """One source.

    Attributes:
        name: as tables show it.
        about: one line.
        keys: of the instrument file; ``axis.key`` is that of every axis.
        by_value: whether the numbers themselves are the error (a repeatability, a diameter), not
            only their uncertainty.
        drawn: once for an ``instrument`` or for every ``value``.
        averages: whether repeating a measurement lowers it.
        moves_light: whether it changes the directions at which f_r is seen.
    """

    name: str
    about: str
    keys: tuple[str, ...]
    by_value: bool = False
    drawn: str = PER_INSTRUMENT
    averages: bool = False
    moves_light: bool = False

    def paths(self, quantities: Mapping[str, Quantity]) -> list[str]:
        """Return the numbers of an instrument that feed it."""
        return [path for path in quantities if _of_all(path) in self.keys or path in self.keys]


_ALL = (
    Source("axis offset", "zeros of the axes", ("axis.offset_deg",), moves_light=True),
    Source(
        "repeatability",
        "where a move stops",
        ("axis.repeatability_deg",),
        by_value=True,
        drawn=PER_VALUE,
        averages=True,
        moves_light=True,
    ),
    Source(
        "plane",
        "height and tilt of the surface",
        ("sample.height_mm", "sample.tilt_deg"),
        moves_light=True,
    ),
    Source(
        "distance",
        "of light and camera; cancels against a standard",
        ("light.distance_mm", "camera.distance_mm"),
        moves_light=True,
    ),
    Source(
        "extent",
        "light, aperture and spot are no points",
        ("light.diameter_mm", "lens.f_mm", "lens.f_number", "sample.spot_diameter_mm"),
        by_value=True,
        moves_light=True,
    ),
    Source(
        "flat field",
        "irradiance at the sample against the standard",
        ("calibration.flat_field", "light.non_uniformity"),
    ),
    Source("spectral mismatch", "bands of the channels", ("calibration.spectral_mismatch",)),
    Source("colour matrix", "all nine elements jointly", ("calibration.colour_matrix",)),
    Source("linearity", "of the response", ("calibration.linearity",)),
    Source("PRNU", "response of the pixels", ("camera.PRNU_pct",), by_value=True, drawn=PER_VALUE),
    Source("black level", "dark level that is subtracted", ("calibration.black_DN",)),
    Source("stray light", "light by the room", ("light.stray",)),
    Source("drift", "of the light since the standard was read", ("light.drift_pct_h",)),
    Source("reference", "f_r of the standard", ("calibration.reference_f_r_per_sr",)),
    Source(
        "noise",
        "photons and read-out",
        ("camera.mu_sat_e", "camera.sigma_d_e"),
        by_value=True,
        drawn=PER_VALUE,
        averages=True,
    ),
    Source(
        "quantisation",
        "steps of the converter",
        ("camera.bits",),
        by_value=True,
        drawn=PER_VALUE,
        averages=True,
    ),
)
SOURCES: dict[str, Source] = {source.name: source for source in _ALL}
"""Every source. A new one is one more entry, and its term in ``simrig.evaluation.uncertainty``."""


def chosen(names: Collection[str] | None) -> Sequence[str]:
    """Return sources by name; all of them for None.

    Raises:
        SimrigError: an unknown one, with the nearest known one.
    """
    for name in names or ():
        check_known("source of uncertainty", name, SOURCES)
    return list(SOURCES) if names is None else [name for name in SOURCES if name in names]


def unstated(
    quantities: Mapping[str, Quantity], given: Mapping[str, Quantity]
) -> dict[str, list[str]]:
    """Return the numbers whose uncertainty a file does not state, by source.

    An uncertainty of zero that is written down is a statement.

    Args:
        quantities: of the instrument, defaults included.
        given: those that its file has.
    """
    found: dict[str, list[str]] = {}
    for source in SOURCES.values():
        paths = source.paths(quantities)
        silent = [
            path
            for path in paths
            if path not in given
            or not (source.by_value or "u" in given[path].model_fields_set)
        ]  # fmt: skip
        if source.name != "quantisation" and (silent or not paths):
            found[source.name] = silent or list(source.keys)
    return found


def _of_all(path: str) -> str:
    first, *_, last = path.split(".")
    return f"{first}.{last}"

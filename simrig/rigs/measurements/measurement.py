"""What a rig recorded, whatever the rig and the plan: directions, values, cost, and how."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from simrig.btf.stack import BtfStack
from simrig.core.colour import encode_srgb
from simrig.core.cost import Cost
from simrig.core.errors import SimrigError, check_known
from simrig.core.gamut import CLIP, GAMUTS
from simrig.core.shown import Exhibit, Shown, beside
from simrig.directions.discs import disc
from simrig.plans.listed import Directions
from simrig.plans.protocol import Plan


class Pictures(Protocol):
    """Registered images, one for each pair of directions; the values are their means."""

    def stack(self) -> BtfStack:
        """Return the images."""

    def save(self, path: str | Path, attributes: Mapping[str, str]) -> None:
        """Write a BTF file that has some texts as attributes."""


_FOUND = {"family": "why", "reconstruction": "predicted"}  # facts, by what a plan found


@dataclass(frozen=True, eq=False, repr=False)
class Measurement(Shown):
    """Samples with their cost and provenance; ``np.asarray`` gives the values.

    Attributes:
        angles: (n, 4) theta_i, theta_v, phi_i, phi_v in radians, in the order of measurement.
        values: (n, 3) f_r in 1/sr, linear RGB.
        material: name of what was measured.
        cost: samples, simulated hardware time, compute time and bytes.
        plan: which directions were asked for, and why; the list of ``angles`` unless given.
        uncertainty: (n, 3) standard uncertainty of the values in 1/sr; None where unknown.
        layout: what the plan knew when it was done (where samples lie along slices, ...).
        pictures: from which the values come; None without any. They are what is stored then.
        provenance: plain values: rig, instrument, parameters, versions, fingerprint of the
            material.
        gamut: with ``"keep"`` values are negative where colours are outside sRGB.

    Raises:
        SimrigError: arrays that do not fit together, polar angles outside [0, 90°), or values or
            uncertainties that are negative or not finite.
    """

    angles: np.ndarray
    values: np.ndarray
    material: str
    cost: Cost = field(default_factory=Cost)
    plan: Plan = None  # type: ignore[assignment]  # set below
    uncertainty: np.ndarray | None = None
    layout: Mapping[str, np.ndarray] = field(default_factory=dict)
    pictures: Pictures | None = None
    provenance: Mapping[str, Any] = field(default_factory=dict)
    gamut: str = CLIP

    def __post_init__(self) -> None:
        count = len(self.angles)
        if count == 0 or self.angles.shape != (count, 4) or self.values.shape != (count, 3):
            raise SimrigError(
                f"a measurement needs angles (n, 4) and values (n, 3) of at least one sample, got "
                f"{self.angles.shape} and {self.values.shape}"
            )
        theta = self.angles[:, :2]
        inside = np.all((theta >= 0.0) & (theta < np.pi / 2))  # false for NaN
        if not inside or not np.all(np.isfinite(self.angles)):
            raise SimrigError("a measurement needs polar angles in [0, 90) degrees, in radians")
        _check_numbers("values of f_r", self.values, self.values.shape, self.gamut)
        if self.uncertainty is not None:
            _check_numbers("uncertainties", self.uncertainty, self.values.shape)
        if self.plan is None:
            object.__setattr__(self, "plan", Directions(self.angles))

    def __len__(self) -> int:
        return len(self.values)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        """Return the values as an array."""
        return np.array(self.values, dtype=dtype, copy=copy)

    def __str__(self) -> str:
        """Return what was measured and what it cost, in one line."""
        return f"{self.material}, {self.plan.describe()}: {self.cost}"

    def exhibit(self) -> Exhibit:
        """Return where light and viewer stood, with the colours seen there, and the cost."""
        bright = np.max(self.values, axis=1)
        white = float(np.percentile(bright, 98.0)) or float(bright.max()) or 1.0
        colours = encode_srgb(np.maximum(self.values, 0.0) / white)
        picture = beside(
            [disc(self.theta_i, self.phi_i, colours), disc(self.theta_v, self.phi_v, colours)]
        )
        found = self.provenance.get("found", {})
        facts = {
            "plan": self.plan.describe(),
            "rig": str(self.provenance.get("rig", "not told")),
            "cost": str(self.cost),
            "error": self._uncertainty_text(),
            **{name: found[key] for name, key in _FOUND.items() if key in found},
            "picture": "directions of light (left) and view (right) from above, f_r in colour",
        }
        return Exhibit(f"Measurement of {self.material}", facts, picture)

    def _uncertainty_text(self) -> str:
        if self.uncertainty is None:
            return "not known"
        share = np.median(self.uncertainty / np.maximum(np.abs(self.values), np.finfo(float).tiny))
        return f"standard uncertainty {100.0 * share:.3g} % of the values (median)"

    @property
    def theta_i(self) -> np.ndarray:
        """Illumination polar angles in radians, (n,)."""
        return self.angles[:, 0]

    @property
    def theta_v(self) -> np.ndarray:
        """View polar angles in radians, (n,)."""
        return self.angles[:, 1]

    @property
    def phi_i(self) -> np.ndarray:
        """Illumination azimuths in radians, (n,)."""
        return self.angles[:, 2]

    @property
    def phi_v(self) -> np.ndarray:
        """View azimuths in radians, (n,)."""
        return self.angles[:, 3]

    def save(self, path: str | Path) -> None:
        """Write the measurement as HDF5 (to a temporary name, then renamed).

        Raises:
            SimrigError: when the folder does not exist or cannot be written.
        """
        from simrig.rigs.measurements.store import save_measurement

        save_measurement(path, self)

    @classmethod
    def load(cls, path: str | Path) -> Measurement:
        """Read a measurement written by ``save``, or by simrig 0.1.

        Raises:
            SimrigError: no measurement, of a later version, truncated, or inconsistent.
        """
        from simrig.rigs.measurements.store import load_measurement

        return load_measurement(path)


def _check_numbers(
    what: str, values: np.ndarray, shape: tuple[int, ...], gamut: str = CLIP
) -> None:
    if values.shape != shape:
        raise SimrigError(f"a measurement needs {what} {shape}, got {values.shape}")
    check_known("gamut", gamut, GAMUTS)
    if not np.all(np.isfinite(values)) or (gamut == CLIP and values.min() < 0.0):
        raise SimrigError(f"a measurement holds negative, infinite or NaN {what}")

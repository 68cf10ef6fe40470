"""Where a gantry of two rotating arms measures: slices at a few pairs of polar angles.

The arms turn around the normal with lights and cameras fixed at a few polar angles. Turning
together they record an axial slice, turning against each other a diagonal slice. The position
along a slice is φ_v, over a full circle (thesis equations 5.1 and 5.2).

Source: thesis sections 6.1.1 (one slice of each kind, two polar angles), 6.2.3 (frames near the
specular highlights) and 6.4.4 (more polar angles and slices).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

from simrig.core.errors import SimrigError
from simrig.core.options import Option
from simrig.directions.spherical import TWO_PI
from simrig.plans.adaptive import Knots
from simrig.plans.protocol import ListedPlan, Measured, plan_of
from simrig.plans.slices import AXIAL, DIAGONAL, PERIODIC

if TYPE_CHECKING:
    from simrig.brdf.protocol import Brdf

# a single axial slice keeps this distance from the plane of incidence (thesis section 6.1.1): the
# highlight would hide what else the material does
_SINGLE_AXIAL = np.radians(15.0)
_BESIDE_HIGHLIGHT = np.radians(1.0)  # thesis section 6.2.3
_MOST_SAMPLES, _MOST_SLICES = 3600, 360  # per slice, per subspace and kind
_ENOUGH = 12  # slices of a kind; further samples go along them


@dataclass(frozen=True)
class GantrySlice:
    """One slice of a gantry.

    Attributes:
        kind: AXIAL (φ_v − φ_i = offset) or DIAGONAL (φ_i + φ_v = offset).
        pair: numbers of the polar angles of illumination and view.
        offset: α or β in radians.
        positions: (m,) φ_v of the samples in radians, ascending, within one turn.
    """

    kind: int
    pair: tuple[int, int]
    offset: float
    positions: np.ndarray


@dataclass(frozen=True)
class GantryPlan(ListedPlan):
    """Slices at every pair of some polar angles; the default is the thesis's with 168 samples.

    Several slices of a kind are spread evenly. The axial ones then include the plane of
    incidence (α = 180°), where the specular highlight lies.

    Args:
        thetas: of lights and cameras, in radians, increasing within (0, 90°); at least two.
        axial: axial slices per subspace; 0 is the isotropic variant (84 samples).
        diagonal: diagonal slices per subspace, at least one.
        slice_samples: samples of a slice, evenly over the full circle; at least 4.
        lowest_samples: the same where both arms are at their lowest polar angle.
        highlights: two more samples 1° beside each specular highlight that a diagonal slice
            crosses, 208 samples with ``lowest_samples`` = 24.
        filmed: φ_v of the samples of every slice where a film has them, radians ascending within
            one turn, in place of even ones.
    """

    name: ClassVar[str] = "gantry"
    about: ClassVar[str] = "one axial and one diagonal slice at each pair of two polar angles"
    options: ClassVar[tuple[Option, ...]] = (
        Option(
            "samples",
            int,
            "At most so many: 168 unless given, 84 if isotropic.",
            least=1,
            short="-n",
        ),
        Option("isotropic", bool, "Diagonal slices alone, half the samples.", False),
    )

    thetas: tuple[float, ...] = (float(np.radians(30.0)), float(np.radians(75.0)))
    axial: int = 1
    diagonal: int = 1
    slice_samples: int = 24
    lowest_samples: int = 12
    highlights: bool = False
    filmed: tuple[tuple[float, ...], ...] | None = None

    def __post_init__(self) -> None:
        theta = np.asarray(self.thetas, dtype=np.float64)
        increasing = theta.ndim == 1 and theta.size >= 2 and bool(np.all(np.diff(theta) > 0.0))
        if not increasing or not 0.0 < theta[0] <= theta[-1] < np.pi / 2:
            raise SimrigError(
                "a gantry needs at least two polar angles increasing within (0, 90) degrees, got "
                f"{np.degrees(theta).round(6).tolist()}"
            )
        object.__setattr__(self, "thetas", tuple(theta.tolist()))
        _check_count("axial slices per subspace", self.axial, 0, _MOST_SLICES)
        _check_count("diagonal slices per subspace", self.diagonal, 1, _MOST_SLICES)
        _check_count("samples per slice", self.slice_samples, 4, _MOST_SAMPLES)
        _check_count("samples per slice at the lowest pair", self.lowest_samples, 4, _MOST_SAMPLES)

    @classmethod
    def for_material(  # type: ignore[override]
        cls, material: Brdf | None = None, *, samples: int | None = None, isotropic: bool = False
    ) -> GantryPlan:
        """Return the thesis's plan, or the one for some samples (see ``gantry_plan``)."""
        if samples is None:
            return cls(axial=0 if isotropic else 1)
        return gantry_plan(samples, isotropic)

    @classmethod
    def restored(cls, settings: Mapping[str, Any], angles: np.ndarray) -> Self:
        """Return the plan of a stored measurement (see ``Plan.restored``)."""
        lists: dict[str, Any] = {"thetas": tuple(settings["thetas"])}
        if settings.get("filmed"):
            lists["filmed"] = tuple(tuple(own) for own in settings["filmed"])
        return cls(**{**settings, **lists})

    def check_layout(self, angles: np.ndarray, layout: Mapping[str, np.ndarray]) -> None:
        """Refuse directions that are not those of the slices."""
        if len(angles) != self.samples or not np.allclose(angles, self.angles(), atol=1e-9):
            raise SimrigError("its directions are not those of its plan")

    @classmethod
    def from_degrees(cls, *thetas_deg: float, **settings: int) -> Self:
        """Return the plan for polar angles in degrees; settings as the fields of the class.

        Raises:
            SimrigError: for polar angles or numbers that do not fit (see the class).
        """
        return cls(tuple(np.radians(thetas_deg).tolist()), **settings)  # type: ignore[arg-type]

    @property
    def theta_max(self) -> float:
        """The largest polar angle in radians."""
        return self.thetas[-1]

    @property
    def pairs(self) -> list[tuple[int, int]]:
        """Numbers (illumination, view) of the polar angles of every subspace."""
        numbers = range(len(self.thetas))
        return list(product(numbers, numbers))

    @property
    def offsets(self) -> tuple[np.ndarray, np.ndarray]:
        """α of the axial and β of the diagonal slices of a subspace, in radians."""
        first = _SINGLE_AXIAL if self.axial == 1 else np.pi
        alpha = first + np.arange(self.axial) * (TWO_PI / max(self.axial, 1))
        return alpha, np.arange(self.diagonal) * (TWO_PI / self.diagonal)

    @cached_property
    def slices(self) -> tuple[GantrySlice, ...]:
        """Every slice: by pair, axial ones first."""
        alpha, beta = self.offsets
        found: list[GantrySlice] = []
        for pair in self.pairs:
            count = self.lowest_samples if pair == (0, 0) else self.slice_samples
            steps = np.arange(count) * (TWO_PI / count)
            found += [GantrySlice(AXIAL, pair, float(a), steps) for a in alpha]
            found += [
                GantrySlice(DIAGONAL, pair, float(b), self._diagonal_positions(b, steps))
                for b in beta
            ]
        if self.filmed is None:
            return tuple(found)
        if len(self.filmed) != len(found) or min(map(len, self.filmed)) < 4:
            raise SimrigError(f"{len(found)} filmed slices of at least four samples are needed")
        return tuple(
            replace(one, positions=np.array(own))
            for one, own in zip(found, self.filmed, strict=True)
        )

    def _diagonal_positions(self, beta: float, steps: np.ndarray) -> np.ndarray:
        """Return positions that meet both specular highlights, φ_v − φ_i = 180°."""
        highlight = 0.5 * (np.pi + beta)
        positions = steps
        if self.highlights:
            beside = np.array([-_BESIDE_HIGHLIGHT, _BESIDE_HIGHLIGHT])
            positions = np.concatenate([steps, beside, np.pi + beside])
        return np.unique(np.mod(highlight + positions, TWO_PI).round(12))

    @property
    def samples(self) -> int:
        """The number of samples that the plan takes."""
        return sum(len(one.positions) for one in self.slices)

    def angles(self) -> np.ndarray:
        """Return (theta_i, theta_v, phi_i, phi_v) of all samples in radians, slice by slice."""
        parts = []
        for one in self.slices:
            phi_v = one.positions
            phi_i = phi_v - one.offset if one.kind == AXIAL else one.offset - phi_v
            theta = [np.full(len(phi_v), self.thetas[number]) for number in one.pair]
            parts.append(np.stack([*theta, np.mod(phi_i, TWO_PI), phi_v], axis=1))
        return np.concatenate(parts)

    def knots(self) -> Knots:
        """Return where the samples lie along the slices; every sample lies on one slice."""
        count = [len(one.positions) for one in self.slices]
        return Knots(
            first=np.concatenate([[0], np.cumsum(count)]),
            ends=np.full(len(count), PERIODIC),
            length=np.full(len(count), TWO_PI),
            position=np.concatenate([one.positions for one in self.slices]),
            sample=np.arange(sum(count)),
        )

    def describe(self) -> str:
        """Return the plan in words."""
        thetas = ", ".join(f"{theta:g}°" for theta in np.degrees(self.thetas).round(9))
        return (
            f"polar angles {thetas}; {self.axial} axial and {self.diagonal} diagonal slices "
            f"per subspace, {self.samples} samples"
        )


def measured_plan(measurement: Measured) -> GantryPlan:
    """Return the plan of a measurement by a gantry; SimrigError where it was another."""
    return plan_of(measurement, GantryPlan, "slices of a gantry")


def gantry_plan(samples: int, isotropic: bool = False) -> GantryPlan:
    """Return a plan of at most a number of samples.

    The thesis's plan at 168 samples (84 for isotropic materials), fewer samples along the same
    slices below, more slices above; from three of each kind on at the four polar angles that thesis
    section 6.5 recommends (the study ``gantry-slices`` finds two polar angles better before). An
    isotropic material needs no second slice: it gets four polar angles, then denser slices.

    Args:
        samples: the most samples to take.
        isotropic: from diagonal slices alone.

    Raises:
        SimrigError: fewer samples than four for each slice.
    """
    kinds = 1 if isotropic else 2
    if samples < 16 * kinds:
        raise SimrigError(
            f"{samples} samples are too few for a gantry: it needs at least {16 * kinds}"
        )
    many = samples >= 16 * 24 * (1 if isotropic else 2 * 3)
    thetas = (15.0, 30.0, 52.5, 75.0) if many else (30.0, 75.0)
    others = len(thetas) ** 2 - 1
    slices = min(max(1, samples // ((24 * others + 12) * kinds)), 1 if isotropic else _ENOUGH)
    each = min(samples // (kinds * slices), _MOST_SAMPLES)
    lowest = max(4, each // (2 * others + 1))
    return GantryPlan.from_degrees(
        *thetas,
        axial=0 if isotropic else slices,
        diagonal=slices,
        slice_samples=(each - lowest) // others,
        lowest_samples=lowest,
    )


def _check_count(what: str, value: int, least: int, most: int) -> None:
    if value != int(value) or not least <= value <= most:
        raise SimrigError(f"{what}: a whole number from {least} to {most} is needed, got {value}")

"""What a plan is: where a rig is asked to look, batch by batch.

A plan is a generator of batches of directions, and is sent back what was recorded there. Lists that
are known in advance are one batch; adaptive plans choose the next batch from what they were sent.
So a rig carries out any plan alike, and an interrupted measurement goes on by sending the plan
again what was recorded before. The order of the poses within a batch is the rig's affair.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Generator, Mapping
from dataclasses import asdict, dataclass, is_dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, Self, TypeVar

import numpy as np

from simrig.core.errors import SimrigError
from simrig.core.options import Option
from simrig.directions.schemes import LARGEST_THETA_DEG

if TYPE_CHECKING:
    from simrig.brdf.protocol import Brdf

THETA_MAX = Option(
    "theta_max_deg",
    float,
    "Largest polar angle in degrees: 80, or where the material's data end, unless given.",
    least=0.0,
    most=90.0,
)
_ROUNDING_DEG = 5e-5  # files often hold angles as float32


P = TypeVar("P", bound="Plan")


@dataclass(frozen=True, eq=False)
class Recorded:
    """What was recorded at directions.

    Attributes:
        values: (n, 3) f_r in 1/sr, linear RGB.
        uncertainty: (n, 3) standard uncertainty of the values, in 1/sr; None where unknown.
    """

    values: np.ndarray
    uncertainty: np.ndarray | None = None


# yields (n, 4) theta_i, theta_v, phi_i, phi_v in radians, n >= 1; is sent what was recorded there;
# returns its layout: arrays of what the plan knows when it is done, by name (how the samples lie
# along slices, which symmetries it found)
Batches = Generator[np.ndarray, Recorded, Mapping[str, np.ndarray]]


class Plan(ABC):
    """Where to measure. Subclasses are frozen dataclasses, one for each way of choosing directions.

    Attributes:
        name: its key in ``simrig.plans.registry.PLANS``, lower case with hyphens.
        options: what ``for_material`` takes.
        implied_by: options that choose this plan where none is named.
        adaptive: whether directions depend on what was recorded, which costs the rig time.
        pictures: whether the rig must record pictures and not values alone.
        logarithms: whether it works with the logarithms of values, so that none may be negative.
        needs: options that have no default.
    """

    name: ClassVar[str]
    about: ClassVar[str]
    options: ClassVar[tuple[Option, ...]] = ()
    implied_by: ClassVar[tuple[str, ...]] = ()
    adaptive: ClassVar[bool] = False
    pictures: ClassVar[bool] = False
    logarithms: ClassVar[bool] = False
    needs: ClassVar[tuple[str, ...]] = ()

    @property
    def one_order(self) -> bool:
        """Whether a pair is measured in one order alone: light and view may change places."""
        return False

    if TYPE_CHECKING:  # fields of some plans; a base class's property would be in their way

        @property
        def theta_max(self) -> float:
            """The largest polar angle that the plan asks for, in radians."""

        @property
        def samples(self) -> int:
            """How many samples the plan takes: exactly, or of some adaptive plans at most."""

    def shots(self, samples: int) -> int:
        """Return how many times the rig moves and exposes for the first so many samples."""
        return samples

    def check_instrument(self, instrument: Any) -> None:
        """Raise SimrigError where the plan was laid out for another instrument; most fit any.

        Args:
            instrument: its numbers (``simrig.instruments.instrument.Instrument``).
        """
        return

    @classmethod
    @abstractmethod
    def for_material(cls, material: Brdf | None, **options: Any) -> Self:
        """Return the plan that options give for a material; those not given have their defaults.

        Raises:
            SimrigError: options that cannot be, or that contradict each other.
        """

    @abstractmethod
    def batches(self) -> Batches:
        """Yield directions to measure until the plan is done (see ``Batches``)."""

    @abstractmethod
    def describe(self) -> str:
        """Return the plan in words, in one line."""

    def settings(self) -> dict[str, Any]:
        """Return plain values from which, with the measured directions, it is restored."""
        if not is_dataclass(self):
            raise TypeError(f"{type(self).__name__} is no dataclass: it needs its own settings()")
        return asdict(self)

    @classmethod
    def restored(cls, settings: Mapping[str, Any], angles: np.ndarray) -> Self:
        """Return the plan of a stored measurement.

        Args:
            settings: what ``settings`` gave.
            angles: (n, 4) the directions that were measured, in radians.

        Raises:
            SimrigError, TypeError, KeyError, ValueError: they do not make a plan.
        """
        return cls(**settings)

    def check_layout(self, angles: np.ndarray, layout: Mapping[str, np.ndarray]) -> None:
        """Raise SimrigError where what the batches returned does not fit the directions.

        By default nothing is returned, and anything fits.
        """
        return

    def found(self, values: np.ndarray, layout: Mapping[str, np.ndarray]) -> dict[str, Any]:
        """Return what the plan found out about the material, as plain values for provenance.

        Args:
            values: (n, 3) f_r that were recorded, in order.
            layout: what the batches returned.

        Returns:
            ``lines`` for people, and whatever else there is; nothing of plans that find nothing.
        """
        return {}

    def probe(self, most: int) -> Plan:
        """Return a plan that looks where this one does, of about ``most`` samples or fewer."""
        return self


class MeasuredPairs(Protocol):
    """Values at any directions: what a method that knows no plan reads of a measurement."""

    @property
    def material(self) -> str: ...
    @property
    def theta_i(self) -> np.ndarray: ...
    @property
    def theta_v(self) -> np.ndarray: ...
    @property
    def phi_i(self) -> np.ndarray: ...
    @property
    def phi_v(self) -> np.ndarray: ...
    @property
    def values(self) -> np.ndarray: ...
    @property
    def gamut(self) -> str: ...


class Measured(MeasuredPairs, Protocol):
    """What plans and reconstructions read of a measurement (``simrig.rigs.measurements``)."""

    @property
    def plan(self) -> Plan: ...
    @property
    def angles(self) -> np.ndarray: ...
    @property
    def layout(self) -> Mapping[str, np.ndarray]: ...


def plan_of(measurement: Measured, kind: type[P], has: str) -> P:
    """Return the plan of a measurement, which has to be of a kind.

    Args:
        has: what a measurement by such a plan has, such as "slices".

    Raises:
        SimrigError: it was measured by another plan.
    """
    if not isinstance(measurement.plan, kind):
        raise SimrigError(
            f"the measurement of '{measurement.material}' has no {has}, its plan is "
            f"'{measurement.plan.name}': measure with the plan '{kind.name}'"
        )
    return measurement.plan


class ListedPlan(Plan):
    """A plan whose directions are known in advance: one batch."""

    @abstractmethod
    def angles(self) -> np.ndarray:
        """Return (n, 4) theta_i, theta_v, phi_i, phi_v in radians."""

    @property
    def samples(self) -> int:
        """How many samples the plan takes."""
        return len(self.angles())

    def batches(self) -> Batches:
        """Yield all directions at once."""
        yield self.angles()
        return {}

    def probe(self, most: int) -> Plan:
        """Return every so many of the directions."""
        from simrig.plans.listed import Directions

        angles = self.angles()
        return Directions(angles[:: -(-len(angles) // most)])


def largest_theta_deg(material: Brdf | None, wished: float | None = None) -> float:
    """Return theta_max of a plan in degrees.

    Without a wish: 80, or where the material's data end earlier, that rounded down to whole
    degrees.

    Raises:
        SimrigError: a wish outside (0, 90) degrees or beyond the data.
    """
    end = 90.0 if material is None else float(np.degrees(material.theta_max))
    if wished is None:
        return min(LARGEST_THETA_DEG, float(np.floor(end + _ROUNDING_DEG)))
    if not 0.0 < wished < 90.0:
        raise SimrigError(f"theta_max must lie between 0 and 90 degrees, got {wished:g}")
    if material is not None and wished > end + _ROUNDING_DEG:
        raise SimrigError(
            f"theta_max is {wished:g} degrees, but '{material.name}' has data up to theta = "
            f"{end:g} degrees: lower theta_max"
        )
    return wished

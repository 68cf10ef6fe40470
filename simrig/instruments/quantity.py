"""A number of an instrument, with its uncertainty where one is known."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, model_validator


class Part(BaseModel):
    """Any table of an instrument file: nothing unknown in it, no infinity, no guessed type."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


class Quantity(Part):
    """A number, or ``{value, u, dist, group}``.

    Attributes:
        value: in the unit that the key's name ends in.
        u: its standard uncertainty (JCGM 100), in the same unit.
        dist: the distribution that ``u`` is of.
        group: quantities of one group are off together (drawn once for an instrument).
    """

    value: float
    u: float = 0.0
    dist: Literal["normal", "uniform", "triangular"] = "normal"
    group: str | None = None

    @model_validator(mode="before")
    @classmethod
    def _from_number(cls, given: Any) -> Any:
        number = isinstance(given, int | float) and not isinstance(given, bool)
        return {"value": given} if number else given

    @model_validator(mode="after")
    def _check(self) -> Quantity:
        if self.u < 0.0:
            raise ValueError(f"the standard uncertainty u must be >= 0, got {self.u:g}")
        return self


def between(least: float, most: float = math.inf) -> AfterValidator:
    """Return the check that a quantity is in [least, most]."""

    def check(quantity: Quantity) -> Quantity:
        if not least <= quantity.value <= most:
            limit = f"from {least:g} to {most:g}" if math.isfinite(most) else f">= {least:g}"
            raise ValueError(f"must be {limit}, got {quantity.value:g}")
        return quantity

    return AfterValidator(check)


def _above_zero(quantity: Quantity) -> Quantity:
    if not quantity.value > 0.0:
        raise ValueError(f"must be above 0, got {quantity.value:g}")
    return quantity


Positive = Annotated[Quantity, AfterValidator(_above_zero)]
NotNegative = Annotated[Quantity, between(0.0)]
Share = Annotated[Quantity, between(0.0, 1.0)]
AtLeastOne = Annotated[Quantity, between(1.0)]

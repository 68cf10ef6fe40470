"""A number of an instrument, with its uncertainty where one is known."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, model_validator

from simrig.core.errors import SimrigError


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


def quantities_of(part: BaseModel, within: str = "", given: bool = False) -> dict[str, Quantity]:
    """Return the numbers of an instrument by ``table.key``.

    Args:
        part: the instrument, or one of its tables.
        within: where the table is; of tables in a list it is their name.
        given: only numbers that were given, not those that have their default.
    """
    found: dict[str, Quantity] = {}
    for key in part.model_fields_set if given else type(part).model_fields:
        value = getattr(part, key)
        if isinstance(value, Quantity):
            found[f"{within}{key}"] = value
        elif isinstance(value, BaseModel):
            found |= quantities_of(value, f"{within}{key}.", given)
        elif isinstance(value, list):
            for one in value:
                if isinstance(one, BaseModel):
                    place = f"{within}{key}.{getattr(one, 'name', '')}."
                    found |= quantities_of(one, place, given)
    return found


def check_groups(quantities: Mapping[str, Quantity]) -> None:
    """Refuse groups whose quantities do not say one distribution: they are drawn as one.

    Raises:
        SimrigError: naming the group and two of its quantities.
    """
    first: dict[str, str] = {}
    for path, quantity in quantities.items():
        if quantity.group is None or not quantity.u:
            continue
        other = first.setdefault(quantity.group, path)
        if quantities[other].dist != quantity.dist:
            raise SimrigError(
                f"group '{quantity.group}' is drawn as one, but '{other}' says dist = "
                f"'{quantities[other].dist}' and '{path}' says '{quantity.dist}': give both the "
                "same dist, or groups of their own"
            )


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

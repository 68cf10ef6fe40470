"""What an instrument's calibration leaves, and what could be bought in its place.

Both serve the uncertainty budget (docs/uncertainty.md). A residual is what remains of an error
after the instrument was calibrated: its ``value`` is the expected rest, mostly 0, its ``u`` how
well that is known. One that is left out has no stated uncertainty, and the budget says so.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Annotated

from pydantic import AfterValidator, Field

from simrig.core.errors import SimrigError, check_known
from simrig.instruments.quantity import NotNegative, Part, Positive, Quantity, between

Residual = Annotated[Quantity, between(-1.0, 1.0)]
_ZERO = Quantity(value=0.0)


def _not_empty(replaces: dict[str, Quantity]) -> dict[str, Quantity]:
    if not replaces:
        raise ValueError("must name at least one number that it changes")
    return replaces


class Calibration(Part):
    """``[calibration]``.

    Attributes:
        reference_f_r_per_sr: of the white standard that is read at 0:45 and that every value is
            divided by; without it f_r is measured absolutely, from distances and apertures.
        interval_h: hours between two readings of the standard, over which the light drifts.
        flat_field: relative error of the irradiance at the sample against that at the standard.
        spectral_mismatch: share of a channel's band that lies in those of the others.
        colour_matrix: of the matrix from the sensor's to linear RGB, each element; white is kept,
            so that the rows' errors cancel, and all nine are off together.
        linearity: relative error of the response from an empty to a full pixel.
        black_DN: of the dark level that is subtracted, in steps of the converter.
    """

    reference_f_r_per_sr: Positive | None = None
    interval_h: Positive | None = None
    flat_field: Residual = _ZERO
    spectral_mismatch: Residual = _ZERO
    colour_matrix: Residual = _ZERO
    linearity: Residual = _ZERO
    black_DN: Annotated[Quantity, between(-1000.0, 1000.0)] = _ZERO


class Alternative(Part):
    """``[[alternative]]``: what could be bought in the place of what is there.

    Attributes:
        name: for people.
        price_eur: in addition to what is there.
        replaces: numbers that it changes, by ``table.key``; ``axis.key`` is that of all four axes.
    """

    name: Annotated[str, Field(min_length=1)]
    price_eur: NotNegative
    replaces: Annotated[dict[str, Quantity], AfterValidator(_not_empty)]


def check_alternatives(known: Iterable[str], alternatives: Iterable[Alternative]) -> None:
    """Refuse alternatives that replace what the instrument does not have.

    Args:
        known: the numbers of the instrument, ``table.key`` or ``axis.name.key``.
        alternatives: of its file.

    Raises:
        SimrigError: an unknown key, with the nearest known one, or two of one name.
    """
    every = {path: path for path in known}
    every |= {_of_all_axes(path): path for path in every}
    names: set[str] = set()
    for one in alternatives:
        if one.name in names:
            raise SimrigError(f"[[alternative]] '{one.name}' is described twice: rename one")
        names.add(one.name)
        for key in one.replaces:
            check_known(f"number in replaces of [[alternative]] '{one.name}'", key, every)


def replaced(
    quantities: Mapping[str, Quantity], changes: Mapping[str, Quantity]
) -> dict[str, Quantity]:
    """Return the numbers of an instrument with those of an alternative in their place."""
    return {
        path: changes.get(path, changes.get(_of_all_axes(path), quantity))
        for path, quantity in quantities.items()
    }


def _of_all_axes(path: str) -> str:
    first, *_, last = path.split(".")
    return f"{first}.{last}"

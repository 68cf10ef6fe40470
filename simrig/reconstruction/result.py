"""What a method gives back."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

from simrig.brdf.protocol import Brdf


@dataclass(frozen=True, eq=False)
class Reconstructed:
    """What a method made of a measurement.

    Attributes:
        bytes: storage of the result.
        notes: what a reader must know: nodes, condition numbers, fall-backs.
    """

    brdf: Brdf
    bytes: int
    notes: tuple[str, ...] = ()

    @classmethod
    def of(cls, brdf: Brdf, *notes: str) -> Self:
        """Return a result that is stored as it is."""
        return cls(brdf, brdf.stored_bytes, notes)

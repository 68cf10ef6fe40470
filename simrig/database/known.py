"""What a database says, opened once: its slices, basis and process."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

from simrig.database.process import RotationProcess
from simrig.database.slices import SliceBasis, Slices
from simrig.database.store import Database


@dataclass(frozen=True, eq=False)
class Known:
    """A database with what is computed from it when it is asked for."""

    database: Database
    fingerprint: str

    @cached_property
    def slices(self) -> Slices:
        """The slices of its materials."""
        return Slices.of(self.database)

    @cached_property
    def basis(self) -> SliceBasis:
        """The basis of all of them."""
        return self.slices.basis()

    @cached_property
    def process(self) -> RotationProcess:
        """The process of all of them."""
        return RotationProcess.of(self.basis)


def known(text: str) -> Known:
    """Return what the database of folders says (see ``Database.open``)."""
    database = Database.open(text)
    return _known(text, database.fingerprint)


@lru_cache(maxsize=2)
def _known(text: str, fingerprint: str) -> Known:
    return Known(Database.open(text), fingerprint)

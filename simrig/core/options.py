"""Options that plans, rigs and methods declare, so that a front end can offer them by name.

A front end (the command line, a file, a program) collects what is declared, and gives each maker
the options that it declares. An option that the chosen one does not have is refused, with who has
it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

from simrig.core.errors import SimrigError, unknown_name

N = TypeVar("N", int, float)
_UNITS = {"_deg": "degrees", "_mm": "mm", "_s": "seconds"}


@dataclass(frozen=True)
class Option:
    """One setting of a plan, a rig or a method.

    Attributes:
        name: as Python takes it, the unit at its end: ``theta_step_deg``.
        type: ``int``, ``float``, ``str`` or ``bool``.
        default: what stands when it is not given; None where that depends on other things (then
            ``about`` says on what).
        choices: of a text, the only ones.
        least, most: of a number, inclusive.
        short: of the command line, for example ``-n``.
    """

    name: str
    type: type
    about: str
    default: Any = None
    choices: tuple[str, ...] = ()
    least: float = -math.inf
    most: float = math.inf
    short: str = ""

    @property
    def unit(self) -> str:
        """The unit that the name ends in, or nothing."""
        return next((unit for end, unit in _UNITS.items() if self.name.endswith(end)), "")

    @property
    def flag(self) -> str:
        """The name on the command line, without its unit: ``--theta-step``."""
        bare = next((self.name.removesuffix(e) for e in _UNITS if self.name.endswith(e)), self.name)
        return "--" + bare.replace("_", "-")

    def checked(self, value: Any) -> Any:
        """Return a value of the option's type.

        Raises:
            SimrigError: another type, a number that is not finite or out of range, an unknown
                choice.
        """
        if self.type in (int, float):
            return self._checked_number(value)
        if not isinstance(value, self.type):
            wanted = "true or false" if self.type is bool else "a text"
            raise SimrigError(f"{self.flag} must be {wanted}, got {value!r}")
        if self.choices and value not in self.choices:
            raise unknown_name(f"value of {self.flag}", str(value), self.choices)
        return value

    def _checked_number(self, value: Any) -> int | float:
        kinds = int if self.type is int else (int, float)
        number = isinstance(value, kinds) and not isinstance(value, bool)
        if not number or not math.isfinite(value) or not self.least <= value <= self.most:
            what = "a whole number" if self.type is int else "a number"
            if math.isfinite(self.most):
                what += f" from {self.least:g} to {self.most:g}"
            elif math.isfinite(self.least):
                what += f" of at least {self.least:g}"
            unit = f" {self.unit}" if self.unit else ""
            raise SimrigError(f"{self.flag} must be {what}{unit}, got {value!r}")
        return self.type(value)


class Declares(Protocol):
    """What has a name, says in one line what it is, and declares options."""

    @property
    def name(self) -> str: ...
    @property
    def about(self) -> str: ...
    @property
    def options(self) -> tuple[Option, ...]: ...


def checked_options(
    chosen: Declares, given: Mapping[str, Any], others: Iterable[Declares] = (), what: str = ""
) -> dict[str, Any]:
    """Return the options that were given (None is: not given), each checked.

    Args:
        others: who may have what ``chosen`` does not, for the message.
        what: ``chosen`` is, for the message: ``"plan"``.

    Raises:
        SimrigError: an option that ``chosen`` does not declare, or a value that cannot be.
    """
    declared = {option.name: option for option in chosen.options}
    checked = {}
    for name, value in given.items():
        if value is None:
            continue
        if name not in declared:
            raise _not_of(chosen, name, list(others), what)
        checked[name] = declared[name].checked(value)
    return checked


def _not_of(chosen: Declares, name: str, others: list[Declares], what: str) -> SimrigError:
    having = [other.name for other in others if name in {o.name for o in other.options}]
    if not having:
        return unknown_name(
            f"option of {what} '{chosen.name}'", name, (o.name for o in chosen.options)
        )
    flag = Option(name, str, "").flag
    return SimrigError(
        f"{what} '{chosen.name}' has no {flag}, {', '.join(having)} "
        f"{'has' if len(having) == 1 else 'have'}: leave it out or choose another {what}"
    )


def numbers_of(text: str, what: str, kind: Callable[[str], N]) -> list[N]:
    """Return the numbers of a text such as ``0,30,60``.

    Args:
        what: they are, in the plural, for the message.
        kind: ``int`` or ``float``.

    Raises:
        SimrigError: something that is no such number.
    """
    try:
        return [kind(part) for part in text.split(",")]
    except ValueError:
        raise SimrigError(
            f"'{text}' is no list of {what}: give numbers with commas between"
        ) from None

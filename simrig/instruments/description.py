"""What an instrument file says: the tables and keys, each number checked (docs/instruments.md).

Units are in the names of the keys. An unknown key is refused, so nothing that a file says is
ignored.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, Field, ValidationError

from simrig.core.errors import SimrigError, check_known, unknown_name
from simrig.files.text import read_toml
from simrig.instruments.calibration import Alternative, Calibration, check_alternatives
from simrig.instruments.filming import Film
from simrig.instruments.parts import (
    About,
    Axis,
    Camera,
    Coupling,
    Dome,
    Lens,
    Light,
    Mirror,
    PolarCamera,
    PolarLight,
    Registration,
    Sample,
    SampleTiming,
    SliceTiming,
    each_once,
)
from simrig.instruments.quantity import Part, Quantity, check_groups, quantities_of
from simrig.instruments.reflector_parts import Ellipsoid, ProjectorPart

SHIPPED = {
    "utia": "utia.toml",
    "utia-large": "utia_large.toml",
    "utia-btf": "utia_btf.toml",
    "merkur-gantry": "merkur_gantry.toml",
    "steady-gantry": "steady_gantry.toml",
    "dome-151": "dome_151.toml",
    "reflector": "reflector.toml",
    "reflector-projector": "reflector_projector.toml",
}


class Description(Part):
    """An instrument file. Each kind of instrument adds the tables that it needs."""

    instrument: About


class GonioreflectometerDescription(Description):
    """One light and one camera anywhere above the sample, on four axes."""

    axis: Annotated[list[Axis], AfterValidator(each_once)]
    sample: Sample
    camera: Camera
    lens: Lens
    other_lens: list[Lens] = Field(default=[])
    light: Light
    mirror: Mirror | None = None
    registration: Registration | None = None
    timing: SampleTiming
    calibration: Calibration = Calibration()
    alternative: Annotated[list[Alternative], Field(default_factory=list)]

    def with_lens(self, f_mm: float) -> GonioreflectometerDescription:
        """Return the instrument with another of its lenses.

        Raises:
            SimrigError: it has none of this focal length.
        """
        known = {lens.f_mm.value: lens for lens in (self.lens, *self.other_lens)}
        if f_mm not in known:
            lengths = ", ".join(f"{f:g}" for f in sorted(known))
            raise SimrigError(
                f"'{self.instrument.name}' has no lens of {f_mm:g} mm: choose one of {lengths} mm"
            )
        return self.model_copy(update={"lens": known[f_mm]})


class GantryDescription(Description):
    """Lights and cameras at fixed polar angles on two arms that turn around the normal."""

    camera: PolarCamera | None = None
    light: PolarLight | None = None
    lens: Lens | None = None
    registration: Registration | None = None
    coupling: list[Coupling] = Field(default=[])
    sample: Sample | None = None
    timing: SliceTiming
    film: Film | None = None


class BtfDescription(Description):
    """Light and camera far away; a registered image in place of a value."""

    timing: SampleTiming


class DomeDescription(Description):
    """Cameras and lights that stand around the sample and never move."""

    dome: Dome
    sample: Sample
    camera: Camera | None = None
    lens: Lens | None = None
    light: Light | None = None
    registration: Registration | None = None
    timing: SampleTiming


class ReflectorDescription(Description):
    """A mirror around the sample, seen and lit along its axis; no axes."""

    reflector: Ellipsoid
    projector: ProjectorPart | None = None
    sample: Sample
    timing: SampleTiming


KINDS: dict[str, type[Description]] = {
    "gonioreflectometer": GonioreflectometerDescription,
    "btf": BtfDescription,
    "gantry": GantryDescription,
    "dome": DomeDescription,
    "reflector": ReflectorDescription,
}


@cache
def shipped(name: str) -> Description:
    """Return an instrument that comes with simrig: a key of ``SHIPPED``.

    Raises:
        SimrigError: unknown name, with the nearest known one.
    """
    check_known("instrument", name, SHIPPED)
    text = files("simrig.instruments").joinpath(SHIPPED[name]).read_text(encoding="utf-8")
    return described(tomllib.loads(text))


def read_description(path: str | Path) -> Description:
    """Read an instrument file.

    Raises:
        SimrigError: no such file, no TOML, a key that is unknown (with the nearest known one),
            missing or given twice, or a value of the wrong type or out of range.
    """
    table = read_toml(path, "an instrument")
    try:
        return described(table)
    except SimrigError as error:
        raise SimrigError(f"'{path}': {error}") from error


def described(table: Mapping[str, Any]) -> Description:
    """Return what a parsed instrument file says.

    Raises:
        SimrigError: see ``read_description``.
    """
    about = table.get("instrument")
    if not isinstance(about, Mapping) or not isinstance(about.get("kind"), str):
        raise SimrigError(
            f"[instrument] needs a 'kind' in quotes, one of: {', '.join(sorted(KINDS))}"
        )
    check_known("kind of instrument", about["kind"], KINDS)
    kind = KINDS[about["kind"]]
    try:
        made = kind.model_validate(table)
    except ValidationError as error:
        raise _refused(kind, error) from error
    numbers = quantities_of(made)
    check_groups(numbers)
    check_alternatives(numbers, getattr(made, "alternative", ()))
    return made


def _refused(kind: type[BaseModel], error: ValidationError) -> SimrigError:
    """Return one of a file's faults in one line: of a misspelt key that it is unknown."""
    faults = error.errors(include_url=False)
    fault = next((f for f in faults if f["type"] == "extra_forbidden"), faults[0])
    table, keys = _place(fault["loc"])
    if fault["type"] == "extra_forbidden":
        known = _known_keys(kind, fault["loc"][:-1])
        return unknown_name(f"key in {table}", str(fault["loc"][-1]), known)
    if fault["type"] == "missing":
        return SimrigError(f"'{fault['loc'][-1]}' is missing in {table}")
    message = fault["msg"]
    if message.startswith("Value error, "):
        message = message.removeprefix("Value error, ")
    else:
        message = f"{message[:1].lower()}{message[1:]}, got {fault['input']!r:.40}"
    if "dictionary" in message:  # what pydantic calls a table; a quantity is a number as well
        wanted = "a number or {value, u, dist, group}" if "Quantity" in message else "a table"
        message = f"must be {wanted}, got {fault['input']!r:.40}"
    return SimrigError(f"'{keys}' in {table}: {message}")


def _place(where: tuple[int | str, ...]) -> tuple[str, str]:
    """Return the table and the key that a fault's place names; a table is in the file."""
    if len(where) < 2:
        return "the file", str(where[0]) if where else ""
    if isinstance(where[1], int):
        return f"[[{where[0]}]] number {where[1] + 1}", str(where[2] if len(where) > 2 else "")
    return f"[{where[0]}]", str(where[1])


def _known_keys(kind: type[BaseModel], where: tuple[int | str, ...]) -> list[str]:
    """Return the keys of the table at a place; those of a quantity are its own four."""
    model: Any = kind
    for step in where:
        if isinstance(step, str) and model is not Quantity:  # a key of a table of quantities
            annotation = model.model_fields[step].annotation
            inner = getattr(annotation, "__args__", None) or (annotation,)
            tables = (a for a in inner if isinstance(a, type) and issubclass(a, BaseModel))
            model = next(tables, Quantity)
    return list(model.model_fields)

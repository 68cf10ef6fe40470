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
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, Field, ValidationError

from simrig.core.errors import SimrigError, check_known, unknown_name
from simrig.files.text import read_toml
from simrig.instruments.calibration import Alternative, Calibration, check_alternatives
from simrig.instruments.instrument import AXES
from simrig.instruments.quantity import (
    AtLeastOne,
    NotNegative,
    Part,
    Positive,
    Quantity,
    Share,
    between,
    check_groups,
    quantities_of,
)

SHIPPED = {
    "utia": "utia.toml",
    "utia-btf": "utia_btf.toml",
    "merkur-gantry": "merkur_gantry.toml",
    "steady-gantry": "steady_gantry.toml",
}

_ZERO = Quantity(value=0.0)


def _checked_range(ends: list[float]) -> list[float]:
    if not ends[0] < ends[1]:
        raise ValueError(f"must be two ascending angles, got {ends}")
    return ends


class About(Part):
    """``[instrument]``: what it is.

    Attributes:
        name: for people.
        kind: which rig works with it, a key of ``KINDS``.
        version: of the file's numbers.
        source: where they come from.
    """

    name: Annotated[str, Field(min_length=1)]
    kind: str
    version: str = "1"
    source: str = ""


class Axis(Part):
    """``[[axis]]``: one motion.

    Attributes:
        name: of ``AXES``, the angle that it sets.
        range_deg: what it reaches.
        repeatability_deg: largest error of a move (±), uniform, independent from move to move.
        offset_deg: of its zero, the same in all moves.
    """

    name: Literal["theta_i", "theta_v", "phi_i", "phi_v"]
    range_deg: Annotated[
        list[float], Field(min_length=2, max_length=2), AfterValidator(_checked_range)
    ]
    repeatability_deg: NotNegative = _ZERO
    offset_deg: Annotated[Quantity, between(-10.0, 10.0)] = _ZERO


def _each_once(axes: list[Axis]) -> list[Axis]:
    names: list[str] = [axis.name for axis in axes]
    for name in AXES:
        if names.count(name) != 1:
            raise ValueError(f"one [[axis]] named '{name}' is needed, got {names.count(name)}")
    return axes


class Sample(Part):
    """``[sample]``: what lies under the instrument.

    Attributes:
        diameter_mm: of the material; around it lies a border.
        border_albedo: of that border.
        spot_diameter_mm: of the area over which a value is averaged.
        height_mm: of the surface above the point that the axes turn about.
        tilt_deg: of the surface's normal, about x and about y each.
    """

    diameter_mm: Positive
    border_albedo: Share = _ZERO
    spot_diameter_mm: Positive
    height_mm: Annotated[Quantity, between(-100.0, 100.0)] = _ZERO
    tilt_deg: Annotated[Quantity, between(-10.0, 10.0)] = _ZERO


class Camera(Part):
    """``[camera]``: the sensor (symbols of EMVA 1288).

    Attributes:
        distance_mm: from the sample's centre.
        bits: of the analogue-to-digital converter.
        mu_sat_e: electrons at which a pixel saturates.
        sigma_d_e: electrons of dark (read-out) noise.
        pixels_averaged: in a value.
        saturation_per_sr: radiance at which the shortest exposure saturates, over the irradiance
            at normal incidence.
        exposure_range_ev: binary logarithm of the longest over the shortest exposure.
        PRNU_pct: standard deviation of the pixels' response, in per cent of it.
    """

    distance_mm: Positive
    bits: Annotated[int, Field(ge=1, le=32)]
    mu_sat_e: AtLeastOne
    sigma_d_e: NotNegative
    pixels_averaged: Annotated[int, Field(ge=1)]
    saturation_per_sr: Positive
    exposure_range_ev: NotNegative
    PRNU_pct: Annotated[Quantity, between(0.0, 100.0)] = _ZERO


class Lens(Part):
    """``[lens]``.

    Attributes:
        f_mm, f_number: focal length and stop; their ratio is the diameter of the aperture.
        blur_diameter_mm: of a point's picture on the sample where it is in focus.
    """

    f_mm: Positive
    f_number: Positive
    blur_diameter_mm: NotNegative = _ZERO


class Light(Part):
    """``[light]``.

    Attributes:
        distance_mm: from the sample's centre.
        diameter_mm: of the emitting area.
        non_uniformity: irradiance at the rim of the spot over that at its centre, less 1, that
            remains after the calibration.
        stray: radiance of stray light over that of a white diffuser.
        drift_pct_h: of its intensity, in per cent an hour.
    """

    distance_mm: Positive
    diameter_mm: NotNegative = _ZERO
    non_uniformity: NotNegative = _ZERO
    stray: NotNegative = _ZERO
    drift_pct_h: Annotated[Quantity, between(-100.0, 100.0)] = _ZERO


class Mirror(Part):
    """``[mirror]``: one around the sample, such as a reflector's.

    Attributes:
        reflectance: of the mirror.
        coverage: the part of the hemisphere (by projected solid angle) that it covers.
    """

    reflectance: Share
    coverage: Share


class SampleTiming(Part):
    """``[timing]`` of what records sample by sample: (set-up + n · per sample) · overhead.

    Attributes:
        set_up_s: before the first sample.
        per_sample_s: to position, expose and transfer one sample.
        adaptive_overhead: factor for adaptive plans (processing between the iterations).
    """

    set_up_s: NotNegative
    per_sample_s: Positive
    adaptive_overhead: AtLeastOne = Quantity(value=1.0)


class SliceTiming(Part):
    """``[timing]`` of what records whole slices as video.

    Attributes:
        slice_s: one recording, a full turn of the arms.
        change_s: between two recordings (lights, gears, camera).
        cameras: how many record at once, at different polar angles, or ``"all"``.
    """

    slice_s: Positive
    change_s: NotNegative
    cameras: Annotated[int, Field(ge=1)] | Literal["all"] = 1


class Description(Part):
    """An instrument file. Each kind of instrument adds the tables that it needs."""

    instrument: About


class GonioreflectometerDescription(Description):
    """One light and one camera anywhere above the sample, on four axes."""

    axis: Annotated[list[Axis], AfterValidator(_each_once)]
    sample: Sample
    camera: Camera
    lens: Lens
    light: Light
    mirror: Mirror | None = None
    timing: SampleTiming
    calibration: Calibration = Calibration()
    alternative: Annotated[list[Alternative], Field(default_factory=list)]


class GantryDescription(Description):
    """Lights and cameras at fixed polar angles on two arms that turn around the normal."""

    timing: SliceTiming


class BtfDescription(Description):
    """Light and camera far away; a registered image in place of a value."""

    timing: SampleTiming


KINDS: dict[str, type[Description]] = {
    "gonioreflectometer": GonioreflectometerDescription,
    "btf": BtfDescription,
    "gantry": GantryDescription,
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

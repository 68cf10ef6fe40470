"""The rigs by name, and from instrument files. A new rig is one more entry."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from simrig.core.errors import SimrigError, unknown_name
from simrig.core.options import checked_options
from simrig.instruments.description import SHIPPED, Description, read_description, shipped
from simrig.rigs.btf.device import BtfRig
from simrig.rigs.direct.gonioreflectometer import Gonioreflectometer
from simrig.rigs.gantry.rig import Gantry
from simrig.rigs.imaging.rig import ImagingRig
from simrig.rigs.protocol import Rig
from simrig.rigs.reflector.rig import ReflectorRig

RIGS: dict[str, type[Rig]] = {
    rig.name: rig for rig in (Gonioreflectometer, Gantry, BtfRig, ImagingRig, ReflectorRig)
}
_LEVELS = {("gonioreflectometer", "imaging"): ImagingRig.name}  # kind of instrument, level
_USUAL = {
    "gonioreflectometer": "utia",
    "gantry": "merkur-gantry",
    "btf": "utia-btf",
    "imaging": "utia",
}  # instrument of each


def make_rig(text: str | Path, **options: Any) -> Rig:
    """Return a rig by name or from an instrument file.

    Args:
        text: a key of ``RIGS``, an instrument that comes with simrig, or the path of a TOML file.
        options: of the rig; None is: not given.

    Raises:
        SimrigError: an unknown name, what ``read_description`` refuses, or an option that the rig
            does not have.
    """
    if str(text) == ImagingRig.name:
        options = {"level": "imaging", **{k: v for k, v in options.items() if v is not None}}
    # what is called 'reflector' as an instrument has a flash; the rig needs a projector
    named = "reflector-projector" if str(text) == ReflectorRig.name else text
    return rig_of(find_description(named), **options)


def find_description(text: str | Path) -> Description:
    """Return the instrument that a text names (see ``make_rig``).

    Raises:
        SimrigError: an unknown name, or what ``read_description`` refuses.
    """
    name = str(text)
    if name.endswith(".toml"):
        return read_description(text)
    if name in RIGS or name in SHIPPED:
        return shipped(_USUAL.get(name, name))
    raise unknown_name("rig (and no .toml file)", name, (*RIGS, *SHIPPED))


def rig_of(description: Description, **options: Any) -> Rig:
    """Return the rig of an instrument.

    Raises:
        SimrigError: an option that the rig does not have, or numbers that contradict each other.
    """
    if description.instrument.kind not in RIGS:
        raise SimrigError(
            f"no rig measures with an instrument of kind '{description.instrument.kind}' yet: "
            "'simrig instrument' draws it"
        )
    kind = RIGS[description.instrument.kind]
    level = _LEVELS.get((kind.name, str(options.get("level"))))
    kind = kind if level is None else RIGS[level]
    made = checked_options(kind, options, RIGS.values(), "rig")
    try:
        return kind.from_description(description, **made)
    except SimrigError as error:
        raise SimrigError(f"instrument '{description.instrument.name}': {error}") from error

"""BSDFs from BRDFs in memory, and plain errors from scenes that Mitsuba loads."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from simrig.brdf.protocol import Brdf
from simrig.btf.spatial import SpatialBrdf
from simrig.core.errors import SimrigError, unknown_name
from simrig.plugins.notes import warnings_in_words

BTF_NUMBERS = ("scale", "scale_v", "rotation", "pixel_angle", "pixel_width", "unit")


def make_bsdf(brdf: Brdf, rotation_deg: float = 0.0) -> Any:
    """Return a Mitsuba BSDF of a BRDF, for use as a value in scene dictionaries.

    Args:
        rotation_deg: rotation of the material about its normal, in degrees.

    Raises:
        SimrigError: when no Mitsuba variant is selected.
    """
    import mitsuba as mi

    from simrig.plugins.register import register

    if mi.variant() is None:
        raise SimrigError("no variant is set: call simrig.core.backend.select() first")
    return register()(mi.Properties("simrig_brdf"), brdf, rotation_deg)


def make_btf(brdf: SpatialBrdf, **options: Any) -> Any:
    """Return a Mitsuba BSDF of a BTF in memory, for use as a value in scene dictionaries.

    Args:
        options: numbers of the plugin ``simrig_btf``: ``scale`` (required), ``scale_v``,
            ``rotation``, ``pixel_angle``, ``pixel_width``, ``unit``.

    Raises:
        SimrigError: no Mitsuba variant is selected, or an option that cannot be.
    """
    import mitsuba as mi

    from simrig.plugins.register import register_btf

    if mi.variant() is None:
        raise SimrigError("no variant is set: call simrig.core.backend.select() first")
    properties = mi.Properties("simrig_btf")
    for name, value in options.items():
        properties[name] = value
    bsdf = register_btf()(properties, brdf)
    stray = properties.unqueried()
    if stray:
        raise unknown_name("option of simrig_btf", stray[0], BTF_NUMBERS)
    return bsdf


class CannotBuildError(SimrigError):
    """Mitsuba cannot build a scene in the current variant."""


@contextmanager
def one_line_errors() -> Iterator[None]:
    """Turn Mitsuba's report of a plugin that refused its input back into that one-line error.

    Mitsuba wraps what a plugin's constructor raises in a ``RuntimeError`` that carries a whole
    traceback. Use around ``mi.load_dict``, ``mi.load_file`` and ``mi.load_string``.

    Raises:
        SimrigError: with the message of the plugin.
    """
    try:
        yield
    except RuntimeError as error:
        found = re.search(r"SimrigError: (.*)", str(error))
        if not found:
            raise
        raise SimrigError(found.group(1).strip()) from None


@contextmanager
def building(what: str) -> Iterator[None]:
    """Say in one line why Mitsuba cannot build a scene.

    Args:
        what: is built, for the message: "the scene 'room.xml'".

    Raises:
        SimrigError: the message of a plugin of ours.
        CannotBuildError: what is built and Mitsuba's reason.
    """
    try:
        with one_line_errors(), warnings_in_words():
            yield
    except RuntimeError as error:
        raise CannotBuildError(f"cannot build {what}: {_reason(str(error))}") from None


def _reason(report: str) -> str:
    """Return what Mitsuba reports in one line, without the places in its own source."""
    lines = [line.strip() for line in report.strip().splitlines()]
    if "Traceback" in report:
        return lines[-1]
    reason = re.sub(r"\[\w+(\.cpp:\d+)?\] ", "", " ".join(lines))
    unknown = re.search(r'Plugin "(simrig_\w+)" not found', reason)
    if unknown:
        from simrig.plugins.register import NAMES

        return str(unknown_name("plugin", unknown.group(1), NAMES))
    return reason

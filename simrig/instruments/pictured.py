"""Instruments of all kinds that take pictures, as one light and one camera on four axes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from simrig.core.errors import SimrigError
from simrig.instruments.description import (
    Description,
    DomeDescription,
    GantryDescription,
    GonioreflectometerDescription,
)
from simrig.instruments.instrument import AXES
from simrig.instruments.parts import Axis, Camera, Light, Part, Quantity, SampleTiming


def pictured(description: Description) -> GonioreflectometerDescription:
    """Return what an instrument is for its pictures; how it moves is left to its kinematics.

    Raises:
        SimrigError: a kind that takes no pictures, or a file that lacks what they need.
    """
    if isinstance(description, GonioreflectometerDescription):
        return description
    made = _KINDS.get(type(description))
    about = description.instrument
    if made is None:
        raise SimrigError(
            f"pictures are taken with a gonioreflectometer, a dome or a gantry, not with "
            f"'{about.name}' of kind '{about.kind}'"
        )
    for table in ("sample", "camera", "light", "lens"):
        if getattr(description, table) is None:
            raise SimrigError(f"'{about.name}' lacks [{table}]: pictures need it")
    return made(description)


def _of_dome(description: Any) -> GonioreflectometerDescription:
    dome = description.dome
    for table, part, distance in (
        ("camera", description.camera, dome.camera_mm),
        ("light", description.light, dome.light_mm),
    ):
        if part.distance_mm.value != distance.value:
            raise SimrigError(
                f"[dome] says {table}_mm = {distance.value:g}, [{table}] says distance_mm = "
                f"{part.distance_mm.value:g}: change one of them"
            )
    reach = dome.placement_deg
    return _made(description, description.camera, description.light, [reach] * 4, {})


def _of_gantry(description: Any) -> GonioreflectometerDescription:
    camera, light, timing = description.camera, description.light, description.timing
    keys = ("pixels", "pitch_um", "exposures_s", "bits", "mu_sat_e", "sigma_d_e")
    for table, part, needed in (
        ("camera", camera, (*keys, "saturation_per_sr")),
        ("timing", timing, ("fps",)),
    ):
        for key in needed:
            if getattr(part, key) is None:
                raise SimrigError(f"'{key}' is missing in [{table}]: pictures need it")
    low, high = (seconds.value for seconds in camera.exposures_s)
    said = _said(camera, Camera) | {
        "pixels_averaged": 1,
        "exposure_range_ev": Quantity(value=max(float(np.log2(high / (low * light.levels[0]))), 0)),
    }
    seconds = SampleTiming(
        set_up_s=Quantity(value=0.0), per_sample_s=Quantity(value=1.0 / timing.fps.value)
    )
    off = [light.repeatability_deg, camera.repeatability_deg] * 2
    return _made(
        description, Camera(**said), Light(**_said(light, Light)), off, {"timing": seconds}
    )


def _said(part: Part, kind: type[Part]) -> dict[str, Any]:
    return {key: getattr(part, key) for key in kind.model_fields if hasattr(part, key)}


def _made(
    description: Any, camera: Camera, light: Light, off: list[Quantity], more: dict[str, Any]
) -> GonioreflectometerDescription:
    axes = [
        Axis.model_validate(
            {
                "name": name,
                "range_deg": [0.0, 360.0 if name.startswith("phi") else 90.0],
                "repeatability_deg": most,
            }
        )
        for name, most in zip(AXES, off, strict=True)
    ]
    tables = {"timing": description.timing} | more
    return GonioreflectometerDescription(
        instrument=description.instrument,
        axis=axes,
        sample=description.sample,
        camera=camera,
        lens=description.lens,
        light=light,
        registration=description.registration,
        **tables,
    )


_KINDS: dict[type[Description], Callable[[Any], GonioreflectometerDescription]] = {
    DomeDescription: _of_dome,
    GantryDescription: _of_gantry,
}

"""The tables of a reflector's instrument file (see ``simrig.instruments.parts``)."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from simrig.instruments.quantity import NotNegative, Part, Positive, Quantity, Share

_ZERO = Quantity(value=0.0)


class Ellipsoid(Part):
    """``[reflector]``: a mirror around the sample, seen and lit from afar along its axis.

    Attributes:
        semi_axes_mm: across and along the axis.
        z_range_mm: of the mirror above the sample.
        opening_mm: diameter of the lower opening, where the sample lies.
        reflectance: of the mirror; one number, or one for each of R, G, B.
        slope_rms_mrad: root mean square error of its slope.
        shift_mm, tilt_mrad: of the mirror along x and y, and about x and y.
        dust: share of the mirror that scatters.
        distance_mm: of camera and projector.
        flash_mm: of the flash beside the lens.
        flash_diameter_mm: of its disc.
        fps: pictures per second.
    """

    semi_axes_mm: Annotated[list[Positive], Field(min_length=2, max_length=2)]
    z_range_mm: Annotated[list[float], Field(min_length=2, max_length=2)]
    opening_mm: Positive
    reflectance: Share | Annotated[list[Share], Field(min_length=3, max_length=3)]
    slope_rms_mrad: NotNegative = _ZERO
    shift_mm: Annotated[list[Quantity], Field(min_length=2, max_length=2)] = Field([_ZERO] * 2)
    tilt_mrad: Annotated[list[Quantity], Field(min_length=2, max_length=2)] = Field([_ZERO] * 2)
    dust: Share = _ZERO
    distance_mm: Positive
    flash_mm: NotNegative = _ZERO
    flash_diameter_mm: NotNegative = _ZERO
    fps: Positive


class ProjectorPart(Part):
    """``[projector]`` of a reflector, in the mirror's far focus.

    Attributes:
        lumens: luminous flux of a white frame.
        frame_mm: its width and height on the mirror.
        contrast: of a white pixel to a black one.
        pupil_mm: diameter of what light leaves by.
        beside_mm: from the camera's lens, as a beam splitter shows it.
    """

    lumens: Positive
    frame_mm: Annotated[list[Positive], Field(min_length=2, max_length=2)]
    contrast: Positive
    pupil_mm: Positive
    beside_mm: NotNegative = _ZERO

"""``[film]`` of an instrument file: what filming needs beyond single pictures (thesis 6.2)."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from simrig.instruments.quantity import NotNegative, Part, Positive, Quantity, Share, between


class Film(Part):
    """How a consumer camera films, and what lies around the sample.

    Attributes:
        shutter_s: each frame is exposed.
        raw_bits: of the converter, before the camera encodes eight bits by the curve of sRGB.
        quality: of M-JPEG, 1 to 100.
        vibration_deg, vibration_hz: largest turn of the shaken camera, and how fast it shakes.
        drift_ev: by how much the automatic exposure strays to both sides of what it is after.
        target: of full scale, at which the automatic exposure holds the bright parts.
        crosstalk: what each of the camera's colours has of both others.
        black_per_sr, black_exponent: f_r of the black material around the border,
            k (cos theta_i cos theta_v)^a.
        dot_diameter_mm, dot_mm: the white dot beyond the border: its size, and its x and y.
        sunk_mm: the sample's surface below the border's.
    """

    shutter_s: Positive
    raw_bits: Annotated[int, Field(ge=8, le=16)] = 12
    quality: Annotated[int, Field(ge=1, le=100)] = 95
    vibration_deg: NotNegative = Quantity(value=0.0)
    vibration_hz: Positive = Quantity(value=9.0)
    drift_ev: Annotated[Quantity, between(0.0, 4.0)] = Quantity(value=0.0)
    target: Share = Quantity(value=0.4)
    crosstalk: Annotated[Quantity, between(0.0, 0.3)] = Quantity(value=0.0)
    black_per_sr: Positive
    black_exponent: Annotated[Quantity, between(-2.0, 2.0)] = Quantity(value=0.0)
    dot_diameter_mm: Positive
    dot_mm: Annotated[list[float], Field(min_length=2, max_length=2)]
    sunk_mm: Annotated[Quantity, between(-2.0, 2.0)] = Quantity(value=0.0)

"""The optics and the sensor of a gonioreflectometer, in numbers."""

from __future__ import annotations

from dataclasses import dataclass, fields

from simrig.core.errors import SimrigError


@dataclass(frozen=True)
class Instrument:
    """What decides how far a recorded value may be from f_r at one pair of directions.

    The defaults describe the UTIA gonioreflectometer. Thesis section 4.1 states the positioning
    accuracy, the distance of the sensor, its bits and dynamic range, and the lenses; section 4.3
    the area over which samples are averaged. What it does not state is marked *assumed*.

    Attributes:
        positioning_deg: largest error of every axis, in degrees (±).
        light_distance, sensor_distance: from the sample's centre, in mm (the light's is assumed).
        light_diameter: of the emitting area, in mm (assumed).
        aperture_diameter: of the lens, in mm: 180 mm at f/8 (the stop is assumed).
        spot_diameter: of the area of the sample over which a value is averaged, in mm.
        sample_diameter: of the material, in mm; around it lies a border.
        border_reflectance: of the border, as an albedo (assumed black).
        blur_diameter: of a point's picture on the sample where it is in focus, in mm: two pixels.
        non_uniformity: irradiance at the rim of the spot over that at its centre, less 1, that
            remains after the calibration (assumed).
        mirror_reflectance, mirror_coverage: of a mirror around the sample, and the part of the
            hemisphere (by projected solid angle) that it covers; a gonioreflectometer has none.
        stray_light: radiance of stray light over that of a white diffuser (assumed).
        bits: of the analogue-to-digital converter.
        saturation: radiance at which the shortest exposure saturates, over that of the irradiance
            at normal incidence (1/sr); follows the brightest highlights (assumed).
        exposure_range_ev: binary logarithm of the longest over the shortest exposure, by time and
            by current: 28.4 EV in all, less those of the bits.
        full_well, read_noise: electrons per pixel (typical of the sensor; not in the thesis).
        pixels: averaged in a value: 50 x 50.
        seed: of the noise and the errors of the axes.
    """

    positioning_deg: float = 0.03
    light_distance: float = 2000.0
    sensor_distance: float = 2000.0
    light_diameter: float = 30.0
    aperture_diameter: float = 22.5
    spot_diameter: float = 14.0
    sample_diameter: float = 30.0
    border_reflectance: float = 0.05
    blur_diameter: float = 0.15
    non_uniformity: float = 0.002
    mirror_reflectance: float = 0.0
    mirror_coverage: float = 0.0
    stray_light: float = 1e-5
    bits: int = 14
    saturation: float = 1000.0
    exposure_range_ev: float = 14.4
    full_well: float = 30000.0
    read_noise: float = 16.0
    pixels: int = 2500
    seed: int = 0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not 0.0 <= value < float("inf"):
                raise SimrigError(f"the rig's {field.name} must be finite and >= 0, got {value}")
        for name in ("light_distance", "sensor_distance", "spot_diameter", "saturation"):
            if getattr(self, name) == 0.0:
                raise SimrigError(f"the rig's {name} must be above 0")
        if self.bits < 1 or self.pixels < 1 or self.full_well < 1.0:
            raise SimrigError("a rig needs at least one bit, one pixel and one electron")
        if self.spot_diameter > self.sample_diameter:
            raise SimrigError("the spot of a rig must lie on the sample: reduce spot_diameter")
        if self.mirror_reflectance * self.mirror_coverage >= 1.0:
            raise SimrigError("a mirror cannot give back all light: lower mirror_reflectance")
        if 2.0 * max(self.spot_diameter, self.light_diameter) > self.light_distance:
            raise SimrigError("the light must be farther away than twice its and the spot's size")


UTIA = Instrument()

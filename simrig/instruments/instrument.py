"""The optics and the sensor of a gonioreflectometer, in numbers, as its direct level reads them."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cache
from typing import TYPE_CHECKING

from simrig.core.errors import SimrigError

if TYPE_CHECKING:
    from simrig.instruments.description import GonioreflectometerDescription

Four = tuple[float, float, float, float]
AXES = ("theta_i", "theta_v", "phi_i", "phi_v")
_FREE = ((0.0, 90.0), (0.0, 90.0), (0.0, 360.0), (0.0, 360.0))


@dataclass(frozen=True)
class Instrument:
    """What decides how far a recorded value may be from f_r at one pair of directions.

    The numbers come from an instrument file (``of``); ``utia()`` are those of the UTIA
    gonioreflectometer.

    Attributes:
        positioning_deg: largest error of every axis (±): theta_i, theta_v, phi_i, phi_v, or one
            number for all, in degrees.
        offset_deg: of the axes' zeros, likewise.
        light_distance, sensor_distance: from the sample's centre, in mm.
        light_diameter: of the emitting area, in mm.
        aperture_diameter: of the lens, in mm.
        spot_diameter: of the area of the sample over which a value is averaged, in mm.
        sample_diameter: of the material, in mm; around it lies a border.
        border_reflectance: of the border, as an albedo.
        blur_diameter: of a point's picture on the sample where it is in focus, in mm.
        non_uniformity: irradiance at the rim of the spot over that at its centre, less 1, that
            remains after the calibration.
        mirror_reflectance, mirror_coverage: of a mirror around the sample, and the part of the
            hemisphere (by projected solid angle) that it covers; a gonioreflectometer has none.
        stray_light: radiance of stray light over that of a white diffuser.
        bits: of the analogue-to-digital converter.
        saturation: radiance at which the shortest exposure saturates, over that of the irradiance
            at normal incidence (1/sr).
        exposure_range_ev: binary logarithm of the longest over the shortest exposure.
        full_well, read_noise: electrons per pixel.
        pixels: averaged in a value.
        reach_deg: lowest and highest angle of every axis.
        name: what it is called.
        seed: of the noise and the errors of the axes.
    """

    positioning_deg: Four
    light_distance: float
    sensor_distance: float
    light_diameter: float
    aperture_diameter: float
    spot_diameter: float
    sample_diameter: float
    border_reflectance: float
    blur_diameter: float
    non_uniformity: float
    stray_light: float
    bits: int
    saturation: float
    exposure_range_ev: float
    full_well: float
    read_noise: float
    pixels: int
    offset_deg: Four = (0.0, 0.0, 0.0, 0.0)
    mirror_reflectance: float = 0.0
    mirror_coverage: float = 0.0
    reach_deg: tuple[tuple[float, float], ...] = _FREE
    name: str = ""
    seed: int = 0

    def __post_init__(self) -> None:
        for name in ("positioning_deg", "offset_deg"):
            given = getattr(self, name)
            four = (given,) * 4 if isinstance(given, int | float) else tuple(given)
            object.__setattr__(self, name, four)
        for field in fields(self):
            value = getattr(self, field.name)
            numbers = value if field.name == "positioning_deg" else (value,)
            if field.name in ("offset_deg", "reach_deg", "name"):
                continue
            if not all(0.0 <= number < float("inf") for number in numbers):
                raise SimrigError(f"the rig's {field.name} must be finite and >= 0, got {value}")
        for name in ("light_distance", "sensor_distance", "spot_diameter", "saturation"):
            if getattr(self, name) == 0.0:
                raise SimrigError(f"the rig's {name} must be above 0")
        if not all(abs(offset) < 90.0 for offset in self.offset_deg):  # false for NaN
            raise SimrigError(f"the rig's offset_deg must be below 90, got {self.offset_deg}")
        if self.bits < 1 or self.pixels < 1 or self.full_well < 1.0:
            raise SimrigError("a rig needs at least one bit, one pixel and one electron")
        if self.spot_diameter > self.sample_diameter:
            raise SimrigError("the spot of a rig must lie on the sample: reduce spot_diameter")
        if self.mirror_reflectance * self.mirror_coverage >= 1.0:
            raise SimrigError("a mirror cannot give back all light: lower mirror_reflectance")
        if 2.0 * max(self.spot_diameter, self.light_diameter) > self.light_distance:
            raise SimrigError("the light must be farther away than twice its and the spot's size")

    @classmethod
    def of(cls, description: GonioreflectometerDescription, seed: int = 0) -> Instrument:
        """Return the numbers of an instrument file.

        Raises:
            SimrigError: numbers that contradict each other.
        """
        d, mirror = description, description.mirror
        moves = {str(axis.name): axis for axis in d.axis}
        four = [moves[name] for name in AXES]
        return cls(
            positioning_deg=tuple(a.repeatability_deg.value for a in four),  # type: ignore[arg-type]
            offset_deg=tuple(a.offset_deg.value for a in four),  # type: ignore[arg-type]
            reach_deg=tuple((a.range_deg[0], a.range_deg[1]) for a in four),
            light_distance=d.light.distance_mm.value,
            sensor_distance=d.camera.distance_mm.value,
            light_diameter=d.light.diameter_mm.value,
            aperture_diameter=d.lens.f_mm.value / d.lens.f_number.value,
            spot_diameter=d.sample.spot_diameter_mm.value,
            sample_diameter=d.sample.diameter_mm.value,
            border_reflectance=d.sample.border_albedo.value,
            blur_diameter=d.lens.blur_diameter_mm.value,
            non_uniformity=d.light.non_uniformity.value,
            mirror_reflectance=mirror.reflectance.value if mirror else 0.0,
            mirror_coverage=mirror.coverage.value if mirror else 0.0,
            stray_light=d.light.stray.value,
            bits=d.camera.bits,
            saturation=d.camera.saturation_per_sr.value,
            exposure_range_ev=d.camera.exposure_range_ev.value,
            full_well=d.camera.mu_sat_e.value,
            read_noise=d.camera.sigma_d_e.value,
            pixels=d.camera.pixels_averaged,
            name=d.instrument.name,
            seed=seed,
        )


@cache
def utia() -> Instrument:
    """Return the UTIA gonioreflectometer (``utia.toml``)."""
    from simrig.instruments.description import shipped

    return Instrument.of(shipped("utia"))  # type: ignore[arg-type]  # a gonioreflectometer

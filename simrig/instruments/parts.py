"""The tables of instrument files: what each key is called, its unit and its range.

Keys of the imaging level (``simrig.rigs.imaging``) may be left out; ``needs`` says what is missing
where they are asked for.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from simrig.core.errors import SimrigError
from simrig.instruments.instrument import AXES
from simrig.instruments.quantity import (
    AtLeastOne,
    NotNegative,
    Part,
    Positive,
    Quantity,
    Share,
    between,
)

_ZERO = Quantity(value=0.0)


def _checked_range(ends: list[float]) -> list[float]:
    if not ends[0] < ends[1]:
        raise ValueError(f"must be two ascending angles, got {ends}")
    return ends


Fixed = Annotated[list[Annotated[float, Field(ge=0.0, lt=90.0)]], Field(min_length=1)]


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


_Side = Annotated[int, Field(ge=1, le=65536)]


def _up_to_one(levels: list[float]) -> list[float]:
    if levels != sorted(levels) or not levels[0] > 0.0 or levels[-1] != 1.0:
        raise ValueError(f"must ascend from above 0 to 1, got {levels}")
    return levels


class Axis(Part):
    """``[[axis]]``: one motion.

    Attributes:
        name: of ``AXES``, the angle that it sets.
        range_deg: what it reaches.
        repeatability_deg: largest error of a move (±), uniform, independent from move to move.
        offset_deg: of its zero, the same in all moves.
        coupled_to: an axis that turns this one along, such as the stage under the sample.
        ratio: by how much of that axis' angle.
        speed_deg_s: of a move.
    """

    name: Literal["theta_i", "theta_v", "phi_i", "phi_v"]
    range_deg: Annotated[
        list[float], Field(min_length=2, max_length=2), AfterValidator(_checked_range)
    ]
    repeatability_deg: Annotated[Quantity, between(0.0, 10.0)] = _ZERO
    offset_deg: Annotated[Quantity, between(-10.0, 10.0)] = _ZERO
    coupled_to: Literal["theta_i", "theta_v", "phi_i", "phi_v"] | None = None
    ratio: Annotated[Quantity, between(-10.0, 10.0)] = Quantity(value=1.0)
    speed_deg_s: Positive | None = None


def each_once(axes: list[Axis]) -> list[Axis]:
    """Refuse axes of which one is missing, described twice, or coupled to a coupled one."""
    names: list[str] = [axis.name for axis in axes]
    for name in AXES:
        if names.count(name) != 1:
            raise ValueError(f"one [[axis]] named '{name}' is needed, got {names.count(name)}")
    coupled = {axis.name for axis in axes if axis.coupled_to is not None}
    for axis in axes:
        if axis.coupled_to is not None and (axis.coupled_to in coupled or axis.ratio.value == 0.0):
            raise ValueError(
                f"axis '{axis.name}' must turn with one that turns alone, by a ratio that is not 0"
            )
    return axes


class Arm(Part):
    """What holds a camera or a light: a bow around the sample, upwards from the horizon.

    Attributes:
        arm_width_mm: of the bow.
        head_diameter_mm, head_depth_mm: of what it carries, across and along its axis.
        over_the_pole: it may also come from the other side, over the pole.
    """

    arm_width_mm: NotNegative = _ZERO
    head_diameter_mm: NotNegative = _ZERO
    head_depth_mm: NotNegative = _ZERO
    over_the_pole: bool = False


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


class Pictured(Arm):
    """What pictures need to know of a camera (symbols of EMVA 1288).

    Attributes:
        pixels: (width, height) of the whole sensor.
        pitch_um: from pixel to pixel.
        cfa: colour filter array, its first two rows (``"RGGB"``); none is monochrome.
        black_DN, K_DN_e: digital number of a dark pixel, and gain; the gain fills the converter
            unless given.
        mu_I_e_s: dark current in electrons per second.
        DSNU_e, PRNU_pct: spread of the pixels' dark signal, and of their response in per cent.
        defects: share of the pixels that see nothing or are always full; more than a tenth cannot
            be filled from those around them.
        exposures_s: shortest and longest.
    """

    pixels: Annotated[list[_Side], Field(min_length=2, max_length=2)] | None = None
    pitch_um: Positive | None = None
    cfa: Literal["RGGB", "BGGR", "GRBG", "GBRG"] | None = None
    black_DN: NotNegative = _ZERO
    K_DN_e: Positive | None = None
    mu_I_e_s: NotNegative = _ZERO
    DSNU_e: NotNegative = _ZERO
    PRNU_pct: Annotated[Quantity, between(0.0, 100.0)] = _ZERO
    defects: Annotated[Quantity, between(0.0, 0.1)] = _ZERO
    exposures_s: Annotated[list[Positive], Field(min_length=2, max_length=2)] | None = None


class Camera(Pictured):
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
    """

    distance_mm: Positive
    bits: Annotated[int, Field(ge=1, le=32)]
    mu_sat_e: AtLeastOne
    sigma_d_e: NotNegative
    pixels_averaged: Annotated[int, Field(ge=1)]
    saturation_per_sr: Positive
    exposure_range_ev: NotNegative


class Lens(Part):
    """``[lens]``.

    Attributes:
        f_mm, f_number: focal length and stop; their ratio is the diameter of the aperture.
        blur_diameter_mm: of a point's picture on the sample where it is in focus.
        sample_um: on the sample per pixel, at its centre; from f_mm and the camera's distance by a
            thin lens unless given.
        largest_sample_mm: side of the largest sample.
        distortion: k1, k2, p1, p2, k3 as in OpenCV, from ideal to distorted.
        vignetting: what the sensor's corner loses beyond cos⁴.
        psf_um: standard deviation of a point's picture on the sensor.
    """

    f_mm: Positive
    f_number: Positive
    blur_diameter_mm: NotNegative = _ZERO
    sample_um: Positive | None = None
    largest_sample_mm: Positive | None = None
    distortion: Annotated[list[Quantity], Field(min_length=5, max_length=5)] | None = None
    vignetting: Share = _ZERO
    psf_um: Annotated[Quantity, between(0.0, 1000.0)] = _ZERO


class Light(Arm):
    """``[light]``.

    Attributes:
        distance_mm: from the sample's centre.
        diameter_mm: of the emitting area.
        non_uniformity: irradiance at the rim of the spot over that at its centre, less 1, that
            remains after the calibration.
        stray: radiance of stray light over that of a white diffuser.
        levels: of the light that can be set, ascending, the last is 1.
        beam_deg: half angle at which the beam's intensity is down to one half; no number is a
            light that shines evenly.
        drift_pct_h: of the intensity, per cent per hour.
    """

    distance_mm: Positive
    diameter_mm: NotNegative = _ZERO
    non_uniformity: NotNegative = _ZERO
    stray: Share = _ZERO
    levels: Annotated[list[float], AfterValidator(_up_to_one)] = Field(default=[1.0], min_length=1)
    beam_deg: Annotated[Quantity, between(0.1, 89.0)] | None = None
    drift_pct_h: Annotated[Quantity, between(-100.0, 100.0)] = _ZERO


class Registration(Part):
    """``[registration]``: the white frame around the sample whose edges are the marks.

    Attributes:
        gap_mm: black between the sample and the frame.
        border_mm: width of the frame.
        albedo: of the frame.
    """

    gap_mm: NotNegative
    border_mm: Positive
    albedo: Share = Quantity(value=0.8)


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
        fps: pictures per second.
    """

    slice_s: Positive
    change_s: NotNegative
    cameras: Annotated[int, Field(ge=1)] | Literal["all"] = 1
    fps: Positive | None = None


class PolarCamera(Pictured):
    """``[camera]`` of a gantry: at fixed polar angles on an arm.

    Attributes:
        distance_mm: from the sample's centre.
        theta_deg: polar angles at which one stands.
        repeatability_deg: largest error (±) of the arm's azimuth and of these angles.
        bits, mu_sat_e, sigma_d_e, saturation_per_sr: as of ``Camera``, where it takes pictures.
    """

    distance_mm: Positive
    theta_deg: Fixed
    repeatability_deg: Annotated[Quantity, between(0.0, 10.0)] = _ZERO
    bits: Annotated[int, Field(ge=1, le=32)] | None = None
    mu_sat_e: AtLeastOne | None = None
    sigma_d_e: NotNegative | None = None
    saturation_per_sr: Positive | None = None


class PolarLight(Light):
    """``[light]`` of a gantry: at fixed polar angles on an arm.

    Attributes:
        theta_deg, repeatability_deg: as of ``PolarCamera``.
    """

    theta_deg: Fixed
    repeatability_deg: Annotated[Quantity, between(0.0, 10.0)] = _ZERO


class Coupling(Part):
    """``[[coupling]]`` of a gantry's two arms: a gear.

    Attributes:
        name: of the slices that it records.
        ratio: azimuth of the camera's arm over that of the light's.
    """

    name: Literal["axial", "diagonal"]
    ratio: float


class Dome(Part):
    """``[dome]``: cameras that never move, and a light beside each.

    Attributes:
        directions_deg: (theta, phi) of every camera and light.
        camera_mm, light_mm: from the sample's centre.
        placement_deg: largest error (±) of where each stands, always the same.
    """

    directions_deg: Annotated[
        list[Annotated[list[float], Field(min_length=2, max_length=2)]], Field(min_length=1)
    ]
    camera_mm: Positive
    light_mm: Positive
    placement_deg: Annotated[Quantity, between(0.0, 10.0)] = _ZERO


def needs(table: str, part: Part, *keys: str) -> None:
    """Refuse a table that lacks keys which pictures need.

    Raises:
        SimrigError: names the first that is missing.
    """
    for key in keys:
        if getattr(part, key) is None:
            raise SimrigError(f"'{key}' is missing in [{table}]: pictures need it")

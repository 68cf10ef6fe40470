"""What a pixel sees of a surface, from the distance, the incidence and the pixel's angle.

Mitsuba gives BSDFs written in Python no ray differentials. The distance of the last ray segment
``si.t`` and the direction to the viewer are there, so a pixel's cone is cut with the surface: its
footprint is an ellipse, longer along the view direction by 1 / cos theta_v.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np

from simrig.btf.mipmap import Footprint, longer_diameter
from simrig.core.errors import SimrigError
from simrig.plugins.named import number


@dataclass(frozen=True)
class Cone:
    """The cone of a pixel and the scale of a material's texture.

    Attributes:
        scale: mm of material per unit of u and of v.
        angle: of a pixel, in radians; 0 for none.
        width_mm: of a pixel at the camera, in mm (what an orthographic camera has).
        unit_mm: mm per unit of the scene.
    """

    scale: tuple[float, float]
    angle: float = 0.0
    width_mm: float = 0.0
    unit_mm: float = 1.0

    @classmethod
    def from_properties(cls, props: Any) -> Cone:
        """Read ``scale``, ``scale_v``, ``pixel_angle``, ``pixel_width`` and ``unit``.

        Raises:
            SimrigError: a number that is missing, not finite or of the wrong sign.
        """
        if "scale" not in props:
            raise SimrigError(
                "simrig_btf: the parameter 'scale' is missing: say how many mm of material one "
                "unit of u holds (for a cylinder its circumference)"
            )
        scale = number(props, "scale", 0.0)
        values = {
            "scale": scale,
            "scale_v": number(props, "scale_v", scale),
            "unit": number(props, "unit", 1.0),
        }
        for name, value in values.items():
            if value <= 0.0:
                raise SimrigError(f"'{name}' must be above 0 mm, got {value:g}")
        angle, width = number(props, "pixel_angle", 0.0), number(props, "pixel_width", 0.0)
        if angle < 0.0 or width < 0.0 or angle >= 90.0:
            raise SimrigError(
                "'pixel_angle' must be in [0°, 90°) and 'pixel_width' at least 0 mm, got "
                f"{angle:g} and {width:g}"
            )
        scales = (values["scale"], values["scale_v"])
        return cls(scales, float(np.radians(angle)), width, values["unit"])

    def footprint(self, si: Any, cos_turn: Any, sin_turn: Any) -> Footprint:
        """Return what is seen at a surface interaction, in the frame of the material.

        Args:
            si: Mitsuba's surface interaction; u runs along phi = 0 of its shading frame.
            cos_turn, sin_turn: of the material's rotation.
        """
        turn = _turned(cos_turn, sin_turn)
        uv = dr.detach(si.uv)
        x, y = turn(uv.x * self.scale[0], uv.y * self.scale[1])
        if self.angle == 0.0 and self.width_mm == 0.0:
            return Footprint(x, y)
        wi = dr.detach(si.wi)
        width = self.width_mm + dr.abs(dr.detach(si.t)) * (self.unit_mm * self.angle)
        return Footprint(x, y, width, *turn(*longer_diameter(width, wi.x, wi.y, wi.z)))


def pixel_angle_deg(sensor: Any) -> float:
    """Return the angle of one pixel in the middle of a perspective sensor's picture, in degrees.

    Pixels towards the corners see less, so this never lets them alias. With n samples per pixel
    each stands for 1/√n of it: a smaller angle then keeps more detail.

    Args:
        sensor: a loaded Mitsuba sensor with the parameter ``x_fov``.

    Raises:
        SimrigError: the sensor has none (an orthographic one has a ``pixel_width`` instead).
    """
    import mitsuba as mi

    parameters = mi.traverse(sensor)
    if "x_fov" not in parameters:
        raise SimrigError(
            f"the sensor {sensor.class_name()} has no field of view: give 'pixel_width' in mm"
        )
    fov = float(np.asarray(parameters["x_fov"]).ravel()[0])
    half = np.tan(np.radians(fov) / 2.0)
    return float(np.degrees(2.0 * half / sensor.film().size()[0]))


def _turned(cos_turn: Any, sin_turn: Any) -> Any:
    """Return the function that takes surface coordinates to those of a turned material."""
    return lambda x, y: (cos_turn * x + sin_turn * y, cos_turn * y - sin_turn * x)

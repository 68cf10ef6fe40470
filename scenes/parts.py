"""The pieces that the scenes share: camera, film, lamp, and the world they stand in.

World: x to the right of the picture, y up, z towards the camera; lengths in millimetres. All
cameras are orthographic and look along −z, so the view direction is the same for every pixel.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from simrig.core.errors import SimrigError, unknown_name

MARGIN = 64.0 / 59.104  # half of a picture cell over the radius of the sphere in it
# mm; outside of every object, but no further: the error of a float32 intersection grows with the
# square of the distance, and from 2 m away the points of a cylinder came to lie below its surface
_CAMERA_DISTANCE = 150.0


def transform() -> Any:
    """Return the identity of the current variant, to build ``to_world`` matrices from.

    Raises:
        SimrigError: no variant is set.
    """
    import mitsuba as mi

    if mi.variant() is None:
        raise SimrigError("no Mitsuba variant is set: call simrig.core.backend.select() first")
    return mi.ScalarTransform4f()


def camera(
    width: int,
    height: int,
    half_width: float,
    pixel_centres: bool,
    centre: tuple[float, float] = (0.0, 0.0),
) -> dict:
    """Return an orthographic camera with a float32 RGB film and a box filter.

    Args:
        width, height: pixels of the picture.
        half_width: half of what the picture spans horizontally, in mm.
        pixel_centres: one regular sample in the centre of each pixel instead of random ones.
        centre: x and y of the centre of the picture, in mm.

    Raises:
        SimrigError: no whole numbers of pixels, or no variant is set.
    """
    x, y = centre
    to_world = transform().look_at(
        origin=[x, y, _CAMERA_DISTANCE], target=[x, y, 0.0], up=[0.0, 1.0, 0.0]
    ) @ transform().scale([half_width, half_width, 1.0])
    return {
        "type": "orthographic",
        "near_clip": 1.0,
        "far_clip": 2.0 * _CAMERA_DISTANCE,
        "to_world": to_world,
        "film": film(width, height),
        "sampler": sampler(pixel_centres),
    }


def film(width: int, height: int) -> dict[str, Any]:
    """Return a float32 RGB film; a pixel is the mean of its own samples, nothing else.

    Raises:
        SimrigError: no whole numbers of pixels.
    """
    if width != int(width) or height != int(height) or min(width, height) < 1:
        raise SimrigError(f"a picture needs whole numbers of pixels >= 1, got {width} x {height}")
    return {
        "type": "hdrfilm",
        "width": int(width),
        "height": int(height),
        "pixel_format": "rgb",
        "component_format": "float32",
        "rfilter": {"type": "box"},
    }


def sampler(pixel_centres: bool, samples: int = 16) -> dict[str, Any]:
    """Return what looks through random places of a pixel, or once through its centre."""
    if pixel_centres:
        return {"type": "stratified", "sample_count": 1, "jitter": False}
    return {"type": "independent", "sample_count": samples}


def lamp(position: Sequence[float] | np.ndarray, distance: float) -> dict:
    """Return a point light that brings a white diffuser at ``distance`` (mm) to radiance 1."""
    return {
        "type": "point",
        "position": [float(x) for x in position],
        "intensity": {"type": "rgb", "value": float(np.pi * distance**2)},
    }


def lamp_position(theta_deg: float, phi_deg: float, distance: float, nearest: float) -> np.ndarray:
    """Return the place of a lamp around the origin.

    Args:
        theta_deg: angle from the direction towards the camera (+z).
        phi_deg: angle around that direction, from +x (right) towards +y (up).
        distance: mm from the origin.
        nearest: the least distance that stays outside of the object.

    Raises:
        SimrigError: a distance that is not further than that.
    """
    if not np.isfinite(distance) or distance <= nearest:
        raise SimrigError(
            f"the lamp must be more than {nearest:g} mm from the centre of the object, "
            f"got {distance:g} mm"
        )
    theta, phi = np.radians(theta_deg), np.radians(phi_deg)
    return distance * np.array(
        [np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)]
    )


def share(bsdf: Any, name: str) -> tuple[dict, Any]:
    """Return a material as (entries of the scene, what a shape names as its BSDF).

    A dictionary becomes one entry of the scene to which shapes refer, so that its data are there
    once and are listed under ``name``; an object is its own reference.

    Raises:
        SimrigError: a list or a text, which no shape takes.
    """
    if isinstance(bsdf, str | list | tuple):
        kind = type(bsdf).__name__
        raise SimrigError(f"a shape takes one Mitsuba BSDF or its dictionary, got a {kind}")
    if isinstance(bsdf, dict):
        return {name: bsdf}, {"type": "ref", "id": name}
    return {}, bsdf


def by_part(bsdf: Any, parts: Iterable[str], kind: str) -> dict[str, tuple[str, Any]]:
    """Return for each part of a scene its material's name and the material.

    Args:
        bsdf: one material for all parts, called ``material``; or a mapping with one for each,
            called as the part.
        kind: of part, for errors.

    Raises:
        SimrigError: a part that there is none of, or one without a material.
    """
    if not isinstance(bsdf, Mapping) or "type" in bsdf:
        return {part: ("material", bsdf) for part in parts}
    known = list(parts)
    for name in bsdf:
        if name not in known:
            raise unknown_name(kind, name, known)
    for part in known:
        if part not in bsdf:
            raise SimrigError(f"the {kind} '{part}' has no material")
    return {part: (part, bsdf[part]) for part in known}


def ball(radius: float, centre: tuple[float, float], material: Any) -> dict:
    """Return a sphere in the plane z = 0 with its poles at the top and bottom of the outline.

    The tangent u of the material runs along the parallels, to the right in the picture; v runs
    along the meridians, up. A pole, where u and v are undefined, lies exactly on the outline: no
    pixel sees it from the front and none has it inside its disc.

    Args:
        radius: in mm.
        centre: x and y in mm.
        material: a Mitsuba BSDF, its dictionary or a reference to it.
    """
    return {"type": "sphere", "radius": radius, "to_world": upright(*centre), "bsdf": material}


def upright(x: float, y: float) -> Any:
    """Return the transform that turns a shape's z axis up and puts it at (x, y, 0), in mm.

    The quarter turn about x is written out: a computed one is off by 1e-8, which Mitsuba warns of.
    """
    turned = np.array([[1, 0, 0, x], [0, 0, 1, y], [0, -1, 0, 0], [0, 0, 0, 1]], dtype=np.float64)
    return type(transform())(turned)


def direct() -> dict:
    """Return the integrator for scenes with one delta light.

    Exact for the light that arrives directly: a delta light reaches a point from one direction
    only, so one light sample is the whole integral and samples of the BSDF can never meet it.
    Pixels with random samples differ only by where in the pixel they look. (More than one light
    sample would be wrong: Mitsuba 3.9.1 counts a delta light ``emitter_samples`` times.)
    """
    return {"type": "direct", "emitter_samples": 1, "bsdf_samples": 0, "hide_emitters": True}


def all_lights(shadows: bool = False) -> dict:
    """Return the integrator that adds up many delta lights.

    Args:
        shadows: one convex object needs none: the cosine says which lights it hides from itself.
    """
    return {"type": "simrig_all_lights", "shadows": shadows}


def everything(hide_emitters: bool = True) -> dict:
    """Return the integrator of scenes where more than direct light counts: all orders, shadows.

    Args:
        hide_emitters: keep lights, an environment map among them, out of the camera's sight.
    """
    return {"type": "path", "max_depth": -1, "hide_emitters": hide_emitters}

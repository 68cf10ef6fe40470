"""Pictures of BRDFs on simple forms under one lamp, without a renderer: one look-up per pixel.

What each pixel sees is found once per form and size with Mitsuba, at the pixels' centres; a new
lamp then costs one evaluation of the BRDF. Nothing but direct light is there to be simulated on one
convex form, so the picture is that of ``simrig render`` with the same lamp; four spheres cast no
shadows on each other here.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from simrig.brdf.protocol import Brdf, evaluate
from simrig.btf.mipmap import Footprint, longer_diameter
from simrig.btf.spatial import SpatialBrdf
from simrig.core import backend
from simrig.core.arrays import vector_type
from simrig.core.errors import check_known
from simrig.scenes import build_scene
from simrig.scenes.parts import MARGIN, lamp_position
from simrig.scenes.stimuli import CYLINDER_HEIGHT, CYLINDER_RADIUS, SPHERE_RADIUS

FORMS = ("sphere", "cylinder", "plane", "four_spheres")
_DISTANCE_MM = {"four_spheres": 400.0}  # of the lamp, as in the scenes; 500 of the others
_NEAREST_MM = 0.5 * CYLINDER_HEIGHT + 10.0
_PLANE_MM = 1.8 * SPHERE_RADIUS  # its side
# mm of material per unit of u and of v: once around, and from pole to pole or end to end
_UNIT_MM = {
    "sphere": (2.0 * np.pi * SPHERE_RADIUS, np.pi * SPHERE_RADIUS),
    "four_spheres": (2.0 * np.pi * SPHERE_RADIUS, np.pi * SPHERE_RADIUS),
    "cylinder": (2.0 * np.pi * CYLINDER_RADIUS, CYLINDER_HEIGHT),
    "plane": (_PLANE_MM, _PLANE_MM),
}


@dataclass(frozen=True, eq=False)
class Form:
    """What the pixels of a picture see.

    Attributes:
        size: height and width in pixels.
        pixel: which pixels see the form, indices of the flattened picture.
        position: (n, 3) in mm.
        frame: (n, 3, 3) rows: tangent u, tangent v, normal.
        view: (n, 3) towards the camera, in that frame.
        centre: that the lamp turns about.
        place: (n, 2) on the material in mm, along u and v.
        pixel_mm: width of a pixel where the surface faces the camera.
    """

    size: tuple[int, int]
    pixel: np.ndarray
    position: np.ndarray
    frame: np.ndarray
    view: np.ndarray
    centre: np.ndarray
    place: np.ndarray
    pixel_mm: float


@lru_cache(maxsize=16)
def form(name: str, resolution: int, zoom: float = 1.0) -> Form:
    """Return a form of ``FORMS`` as a camera sees it, so many pixels wide.

    Args:
        name: of the form.
        resolution: width in pixels.
        zoom: magnification about the middle of the picture; below 1 for a camera further away.

    Raises:
        SimrigError: an unknown form.
    """
    check_known("form", name, FORMS)
    backend.current()
    import drjit as dr
    import mitsuba as mi

    shown = "sphere" if name == "plane" else name
    scene = build_scene(shown, {"type": "diffuse"}, resolution=resolution, pixel_centres=True)
    if name == "plane":
        side = mi.ScalarTransform4f().scale(0.5 * _PLANE_MM)
        scene["sphere"] = {"type": "rectangle", "to_world": side, "bsdf": {"type": "diffuse"}}
    loaded: Any = mi.load_dict(scene)
    sensor = loaded.sensors()[0]
    width, height = (int(side) for side in sensor.film().crop_size())
    index = dr.arange(mi.UInt32, width * height)
    x = 0.5 + ((mi.Float(index % width) + 0.5) / width - 0.5) / zoom
    y = 0.5 + ((mi.Float(index // width) + 0.5) / height - 0.5) / zoom
    ray, _ = sensor.sample_ray(0.0, 0.5, mi.Point2f(x, y), mi.Point2f(0.5, 0.5))
    origin = np.array(ray.o).T
    pixel_mm = float(np.linalg.norm(origin[1] - origin[0]))  # the cameras are orthographic
    si = loaded.ray_intersect(ray)
    si.initialize_sh_frame()
    pixel = np.flatnonzero(np.array(si.is_valid()))
    axes = [np.array(a).T[pixel] for a in (si.sh_frame.s, si.sh_frame.t, si.sh_frame.n)]
    view = np.array(si.wi).T[pixel]
    position = np.array(si.p).T[pixel]
    centre = np.zeros(3)
    if name == "four_spheres":
        centre[0] = -1.5 * 2.0 * SPHERE_RADIUS * MARGIN  # of the first of them
    place = np.array(si.uv).T[pixel] * _UNIT_MM[name]
    frame = np.stack(axes, axis=1)
    return Form((height, width), pixel, position, frame, view, centre, place, pixel_mm)


def lit(
    brdf: Brdf,
    name: str = "sphere",
    resolution: int = 256,
    theta_deg: float = 40.0,
    phi_deg: float = 60.0,
    rotation_deg: float = 0.0,
    zoom: float = 1.0,
) -> np.ndarray:
    """Return a picture of a material under a lamp; a BTF is averaged over each pixel's footprint.

    Args:
        brdf: the material.
        name: of a form.
        resolution: width in pixels.
        theta_deg, phi_deg: of the lamp from the direction towards the camera, and around it.
        rotation_deg: of the material about the surface normal.
        zoom: see ``form``.

    Returns:
        Linear RGB, float32, shape (height, width, 3), black beside the form. A white diffuser
        nearest to the lamp reaches 1.

    Raises:
        SimrigError: an unknown form.
    """
    seen = form(name, resolution, zoom)
    distance = _DISTANCE_MM.get(name, 500.0)
    place = seen.centre + lamp_position(theta_deg, phi_deg, distance, _NEAREST_MM)
    towards = place - seen.position
    length = np.linalg.norm(towards, axis=1, keepdims=True)
    light = np.einsum("nij,nj->ni", seen.frame, towards / length)
    turn = np.radians(rotation_deg)
    turned = np.array(
        [[np.cos(turn), np.sin(turn), 0], [-np.sin(turn), np.cos(turn), 0], [0, 0, 1]]
    )
    number = backend.types("float32").Float
    directions = (light @ turned.T, seen.view @ turned.T)
    if isinstance(brdf, SpatialBrdf):
        values = _of_footprints(brdf, *directions, seen.place @ turned[:2, :2].T, seen, number)
    else:
        values = evaluate(brdf, *directions, number, differentiable=False)
    nearest = distance - (SPHERE_RADIUS if name != "plane" else 0.0)
    strength = np.pi * nearest**2 / length**2 * np.maximum(light[:, 2:], 0.0)
    image = np.zeros((seen.size[0] * seen.size[1], 3), dtype=np.float32)
    image[seen.pixel] = values * strength
    return image.reshape(*seen.size, 3)


def _of_footprints(
    brdf: SpatialBrdf,
    light: np.ndarray,
    view: np.ndarray,
    place: np.ndarray,
    seen: Form,
    number: Any,
) -> np.ndarray:
    """Return f_r, (n, 3), averaged over what pixels see: ellipses longer along the view."""
    longer = longer_diameter(seen.pixel_mm, *view.T)
    parts = (*place.T, np.full(len(place), seen.pixel_mm), *longer)
    footprint = Footprint(*(number(part) for part in parts))
    make = vector_type(number)
    wi, wv = (make(*np.ascontiguousarray(w.T)) for w in (light, view))
    found = brdf.eval_at(wi, wv, footprint, brdf.tables(number, False))
    return np.array(found, dtype=np.float64).reshape(3, -1).T


def in_plane(
    brdf: Brdf, theta_i_deg: float, phi_i_deg: float, phi_v_deg: float, count: int = 181
) -> np.ndarray:
    """Return f_r in 1/sr seen along a plane from one illumination, (count, 3).

    Args:
        brdf: the material.
        theta_i_deg, phi_i_deg: of the illumination.
        phi_v_deg: azimuth of the views of positive angles; those of negative ones lie opposite.
        count: of views, from −90° to 90°, at the middles of equal steps.
    """
    angle = np.radians(views_deg(count))
    azimuth = np.radians(phi_v_deg)
    views = np.stack(
        [np.sin(angle) * np.cos(azimuth), np.sin(angle) * np.sin(azimuth), np.cos(angle)], axis=1
    )
    theta, phi = np.radians(theta_i_deg), np.radians(phi_i_deg)
    light = np.array([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)])
    return evaluate(brdf, np.broadcast_to(light, views.shape), views)


def views_deg(count: int = 181) -> np.ndarray:
    """Return the angles of ``in_plane``, in degrees."""
    return (np.arange(count) + 0.5) * 180.0 / count - 90.0

"""Triangles as Mitsuba meshes, and rounded boxes and rectangles whose uv are millimetres."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

_ARC_STEPS = 4  # of a rounded edge, on either side of its middle
# normal axis, its sign, axis of u with its sign, axis of v: (u, v, normal) is right-handed
_SIDES = (
    (2, 1.0, 0, 1.0, 1),
    (2, -1.0, 0, -1.0, 1),
    (0, 1.0, 1, 1.0, 2),
    (0, -1.0, 1, -1.0, 2),
    (1, 1.0, 0, -1.0, 2),
    (1, -1.0, 0, 1.0, 2),
)


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles of one material.

    Attributes:
        vertices: shape (n, 3), mm.
        normals: unit vectors, shape (n, 3).
        uv: shape (n, 2), mm along the surface.
        faces: shape (m, 3).
    """

    vertices: np.ndarray
    normals: np.ndarray
    uv: np.ndarray
    faces: np.ndarray

    def moved(self, rotation: np.ndarray, shift: Sequence[float]) -> Surface:
        """Return the surface turned by a rotation matrix, then shifted by mm."""
        turn = np.asarray(rotation, dtype=np.float64).T
        return Surface(
            self.vertices @ turn + np.asarray(shift), self.normals @ turn, self.uv, self.faces
        )


def joined(surfaces: Sequence[Surface]) -> Surface:
    """Return several surfaces as one."""
    starts = np.cumsum([0, *(len(s.vertices) for s in surfaces[:-1])])
    return Surface(
        np.concatenate([s.vertices for s in surfaces]),
        np.concatenate([s.normals for s in surfaces]),
        np.concatenate([s.uv for s in surfaces]),
        np.concatenate([s.faces + first for s, first in zip(surfaces, starts, strict=True)]),
    )


def rectangle(corner: Sequence[float], along: Sequence[float], up: Sequence[float]) -> Surface:
    """Return a rectangle seen from the side of ``along`` × ``up``, in mm.

    Args:
        corner: where u = v = 0.
        along, up: its edges of u and of v, at a right angle.
    """
    origin, u, v = (np.asarray(x, dtype=np.float64) for x in (corner, along, up))
    width, height = np.linalg.norm(u), np.linalg.norm(v)
    normal = np.cross(u, v) / (width * height)
    uv = np.array([[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]])
    vertices = np.array([origin, origin + u, origin + u + v, origin + v])
    return Surface(vertices, np.tile(normal, (4, 1)), uv, np.array([[0, 1, 2], [0, 2, 3]]))


def rounded_box(
    size: Sequence[float], radius: float, crown: float = 0.0, flat_steps: int = 1
) -> Surface:
    """Return a box with rounded edges around the origin.

    u and v measure mm along the surface, around the edges too; v runs along z on the four sides
    around the z axis, along y on the other two. Only at the eight corners is the texture squeezed.

    Args:
        size: along x, y and z in mm.
        radius: of the edges in mm; at most half of the shortest side.
        crown: by how many mm the middle is raised along z, as a stuffed cushion is.
        flat_steps: steps between the edges; a crown needs several.
    """
    half = np.asarray(size, dtype=np.float64) / 2.0 - radius
    sides = [_side(half, radius, flat_steps, *side) for side in _SIDES]
    box = joined(sides)
    if crown == 0.0:
        return box
    x, y = (2.0 * box.vertices[:, axis] / size[axis] for axis in (0, 1))
    vertices, normals = box.vertices.copy(), box.normals.copy()
    vertices[:, 2] += crown * (1.0 - x * x) * (1.0 - y * y)
    # the inverse transpose of the raising's Jacobian
    normals[:, 0] += normals[:, 2] * crown * (4.0 * x / size[0]) * (1.0 - y * y)
    normals[:, 1] += normals[:, 2] * crown * (4.0 * y / size[1]) * (1.0 - x * x)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Surface(vertices, normals, box.uv, box.faces)


def _side(
    half: np.ndarray, radius: float, steps: int, n: int, sign: float, a: int, sign_a: float, b: int
) -> Surface:
    """Return one of the six sides of a rounded box, up to the middle of its edges."""
    (along, u), (up, v) = (_profile(half[axis], radius, steps) for axis in (a, b))
    shape = (len(up), len(along))
    outer = np.empty((*shape, 3))
    outer[..., n] = sign * (half[n] + radius)
    outer[..., a] = sign_a * along
    outer[..., b] = up[:, None]
    inner = np.clip(outer, -half, half)
    normals = outer - inner
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    uv = np.stack(np.broadcast_arrays(u, v[:, None]), axis=-1)
    first = (np.arange(shape[0] - 1)[:, None] * shape[1] + np.arange(shape[1] - 1)).ravel()
    quads = np.stack([first, first + 1, first + 1 + shape[1], first + shape[1]], axis=1)
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    flat = (-1, 3)
    vertices = inner + radius * normals
    return Surface(vertices.reshape(flat), normals.reshape(flat), uv.reshape(-1, 2), faces)


def _profile(half: float, radius: float, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Return places across a side, as they lie on the sharp box and as mm along the surface."""
    arc = np.linspace(0.0, np.pi / 4.0, _ARC_STEPS + 1)[1:]
    flat = np.linspace(-half, half, steps + 1)
    edge = half + radius * np.tan(arc)
    length = half + radius * arc
    return (
        np.concatenate([-edge[::-1], flat, edge]),
        np.concatenate([-length[::-1], flat, length]),
    )


def mesh(
    name: str,
    vertices: np.ndarray,
    faces: np.ndarray,
    bsdf: Any,
    normals: np.ndarray | None = None,
    uv: np.ndarray | None = None,
    face_colours: np.ndarray | None = None,
    colour_name: str = "face_color",
) -> Any:
    """Return triangles as a Mitsuba mesh.

    Args:
        vertices: shape (n, 3).
        faces: shape (m, 3).
        bsdf: a loaded Mitsuba BSDF.
        normals: shape (n, 3); without them the triangles are flat.
        uv: shape (n, 2).
        face_colours: shape (m, 3), the attribute ``colour_name``.
        colour_name: name of the attribute.
    """
    import mitsuba as mi

    properties = mi.Properties()
    properties["bsdf"] = bsdf
    made = mi.Mesh(
        name,
        len(vertices),
        len(faces),
        props=properties,
        has_vertex_normals=normals is not None,
        has_vertex_texcoords=uv is not None,
    )
    if face_colours is not None:
        values: Any = face_colours.ravel()  # the stub knows no arrays
        made.add_attribute(colour_name, 3, values)
    data = mi.traverse(made)
    data["vertex_positions"] = _flat(vertices, np.float32)
    data["faces"] = _flat(faces, np.uint32)
    if normals is not None:
        data["vertex_normals"] = _flat(normals, np.float32)
    if uv is not None:
        data["vertex_texcoords"] = _flat(uv, np.float32)
    data.update()
    return made


def _flat(values: np.ndarray, kind: type) -> np.ndarray:
    return np.ascontiguousarray(values, dtype=kind).ravel()

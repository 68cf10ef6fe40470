"""The form of a shape: its box, whether it is convex, flat or closed, and whose normals it has."""

from __future__ import annotations

from typing import Any, NamedTuple

import mitsuba as mi
import numpy as np

_FLAT = {"Disk", "Rectangle"}
_CLOSED = {"Sphere", "Cube"}
_CONVEX = {*_FLAT, *_CLOSED, "Cylinder"}
_TURNING = {"NormalMap", "BumpMap"}  # BSDFs whose normals are not those of the shape
_MOST_CORNERS = 20_000_000  # faces × vertices of a mesh whose convexity is tested
_FEW_FACES = 256  # tried first: most meshes show with few that they are not convex
_ON_PLANE = 1e-5  # of the size of a mesh: float32 vertices of one face are that far off it
_SAME_NORMAL = 1e-4  # of 1 - cosine


class Form(NamedTuple):
    """Whether a shape bounds a convex set with its normals outwards, is flat, and is closed."""

    convex: bool
    flat: bool
    closed: bool


def box_of(shape: Any) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the (3,) corners of the bounding box of a shape, None where nobody knows.

    Mitsuba leaves that of merged meshes invalid; it is taken from their vertices then.
    """
    box = shape.bbox()
    low, high = (np.array(corner, dtype=np.float64).ravel() for corner in (box.min, box.max))
    if np.isfinite([low, high]).all() and (low <= high).all():
        return low, high
    vertices, _ = _mesh(shape)
    if not len(vertices) or not np.isfinite(vertices).all():
        return None
    return vertices.min(axis=0), vertices.max(axis=0)


def turns_normals(shape: Any) -> bool:
    """Return whether a shape is shaded with normals that are not those of its surface.

    Its cosine then sees light that the surface hides from itself.
    """
    plain = shape.class_name() in _CONVEX
    if not plain and shape.is_mesh() and shape.has_vertex_normals() and _interpolates(shape):
        return True
    bsdf = shape.bsdf()
    if bsdf is None:
        return False
    nodes = mi.traverse(bsdf).hierarchy
    return any(isinstance(node, mi.BSDF) and node.class_name() in _TURNING for node in nodes)


def form_of(shape: Any) -> Form:
    """Return the form of a shape, as far as it is known."""
    kind = shape.class_name()
    if kind in _CONVEX:
        return Form(True, kind in _FLAT, kind in _CLOSED)
    return _mesh_form(*_mesh(shape)) if shape.is_mesh() else Form(False, False, False)


def _mesh(shape: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices (n, 3) and faces (m, 3); none of what is no mesh."""
    if not shape.is_mesh():
        return np.empty((0, 3)), np.empty((0, 3), dtype=np.int64)
    parameters = mi.traverse(shape)
    if "vertex_positions" not in parameters or "faces" not in parameters:
        return np.empty((0, 3)), np.empty((0, 3), dtype=np.int64)
    vertices = np.array(parameters["vertex_positions"], dtype=np.float64).reshape(-1, 3)
    return vertices, np.array(parameters["faces"], dtype=np.int64).reshape(-1, 3)


def _interpolates(shape: Any) -> bool:
    """Return whether the normals of a mesh's vertices differ from those of its faces."""
    parameters = mi.traverse(shape)
    if "vertex_normals" not in parameters:
        return True
    vertices, faces = _mesh(shape)
    given = np.array(parameters["vertex_normals"], dtype=np.float64).reshape(-1, 3)
    if len(given) != len(vertices) or not len(faces):
        return bool(len(given))
    normals, kept = _face_normals(vertices[faces])
    cosine = np.einsum("fvc,fc->fv", given[faces[kept]], normals)
    return bool((np.abs(cosine) < 1.0 - _SAME_NORMAL).any())


def _face_normals(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return unit normals (k, 3) of the faces that have an area, and which (m,) those are."""
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    kept = lengths > 0.0
    return normals[kept] / lengths[kept, None], kept


def _mesh_form(vertices: np.ndarray, faces: np.ndarray) -> Form:
    """Return the form of a mesh.

    Every vertex of a convex one has to lie on or below the plane of every face. An open convex
    mesh passes as well; it is then one-sided or counts as concave.
    """
    nothing = Form(False, False, False)
    if not len(faces):
        return nothing
    size = float(np.ptp(vertices, axis=0).max()) or 1.0
    normals, kept = _face_normals(vertices[faces])
    first = vertices[faces[kept, 0]]

    def above(some: slice | np.ndarray) -> np.ndarray:
        own = np.sum(normals[some] * first[some], axis=1)
        return np.asarray(normals[some] @ vertices.T - own[:, None])

    few = np.linspace(0, len(normals) - 1, min(_FEW_FACES, len(normals))).astype(np.int64)
    sample = above(few)
    bent = np.abs(sample).max(initial=0.0) > _ON_PLANE * size
    if bent and sample.max(initial=0.0) > _ON_PLANE * size:
        return nothing
    if len(faces) * len(vertices) > _MOST_CORNERS:
        return nothing
    whole = above(slice(None))
    flat = bool(np.abs(whole).max(initial=0.0) <= _ON_PLANE * size)
    convex = bool(whole.max(initial=0.0) <= _ON_PLANE * size)
    closed = _is_closed(vertices, faces, size)
    return Form(closed and convex, flat, closed)


def _is_closed(vertices: np.ndarray, faces: np.ndarray, size: float) -> bool:
    """Return whether every edge belongs to two faces."""
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    same_place = np.unique(np.round(vertices / (size * 1e-6)), axis=0, return_inverse=True)[1]
    counts = np.unique(np.sort(same_place.ravel()[edges], axis=1), axis=0, return_counts=True)[1]
    return bool((counts == 2).all())

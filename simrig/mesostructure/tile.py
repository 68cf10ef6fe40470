"""A seamless piece of a material with real structure: triangles, colours and how they reflect."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from simrig.core.errors import SimrigError

# The seven groups of thesis section B.1, and what none of its materials is
GROUPS = {
    "fabric smooth": "G1",
    "fabric meso": "G2",
    "fabric rough": "G3",
    "leather meso": "G4",
    "leather rough": "G5",
    "wood meso": "G6",
    "wood rough": "G7",
    "other": "-",
}

# What a BSDF names to be given the colours of its part (see ``simrig.scenes.tile``)
COLOURS = {"type": "mesh_attribute", "name": "vertex_color"}


@dataclass(frozen=True, eq=False)
class Part:
    """Triangles with one BSDF; lengths in mm, z up, the reference plane at z = 0.

    Attributes:
        vertices: (n, 3) float32. They may reach beyond the tile; its copies meet them there.
        faces: (m, 3) uint32, counter-clockwise seen from outside.
        normals: (n, 3) float32 unit shading normals, or None for flat facets.
        colours: (n, 3) float32 linear RGB albedo in [0, 1], or None.
        bsdf: dictionary of a built-in Mitsuba BSDF, plain values; ``COLOURS`` stands for the
            colours.
        uv: (n, 2) float32 whose u runs along the tangent of anisotropic BSDFs, or None.

    Raises:
        SimrigError: arrays that do not fit together or are not finite.
    """

    vertices: np.ndarray
    faces: np.ndarray
    normals: np.ndarray | None
    colours: np.ndarray | None
    bsdf: dict[str, Any]
    uv: np.ndarray | None = None

    def __post_init__(self) -> None:
        count = len(self.vertices)
        for name, columns in (("vertices", 3), ("normals", 3), ("colours", 3), ("uv", 2)):
            values = getattr(self, name)
            if values is None:
                continue
            values = np.ascontiguousarray(values, dtype=np.float32)
            if values.shape != (count, columns) or not np.isfinite(values).all():
                raise SimrigError(
                    f"{name} of a part must be finite, of shape ({count}, {columns}), "
                    f"got {values.shape}"
                )
            object.__setattr__(self, name, values)
        faces = np.ascontiguousarray(self.faces, dtype=np.uint32)
        if faces.ndim != 2 or faces.shape[1] != 3 or len(faces) == 0 or faces.max() >= count:
            raise SimrigError(f"faces must index the {count} vertices by threes, got {faces.shape}")
        object.__setattr__(self, "faces", faces)

    @property
    def nbytes(self) -> int:
        """Bytes of the arrays."""
        arrays = (self.vertices, self.faces, self.normals, self.colours, self.uv)
        return sum(a.nbytes for a in arrays if a is not None)


@dataclass(frozen=True, eq=False)
class Tile:
    """A piece of a material that repeats seamlessly in x and in y.

    The material is the union of the parts moved by every whole multiple of ``size_mm``; the tile
    itself covers 0 ≤ x ≤ width and 0 ≤ y ≤ height, and its parts may overhang. Seen from above
    there is a surface everywhere.

    Attributes:
        name: of the preset, or of what was built.
        group: one of ``GROUPS``.
        description: one line for lists.
        size_mm: (width along x, height along y).
        element_mm: size of the largest structural element, as in thesis Fig. B.2.
        parts: at least one.
        height_mm: (lowest, highest) z of the vertices, filled in when not given.
        origin: how it was made, plain values.

    Raises:
        SimrigError: unknown group, or sizes that are not positive.
    """

    # what plans ask of a material: apparent BRDFs keep their order, and a tile has data everywhere
    reciprocal: ClassVar[bool] = False
    theta_max: ClassVar[float] = float(np.pi / 2)

    name: str
    group: str
    description: str
    size_mm: tuple[float, float]
    element_mm: float
    parts: tuple[Part, ...]
    height_mm: tuple[float, float] = (0.0, 0.0)
    origin: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.group not in GROUPS:
            raise SimrigError(f"unknown group '{self.group}': known: {', '.join(GROUPS)}")
        if not self.parts:
            raise SimrigError(f"tile '{self.name}' has no parts")
        for what, size in (("tile", min(self.size_mm)), ("structural element", self.element_mm)):
            if not (np.isfinite(size) and size > 0.0):
                raise SimrigError(f"the size of a {what} must be > 0 mm, got {size:g}")
        z = [part.vertices[:, 2] for part in self.parts]
        extent = (min(float(h.min()) for h in z), max(float(h.max()) for h in z))
        object.__setattr__(self, "height_mm", extent)

    @property
    def triangles(self) -> int:
        """Number of triangles of all parts."""
        return sum(len(part.faces) for part in self.parts)

    @property
    def nbytes(self) -> int:
        """Bytes of the arrays of all parts."""
        return sum(part.nbytes for part in self.parts)

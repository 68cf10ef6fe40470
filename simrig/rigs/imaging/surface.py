"""What lies under the camera, and the light that it sends there.

A flat material (a BRDF, or a BTF, whose structure is in its values) is evaluated where every pixel
looks: exact, and nothing is left for a renderer to do. A tile with true structure is traced by
Mitsuba: the camera's rays once for a view, then a shadow ray and an evaluation for each light.
"""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

import numpy as np

from simrig.brdf.protocol import Brdf, evaluate
from simrig.btf.full import FullBtf
from simrig.btf.mipmap import Footprint
from simrig.btf.spatial import SpatialBrdf
from simrig.btf.stack import BtfStack
from simrig.core.errors import SimrigError
from simrig.mesostructure.tile import Tile
from simrig.rigs.imaging.view import View


@runtime_checkable
class Surface(Protocol):
    """A sample in the sensor's frame: x, y in mm around its centre, z its normal."""

    def reflected(self, view: View, lights: np.ndarray, number: int) -> np.ndarray:
        """Return f_r times the cosine of what a view sees.

        Args:
            view: what its pixels see.
            lights: (m, 3) where the light stands, mm.
            number: of the view, for what is sampled.

        Returns:
            (m, n, 3) for the n pixels of the view that see the sample, in 1/sr.
        """
        ...


class FlatSurface:
    """A BRDF, the same everywhere, or a BTF, which repeats over the sample."""

    def __init__(self, material: Brdf):
        self.material = material

    def reflected(self, view: View, lights: np.ndarray, number: int) -> np.ndarray:
        """Return f_r times the cosine (see ``Surface``)."""
        return np.stack([self._lit(view, light) for light in lights])

    def _lit(self, view: View, light: np.ndarray) -> np.ndarray:
        to_light = light - view.points
        wi = to_light / np.linalg.norm(to_light, axis=1, keepdims=True)
        if isinstance(self.material, SpatialBrdf):
            values = self._of_texels(self.material, view, wi)
        else:
            values = evaluate(self.material, wi, view.towards)
        if not np.all(np.isfinite(values)) or (values.size and values.min() < 0.0):
            raise SimrigError(
                f"'{self.material.name}' is negative or not finite where a pixel looks: repair the "
                "material's data"
            )
        return np.asarray(values * np.maximum(wi[:, 2:], 0.0))

    @staticmethod
    def _of_texels(material: SpatialBrdf, view: View, wi: np.ndarray) -> np.ndarray:
        x = view.points[:, 0] + 0.5 * material.size_mm[0]
        y = view.points[:, 1] + 0.5 * material.size_mm[1]
        right, down = np.linalg.norm(view.steps, axis=-1)
        wider = np.where((right >= down)[:, None], *view.steps)
        footprint = Footprint(x, y, np.minimum(right, down), wider[:, 0], wider[:, 1])
        found = material.eval_at(wi, view.towards, footprint, material.tables(np.ndarray))
        return np.asarray(found)


def surface_of(material: Any, *, spp: int, bounces: int, seed: int, steepest: float) -> Surface:
    """Return a material as what lies under the camera.

    Args:
        material: a ``Brdf``, ``BtfStack`` or ``Tile``; what is one already stays as it is.
        spp: samples per pixel of a tile; what is flat needs none.
        bounces: reflections at most between the parts of a tile.
        seed: of the samples.
        steepest: polar angle of any view or light, radians.

    Raises:
        SimrigError: another kind of material.
    """
    if isinstance(material, Surface):
        return material
    if isinstance(material, Tile):
        from simrig.rigs.imaging.traced import TracedSurface

        return TracedSurface(material, float(np.degrees(steepest)), spp, bounces, seed)
    if isinstance(material, BtfStack):
        return FlatSurface(FullBtf.from_stack(material))
    if isinstance(material, Brdf):
        return FlatSurface(material)
    raise SimrigError(
        f"pictures are taken of a BRDF, a BTF or a tile with structure, not of "
        f"{type(material).__name__}"
    )

"""The plugin ``simrig_btf``: a material with structure, filtered over distance."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

import drjit as dr
import numpy as np

from simrig.btf.factored import TOLERANCE, FactoredBtf
from simrig.btf.full import BUDGET_BYTES, OVER_BUDGET, FullBtf
from simrig.btf.grid import MISSING
from simrig.btf.mipmap import MOST_ANISOTROPY
from simrig.btf.spatial import SpatialBrdf
from simrig.core.errors import SimrigError, unknown_name
from simrig.plugins.adapter import to_number
from simrig.plugins.footprint import Cone
from simrig.plugins.named import number, resolved

FORMS = ("full", "factored")
_KEPT = 4  # files whose tables stay in memory for the next scene
_MIB = 1 << 20


def define_btf(adapter: type) -> type:
    """A bidirectional texture function from a file.

    | parameter | type | default | differentiable | meaning |
    | --- | --- | --- | --- | --- |
    | filename | string | required | – | an image stack or a factored BTF of simrig (HDF5) |
    | form | string | full | – | of a stack: `full`, or `factored` when it is loaded |
    | tolerance | float | 0.2 | – | error of factors that are made here |
    | scale | float | required | – | mm of material per unit of u |
    | scale_v | float | scale | – | mm of material per unit of v |
    | rotation | float | 0 | – | degrees about the normal, texture and directions alike |
    | pixel_angle | float | 0 | – | degrees of one pixel: the footprint grows with distance |
    | pixel_width | float | 0 | – | mm of one pixel of an orthographic camera |
    | unit | float | 1 | – | mm per unit of the scene |
    | anisotropy | integer | 8 | – | most look-ups along a footprint's longer axis |
    | missing | string | refuse | – | pairs without an image: `refuse` or `fill` |
    | budget | float | 2048 | – | MiB that the table may take |
    | over_budget | string | refuse | – | a larger one: `refuse`, or `coarsen` the tile |

    With neither `pixel_angle` nor `pixel_width` the finest level is seen everywhere. The colour
    `gain` (1) multiplies f_r; it is listed by `mi.traverse` and differentiable, and so are the
    factors `basis` and `coefficients`. See docs/btf.md.

    ```python
    {"type": "simrig_btf", "filename": "corduroy.h5", "scale": 185.35, "scale_v": 120.0,
     "pixel_angle": 0.02}
    ```
    """

    import mitsuba

    mi: Any = mitsuba  # its stubs describe one variant, the class below serves all

    class BtfBSDF(adapter):
        """A spatially varying BRDF, seen through a pixel's cone.

        Attributes:
            within_mm: how far structure is seen; see ``show_structure_within``.
        """

        def __init__(
            self,
            props: Any,
            brdf: SpatialBrdf | None = None,
            rotation_deg: float = 0.0,
        ) -> None:
            self.cone = Cone.from_properties(props)
            if brdf is not None:
                rotation_deg = number(props, "rotation", rotation_deg)
            super().__init__(props, brdf, rotation_deg)
            self.show_structure_within(np.inf)

        def show_structure_within(self, distance_mm: float) -> None:
            """See the texels up to a distance, and beyond it the average of the tile.

            What is not needed is not traced either: infinity and 0 make kernels of their own.

            Args:
                distance_mm: of the last ray segment, in mm; infinity (the default) or 0 for none.
            """
            self.within_mm = distance_mm
            self.within = to_number(distance_mm / self.cone.unit_mm, mi)

        @staticmethod
        def build(props: Any) -> SpatialBrdf:
            """Read the file that the properties name."""
            path = resolved("simrig_btf", props)
            options = {
                "missing": _choice(props, "missing", MISSING),
                "over_budget": _choice(props, "over_budget", OVER_BUDGET),
                "budget_bytes": int(_MIB * number(props, "budget", BUDGET_BYTES / _MIB)),
                "anisotropy": number(props, "anisotropy", MOST_ANISOTROPY),
                "form": _choice(props, "form", FORMS),
                "tolerance": number(props, "tolerance", TOLERANCE),
            }
            return _loaded(path, path.stat().st_mtime_ns, tuple(options.items()))

        def _place(self, si: Any) -> Any:
            if self.within_mm == 0.0:
                return None
            footprint = self.cone.footprint(si, self.cos_turn, self.sin_turn)
            everywhere = np.isinf(self.within_mm)
            return footprint, None if everywhere else dr.abs(dr.detach(si.t)) < self.within

        def _look_up(self, light: Any, view: Any, place: Any) -> Any:
            def average(light: Any, view: Any) -> Any:
                return mi.Color3f(self.brdf.look_up(light, view, self.prepared))

            if place is None:
                return average(light, view)
            footprint, near = place

            def texels(light: Any, view: Any) -> Any:
                return mi.Color3f(self.brdf.look_up_at(light, view, footprint, self.prepared))

            if near is None:
                return texels(light, view)
            if self.differentiable:
                return dr.select(near, texels(light, view), average(light, view))
            return dr.if_stmt((light, view), near, texels, average)

    return type("simrig_btf", (BtfBSDF,), {"__doc__": define_btf.__doc__})


@lru_cache(maxsize=_KEPT)
def _loaded(path: Path, changed: int, options: tuple[tuple[str, Any], ...]) -> SpatialBrdf:
    """Return the BRDF of a file, read once; its time of change is part of the key."""
    from simrig.files.btf.hdf5 import read_btf
    from simrig.files.hdf5 import content_of, read_brdf

    chosen = dict(options)
    form, tolerance = chosen.pop("form"), chosen.pop("tolerance")
    if content_of(path) == "brdf":
        brdf = read_brdf(path)
        if isinstance(brdf, SpatialBrdf):
            return brdf
        raise SimrigError(f"simrig_btf: '{path}' holds a BRDF: use simrig_table")
    if form == "full":
        return FullBtf.from_stack(read_btf(path), **chosen)
    return FactoredBtf.from_stack(
        read_btf(path),
        tolerance=tolerance,
        missing=chosen["missing"],
        anisotropy=chosen["anisotropy"],
    )


def _choice(props: Any, name: str, known: tuple[str, ...]) -> str:
    """Return a property that is one of a few words, by default the first."""
    value = props.get(name, known[0])
    if not isinstance(value, str):
        raise SimrigError(f"'{name}' must be one of {', '.join(known)}, got {value!r}")
    if value not in known:
        raise unknown_name(name, value, known)
    return value

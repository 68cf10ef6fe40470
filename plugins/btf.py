"""The plugin ``simrig_btf``: a material with structure, filtered over distance."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

from simrig.errors import SimrigError, unknown_name
from simrig.plugins.footprint import Cone
from simrig.plugins.named import number, resolved
from simrig.reflectance.btf_factored import TOLERANCE, FactoredBtf
from simrig.reflectance.btf_full import BUDGET_BYTES, OVER_BUDGET, FullBtf
from simrig.reflectance.btf_grid import MISSING
from simrig.reflectance.pyramid import MOST_PROBES
from simrig.reflectance.spatial import SpatialReflectance

FORMS = ("full", "factored")
_KEPT = 4  # files whose tables stay in memory for the next scene
_MIB = 1 << 20


def define_btf(adapter: type) -> type:
    """A bidirectional texture function from a file.

    | parameter | type | default | differentiable | meaning |
    | --- | --- | --- | --- | --- |
    | filename | string | required | – | an image stack or a factored BTF of simrig (HDF5) |
    | form | string | full | – | of a stack: `full`, or `factored` when it is loaded |
    | tolerance | float | 0.05 | – | error of factors that are made here |
    | scale | float | required | – | mm of material per unit of u |
    | scale_v | float | scale | – | mm of material per unit of v |
    | rotation | float | 0 | – | degrees about the normal, texture and directions alike |
    | pixel_angle | float | 0 | – | degrees of one pixel: the footprint grows with distance |
    | pixel_width | float | 0 | – | mm of one pixel of an orthographic camera |
    | unit | float | 1 | – | mm per unit of the scene |
    | probes | integer | 8 | – | most look-ups along a footprint's longer axis |
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

    class BtfBSDF(adapter):
        """A spatially varying reflectance, seen through a pixel's cone."""

        def __init__(
            self,
            props: Any,
            reflectance: SpatialReflectance | None = None,
            rotation_deg: float = 0.0,
        ) -> None:
            self.cone = Cone.from_properties(props)
            if reflectance is not None:
                rotation_deg = number(props, "rotation", rotation_deg)
            super().__init__(props, reflectance, rotation_deg)

        @staticmethod
        def build(props: Any) -> SpatialReflectance:
            """Read the file that the properties name."""
            path = resolved("simrig_btf", props)
            options = {
                "missing": _choice(props, "missing", MISSING),
                "over_budget": _choice(props, "over_budget", OVER_BUDGET),
                "budget_bytes": int(_MIB * number(props, "budget", BUDGET_BYTES / _MIB)),
                "probes": number(props, "probes", MOST_PROBES),
                "form": _choice(props, "form", FORMS),
                "tolerance": number(props, "tolerance", TOLERANCE),
            }
            return _loaded(path, path.stat().st_mtime_ns, tuple(options.items()))

        def _place(self, si: Any) -> Any:
            return self.cone.footprint(si, self.cos_turn, self.sin_turn)

        def _look_up(self, light: Any, view: Any, place: Any) -> Any:
            return self.reflectance.eval_at(light, view, place, self.prepared)

    return type("simrig_btf", (BtfBSDF,), {"__doc__": define_btf.__doc__})


@lru_cache(maxsize=_KEPT)
def _loaded(path: Path, changed: int, options: tuple[tuple[str, Any], ...]) -> SpatialReflectance:
    """Return the reflectance of a file, read once; its time of change is part of the key."""
    from simrig.data.btf_hdf5 import read_btf
    from simrig.data.hdf5 import content_of, read_reflectance

    chosen = dict(options)
    form, tolerance = chosen.pop("form"), chosen.pop("tolerance")
    if content_of(path) == "reflectance":
        reflectance = read_reflectance(path)
        if isinstance(reflectance, SpatialReflectance):
            return reflectance
        raise SimrigError(f"simrig_btf: '{path}' holds a BRDF: use simrig_table")
    if form == "full":
        return FullBtf.from_stack(read_btf(path), **chosen)
    return FactoredBtf.from_stack(
        read_btf(path),
        tolerance=tolerance,
        missing=chosen["missing"],
        probes=chosen["probes"],
    )


def _choice(props: Any, name: str, known: tuple[str, ...]) -> str:
    """Return a property that is one of a few words, by default the first."""
    value = props.get(name, known[0])
    if not isinstance(value, str):
        raise SimrigError(f"'{name}' must be one of {', '.join(known)}, got {value!r}")
    if value not in known:
        raise unknown_name(name, value, known)
    return value

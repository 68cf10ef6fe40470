"""The plugin ``simrig_btf``: a material with structure, filtered over distance."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from weakref import WeakValueDictionary

import drjit as dr
import numpy as np

from simrig.btf.factored import TOLERANCE, FactoredBtf
from simrig.btf.full import BUDGET_BYTES, OVER_BUDGET, FullBtf
from simrig.btf.grid import MISSING
from simrig.btf.mipmap import MOST_ANISOTROPY
from simrig.btf.spatial import SpatialBrdf
from simrig.btf.stack import BtfStack
from simrig.btf.varying import METHODS
from simrig.core.errors import SimrigError, unknown_name
from simrig.plugins.adapter import to_number
from simrig.plugins.footprint import Cone
from simrig.plugins.named import number, resolved

FORMS = ("full", "factored")
_OPTIONS = (
    "missing", "over_budget", "budget", "anisotropy", "form", "tolerance", "time", "interpolation"
)  # fmt: skip
_KEPT_BYTES = 1 << 29  # of tables that stay in memory for the next scene
_MIB = 1 << 20
_shared: WeakValueDictionary[tuple, SpatialBrdf] = WeakValueDictionary()
_recent: list[SpatialBrdf] = []


def define_btf(adapter: type) -> type:
    """A bidirectional texture function from a file.

    | parameter | type | default | differentiable | meaning |
    | --- | --- | --- | --- | --- |
    | filename | string | required | – | a stack or a factored BTF (HDF5), or a sequence (.toml) |
    | time | float | required | – | of a sequence, a BTF that changes with time |
    | interpolation | string | linear | – | of a sequence: `linear`, `staf`, `displacement` |
    | form | string | full | – | of a stack: `full`, or `factored` when it is loaded |
    | tolerance | float | 0.2 | – | error of factors that are made here |
    | scale | float | required | – | mm of material per unit of u |
    | scale_v | float | scale | – | mm of material per unit of v |
    | rotation | float | 0 | – | degrees about the normal, texture and directions alike |
    | pixel_angle | float | 0 | – | degrees of one pixel: the footprint grows with distance |
    | pixel_width | float | 0 | – | mm of one pixel of an orthographic camera |
    | unit | float | 1 | – | mm per unit of the scene |
    | anisotropy | integer | 8 | – | most look-ups along a footprint (with a pixel's size) |
    | missing | string | refuse | – | of a full stack, pairs without an image: `refuse` or `fill` |
    | budget | float | 2048 | – | MiB that the table or the factors may take |
    | over_budget | string | refuse | – | a larger full stack: `refuse`, or `coarsen` the tile |

    A parameter that could do nothing is refused, for example `tolerance` with a file that holds
    factors already. With neither `pixel_angle` nor `pixel_width` the finest level is seen
    everywhere. The colour `gain` (1) multiplies f_r; it is listed by `mi.traverse` and
    differentiable, and so are the factors `basis` and `coefficients`. See docs/btf.md.

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
            asked = {name for name in _OPTIONS if name in props}  # reading marks them as used
            options = {
                "missing": _choice(props, "missing", MISSING),
                "over_budget": _choice(props, "over_budget", OVER_BUDGET),
                "budget": number(props, "budget", BUDGET_BYTES / _MIB),
                "anisotropy": number(props, "anisotropy", MOST_ANISOTROPY),
                "form": _choice(props, "form", FORMS),
                "tolerance": number(props, "tolerance", TOLERANCE),
                "time": number(props, "time", 0.0),
                "interpolation": _choice(props, "interpolation", tuple(METHODS)),
            }
            given = {name: value for name, value in options.items() if name in asked}
            if not any(number(props, name, 0.0) for name in ("pixel_angle", "pixel_width")):
                _refuse(given, {"anisotropy"}, "pixels of no size have no footprint")
            return _loaded(path, given)

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


def _loaded(path: Path, given: dict[str, Any]) -> SpatialBrdf:
    """Return the BRDF of a file, read once for all scenes that have it at the same time."""
    key = (path, path.stat().st_mtime_ns, tuple(sorted(given.items())))
    found = _shared.get(key)
    if found is None:
        found = _shared[key] = _read(path, given)
    _keep(found)
    return found


def _keep(brdf: SpatialBrdf) -> None:
    """Keep what was read last for the next scene, as long as it takes little memory."""
    others = [one for one in _recent if one is not brdf]
    _recent[:] = [brdf, *others]
    while sum(one.device_bytes for one in _recent) > _KEPT_BYTES:
        _recent.pop()


def _read(path: Path, given: dict[str, Any]) -> SpatialBrdf:
    from simrig.files.btf.hdf5 import read_btf
    from simrig.files.hdf5 import content_of, read_brdf

    budget, at = int(_MIB * given.get("budget", BUDGET_BYTES / _MIB)), _at_time(path, given)
    if at is None and content_of(path) == "brdf":
        brdf = read_brdf(path)
        if not isinstance(brdf, FactoredBtf):
            raise SimrigError(f"simrig_btf: '{path}' holds a BRDF: use simrig_table")
        return _of_factors(path, brdf, budget, given)
    stack, form = read_btf(path) if at is None else at, given.get("form", FORMS[0])
    anisotropy = int(given.get("anisotropy", MOST_ANISOTROPY))
    if form == "full":
        _refuse(given, {"tolerance"}, "the full form has no factors")
        kept = {name: given[name] for name in ("missing", "over_budget") if name in given}
        return FullBtf.from_stack(stack, budget_bytes=budget, anisotropy=anisotropy, **kept)
    _refuse(given, {"over_budget", "missing"}, "factors are made of the whole stack")
    tolerance = given.get("tolerance", TOLERANCE)
    return FactoredBtf.from_stack(
        stack, tolerance=tolerance, anisotropy=anisotropy, budget_bytes=budget
    )


def _at_time(path: Path, given: dict[str, Any]) -> BtfStack | None:
    """Return a BTF that changes with time at the one that is asked for; None of a file of one."""
    from simrig.files.btf.sequence import read_sequence

    if path.suffix.lower() != ".toml":
        _refuse(given, {"time", "interpolation"}, f"'{path}' does not change with time")
        return None
    if "time" not in given:
        raise SimrigError(f"simrig_btf: '{path}' changes with time: 'time' is missing")
    return read_sequence(path).at(given["time"], given.get("interpolation", "linear"))


def _of_factors(path: Path, brdf: FactoredBtf, budget: int, given: dict[str, Any]) -> FactoredBtf:
    """Return the BTF of a file that holds factors, with what can still be chosen."""
    useless = {"tolerance", "missing", "over_budget"}
    if given.get("form") == "full":
        useless.add("form")
    _refuse(given, useless, f"'{path}' holds factors already")
    if brdf.device_bytes > budget:
        raise SimrigError(
            f"simrig_btf: the factors of '{path}' take {brdf.device_bytes / _MIB:.3g} MiB, the "
            f"budget is {budget / _MIB:.3g} MiB: raise it"
        )
    if "anisotropy" in given:
        return brdf.with_anisotropy(int(given["anisotropy"]))
    return brdf


def _refuse(given: dict[str, Any], useless: set[str], reason: str) -> None:
    for name in sorted(useless & given.keys()):
        raise SimrigError(f"simrig_btf: '{name}' can do nothing here ({reason}): leave it out")


def _choice(props: Any, name: str, known: tuple[str, ...]) -> str:
    """Return a property that is one of a few words, by default the first."""
    value = props.get(name, known[0])
    if not isinstance(value, str):
        raise SimrigError(f"'{name}' must be one of {', '.join(known)}, got {value!r}")
    if value not in known:
        raise unknown_name(name, value, known)
    return value

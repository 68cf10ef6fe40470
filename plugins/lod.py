"""The plugin ``simrig_lod``: one material near, another far (thesis section 3.3)."""

from __future__ import annotations

from typing import Any

import drjit as dr

from simrig.core.errors import SimrigError
from simrig.plugins.adapter import as_float, to_number
from simrig.plugins.lifetime import traced
from simrig.plugins.named import number
from simrig.plugins.variants import check_vectorised

_BELOW_ONE = 1.0 - 2.0**-24


def define_lod() -> type:
    """Two materials by distance: a BTF within the critical viewing distance, its BRDF beyond.

    | parameter | type | default | differentiable | meaning |
    | --- | --- | --- | --- | --- |
    | near, far | BSDF | required | `near.…`, `far.…` | the two materials |
    | distance | float | required | `distance` | mm from which on `far` is seen |
    | fade | float | 0 | – | mm over which they blend, half on either side of `distance` |
    | unit | float | 1 | – | mm per unit of the scene |

    The distance is that of the ray segment which ends at the surface: from the camera for what is
    seen directly, from the last surface for what is seen in it. Each material is evaluated only
    where it is needed.

    ```python
    {"type": "simrig_lod", "distance": 2000.0, "fade": 200.0,
     "near": {"type": "simrig_btf", "filename": "leather.h5", "scale": 100.0},
     "far": {"type": "simrig_table", "filename": "leather_brdf.h5"}}
    ```
    """
    import mitsuba

    mi: Any = mitsuba  # its stubs describe one variant, the class below serves all

    class LodBSDF(mi.BSDF):
        """Forwards to one of two materials, or blends them."""

        def __init__(self, props: Any) -> None:
            check_vectorised("'simrig_lod'")
            for name in ("near", "far"):
                if name not in props or not isinstance(props[name], mi.BSDF):
                    raise SimrigError(f"simrig_lod: '{name}' must be a nested BSDF")
            if "distance" not in props:
                raise SimrigError("simrig_lod: the parameter 'distance' (mm) is missing")
            distance = number(props, "distance", 0.0)
            fade, unit = number(props, "fade", 0.0), number(props, "unit", 1.0)
            if distance < 0.0 or fade < 0.0 or unit <= 0.0:
                raise SimrigError(
                    "simrig_lod: 'distance' and 'fade' must be at least 0 mm and 'unit' above 0"
                )
            # refused before: from here on Mitsuba's kernels may call it
            super().__init__(props)
            self.near, self.far = props["near"], props["far"]
            self.distance, self.fade, self.unit = to_number(distance, mi), fade, unit
            # one component: a context that asks for a type reaches both
            self.m_flags = self.near.flags() | self.far.flags()
            self.m_components = [self.m_flags]

        @traced
        def eval(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            share, near, far = self._shares(si, active)
            value = share * (self.near.eval(ctx, si, wo, near) & near)
            return value + (1.0 - share) * (self.far.eval(ctx, si, wo, far) & far)

        @traced
        def pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            share, near, far = self._shares(si, active)
            density = share * dr.select(near, self.near.pdf(ctx, si, wo, near), 0.0)
            return density + (1.0 - share) * dr.select(far, self.far.pdf(ctx, si, wo, far), 0.0)

        @traced
        def eval_pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            share, near, far = self._shares(si, active)
            value_n, pdf_n = self.near.eval_pdf(ctx, si, wo, near)
            value_f, pdf_f = self.far.eval_pdf(ctx, si, wo, far)
            value = share * (value_n & near) + (1.0 - share) * (value_f & far)
            density = share * dr.select(near, pdf_n, 0.0)
            return value, density + (1.0 - share) * dr.select(far, pdf_f, 0.0)

        @traced
        def sample(self, ctx: Any, si: Any, sample1: Any, sample2: Any, active: Any = True) -> Any:
            share, near, far = self._shares(si, active)
            chance = dr.detach(share)
            take_near = sample1 < chance
            taken = dr.select(take_near, chance, 1.0 - chance)
            # the variate that chose the material is stretched and used again
            again = dr.select(take_near, sample1, sample1 - chance) / dr.maximum(taken, 1e-6)
            again = dr.minimum(again, _BELOW_ONE)
            bs_near, weight_near = self.near.sample(ctx, si, again, sample2, near & take_near)
            bs_far, weight_far = self.far.sample(ctx, si, again, sample2, far & ~take_near)
            bs = dr.select(take_near, bs_near, bs_far)
            weight = dr.select(take_near, weight_near, weight_far)
            if self.fade > 0.0:
                bs.pdf *= taken
                delta = mi.has_flag(bs.sampled_type, mi.BSDFFlags.Delta)
                blended = near & far & (bs.pdf > 0.0) & ~delta
                value, density = self.eval_pdf(ctx, si, bs.wo, blended)
                bs.pdf = dr.select(blended, density, bs.pdf)
                weight = dr.select(blended, value / dr.select(blended, density, 1.0), weight)
            bs.sampled_component = mi.UInt32(0)
            return bs, weight & active

        def traverse(self, cb: Any) -> None:
            cb.put("near", self.near, mi.ParamFlags.Differentiable)
            cb.put("far", self.far, mi.ParamFlags.Differentiable)
            cb.put("distance", self.distance, mi.ParamFlags.Differentiable)

        def to_string(self) -> str:
            return (
                f"simrig_lod[\n  distance = {as_float(self.distance):g} mm,\n  fade = "
                f"{self.fade:g} mm,\n  near = {self.near},\n  far = {self.far}\n]"
            )

        def parameters_changed(self, keys: Any = ()) -> None:
            dr.make_opaque(self.distance)

        # -- what happens inside -----------------------------------------------------------------

        def _shares(self, si: Any, active: Any) -> tuple[Any, Any, Any]:
            """Return the share of the near material, and where each of the two is needed."""
            beyond = si.t * self.unit - self.distance
            if self.fade == 0.0:
                share = dr.select(beyond < 0.0, mi.Float(1.0), mi.Float(0.0))
            else:
                share = 0.5 - beyond * (1.0 / self.fade)
                share = dr.minimum(dr.maximum(share, 0.0), 1.0)
            return share, active & (share > 0.0), active & (share < 1.0)

    return type("simrig_lod", (LodBSDF,), {"__doc__": define_lod.__doc__})

"""The one adapter that turns any BRDF into a Mitsuba BSDF.

A class made under one Mitsuba variant cannot be used under another, so the class is defined by a
function that ``register`` calls once per variant.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import drjit as dr
import numpy as np

from simrig.brdf.protocol import Brdf, is_above_horizon, upright
from simrig.core.arrays import Array
from simrig.core.errors import SimrigError
from simrig.plugins.importance_sampling import fit_mixture, fitted
from simrig.plugins.lifetime import traced
from simrig.plugins.lobes import (
    Lobe,
    Mixture,
    Stretched,
    all_stretched,
    mixture_pdf,
    sample_mixture,
)
from simrig.plugins.named import number
from simrig.plugins.spectral import Upsampler
from simrig.plugins.variants import check_vectorised

_TOLERATED_CHANGE = 0.1  # of an array under optimisation before the sampling is fitted again


@dataclass(frozen=True)
class _Fixed:
    """The direction ``si.wi``, and what every look-up and every lobe needs of it.

    Attributes:
        above: where it is valid; elsewhere ``local`` is the normal.
        local: the direction in the frame of the material.
        seen: what ``Brdf.seen`` made of it.
        stretched: what the sampling's lobes need of it.
        place: where on the material it is seen.
    """

    above: Array
    local: Array
    seen: Any
    stretched: tuple[Stretched, ...]
    place: Any


def define_adapter() -> type:
    """Return the adapter class for the current Mitsuba variant."""
    import mitsuba

    mi: Any = mitsuba  # its stubs describe one variant, the class below serves all
    glossy = mi.BSDFFlags.GlossyReflection
    all_flags = (
        glossy | mi.BSDFFlags.DiffuseReflection | mi.BSDFFlags.Anisotropic | mi.BSDFFlags.FrontSide
    )
    upsample = Upsampler()
    backend = dr.backend_v(mi.Float)

    class BrdfBSDF(mi.BSDF):
        """A BRDF as a Mitsuba BSDF: one-sided, one component.

        Mitsuba's ``si.wi`` is the view direction in radiance mode and the illumination in
        importance mode; the value returned is f_r times the cosine of ``wo`` in both, as in
        Mitsuba's own BSDFs.
        """

        def __init__(self, props: Any, brdf: Brdf | None = None, rotation_deg: float = 0.0) -> None:
            check_vectorised(f"'{props.plugin_name()}'")
            if brdf is None:
                rotation_deg = number(props, "rotation", 0.0)
                brdf = type(self).build(props)
            if not brdf.in_kernels:
                raise SimrigError(
                    f"'{brdf.name}' is too slow to render: tabulate it first (resample_dense, or "
                    "'simrig reconstruct')"
                )
            # from here on Mitsuba's kernels may call it: what can be refused was refused before
            super().__init__(props)
            self.brdf = brdf
            self.data = _device_copies(brdf, mi)
            self._prepare()
            self.mixture_host = fitted(brdf)
            self.mixture = _on_device(self.mixture_host, mi)
            self.fitted_data: Mapping[str, np.ndarray] = brdf.data()
            self._recent: tuple[Any, list[Array], _Fixed] | None = None
            self.rotation = to_number(float(rotation_deg), mi)
            self._turn()
            self.m_components = [all_flags]
            self.m_flags = all_flags

        @staticmethod
        def build(props: Any) -> Brdf:
            """Return the BRDF that the properties describe; named plugins override it."""
            raise SimrigError("this plugin is made by simrig.plugins.make_bsdf, not by name")

        # -- the interface of Mitsuba ------------------------------------------------------------

        @traced
        def eval(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            if not self._enabled(ctx):
                return mi.Spectrum(0.0)
            fixed = self._fixed(si)
            active, local_o = self._other(fixed, wo, active)
            return self._value(ctx, si, fixed, local_o, active) & active

        @traced
        def pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            if not self._enabled(ctx):
                return mi.Float(0.0)
            fixed = self._fixed(si)
            active, local_o = self._other(fixed, wo, active)
            return dr.select(active, self._density(fixed, local_o), 0.0)

        @traced
        def eval_pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            if not self._enabled(ctx):
                return mi.Spectrum(0.0), mi.Float(0.0)
            fixed = self._fixed(si)
            active, local_o = self._other(fixed, wo, active)
            pdf = dr.select(active, self._density(fixed, local_o), 0.0)
            value = self._value(ctx, si, fixed, local_o, active) & active
            self._keep(si, fixed)
            return value, pdf

        @traced
        def sample(self, ctx: Any, si: Any, sample1: Any, sample2: Any, active: Any = True) -> Any:
            bs = dr.zeros(mi.BSDFSample3f)
            if not self._enabled(ctx):
                return bs, mi.Spectrum(0.0)
            up = mi.Vector3f(0.0, 0.0, 1.0)
            fixed = self._fixed(si)
            # the density and the direction are constants to the derivative
            local_i, variates = dr.detach(fixed.local), (sample1, sample2.x, sample2.y)
            drawn = mi.Vector3f(*sample_mixture(self.mixture, local_i, *variates, fixed.stretched))
            active = active & fixed.above & (drawn.z > 0.0)
            local_o = dr.select(active, drawn, up)
            pdf = self._density(fixed, local_o)
            value = self._value(ctx, si, fixed, local_o, active)
            cos_turn, sin_turn = dr.detach(self.cos_turn), dr.detach(self.sin_turn)
            turned = mi.Vector3f(
                cos_turn * local_o.x - sin_turn * local_o.y,
                sin_turn * local_o.x + cos_turn * local_o.y,
                local_o.z,
            )
            # a failed draw points below the surface: adapters such as 'blendbsdf' weigh whatever
            # direction they get, also where its density is 0
            bs.wo = dr.select(active, turned, mi.Vector3f(0.0, 0.0, -1.0))
            bs.pdf = dr.select(active, pdf, 0.0)
            bs.eta = 1.0
            bs.sampled_type = mi.UInt32(+glossy)
            bs.sampled_component = mi.UInt32(0)
            return bs, (value / pdf) & active

        def traverse(self, cb: Any) -> None:
            for name, value in self.data.items():
                cb.put(name, value, mi.ParamFlags.Differentiable)
            cb.put("rotation", self.rotation, mi.ParamFlags.Differentiable)

        def parameters_changed(self, keys: Any = ()) -> None:
            self._turn()
            if keys and set(keys) == {"rotation"}:
                return
            host = self._host_data()
            for value in self.data.values():
                dr.make_opaque(value)  # a literal would become part of the kernel
            self._prepare()
            if self._outdated(host):
                self.mixture_host = fit_mixture(self.brdf, host, start=self.mixture_host)
                self.mixture = _on_device(self.mixture_host, mi)
                self.fitted_data = host

        def to_string(self) -> str:
            shapes = {name: np.shape(value) for name, value in self.brdf.data().items()}
            data = ", ".join(f"{name}{list(shape) or ''}" for name, shape in shapes.items())
            return (
                f"{type(self).__name__}[\n"
                f"  BRDF = {type(self.brdf).__name__} '{self.brdf.name}',\n"
                f"  data = [{data}],\n"
                f"  reciprocal = {str(self.brdf.reciprocal).lower()},\n"
                f"  rotation = {as_float(self.rotation):g}\n"
                f"]"
            )

        # -- what happens inside -----------------------------------------------------------------

        def _enabled(self, ctx: Any) -> bool:
            """Return whether the context asks for us: a BRDF cannot be split in lobes.

            Whoever sums over the types must get it once, so only the glossy one counts.
            """
            return ctx.is_enabled(glossy, 0)

        def _prepare(self) -> None:
            """Make the arrays that look-ups read from the data."""
            self.differentiable = dr.grad_enabled(self.data)
            self.prepared = self.brdf.prepare(self.data, self.differentiable)
            dr.make_opaque(self.prepared)

        def _outdated(self, host: Mapping[str, np.ndarray]) -> bool:
            """Return whether the sampling has to be fitted again.

            Always, but for data under optimisation: those change a little all the time, and the
            fit may take longer than the picture.
            """
            return not self.differentiable or any(
                np.abs(value - self.fitted_data[name]).sum()
                > _TOLERATED_CHANGE * np.abs(self.fitted_data[name]).sum()
                for name, value in host.items()
            )

        def _turn(self) -> None:
            """Update cosine and sine of the rotation."""
            angle = self.rotation * (np.pi / 180.0)
            self.cos_turn, self.sin_turn = dr.cos(angle), dr.sin(angle)
            dr.make_opaque(self.rotation, self.cos_turn, self.sin_turn)

        def _fixed(self, si: Any) -> _Fixed:
            """Return what is made of ``si.wi``, shared with the ``eval_pdf`` just before.

            Integrators call ``eval_pdf`` and ``sample`` in one callable. Dr.Jit does not find what
            both compute, because the branch between them begins a new scope.
            """
            recent, self._recent = self._recent, None
            if recent is not None:
                scope, inputs, fixed = recent
                if scope == dr.detail.scope(backend) and _same(inputs, self._inputs(si)):
                    return fixed
            above = is_above_horizon(si.wi)
            local = self._to_material(si.wi, above)
            stretched = all_stretched(self.mixture, dr.detach(local))
            return _Fixed(above, local, self.brdf.seen(local), stretched, self._place(si))

        def _keep(self, si: Any, fixed: _Fixed) -> None:
            """Keep what was made of ``si.wi`` as long as no scope is closed.

            Only while a callable is traced, where it holds no memory, and without derivatives.
            """
            inputs = self._inputs(si)
            plain = not (self.differentiable or dr.grad_enabled(inputs, self.cos_turn))
            if plain and dr.flag(dr.JitFlag.SymbolicScope):
                self._recent = dr.detail.scope(backend), inputs, fixed

        def _inputs(self, si: Any) -> list[Array]:
            """Return the numbers that ``_fixed`` is made of."""
            return [*si.wi, *si.uv, si.t]

        def _other(self, fixed: _Fixed, wo: Any, active: Any) -> tuple[Any, Any]:
            """Return the mask and ``wo`` in the frame of the material.

            Where the mask is false it is the normal, so that a look-up never sees NaN.
            """
            active = active & fixed.above & is_above_horizon(wo)
            return active, self._to_material(wo, active)

        def _to_material(self, w: Any, active: Any) -> Any:
            turned = mi.Vector3f(
                self.cos_turn * w.x + self.sin_turn * w.y,
                self.cos_turn * w.y - self.sin_turn * w.x,
                w.z,
            )
            return upright(turned, active)

        def _value(self, ctx: Any, si: Any, fixed: _Fixed, wo: Any, active: Any) -> Any:
            if not self.differentiable and dr.grad_enabled(self.data):
                raise SimrigError(
                    "call update() on the scene parameters after enabling their gradients"
                )

            def found(wo: Any) -> Any:
                pair = self.brdf.seen(wo), fixed.seen  # light and view, for radiance
                light, view = pair if ctx.mode == mi.TransportMode.Radiance else pair[::-1]
                return mi.Color3f(self._look_up(light, view, fixed.place))

            if self.differentiable:
                colour = found(wo)
            else:  # a branch: packets of lanes that all missed the surface skip the look-up
                colour = dr.if_stmt((wo,), active, found, lambda wo: mi.Color3f(0.0))
            return upsample(colour * wo.z, si.wavelengths)

        def _place(self, si: Any) -> Any:
            """Return where on the material it is seen; a BRDF is the same everywhere."""
            return None

        def _look_up(self, light: Any, view: Any, place: Any) -> Any:
            """Return f_r as a colour, of what ``Brdf.seen`` made of valid directions."""
            return self.brdf.look_up_seen(light, view, self.prepared)

        def _density(self, fixed: _Fixed, wo: Any) -> Any:
            local_i = dr.detach(fixed.local)
            return mixture_pdf(self.mixture, local_i, dr.detach(wo), fixed.stretched)

        def _host_data(self) -> Mapping[str, np.ndarray]:
            """Return the current data on the host, in the shapes of the BRDF.

            Raises:
                SimrigError: where the size differs (a look-up would leave the array).
            """
            host = {}
            for name, master in self.brdf.data().items():
                value = dr.detach(self.data[name]).numpy()
                if value.size != np.size(master):
                    raise SimrigError(
                        f"'{name}' of '{self.brdf.name}' needs {np.size(master)} values, "
                        f"got {value.size}"
                    )
                host[name] = value.reshape(np.shape(master))
            return host

    return BrdfBSDF


def _same(some: list[Array], others: list[Array]) -> bool:
    """Return whether arrays are the same variables of Dr.Jit."""
    return len(some) == len(others) and all(
        a.index == b.index for a, b in zip(some, others, strict=True)
    )


def _device_copies(brdf: Brdf, mi: Any) -> dict[str, Array]:
    """Return the data for the current variant; tables share memory until they are changed."""
    copies = {}
    for name, value in brdf.on(mi.Float).items():
        make = mi.Color3f if dr.depth_v(value) == 2 else mi.Float
        copies[name] = make(value)
    return copies


def to_number(value: float, mi: Any) -> Array:
    """Return a number of the current variant that does not become part of kernels."""
    return dr.opaque(mi.Float, value)


def as_float(value: Array) -> float:
    """Return what ``to_number`` made as a plain number."""
    return float(dr.detach(value)[0])


def _on_device(mixture: Mixture, mi: Any) -> Mixture:
    """Return the mixture with opaque numbers of the current variant."""
    names = [field.name for field in fields(Lobe)]
    return Mixture(
        tuple(
            Lobe(**{name: to_number(getattr(lobe, name), mi) for name in names})
            for lobe in mixture.lobes
        )
    )

"""Registration of the simrig BSDFs, once per Mitsuba variant."""

from __future__ import annotations

from simrig.plugins.adapter import define_adapter
from simrig.plugins.all_lights import define_all_lights
from simrig.plugins.btf import define_btf
from simrig.plugins.lod import define_lod
from simrig.plugins.named import PLUGINS
from simrig.plugins.unshadowed import define_unshadowed

NAMES = (*PLUGINS, "simrig_btf", "simrig_lod", "simrig_all_lights", "simrig_unshadowed")
_ADAPTERS: dict[str, type] = {}
_BTFS: dict[str, type] = {}


def register() -> type:
    """Register every simrig plugin in the current variant; a second call does nothing.

    Returns:
        The adapter class of the variant.
    """
    import mitsuba as mi

    variant = str(mi.variant())
    if variant not in _ADAPTERS:
        adapter = define_adapter()
        for name, build in PLUGINS.items():
            body = {"build": staticmethod(build), "__doc__": build.__doc__}
            mi.register_bsdf(name, type(name, (adapter,), body))
        _BTFS[variant] = define_btf(adapter)
        mi.register_bsdf("simrig_btf", _BTFS[variant])
        mi.register_bsdf("simrig_lod", define_lod())
        mi.register_integrator("simrig_all_lights", define_all_lights())
        mi.register_integrator("simrig_unshadowed", define_unshadowed())
        _ADAPTERS[variant] = adapter
    return _ADAPTERS[variant]


def register_btf() -> type:
    """Register as ``register`` does; return the class of ``simrig_btf`` of the variant."""
    import mitsuba as mi

    register()
    return _BTFS[str(mi.variant())]

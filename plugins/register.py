"""Registration of the simrig BSDFs, once per Mitsuba variant."""

from __future__ import annotations

from simrig.plugins.adapter import define_adapter
from simrig.plugins.all_lights import define_all_lights
from simrig.plugins.named import PLUGINS

_ADAPTERS: dict[str, type] = {}


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
        mi.register_integrator("simrig_all_lights", define_all_lights())
        _ADAPTERS[variant] = adapter
    return _ADAPTERS[variant]

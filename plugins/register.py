"""Registration of the simrig plugins in every Mitsuba variant that is set."""

from __future__ import annotations

from simrig.core import backend
from simrig.core.errors import SimrigError
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

    Raises:
        SimrigError: an LLVM variant, and no libLLVM that can run it, with the cure.
    """
    import mitsuba as mi

    variant = str(mi.variant())
    if variant not in _ADAPTERS:
        _check_llvm(variant)
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


def follow_variants() -> None:
    """Register the plugins in the variant that is set, if one is, and in each that will be.

    Mitsuba calls back whenever another variant is set, whoever sets it.

    Raises:
        SimrigError: as ``register``; later it is ``mi.set_variant`` that raises it.
    """
    import mitsuba as mi

    if mi.variant() is not None:
        register()
    mi.detail.add_variant_callback(_variant_changed)


def _check_llvm(variant: str) -> None:
    """Refuse a libLLVM that would abort the process, before the first kernel is compiled."""
    problem = backend.llvm_problem() if variant.startswith("llvm") else None
    if problem:
        raise SimrigError(f"variant '{variant}' cannot run here: {problem}")


def _variant_changed(old: str | None, new: str) -> None:
    """Register in the variant; where that cannot run, set the one before it again."""
    try:
        register()
    except SimrigError:
        import mitsuba as mi

        if old in _ADAPTERS:
            mi.set_variant(old)
        raise

"""simrig: a virtual laboratory for measuring how materials look.

What most people need is here, loaded when it is used, so that importing simrig costs nothing::

    import simrig as sr

    satin = sr.load("yellow_satin")
    scan = sr.measure(satin, samples=8911)
    ours = sr.reconstruct(scan)
    print(scan.cost, sr.compare(satin, ours))

``help(sr.measure)`` and the like say the rest.
"""

import importlib
from typing import Any

__version__ = "0.1.0"

# name: the module that has it; ``__init__.pyi`` says the same to type checkers
_HOME = {
    "Brdf": "simrig.brdf.protocol",
    "Btf": "simrig.btf.stack",
    "Cost": "simrig.core.cost",
    "Measurement": "simrig.rigs.measurements.measurement",
    "SimrigError": "simrig.core.errors",
    "average": "simrig.front_door.materials",
    "bake": "simrig.front_door.baking",
    "budget": "simrig.front_door.uncertainty",
    "compare": "simrig.front_door.comparing",
    "critical_distance": "simrig.front_door.seeing",
    "fit_psychometric": "simrig.perception.trials",
    "imaging": "simrig",
    "load": "simrig.front_door.materials",
    "materials": "simrig.front_door.materials",
    "measure": "simrig.front_door.measuring",
    "pareto": "simrig.front_door.studies",
    "plan": "simrig.front_door.pictures",
    "reconstruct": "simrig.front_door.measuring",
    "render": "simrig.front_door.pictures",
    "save": "simrig.front_door.materials",
    "scene": "simrig.front_door.pictures",
    "set_variant": "simrig.core.backend",
    "study": "simrig.front_door.studies",
    "view": "simrig.front_door.viewing",
}
_HOME_NAME = {
    "Btf": "BtfStack",
    "set_variant": "select",
}  # what its home calls it, where that differs
__all__ = [*_HOME, "__version__"]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'simrig' has no attribute '{name}'")
    if _HOME[name] == __name__:  # a room of its own
        return importlib.import_module(f"{__name__}.{name}")
    found = getattr(importlib.import_module(_HOME[name]), _HOME_NAME.get(name, name))
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})

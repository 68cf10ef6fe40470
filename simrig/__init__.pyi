# What ``__init__.py`` loads when it is used, as type checkers and editors see it.
from simrig import imaging as imaging
from simrig.brdf.protocol import Brdf as Brdf
from simrig.btf.stack import BtfStack as Btf
from simrig.core.backend import select as set_variant
from simrig.core.cost import Cost as Cost
from simrig.core.errors import SimrigError as SimrigError
from simrig.front_door.baking import bake as bake
from simrig.front_door.comparing import compare as compare
from simrig.front_door.materials import average as average
from simrig.front_door.materials import load as load
from simrig.front_door.materials import materials as materials
from simrig.front_door.materials import save as save
from simrig.front_door.measuring import measure as measure
from simrig.front_door.measuring import reconstruct as reconstruct
from simrig.front_door.pictures import plan as plan
from simrig.front_door.pictures import render as render
from simrig.front_door.pictures import scene as scene
from simrig.front_door.seeing import critical_distance as critical_distance
from simrig.front_door.studies import pareto as pareto
from simrig.front_door.studies import study as study
from simrig.front_door.uncertainty import budget as budget
from simrig.front_door.viewing import view as view
from simrig.perception.trials import fit_psychometric as fit_psychometric
from simrig.rigs.measurements.measurement import Measurement as Measurement

__version__: str
__all__ = [
    "Brdf",
    "Btf",
    "Cost",
    "Measurement",
    "SimrigError",
    "__version__",
    "average",
    "bake",
    "budget",
    "compare",
    "critical_distance",
    "fit_psychometric",
    "imaging",
    "load",
    "materials",
    "measure",
    "pareto",
    "plan",
    "reconstruct",
    "render",
    "save",
    "scene",
    "set_variant",
    "study",
    "view",
]

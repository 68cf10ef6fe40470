"""One small example of every kind of BRDF and BTF, by name: for tests that hold all of them."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from simrig.brdf import Brdf, Lambert, Ward, kurt_material
from simrig.brdf.kriging.coordinates import Stretch
from simrig.brdf.kriging.symmetry import Symmetry
from simrig.brdf.minnaert import Minnaert
from simrig.brdf.multiaxial import Mode, Multiaxial
from simrig.brdf.slices.slices import SliceBrdf
from simrig.brdf.tables.barycentric import BarycentricBrdf
from simrig.brdf.tables.dense import DenseTable
from simrig.brdf.tables.half_difference import HalfDifferenceTable
from simrig.brdf.tables.isotropic import IsotropicTable
from simrig.brdf.tables.simplex import SimplexTable
from simrig.btf.factored import FactoredBtf
from simrig.btf.full import FullBtf
from simrig.btf.stack import BtfStack
from simrig.btf.synthetic import bumps
from simrig.directions.schemes import scheme
from simrig.evaluation.experiment.measured_half import MeasuredHalf
from simrig.evaluation.studies.multiaxial import Turned
from simrig.files.rgl.reader import read_rgl
from simrig.files.rgl.writer import RglResolution, write_rgl
from simrig.plans.along_slices import SlicePlan
from simrig.plans.listed import SchemePlan
from simrig.plans.placement import SlicePlacement
from simrig.reconstruction.scattered.rbf import reconstruct_rbf
from simrig.reconstruction.slices.highlights import reconstruct_along_highlights
from simrig.reconstruction.slices.tables import reconstruct
from simrig.rigs.direct.gonioreflectometer import Gonioreflectometer

RIG = Gonioreflectometer()
_MATERIAL = "fabric112"


def random(*shape: int) -> np.ndarray:
    """Return plausible values of f_r, float32."""
    return np.random.default_rng(5).uniform(0.02, 0.4, (*shape, 3)).astype(np.float32)


def _along_slices(slice_types: str = "all", **options: bool) -> SliceBrdf:
    return reconstruct(_slice_measurement(slice_types), **options)


def _slice_measurement(slice_types: str):
    placement = SlicePlacement.from_degrees(25.0, 90.0, 75.0)
    plan = SlicePlan(placement, 400, slice_types=slice_types)
    return RIG.measure(kurt_material(_MATERIAL), plan)


def _pairs(name: str = _MATERIAL):
    return RIG.measure(kurt_material(name), SchemePlan.of(scheme("uniform_1")))


def _rgl(brdf: Brdf) -> Brdf:
    few = RglResolution(theta=4, phi=6, warp=13, colour=9)
    with TemporaryDirectory() as folder:
        write_rgl(Path(folder) / "m.bsdf", brdf, few)
        return read_rgl(Path(folder) / "m.bsdf")


def _barycentric() -> BarycentricBrdf:
    ring = scheme("uniform_1")
    return BarycentricBrdf(ring.theta, ring.phi, random(len(ring), len(ring)))


def half_difference(symmetry: Symmetry) -> HalfDifferenceTable:
    """Return a random table of a symmetry."""
    logs = np.random.default_rng(1).normal(size=(5, 1 if symmetry.isotropic else 6, 4, 6, 3)) - 2.0
    power = 0 if symmetry.reciprocal else 1
    return HalfDifferenceTable(logs, symmetry, Stretch(0.1, 0.3), 1e-3, power, np.radians(80.0))


@cache
def _stack() -> BtfStack:
    return bumps((4, 6))


KINDS: dict[str, Callable[[], Brdf]] = {
    "lambert": Lambert,
    "ward": lambda: Ward(m_x=0.1, m_y=0.4, variant="ward"),
    "ward_duer": lambda: Ward(m_x=0.1, m_y=0.4, variant="duer"),
    "ward_bounded": lambda: Ward(m_x=0.005, m_y=0.4),
    "kurt": lambda: kurt_material(_MATERIAL),
    "kurt_metal": lambda: kurt_material("brushed_aluminium"),
    "multiaxial": lambda: Multiaxial(
        (0.1, 0.2, 0.3), (Mode.of(20.0, 30.0, 40.0, 0.2), Mode.of(110.0, 50.0, 60.0, 0.1))
    ),
    "minnaert": lambda: Minnaert((0.1, 0.2, 0.3), -2.0),
    "dense": lambda: DenseTable(random(4, 4, 6, 8), np.radians(25.0)),
    "dense_fade": lambda: DenseTable(random(4, 4, 6, 6), np.radians(25.0), beyond="fade"),
    "simplex": lambda: SimplexTable(random(4, 4, 6, 8), np.radians(25.0)),
    "isotropic": lambda: IsotropicTable(random(6, 4, 8)),
    "isotropic_nearest": lambda: IsotropicTable(random(6, 4, 8), "nearest", reciprocal=False),
    "rgl": lambda: _rgl(kurt_material(_MATERIAL)),
    "rgl_isotropic": lambda: _rgl(Ward(m_x=0.3, m_y=0.3)),
    "barycentric": _barycentric,
    "half_difference": lambda: half_difference(Symmetry()),
    "half_difference_isotropic": lambda: half_difference(
        Symmetry(isotropic=True, reciprocal=True, mirror=True, half_turn=True)
    ),
    "rbf": lambda: reconstruct_rbf(_pairs()).brdf,
    "rbf_one_way": lambda: reconstruct_rbf(_pairs(), reciprocal=False, logarithms=True).brdf,
    "rbf_local": lambda: reconstruct_rbf(_pairs(), 10).brdf,
    "slices": _along_slices,
    "slices_axial_diagonal": lambda: _along_slices("axial-diagonal"),
    "slices_many_poles": lambda: _along_slices(one_pole=False),
    "highlight_slices": lambda: reconstruct_along_highlights(_slice_measurement("all")),
    "highlight_slices_axial_diagonal": lambda: reconstruct_along_highlights(
        _slice_measurement("axial-diagonal")
    ),
    "turned": lambda: Turned(
        ((Ward(m_x=0.1, m_y=0.4), 0.4, 0.5), (kurt_material(_MATERIAL), 1.2, 0.5))
    ),
    "measured_half": lambda: MeasuredHalf(_along_slices()),
    "btf_full": lambda: FullBtf.from_stack(_stack()),
    "btf_factored": lambda: FactoredBtf.from_stack(_stack(), tolerance=0.3),
}


@cache
def example(name: str) -> Brdf:
    """Return the example of a kind, made once."""
    return KINDS[name]()

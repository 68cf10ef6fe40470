"""Instructions and gathers of every material's look-up, from Dr.Jit's intermediate code.

``direct`` calls ``eval_pdf``, ``path`` calls ``eval_pdf`` and ``sample`` at once.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from simrig.brdf import Brdf, Ward, kurt_material
from simrig.brdf.kriging.coordinates import Stretch
from simrig.brdf.kriging.symmetry import Symmetry
from simrig.brdf.multiaxial import Mode, Multiaxial
from simrig.brdf.tables.half_difference import HalfDifferenceTable
from simrig.brdf.tables.resample import resample_dense
from simrig.brdf.tables.simplex import SimplexTable
from simrig.btf.full import FullBtf
from simrig.btf.synthetic import bumps
from simrig.core import backend
from simrig.core.progress import Progress, tracked
from simrig.core.tables import Column, record_table
from simrig.evaluation.instructions import count
from simrig.files.rgl.reader import read_rgl
from simrig.files.rgl.writer import write_rgl
from simrig.plans.along_slices import SlicePlan
from simrig.plugins import make_bsdf, make_btf
from simrig.reconstruction.slices.tables import reconstruct
from simrig.rigs.direct.gonioreflectometer import Gonioreflectometer

MATERIAL = "fabric112"
SAMPLES = 8911


def run(progress: Progress | None = None, variant: str = "llvm_ad_rgb") -> dict[str, Any]:
    """Count.

    Args:
        variant: Mitsuba variant of the LLVM backend.

    Returns:
        ``rows``, one per material, with ``instructions`` and ``gathers`` of ``direct`` and
        ``path``, and the ratios of the instructions to those of ``principled``.
    """
    variant = backend.select(variant)
    with tempfile.TemporaryDirectory() as folder:
        materials = _materials(Path(folder))
        counts = {name: _both(materials[name]()) for name in tracked(materials, progress, str)}
    reference = counts["principled"]
    rows = [
        {
            "material": name,
            **{f"{call}_{what}": n for call, found in both.items() for what, n in found.items()},
            **{
                f"{call}_ratio": found["instructions"] / reference[call]["instructions"]
                for call, found in both.items()
            },
        }
        for name, both in counts.items()
    ]
    return {"benchmark": "look-ups", "variant": variant, "material": MATERIAL, "rows": rows}


def _both(bsdf: Any) -> dict[str, dict[str, int]]:
    return {"direct": count(bsdf, False), "path": count(bsdf, True)}


def _materials(folder: Path) -> dict[str, Callable[[], Any]]:
    """Return functions that make the BSDFs."""
    import mitsuba as mi

    truth = kurt_material(MATERIAL)
    plan = SlicePlan.for_material(truth, samples=SAMPLES)
    rgl, isotropic = folder / "material.bsdf", folder / "isotropic.bsdf"
    write_rgl(rgl, truth)
    write_rgl(isotropic, Ward(m_x=0.3, m_y=0.3))
    grey = {"type": "rgb", "value": [0.3, 0.25, 0.2]}
    built_in: dict[str, dict[str, Any]] = {
        "principled": {"type": "principled", "base_color": grey, "roughness": 0.3},
        "roughconductor": {"type": "roughconductor", "alpha_u": 0.2, "alpha_v": 0.5},
        "measured": {"type": "measured", "filename": str(rgl)},
        "measured, isotropic": {"type": "measured", "filename": str(isotropic)},
    }
    own: dict[str, Callable[[], Brdf]] = {
        "table": lambda: resample_dense(truth, np.radians(7.5), 48, np.radians(82.5)),
        "table, simplices": lambda: _simplices(truth),
        "half-difference": lambda: _half_difference(False),
        "half-difference, isotropic": lambda: _half_difference(True),
        "slices": lambda: reconstruct(Gonioreflectometer().measure(truth, plan)),
        "RGL file": lambda: read_rgl(rgl),
        "RGL file, isotropic": lambda: read_rgl(isotropic),
        "multiaxial": lambda: Multiaxial((0.1,) * 3, (Mode.of(20.0, 30.0, 40.0, 0.2),)),
        "kurt": lambda: truth,
    }
    return {
        **{name: partial(mi.load_dict, plugin) for name, plugin in built_in.items()},
        **{name: partial(_made, make) for name, make in own.items()},
        "BTF": lambda: make_btf(FullBtf.from_stack(bumps((4, 6))), scale=1.0, pixel_angle=0.02),
    }


def _made(make: Callable[[], Brdf]) -> Any:
    return make_bsdf(make())


def _simplices(truth: Brdf) -> SimplexTable:
    table = resample_dense(truth, np.radians(7.5), 48, np.radians(82.5))
    return SimplexTable(table.values, table.theta_step, table.theta_max)


def _half_difference(isotropic: bool) -> HalfDifferenceTable:
    """Return a table in half-difference angles as kriging makes it; its values do not matter."""
    logs = np.full((24, 1 if isotropic else 12, 12, 12, 3), -2.0)
    symmetry = Symmetry(isotropic=isotropic, reciprocal=True, mirror=isotropic, half_turn=isotropic)
    return HalfDifferenceTable(logs, symmetry, Stretch(0.1, 0.3), 1e-3, 0, np.radians(80.0))


def table(results: dict[str, Any]) -> Any:
    """Return the results as a table for the terminal."""
    columns: dict[str, Column] = {
        "material": "{material}",
        "direct": "{direct_instructions}",
        "gathers": "{direct_gathers}",
        "÷ princ.": "{direct_ratio:.2f}",
        "path": "{path_instructions}",
        "gathers ": "{path_gathers}",
        "÷ princ. ": "{path_ratio:.2f}",
    }
    title = "Instructions and gathers of a look-up, " + results["variant"]
    return record_table(title, columns, results["rows"])

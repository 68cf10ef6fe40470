"""Plans that reuse patterns of known materials, and those of multi-angle reflectometers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from refusals import refused
from simrig.brdf import kurt_material
from simrig.brdf.tables.dense import DenseTable
from simrig.database.resampling import turned
from simrig.database.store import Database
from simrig.methods import METHODS, method_for
from simrig.plans.registry import make_plan
from simrig.rigs.direct.gonioreflectometer import Gonioreflectometer

RIG = Gonioreflectometer()


@pytest.mark.parametrize(("kind", "samples"), [("method1", 150), ("method2", 420)])
def test_a_template_follows_how_the_material_is_turned(
    small_database: Path, kind: str, samples: int
) -> None:
    known = Database.open(small_database)
    table = known["fabric002"].load()  # the first, the template of alignment
    assert isinstance(table, DenseTable)
    plan = make_plan(
        "template", table, database=str(small_database), samples=samples, template=kind
    )
    straight, away = (RIG.measure(turned(table, turn), plan) for turn in (0, 5))
    assert len(straight) == len(away) <= samples
    n = 24  # after the axial slice all directions turn with the material
    apart = away.angles[n:] - straight.angles[n:]
    off = np.degrees(apart[:, 2:]) % 360.0
    pole = straight.angles[n:, :2] == 0.0
    assert np.allclose(np.where(pole, 75.0, off), 75.0)
    assert np.allclose(away.values[n:], straight.values[n:], rtol=1e-6)
    assert method_for(away).name == "basis"


def test_template_plans_that_cannot_be_are_refused(small_database: Path) -> None:
    refused("needs --database", make_plan, "template", None)
    refused("from 120", make_plan, "template", None, database=str(small_database), samples=5)
    refused("method2 takes", make_plan, "template", None, database=str(small_database),
            samples=130, template="method2")  # fmt: skip


@pytest.mark.parametrize(
    ("device", "count"), [("MA68", 5), ("MA98", 19), ("BYK-mac", 6), ("MultiFX10", 10)]
)
def test_reflectometers_have_the_geometries_of_table_7_1(device: str, count: int) -> None:
    plan = make_plan("reflectometer", None, device=device, rotations=8)
    angles = plan.angles()
    assert plan.samples == len(angles) == 8 * count
    degrees = np.degrees(angles[:count])
    common = {(45, 0, 0, 0), (45, 30, 0, 0), (45, 65, 0, 0), (45, 20, 0, 180), (45, 30, 0, 180)}
    assert common <= {tuple(np.round(row).astype(int).tolist()) for row in degrees}
    assert np.allclose(angles[count:, 2:] - angles[:-count, 2:], np.radians(45.0))


def test_a_reflectometer_of_ones_own_measures_and_reconstructs(
    small_database: Path, tmp_path: Path
) -> None:
    own = tmp_path / "own.toml"
    own.write_text("[two]\ngeometries = [[45, 0, 45, 180], [45, 0, 10, 180]]\n")
    plan = make_plan("reflectometer", None, device=f"{own}:two", rotations=4)
    measured = RIG.measure(kurt_material("fabric112"), plan)
    made = METHODS["basis"].reconstruct(measured, database=str(small_database))
    assert len(measured) == 8 and np.all(np.isfinite(made.brdf.logs))
    refused("unknown reflectometer", make_plan, "reflectometer", None, device="MA86")
    refused("no file of reflectometers", make_plan, "reflectometer", None, device="x.toml:two")
    own.write_text("[two]\ngeometries = [[45, 0, 95, 180]]\n")
    refused("polar angle", make_plan, "reflectometer", None, device=f"{own}:two")
    own.write_text("[two]\ngeometries = [[45, 0]]\n")
    refused("four", make_plan, "reflectometer", None, device=f"{own}:two")

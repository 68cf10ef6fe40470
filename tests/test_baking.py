"""Baking: the cheapest form within a tolerance, stored, read and refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from simrig.brdf import Lambert, Ward, kurt_material
from simrig.brdf.tables.resample import resample_dense
from simrig.brdf.tables.simplex import SimplexTable
from simrig.btf.factored import FactoredBtf
from simrig.btf.synthetic import bumps
from simrig.cli.app import app
from simrig.core.effects import Tolerance
from simrig.core.errors import SimrigError
from simrig.evaluation import baking
from simrig.evaluation.metrics.sphere_picture import SpherePicture
from simrig.files.hdf5 import origin, read_brdf, write_brdf

COARSE = (15.0, 24)


@pytest.fixture
def quick(monkeypatch, variant_llvm):
    """Few forms and levels, and look-ups that are timed once."""
    forms = {
        name: baking.Form(form.about, {"15°": COARSE}, form.make)
        for name, form in baking.FORMS.items()
        if name in ("simplex", "dense")
    }
    monkeypatch.setattr(baking, "FORMS", {"lambert": baking.FORMS["lambert"], **forms})
    monkeypatch.setattr(baking, "_ROUNDS", 1)


def _table(brdf=None):
    return resample_dense(brdf or kurt_material("fabric112"), np.radians(15.0), 24, np.radians(75))


def test_the_cheapest_form_within_the_tolerance_is_chosen(quick) -> None:
    table = _table()
    baked = baking.bake(table, Tolerance("dE", 2.0))
    assert isinstance(baked.brdf, SimplexTable) and baked.chosen.form == "simplex"
    costs = {one.form: one.cost for one in baked.tried if one.delta_e <= 2.0}
    assert baked.chosen.cost == min(costs.values()) < baked.itself.cost
    for lights in (16, 4):  # the error stands beside it, taken again
        assert SpherePicture(table, lights=lights).compare(baked.brdf).delta_e <= (
            baked.chosen.delta_e + 1e-9
        )


def test_diffuse_and_black_become_a_formula(quick) -> None:
    for colour in ((0.3, 0.2, 0.1), (0.0, 0.0, 0.0)):
        baked = baking.bake(_table(Lambert(colour)), Tolerance("dE", 0.2))
        assert baked.chosen.form == "lambert"
        assert np.allclose(baked.brdf.eval(np.eye(3)[2], np.eye(3)[2]) * np.pi, colour, rtol=1e-3)


def test_what_cannot_be_baked_is_said_in_a_line(quick) -> None:
    mirror = Ward(m_x=0.005, m_y=0.005, k_s=(0.3, 0.3, 0.3))
    with pytest.raises(
        SimrigError, match=r"no form of 'ward' is within dE=0.2: lambert ΔE .*dense"
    ):
        baking.bake(mirror, Tolerance("dE", 0.2))
    with pytest.raises(SimrigError, match="fastest as it is"):
        baking.bake(Lambert((0.3, 0.2, 0.1)), Tolerance("dE", 0.2))
    with pytest.raises(SimrigError, match="is a BTF"):
        baking.bake(FactoredBtf.from_stack(bumps((4, 6)), tolerance=0.3), Tolerance("dE", 0.2))
    with pytest.raises(SimrigError, match="tolerance of a bake"):
        baking.bake(_table(), Tolerance("psnr", 40.0))


def test_the_command_stores_what_renders(quick, tmp_path: Path) -> None:
    source, output = tmp_path / "table.h5", tmp_path / "baked.h5"
    write_brdf(source, _table())
    command = ["bake", str(source), "-o", str(output), "--tolerance", "dE=2"]
    assert CliRunner().invoke(app, command).exit_code == 0
    stored = read_brdf(output)
    about = origin(stored)[baking.BAKED]
    assert about["chosen"]["form"] == "simplex" and about["chosen"]["delta_e"] <= 2.0
    shown = CliRunner().invoke(app, ["info", str(output), "--json"]).stdout
    assert "baked as simplex" in shown
    import mitsuba as mi

    mi.load_dict({"type": "simrig_table", "filename": str(output)})
    for more, told in (
        (command, "exists"),
        (["bake", str(output), "-o", str(tmp_path / "again.h5")], "baked already"),
        ([*command[:-1], "dE=0", "--overwrite"], "above 0"),
        ([*command[:-1], "dE=-1", "--overwrite"], "above 0"),
    ):
        refused = CliRunner().invoke(app, more)
        assert refused.exit_code == 2 and told in " ".join(refused.output.split())
    assert origin(read_brdf(output))[baking.BAKED] == about


def test_a_picture_is_baked_for_where_that_pays(quick, monkeypatch) -> None:
    table, allowed = _table(), Tolerance("dE", 8.0)
    baked = baking.bake_for(table, allowed, 1e3)
    assert baked is not None and baked.chosen.delta_e <= 2.0 and baked.rest == Tolerance("dE", 6.0)
    assert len(baked.tried) == 2  # nothing dearer than the first that is good enough
    assert baking.bake_for(table, allowed, 12.0) is None  # it would save less than it takes
    assert baking.bake_for(table, Tolerance("dE", 1e-3), 1e3) is None  # no form is within it
    assert baking.bake_for(table, Tolerance("psnr", 40.0), 1e3) is None
    assert baking.bake_for(Lambert((0.3, 0.2, 0.1)), allowed, 1e3) is None  # nothing is cheaper
    assert baking.bake_for(baked.brdf, allowed, 1e3) is None
    assert baking.bake_for(None, allowed, 1e3) is None


def test_render_bakes_unless_told_not_to(quick, monkeypatch, tmp_path: Path) -> None:
    monkeypatch.setattr(baking, "_LONGEST", 0.0)
    source, picture = tmp_path / "table.h5", tmp_path / "picture.exr"
    write_brdf(source, _table())
    command = ["render", "--material", str(source), "--output", str(picture), "--overwrite"]
    command += ["--resolution", "32", "--tolerance", "dE=8", "--json"]
    said = json.loads(CliRunner().invoke(app, command).stdout)
    assert said["baked"].startswith("baked as simplex") and said["plan"]["tolerance"] == "dE=6"
    assert "baked" not in json.loads(CliRunner().invoke(app, [*command, "--no-bake"]).stdout)

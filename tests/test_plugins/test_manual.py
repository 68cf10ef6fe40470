"""The manual and the examples: equal to the docstrings, and they run."""

from __future__ import annotations

import importlib.util
import re
import sys
from dataclasses import fields
from pathlib import Path
from types import ModuleType

import mitsuba as mi
import numpy as np
import pytest

from simrig.brdf.tables.dense import DenseTable
from simrig.btf.synthetic import bumps
from simrig.core.errors import SimrigError
from simrig.files.btf.hdf5 import write_btf
from simrig.files.load import ReadOptions, save_material
from simrig.plugins.manual import DOCUMENTED, with_manual
from simrig.plugins.named import PLUGINS

DOCS = Path(__file__).resolve().parents[2] / "docs"
PAGE = (DOCS / "plugins.md").read_text(encoding="utf-8")


def load_example(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, DOCS / "examples" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_page_holds_the_docstrings():
    assert with_manual(PAGE) == PAGE, "run python -m simrig.plugins.manual docs/plugins.md"


def test_the_blocks_of_the_page_run(tools, variant_llvm, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    save_material("slices.h5", tools.slices())
    for name in ("table.h5", "leather_brdf.h5"):
        save_material(name, tools.small_table())
    for name in ("corduroy.h5", "leather.h5"):
        write_btf(name, bumps((2, 2)))
    namespace: dict = {}
    seen = set()
    for block in re.findall(r"```python\n(.*?)```", PAGE, flags=re.DOTALL):
        if block.startswith("{"):
            properties = eval(block)
            seen.add(properties["type"])
            assert type(mi.load_dict(properties)).__name__ == properties["type"]
        else:
            exec(block, namespace)
    assert seen == set(DOCUMENTED)
    for block in re.findall(r"```xml\n(.*?)```", PAGE, flags=re.DOTALL):
        bsdf = mi.load_string(block.replace("<bsdf ", '<bsdf version="3.0.0" ', 1))
        assert bsdf.brdf.m_x == pytest.approx(0.05)


@pytest.mark.parametrize("name", PLUGINS)
def test_every_documented_parameter_is_accepted(name, tools, variant_llvm, tmp_path):
    """Those of the table, all at once, are known to the plugin; Mitsuba refuses unknown ones."""
    save_material(tmp_path / "slices.h5", tools.slices())
    save_material(tmp_path / "table.h5", DenseTable(np.ones((3, 3, 4, 4, 3)), 0.5))
    file = tmp_path / ("slices.h5" if name == "simrig_slices" else "table.h5")
    values = {"filename": str(file), "variant": "ward", "rotation": 5.0}
    rows = re.findall(r"^\s*\| (\w[\w, ]*) \|", PLUGINS[name].__doc__ or "", flags=re.M)
    names = [part for row in rows[1:] for part in row.split(", ") if part != "material"]
    assert "rotation" in names
    of_other_formats = set(names) & {option.name for option in fields(ReadOptions)} - {"factor"}
    stated = {"gamut": "keep", "clamp_negative": True}
    for option in of_other_formats:
        with pytest.raises(RuntimeError, match=f"'{option}' is (not )?for"):
            file_and_option = {"filename": str(file), option: stated.get(option, "6x48")}
            mi.load_dict({"type": name, **file_and_option})
    names = [part for part in names if part not in of_other_formats]
    mi.load_dict({"type": name, **{key: values.get(key, 0.25) for key in names}})


def test_a_material_is_recovered_from_a_picture(variant_llvm):
    found = load_example("recover_kurt").recover()
    assert found["k_s"] == pytest.approx(0.3, rel=0.02)
    assert found["m_x"] == pytest.approx(0.25, rel=0.02)


@pytest.mark.slow
def test_a_slice_is_recovered_from_pictures(variant_llvm):
    before, after = load_example("recover_slice").recover()
    assert before > 0.5
    assert after < 0.15


def test_a_refused_plugin_is_never_called(variant_llvm, monkeypatch):
    """A notebook keeps the last traceback, and with it what was half built."""
    kept = []

    def refuse(*_):
        kept.append(sys._getframe())
        raise SimrigError("refused")

    monkeypatch.setattr("simrig.plugins.named._load", refuse)
    with pytest.raises(RuntimeError, match="refused"):
        mi.load_dict({"type": "simrig_table", "filename": "a.h5"})
    kurt = {"type": "simrig_kurt", "material": "fabric112"}
    scene = {"type": "scene", "light": {"type": "constant"}, "a": {"type": "sphere", "bsdf": kurt}}
    scene["b"] = {"type": "sphere", "center": [3, 0, 0], "bsdf": {"type": "diffuse"}}
    scene["sensor"] = {"type": "perspective", "film": {"type": "hdrfilm", "width": 8, "height": 8}}
    scene["integrator"] = {"type": "path", "max_depth": 3}
    assert np.isfinite(np.array(mi.render(mi.load_dict(scene), spp=4))).all()
    assert kept

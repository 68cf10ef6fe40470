"""An option that has no effect where it is given is refused, in one line that names it."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import simrig as sr
from command_line import refusal
from simrig.brdf import kurt_material
from simrig.btf.synthetic import bumps
from simrig.core.errors import SimrigError
from simrig.files.btf.hdf5 import write_btf
from simrig.files.images import write_exr
from simrig.files.load import save_material

SCENE = """<scene version="3.0.0"><integrator type="path"/><sensor type="perspective"/>
<shape type="sphere"><bsdf type="diffuse"/></shape><emitter type="constant"/></scene>"""

# what is asked for, and the option that does nothing there
COMMANDS = [
    ("materials", "--overwrite"),
    ("materials", "--factor 2"),
    ("materials", "--picture p.png"),
    ("materials fabric112", "--overwrite"),
    ("materials fabric112", "--factor 2"),
    ("materials leather_tan", "--layout 6x48"),
    ("materials sphere", "--gamut keep"),
    ("materials --structures", "--clamp-negative"),
    ("convert", "--format merl"),
    ("convert", "--side front"),
    ("convert fabric112 x.h5", "--gamut keep"),
    ("convert m.h5 x.h5", "--clamp-negative"),
    ("convert m.h5 x.h5", "--axes theta_i"),
    ("info a.exr", "--factor 2"),
    ("info btf.h5", "--colour xyz"),
    ("info m.h5", "--layer R"),
    ("compare a.exr b.exr", "--step 5"),
    ("compare a.exr b.exr", "--theta-max 50"),
    ("compare a.exr b.exr", "--overwrite"),
    ("compare fabric112 lambert", "--exposure 2"),
    ("compare fabric112 lambert", "--foreground"),
    ("compare fabric112 lambert", "--difference d.png"),
    ("compare fabric112 lambert", "--materials"),
    ("render --material fabric112 --scene sphere -o r.exr", "--lights 8"),
    ("render --material fabric112 --scene sphere -o r.exr", "--environment a.exr"),
    ("render --material fabric112 --scene sphere -o r.exr", "--light top"),
    ("render --material fabric112 --scene sphere -o r.exr", "-D g=1"),
    ("render --material fabric112 --scene sphere -o r.exr", "--scale 0.5"),
    ("render --material fabric112 --scene sphere --spp 1 -o r.exr", "--budget 5s"),
    ("render --material fabric112 --scene sphere --spp 1 -o r.exr", "--tolerance dE=1"),
    ("render --material fabric112 --scene sphere --spp 1 -o r.exr", "--no-verify"),
    ("render --material fabric112 --scene sphere --spp 1 --resolution 8 -o r.exr", "--sensor 1"),
    ("render --material fabric112 --scene sphere -o r.png", "--no-png"),
    ("render --scene s.xml -o r.exr", "--material fabric112"),
    ("render --scene s.xml -o r.exr", "--rotation 30"),
    ("plan sphere", "-D a=1"),
    ("plan sphere", "--scale 0.5"),
    ("plan s.xml", "--resolution 8"),
    ("ablate s.xml", "--material fabric112"),
    ("converge s.xml", "--resolution 9"),
    ("converge sphere", "--overwrite"),
    ("distance a.exr --size-mm 10", "--seed 3"),
    ("distance a.exr --size-mm 10", "--texels 8"),
    ("distance leather_tan", "--size-mm 10"),
    ("distance leather_tan", "--texels 8"),
    ("measure fabric112 -o m2.h5 --plan uniform", "--k 0.5"),
    ("measure fabric112 -o m2.h5 --rig gantry", "--seed 1"),
    ("measure fabric112 -o m2.h5 --rig gantry", "--tolerance dE=1"),
    ("measure fabric112 -o m2.h5 --ideal", "--enable noise"),
    ("measure fabric112 -o m2.h5 --rig gantry", "--ideal"),
    ("measure leather_tan -o b.h5 --rig btf", "--theta-step 5"),
    ("btf measure leather_tan -o b.h5 --bounces 2", "--tolerance dE=1"),
    ("stability --files 1", "--every-case"),
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("options")
    for name in ("a.exr", "b.exr"):
        write_exr(made / name, np.full((4, 4, 3), 0.5, np.float32))
    save_material(made / "m.h5", kurt_material("fabric112"))
    write_btf(made / "btf.h5", bumps((2, 2), (8.0, 8.0), "uniform_1"))
    (made / "s.xml").write_text(SCENE)
    return made


@pytest.mark.parametrize(("command", "option"), COMMANDS, ids=lambda text: text)
def test_a_command_refuses_it(
    command: str, option: str, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    said = refusal(*command.split(), *option.split())
    word = option.split()[0].lstrip("-").replace("-", "[-_ ]")
    assert re.search(rf"{word}|leave them|leave out|give neither", said), said


@pytest.mark.parametrize(
    ("source", "stated"),
    [("leather_tan", {"factor": 2.0}), ("fabric112", {"gamut": "keep"}), ("btf.h5", {"side": "b"})],
)
def test_loading_refuses_it(folder: Path, source: str, stated: dict[str, Any]) -> None:
    named = folder / source if "." in source else source
    with pytest.raises(SimrigError, match=f"leave out {next(iter(stated))}"):
        sr.load(named, **stated)


@pytest.mark.parametrize(
    "option",
    [{"tolerance": 0.1}, {"form": "factored", "missing": "fill"}, {"anisotropy": 4},
     {"form": "factored", "over_budget": "coarsen"}],
)  # fmt: skip
def test_the_plugin_of_btfs_refuses_it(
    folder: Path, option: dict[str, Any], variant_llvm: None
) -> None:
    import mitsuba as mi

    import simrig.plugins  # noqa: F401

    with pytest.raises(Exception, match=f"'{list(option)[-1]}' can do nothing here"):
        mi.load_dict(
            {"type": "simrig_btf", "filename": str(folder / "btf.h5"), "scale": 8.0, **option}
        )

"""Mutated files of the formats that people bring: read or refused in one line, nothing else."""

from __future__ import annotations

import json
import signal
from collections.abc import Callable
from itertools import product
from pathlib import Path

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from simrig.brdf import Lambert
from simrig.core.errors import SimrigError
from simrig.files.load import load_material
from simrig.files.window import klems, tensor_tree

AXES = "theta_i=0:60,theta_v=0:60,phi_i,phi_v"
TABLE = np.full((3, 3, 4, 4, 3), 0.1, dtype=np.float32)
GRID = list(product((0, 30, 60), (0, 90, 180, 270)))
PAIRS = np.array([[*light, *view] for light, view in product(GRID, GRID)], dtype=np.float64)


def astm(path: Path) -> None:
    rows = "\n".join(",".join(f"{v:.0f}" for v in row) + ",0.1,0.2,0.3" for row in PAIRS)
    path.write_text(f"LAB_NAME x\nNUM_POINTS 144\nVARS theta_i,phi_i,theta_s,phi_s,R,G,B\n{rows}\n")


def bird(path: Path) -> None:
    names = ("theta_i", "phi_i", "theta_r", "phi_r")
    columns = zip(names, PAIRS.T, strict=True)
    data = {name: {"unit": "deg", "values": column.tolist()} for name, column in columns}
    data["BRDF"] = {"unit": "1/sr", "values": [0.1] * 144}
    path.write_text(json.dumps({"metadata": {}, "data": data}))


def alta(path: Path) -> None:
    rows = "\n".join(" ".join(f"{v:.4f}" for v in np.radians(row)) + " 0.1" for row in PAIRS)
    path.write_text(
        f"#DIM 4 1\n#PARAM_IN SPHERICAL_TL_PL_TV_PV\n#PARAM_OUT INV_STERADIAN\n{rows}\n"
    )


def matlab_73(path: Path) -> None:
    with h5py.File(path, "w", userblock_size=512) as file:
        file.create_dataset("f", data=TABLE.T).attrs["MATLAB_class"] = np.bytes_("single")
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file".ljust(512))


MAKERS: dict[str, Callable[[Path], object]] = {
    "a.astm": astm,
    "a.json": bird,
    "a.dat": alta,
    "klems.xml": lambda path: klems.write_klems(path, Lambert(), "LBNL/Klems Quarter"),
    "tree.xml": lambda path: tensor_tree.write_tree(path, Lambert(), 2),
    "a.npz": lambda path: np.savez_compressed(path, f=TABLE),
    "a.npy": lambda path: np.save(path, TABLE),
    "a.mat": lambda path: savemat(path, {"f": TABLE}, do_compression=True),
    "b.mat": matlab_73,
}


@pytest.mark.parametrize("name", MAKERS)
def test_mutated_files_are_read_or_refused(tmp_path, rng, name, capfd) -> None:
    path = tmp_path / name
    MAKERS[name](path)
    options = {"axes": AXES} if path.suffix in (".npz", ".npy", ".mat") else {}
    load_material(path, **options)
    content = np.frombuffer(path.read_bytes(), dtype=np.uint8)
    refused = 0
    for number in range(60):
        damaged = content.copy()
        start = min(len(content), 1500) if number % 2 else len(content)
        damaged[rng.integers(0, start, 6)] = rng.choice(
            [0, 45, 57, 255, *rng.integers(0, 256, 4)], 6
        )
        cut = len(damaged) if number % 3 else int(rng.integers(1, len(damaged)))
        path.write_bytes(damaged[:cut].tobytes())
        signal.alarm(30)  # ends the run where a reader hangs
        try:
            load_material(path, **options)
        except SimrigError as error:
            refused += 1
            assert "\n" not in str(error)
        finally:
            signal.alarm(0)
    assert refused > 0
    assert capfd.readouterr() == ("", "")

"""The formats that people of this trade bring: round trips with their loss, and what files say."""

from __future__ import annotations

import json
from itertools import product
from pathlib import Path

import h5py
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from refusals import refused
from simrig.brdf import Lambert, Ward
from simrig.brdf.protocol import Brdf, evaluate
from simrig.brdf.tables.dense import DenseTable
from simrig.brdf.tables.isotropic import IsotropicTable
from simrig.brdf.tables.resample import resample_dense
from simrig.core.colour import TO_XYZ
from simrig.core.errors import SimrigError
from simrig.directions.spherical import to_vector
from simrig.files import alta, astm, bird, zemax
from simrig.files.arrays.reader import load_arrays
from simrig.files.load import load_material, read_material, save_material
from simrig.files.window import klems, tensor_tree
from simrig.files.window.reader import load_window

COLOUR = np.array([0.2, 0.1, 0.05])
NORMAL = to_vector(np.float64(0.0), np.float64(0.0))


def at(brdf: Brdf, theta_i: float, phi_i: float, theta_v: float, phi_v: float) -> np.ndarray:
    """Return f_r, angles in degrees."""
    wi, wv = (to_vector(*np.radians(pair)) for pair in ((theta_i, phi_i), (theta_v, phi_v)))
    return evaluate(brdf, wi[None], wv[None])[0]


@pytest.fixture(scope="module")
def small() -> DenseTable:
    return resample_dense(
        Ward((0.1, 0.2, 0.3), (0.3, 0.2, 0.1), 0.3, 0.5), np.pi / 6, 12, np.pi / 3
    )


# The cosine-weighted loss of an isotropic glossy material (Ward, m = 0.3), measured
LOSS = {
    "astm": 0.012,
    "bird": 0.012,
    "klems": 0.11,
    "tensor-tree": 0.03,
    "npz": 0.012,
    "mat": 0.012,
}


@pytest.mark.parametrize("format", LOSS)
def test_round_trips_keep_a_constant_and_state_their_loss(tmp_path, format) -> None:
    path = tmp_path / "x"
    assert save_material(path, Lambert(COLOUR), format).error.worst_relative < 2e-5
    error = save_material(path, Ward((0.1, 0.2, 0.3), (0.3, 0.2, 0.1), 0.3, 0.3), format).error
    assert 0.0 < error.weighted_relative < LOSS[format]


@pytest.mark.parametrize("format", ["klems", "npz", "mat"])
def test_what_was_read_is_written_as_it_is(tmp_path, format) -> None:
    save_material(tmp_path / "a", Ward(m_x=0.3, m_y=0.5), format)
    once = load_material(tmp_path / "a")
    save_material(tmp_path / "b", once, format)
    first, second = (next(iter(load_material(tmp_path / n).data().values())) for n in "ab")
    np.testing.assert_allclose(first, second, rtol=2e-6, atol=1e-9)


# ASTM

HEAD = "LAB_NAME somewhere\nSAMPLE_NAME x\n"
GRID = list(product((0, 30, 60), range(0, 360, 90)))


def astm_file(path: Path, columns: str, values: str, degrees: bool = False, count: int = 0) -> Path:
    turn = (lambda a: a) if degrees else np.radians
    rows = [
        ",".join(f"{turn(a):.6f}" for a in (ti, pi, ts, ps)) + "," + values
        for (ti, pi), (ts, ps) in product(GRID, GRID)
    ]
    stated = f"NUM_POINTS {count or len(rows)}\nVARS theta_i,phi_i,theta_s,phi_s,{columns}\n"
    path.write_text(HEAD + stated + "\n".join(rows) + "\n")
    return path


XYZ = ",".join(f"{v:.6f}" for v in TO_XYZ @ COLOUR)
BANDS = ",".join(f"{w}nm" for w in range(400, 701, 10))


@pytest.mark.parametrize(
    "columns,values,expected",
    [
        ("R,G,B", "0.2,0.1,0.05", COLOUR),
        ("Red,Green,Blue", "0.2,0.1,0.05", COLOUR),
        ("X,Y,Z", XYZ, COLOUR),
        (BANDS, ",".join(["0.3"] * 31), [0.3] * 3),
        ("465nm,525nm,630nm", "0.05,0.1,0.2", COLOUR),
        ("633nm", "0.3", [0.3] * 3),
        ("BRDF", "0.3", [0.3] * 3),
    ],
)
@pytest.mark.parametrize("degrees", [False, True])
def test_astm_columns_say_what_they_hold(tmp_path, columns, values, expected, degrees) -> None:
    path = astm_file(tmp_path / "a.astm", columns, values, degrees)
    brdf, notes = astm.load_astm(path)
    np.testing.assert_allclose(at(brdf, 30, 90, 60, 180), expected, rtol=1e-4)
    assert notes[0].startswith("angles in degrees" if degrees else "angles in radians")


def test_astm_cosine_corrected_values_are_divided(tmp_path) -> None:
    brdf, _ = astm.load_astm(astm_file(tmp_path / "a.astm", "CCBSDF", "0.3"))
    np.testing.assert_allclose(at(brdf, 0, 0, 60, 0), 0.6, rtol=1e-4)


def test_astm_refuses_what_does_not_fit(tmp_path) -> None:
    path = tmp_path / "a.astm"
    refused("NUM_POINTS 7 and has 144", astm.load_astm, astm_file(path, "R,G,B", "1,2,3", count=7))
    refused("6 numbers instead of 7", astm.load_astm, astm_file(path, "R,G,B", "1,2"))
    refused(r"no colour.*--wavelength", astm.load_astm, astm_file(path, "550nm,850nm", "1,2"))
    refused("negative of", astm.load_astm, astm_file(path, "R,G,B", "1,2,-3"))
    path.write_text(HEAD + "VARS theta_i,phi_i,theta_s,R,G,B\n0,0,0,1,2,3\n")
    refused("no column phi_s", astm.load_astm, path)
    grey, _ = astm.load_astm(astm_file(path, "550nm,850nm", "0.1,0.2"), wavelength=850.0)
    np.testing.assert_allclose(at(grey, 0, 0, 30, 0), 0.2, rtol=1e-5)


# BiRD


def bird_content(values: dict[str, list]) -> dict:
    units = {"BRDF": "sr^-1", "wavelength_i": "nm"}
    data = {k: {"unit": units.get(k, "°"), "values": v} for k, v in values.items()}
    return {"metadata": {"type": "BRDF"}, "data": data}


def bird_columns(wavelengths: list[float]) -> dict[str, list]:
    rows = [
        (ti, pi, ts, ps, w, 0.1 + 1e-4 * w)
        for (ti, pi), (ts, ps), w in product(GRID, GRID, wavelengths)
    ]
    names = ("theta_i", "phi_i", "theta_r", "phi_r", "wavelength_i", "BRDF")
    return {name: list(column) for name, column in zip(names, zip(*rows, strict=True), strict=True)}


def test_bird_both_forms(tmp_path) -> None:
    path = tmp_path / "a.json"
    columns = bird_columns([550.0])
    path.write_text(json.dumps(bird_content(columns)))
    brdf, notes = bird.load_bird(path)
    np.testing.assert_allclose(at(brdf, 30, 0, 60, 90), 0.155, rtol=1e-6)
    assert "grey: measured at 550 nm alone" in notes
    variables = [
        {"name": name, "unit": "nm" if name == "wavelength_i" else "deg", "type": "number"}
        for name in columns
    ]
    variables[-1]["unit"] = "1/sr"
    rows = [list(row) for row in zip(*columns.values(), strict=True)]
    older = {"metadata": {}, "data": {"variables": variables, "values": rows}}
    path.write_text(json.dumps(older))
    again, _ = bird.load_bird(path)
    np.testing.assert_array_equal(again.data()["values"], brdf.data()["values"])


def test_bird_spectra_and_polarisation(tmp_path) -> None:
    path = tmp_path / "a.json"
    columns = bird_columns([float(w) for w in range(400, 701, 20)])
    columns["BRDF"] = [0.3] * len(columns["BRDF"])
    path.write_text(json.dumps(bird_content(columns)))
    np.testing.assert_allclose(at(bird.load_bird(path)[0], 0, 0, 30, 0), 0.3, rtol=1e-6)
    columns = bird_columns([550.0])
    both = {name: [*column, *column] for name, column in columns.items()}
    count = len(columns["BRDF"])
    both["BRDF"] = [0.1] * count + [0.3] * count
    content = bird_content(both)
    content["data"]["polarization_i"] = {"notation": "sp", "values": ["s"] * count + ["p"] * count}
    path.write_text(json.dumps(content))
    brdf, notes = bird.load_bird(path)
    np.testing.assert_allclose(at(brdf, 0, 0, 30, 0), 0.2, rtol=1e-6)
    assert "polarization of i averaged" in notes


@pytest.mark.parametrize(
    "change,message",
    [
        ({"theta_i": None}, "lacks theta_i"),
        ({"BRDF": [0.1]}, "different lengths"),
        ({"BRDF": ["x"] * 144}, "no array of numbers"),
        ({"theta_r": [95.0] * 144}, "outside 0° to 90°"),
    ],
)
def test_bird_refuses_what_does_not_fit(tmp_path, change, message) -> None:
    columns = bird_columns([550.0])
    for name, value in change.items():
        columns.pop(name) if value is None else columns.update({name: value})
    path = tmp_path / "a.json"
    path.write_text(json.dumps(bird_content(columns)))
    refused(message, bird.load_bird, path)


# WINDOW and Radiance


def window_file(path: Path, structure: str, blocks: str, definition: str = "") -> Path:
    data = "".join(
        "<WavelengthData><LayerNumber>System</LayerNumber>"
        '<Wavelength unit="Integral">Visible</Wavelength><WavelengthDataBlock>'
        f"{block}</WavelengthDataBlock></WavelengthData>"
        for block in blocks.split("||")
    )
    path.write_text(
        '<?xml version="1.0"?><WindowElement xmlns="http://windows.lbl.gov"><Optical><Layer>'
        f"<DataDefinition><IncidentDataStructure>{structure}</IncidentDataStructure>{definition}"
        f"</DataDefinition>{data}</Layer></Optical></WindowElement>"
    )
    return path


def klems_block(matrix: np.ndarray, side: str = "Front", kind: str = "Reflection") -> str:
    values = " ".join(f"{v:.6g}" for v in matrix.ravel())
    basis = "LBNL/Klems Quarter"
    return (
        f"<WavelengthDataDirection>{kind} {side}</WavelengthDataDirection>"
        f"<ColumnAngleBasis>{basis}</ColumnAngleBasis><RowAngleBasis>{basis}</RowAngleBasis>"
        f"<ScatteringData>{values}</ScatteringData>"
    )


QUARTER = klems.BASES["LBNL/Klems Quarter"]


@pytest.mark.parametrize("structure", ["Columns", "Rows"])
def test_klems_mirror_is_the_diagonal(tmp_path, structure) -> None:
    """The light's patch is where it travels to, so a mirror reflects into the same patch."""
    matrix = np.full((41, 41), 0.01) + np.diag(np.full(41, 1.0))
    matrix[9, 0] = 0.5  # row 9, column 0: normal light into the first patch of the second ring
    path = window_file(tmp_path / "a.xml", structure, klems_block(matrix))
    brdf, notes = load_window(path)
    assert notes[0] == "Klems matrix of 41 patches"
    theta, phi = np.degrees(QUARTER.centres())
    for patch in (1, 4, 12, 30):
        value = at(brdf, theta[patch], phi[patch] + 180.0, theta[patch], phi[patch])
        np.testing.assert_allclose(value, 1.01, rtol=1e-6)
    there, back = at(brdf, 0, 0, theta[9], 0), at(brdf, theta[9], 180, 0, 0)
    np.testing.assert_allclose(there, 0.5 if structure == "Columns" else 0.01, rtol=1e-6)
    np.testing.assert_allclose(back, 0.01 if structure == "Columns" else 0.5, rtol=1e-6)


def test_sides_are_told_apart_or_asked_for(tmp_path) -> None:
    one, two = np.full((41, 41), 0.1), np.full((41, 41), 0.2)
    path = tmp_path / "a.xml"
    window_file(path, "Columns", klems_block(one) + "||" + klems_block(two, "Back"))
    refused("two sides: choose --side front or back", load_window, path)
    np.testing.assert_allclose(at(load_window(path, side="back")[0], 20, 0, 40, 0), 0.2)
    window_file(path, "Columns", klems_block(0 * one) + "||" + klems_block(two, "Back"))
    np.testing.assert_allclose(at(load_window(path)[0], 20, 0, 40, 0), 0.2)
    window_file(path, "Columns", klems_block(one, kind="Transmission"))
    refused("no visible reflection", load_window, path)


def test_klems_refuses_what_does_not_fit(tmp_path) -> None:
    path = tmp_path / "a.xml"
    with pytest.raises(SimrigError, match="1600 values instead of 41²"):
        load_window(window_file(path, "Columns", klems_block(np.ones((40, 40)))))
    with pytest.raises(SimrigError, match="did you mean 'LBNL/Klems Full'"):
        block = klems_block(np.ones((41, 41))).replace("Quarter", "Ful")
        load_window(window_file(path, "Columns", block))
    with pytest.raises(SimrigError, match="structure 'Sideways'"):
        load_window(window_file(path, "Sideways", klems_block(np.ones((41, 41)))))
    path.write_text('<!DOCTYPE a [<!ENTITY b "c">]><WindowElement/>')
    refused("defines entities", load_window, path)
    path.write_text("<WindowElement><Optical>")
    refused("damaged or truncated", load_window, path)


def test_klems_patches_share_the_projected_hemisphere() -> None:
    """Klems: the means over patches, by their projected solid angles, give π."""
    for basis in klems.BASES.values():
        bounds = np.radians(basis.bounds_deg)
        rings = np.pi * np.diff(np.sin(bounds) ** 2)
        np.testing.assert_allclose(rings.sum(), np.pi)
        inside = basis.inside(2)
        theta = np.degrees(np.arccos(inside[..., 2]))
        starts = np.repeat(basis.bounds_deg[:-1], basis.counts)
        ends = np.repeat(basis.bounds_deg[1:], basis.counts)
        assert np.all((theta > starts[:, None]) & (theta < ends[:, None]))


def tree_block(text: str) -> str:
    return (
        "<WavelengthDataDirection>Reflection Back</WavelengthDataDirection>"
        "<AngleBasis>LBNL/Shirley-Chiu</AngleBasis>"
        f"<ScatteringData>{text}</ScatteringData>"
    )


def test_tree_branches_and_grids_have_radiances_order() -> None:
    """Bit i of a branch's number is dimension i; grids run fastest along the last dimension."""
    branches = "{ " + " ".join(f"{{ {n} }}" for n in range(8)) + " }"
    grid = tensor_tree._parsed(branches, 3, "x")
    assert grid[1, 0, 0] == 1 and grid[0, 1, 0] == 2 and grid[0, 0, 1] == 4
    grid = tensor_tree._parsed("{ 0 1 2 3 4 5 6 7 }", 3, "x")
    assert grid[0, 0, 1] == 1 and grid[0, 1, 0] == 2 and grid[1, 0, 0] == 4
    mixed = tensor_tree._parsed("{ {0 1 2 3 4 5 6 7} " + "{ 9 }" * 7 + " }", 3, "x")
    assert mixed.shape == (4, 4, 4) and mixed[0, 0, 1] == 1 and mixed[3, 3, 3] == 9


def test_the_map_of_shirley_and_chiu_is_undone(rng) -> None:
    r, phi = np.sqrt(rng.uniform(0, 1, 500)), rng.uniform(0, 2 * np.pi, 500)
    x, y = r * np.cos(phi), r * np.sin(phi)
    a, b = tensor_tree.disk_to_square(x, y)
    assert a.min() >= 0 and a.max() <= 1 and b.min() >= 0 and b.max() <= 1
    np.testing.assert_allclose(tensor_tree.square_to_disk(a, b), (x, y), atol=1e-12)
    # the map keeps areas: as many points in every quarter of the square
    counts = np.histogram2d(a, b, bins=2, range=((0, 1), (0, 1)))[0]
    assert counts.min() > 90


def test_a_tree_of_rank_three_is_isotropic(tmp_path) -> None:
    path = window_file(tmp_path / "a.xml", "TensorTree3", tree_block("{ 0.25 }"))
    brdf, notes = load_window(path)
    assert isinstance(brdf, IsotropicTable) and "tensor tree of rank 3" in notes[0]
    np.testing.assert_allclose(at(brdf, 40, 10, 20, 200), 0.25, rtol=1e-5)


@pytest.mark.parametrize(
    "text,message",
    [
        ("{ 1 2 3 }", "grid of 3 values"),
        ("{ { 1 } { 2 }", "truncated"),
        ("{ 1 } 2", "more after the end"),
        ("{ nan }", "NaN"),
        ("{" * 30 + " 1 " + "}" * 30, "very fine|more levels"),
        ("", "truncated"),
    ],
)
def test_broken_trees_are_refused(tmp_path, text, message) -> None:
    refused(message, load_window, window_file(tmp_path / "a.xml", "TensorTree4", tree_block(text)))


# Arrays


@pytest.mark.parametrize("axes", ["theta_i,theta_v,phi_i,phi_v", "theta_v,phi_v,theta_i,phi_i,rgb"])
@pytest.mark.parametrize("container", ["npz", "npy", "mat", "mat73"])
def test_arrays_by_their_axes(tmp_path, small, axes, container) -> None:
    ours = ["theta_i", "theta_v", "phi_i", "phi_v", "rgb"]
    names = axes.split(",") + ([] if "rgb" in axes else ["rgb"])
    values = small.values.transpose([ours.index(name) for name in names])
    path = tmp_path / f"a.{container[:3]}"
    if container == "npz":
        np.savez(path, f=values)
    elif container == "npy":
        np.save(path, values)
    elif container == "mat":
        from scipy.io import savemat

        savemat(path, {"f": values, "comment": "a table"})
    else:
        with h5py.File(path, "w", userblock_size=512) as file:
            file.create_dataset("f", data=values.T).attrs["MATLAB_class"] = np.bytes_("double")
        with path.open("r+b") as raw:
            raw.write(b"MATLAB 7.3 MAT-file".ljust(512))
    stated = axes.replace("theta_i", "theta_i=0:60").replace("theta_v", "theta_v=0:30:60")
    brdf = load_material(path, axes=stated)
    np.testing.assert_allclose(brdf.data()["values"], small.values, rtol=1e-12)
    refused(r"name its axes in their order, --axes", load_material, path)


def test_nodes_come_from_the_file_the_caller_or_what_is_usual(tmp_path, small) -> None:
    path = tmp_path / "a.npz"
    np.savez(path, f=small.values, theta_i=np.radians([0, 30, 60]), theta_o=np.radians([0, 30, 60]))
    brdf, notes = load_arrays(path, axes="theta_i,theta_o,phi_i,phi_o")
    np.testing.assert_array_equal(brdf.data()["values"], small.values)
    assert "nodes in radians" in notes and "phi_i assumed every 30°" in notes
    np.savez(path, f=np.ones((6, 6, 48, 48)))
    brdf, notes = load_arrays(path, axes="theta_i,theta_v,phi_i,phi_v")
    assert np.degrees(brdf.theta_max) == pytest.approx(75.0)
    assert "theta_i assumed 0° to 75° in steps of 15°" in notes
    np.savez(path, f=np.ones((5, 5, 48, 48)))
    refused("theta_i=0:72 or theta_i=0:90", load_arrays, path, axes="theta_i,theta_v,phi_i,phi_v")


def test_isotropic_and_half_difference_arrays(tmp_path) -> None:
    path = tmp_path / "a.npz"
    angles = np.arange(0.0, 90.1, 15.0)
    f = 0.1 + angles[:, None, None] / 900 + angles[None, :, None] / 1800 + np.zeros(13)
    np.savez(path, f=f, dphi=np.arange(0.0, 181.0, 15.0))
    brdf, notes = load_arrays(path, axes="theta_i,theta_v,dphi")
    np.testing.assert_allclose(at(brdf, 30, 0, 60, 200), 0.1 + 30 / 900 + 60 / 1800, rtol=1e-5)
    assert any("held as they are" in note for note in notes)
    np.savez(path, f=np.full((12, 10, 8, 3), COLOUR))
    brdf, notes = load_arrays(path, axes="theta_h,theta_d,phi_d")
    assert isinstance(brdf, IsotropicTable) and "bins assumed as in MERL" in notes[-1]


def test_arrays_that_do_not_fit_are_refused(tmp_path, small) -> None:
    path = tmp_path / "a.npz"
    np.savez(path, f=small.values, g=small.values)
    axes = "theta_i=0:60,theta_v=0:60,phi_i,phi_v"
    refused(r"several arrays that fit \(f, g\): --variable", load_arrays, path, axes=axes)
    load_arrays(path, axes=axes, variable="g")
    for bad, message in (
        ("theta_i,theta_v,phi_i", "no whole set of angles"),
        ("theta_i,theta_v,phi_i,phi_i", "names an axis twice"),
        ("theta_i,theta_v,phi_i,phi_vv", "did you mean"),
        ("theta_i=60:0,theta_v,phi_i,phi_v", "FIRST:LAST"),
    ):
        refused(message, load_arrays, path, axes=bad)
    np.savez(path, f=np.where(small.values > 1e9, 0, np.nan))
    refused("NaN or infinite", load_arrays, path, axes=axes)


def test_array_bombs_are_refused(tmp_path) -> None:
    path = tmp_path / "a.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        file.create_dataset("f", (90, 90, 1000, 1000), dtype="f8", chunks=True, compression="gzip")
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file".ljust(512))
    refused("more than the file can hold", load_arrays, path, axes="theta_i,theta_v,phi_i,phi_v")
    np.save(tmp_path / "b.npy", np.array([{"a": 1}], dtype=object), allow_pickle=True)
    with pytest.raises(SimrigError, match="no array of 4 axes"):
        load_arrays(tmp_path / "b.npy", axes="theta_i,theta_v,phi_i,phi_v")


# ALTA


def test_alta_grids_become_tables(tmp_path) -> None:
    path = tmp_path / "a.dat"
    rows = [
        f"{np.radians(tl):.5f} {np.radians(pl):.5f} {np.radians(tv):.5f} {np.radians(pv):.5f} "
        f"{0.1 + tl / 900:.6f} 0.1 0.05"
        for (tl, pl), (tv, pv) in product(GRID, GRID)
    ]
    path.write_text("#DIM 4 3\n#PARAM_IN SPHERICAL_TL_PL_TV_PV\n" + "\n".join(rows))
    brdf, notes = alta.load_alta(path)
    assert isinstance(brdf, DenseTable) and brdf.values.shape == (3, 3, 4, 4, 3)
    np.testing.assert_allclose(at(brdf, 60, 90, 30, 0), [0.1 + 60 / 900, 0.1, 0.05], rtol=1e-5)
    assert "held as they are" in notes[-1]


@pytest.mark.parametrize("turn", [180, 360])
def test_alta_half_difference_grids(tmp_path, turn) -> None:
    path = tmp_path / "a.alta"
    rows = [
        f"{np.radians(th):.6f} {np.radians(td):.6f} {np.radians(pd):.6f} {0.1 + th / 900:.6f}"
        for th, td, pd in product(range(1, 90, 8), range(1, 90, 8), range(0, turn, 20))
    ]
    path.write_text("#DIM 3 1\n#PARAM_IN RUSIN_TH_TD_PD\n" + "\n".join(rows))
    brdf, notes = alta.load_alta(path)
    assert isinstance(brdf, IsotropicTable) and brdf.reciprocal == (turn == 180)
    np.testing.assert_allclose(at(brdf, 17, 0, 17, 0), 0.1 + 17 / 900, rtol=2e-3)
    assert "rows below the horizon left out" in notes[1]


def test_alta_outputs_are_converted_or_refused(tmp_path) -> None:
    path = tmp_path / "a.dat"
    head = "#DIM 4 3\n#PARAM_IN SPHERICAL_TL_PL_TV_PV\n#PARAM_OUT {}\n0.3 0 0.2 1 {}\n"
    path.write_text(head.format("XYZ_COLOR", XYZ.replace(",", " ")))
    np.testing.assert_allclose(alta.read_alta(path).values[0], COLOUR, atol=1e-6)
    path.write_text(head.format("INV_STERADIAN_COSINE_FACTOR", "1 1 1"))
    np.testing.assert_allclose(alta.read_alta(path).values[0], 1 / np.cos(0.3), rtol=1e-9)
    path.write_text(head.format("ENERGY", "1 1 1"))
    refused("holds ENERGY", alta.read_alta, path)


@pytest.mark.parametrize("name", ["STARK_3D", "COS_TH", "RUSIN_VH"])
def test_alta_parameterisations_that_are_not_read_are_named(tmp_path, name) -> None:
    path = tmp_path / "a.dat"
    path.write_text(f"#DIM 3 1\n#PARAM_IN {name}\n1 2 3 4\n")
    refused(f"is in {name}:", alta.read_alta, path)


def test_retro_and_back_parameterisations(tmp_path) -> None:
    """At their centres the view is at the light."""
    for name in ("RETRO_TL_TVL_PROJ_DPHI", "SCHLICK_TL_TK_PROJ_DPHI"):
        path = tmp_path / "a.dat"
        path.write_text(f"#DIM 3 1\n#PARAM_IN {name}\n0.4 0 0 1\n")
        samples = alta.read_alta(path)
        np.testing.assert_allclose([samples.theta_i, samples.theta_v], 0.4, atol=1e-9)
        np.testing.assert_allclose(samples.phi_v, samples.phi_i, atol=1e-9)


# Others are named for what they are


@pytest.mark.parametrize(
    "content,message",
    [
        ("Symmetry Asymmetric\nScatterAzimuth 5\n1\nScatterRadial 5\n", "a LightTools BSDF file"),
        ("OPTIS - Anisotropic BSDF surface file v8.0\n0\n", "a surface file of Ansys Speos"),
        ('{"a": 1}', "JSON, but no BRDF of the BiRD format"),
        ("<scene version='3.0.0'/>", "a Mitsuba scene"),
        ("IESNA:LM-63-2002\n", "an IES light"),
    ],
)
def test_other_formats_are_named(tmp_path, content, message) -> None:
    path = tmp_path / "file.bsdf"
    path.write_text(content)
    refused(f"is {message}.*(not a material|not read)", load_material, path)


def test_options_for_another_format_are_refused(tmp_path) -> None:
    path = tmp_path / "a.npz"
    save_material(path, Lambert())
    refused("'layout' is for utia, utia-exr; the file is", load_material, path, layout="6x48")
    doubled = load_material(path, factor=2.0)
    np.testing.assert_allclose(at(doubled, 0, 0, 30, 0), 1.0 / np.pi, rtol=1e-6)
    assert read_material(path).format == "npz"


# Zemax


def zemax_file(path: Path, content: str, material: Brdf) -> Path:
    """Write a material around its specular directions, each computed by turning vectors."""
    incidence, azimuth, radial = range(0, 80, 15), range(0, 181, 30), range(0, 60, 6)
    lines = ["# made by a test", "Source Measured", "Symmetry PlaneSymmetrical"]
    lines += [f"SpectralContent {content}", "ScatterType BRDF", "SampleRotation 1", "0"]
    for name, angles in (
        ("AngleOfIncidence", incidence),
        ("ScatterAzimuth", azimuth),
        ("ScatterRadial", radial),
    ):
        lines += [f"{name} {len(angles)}", " ".join(map(str, angles))]
    blocks = ["Monochrome"] if content == "Monochrome" else [f"Tristimulus{c}" for c in "XYZ"]
    for channel, block in enumerate(blocks):
        lines += ["", block, "DataBegin"]
        for theta in np.radians(incidence):
            lines.append("TIS 0.5")
            light = np.array([np.sin(theta), 0.0, np.cos(theta)])
            specular = light * [-1.0, -1.0, 1.0]
            up = np.array([np.cos(theta), 0.0, np.sin(theta)])
            for a in np.radians(azimuth):
                axis = np.cross(specular, np.cos(a) * up + np.sin(a) * np.cross(specular, up))
                views = np.array(
                    [Rotation.from_rotvec(r * axis).apply(specular) for r in np.radians(radial)]
                )
                values = evaluate(material, light[None], views)
                values = values[:, 0] if len(blocks) == 1 else (values @ TO_XYZ.T)[:, channel]
                lines.append(" ".join(f"{v:.6g}" for v in values))
        lines.append("DataEnd")
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize("content", ["Monochrome", "XYZ"])
def test_zemax_lies_around_the_specular_direction(tmp_path, content) -> None:
    material = Ward((0.1, 0.1, 0.1), (0.3, 0.3, 0.3), 0.4, 0.4)
    path = zemax_file(tmp_path / "a.bsdf", content, material)
    samples = zemax.read_zemax(path)
    expected = evaluate(material, *samples.directions)
    np.testing.assert_allclose(samples.values, expected, rtol=2e-4, atol=1e-6)
    read = read_material(path)
    assert read.format == "zemax" and "spline" in read.notes[0]
    for theta in (0, 30, 60):
        found, true = (at(b, theta, 0, theta, 180) for b in (read.brdf, material))
        np.testing.assert_allclose(found, true, rtol=0.1)


def test_zemax_refuses_what_does_not_fit(tmp_path) -> None:
    path = zemax_file(tmp_path / "a.bsdf", "Monochrome", Lambert())
    text = path.read_text()
    for old, new, message in (
        ("ScatterType BRDF", "ScatterType BTDF", "holds BTDF, not reflection"),
        ("SampleRotation 1\n0", "SampleRotation 2\n0 90", "several sample rotations"),
        ("ScatterRadial", "ScatterRadius", "lacks ScatterRadial"),
        ("Monochrome\nDataBegin", "Monochrome\nDataBegin x", "values missing"),
    ):
        path.write_text(text.replace(old, new))
        refused(message, zemax.read_zemax, path)
    path.write_text(text[: len(text) // 2])
    refused("values missing: truncated", zemax.read_zemax, path)

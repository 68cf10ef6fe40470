"""Files of samples (ASTM, BiRD, ALTA, Zemax): what they say is used, what does not fit refused."""

from __future__ import annotations

import json
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from formats_shared import COLOUR, GRID, XYZ, at
from refusals import refused
from simrig.brdf import Lambert, Ward
from simrig.brdf.protocol import Brdf, evaluate
from simrig.brdf.tables.dense import DenseTable
from simrig.brdf.tables.isotropic import IsotropicTable
from simrig.core.colour import TO_XYZ
from simrig.files import alta, astm, bird, zemax
from simrig.files.load import read_material

# ASTM

HEAD = "LAB_NAME somewhere\nSAMPLE_NAME x\n"


def astm_file(path: Path, columns: str, values: str, degrees: bool = False, count: int = 0) -> Path:
    turn = (lambda a: a) if degrees else np.radians
    rows = [
        ",".join(f"{turn(a):.6f}" for a in (ti, pi, ts, ps)) + "," + values
        for (ti, pi), (ts, ps) in product(GRID, GRID)
    ]
    stated = f"NUM_POINTS {count or len(rows)}\nVARS theta_i,phi_i,theta_s,phi_s,{columns}\n"
    path.write_text(HEAD + stated + "\n".join(rows) + "\n")
    return path


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

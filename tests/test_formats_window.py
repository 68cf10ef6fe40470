"""BSDF files of WINDOW and Radiance: Klems matrices and tensor trees."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from formats_shared import at
from refusals import refused
from simrig.brdf.tables.isotropic import IsotropicTable
from simrig.core.errors import SimrigError
from simrig.files.window import klems, tensor_tree
from simrig.files.window.reader import load_window


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

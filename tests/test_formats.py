"""Formats of materials: round trips with their loss, arrays, files that are something else."""

from __future__ import annotations

import h5py
import numpy as np
import pytest

from formats_shared import COLOUR, at
from refusals import refused
from simrig.brdf import Lambert, Ward
from simrig.brdf.tables.dense import DenseTable
from simrig.brdf.tables.isotropic import IsotropicTable
from simrig.brdf.tables.resample import resample_dense
from simrig.core.errors import SimrigError
from simrig.files.arrays.reader import load_arrays
from simrig.files.load import load_material, read_material, save_material


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

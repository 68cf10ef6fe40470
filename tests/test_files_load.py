"""Materials by name and by content, refusals that say what a file is, and saving."""

from __future__ import annotations

import numpy as np
import pytest

from refusals import refused
from simrig.brdf import Kurt, Lambert, Ward, kurt_material
from simrig.brdf.tables.barycentric import BarycentricBrdf
from simrig.brdf.tables.dense import DenseTable
from simrig.brdf.tables.isotropic import IsotropicTable
from simrig.brdf.tables.rgl import RglBrdf
from simrig.btf.synthetic import bumps
from simrig.files import hdf5
from simrig.files.btf.hdf5 import write_btf
from simrig.files.load import FORMATS, MATERIALS, file_format, load_material, save_material
from simrig.files.rgl.writer import RglResolution
from simrig.files.utia import UtiaLayout

COARSE = {"rgl": {"resolution": RglResolution(4, 8, 17, 9)}}


def test_every_built_in_name_loads():
    for name in MATERIALS:
        assert load_material(name).name == name


@pytest.mark.parametrize("name", ["fabric02", "lambertian", "no_such"])
def test_unknown_names_suggest(name):
    refused("unknown material", load_material, name)


def test_a_btf_is_refused_with_what_makes_a_material_of_it(tmp_path):
    path = write_btf(tmp_path / "bumps.h5", bumps((1, 1), (1.0, 1.0), "uniform_1"))
    refused(r"average it first .simrig btf average", load_material, path)


def test_missing_files_are_not_names(tmp_path):
    refused("there is no file", load_material, "fabric002.h5")
    refused("there is no file", load_material, tmp_path / "fabric002")
    refused("is a folder", load_material, tmp_path)


@pytest.mark.parametrize(
    "format,kind",
    [
        ("astm", DenseTable),
        ("bird", DenseTable),
        ("klems", BarycentricBrdf),
        ("tensor-tree", DenseTable),
        ("npz", DenseTable),
        ("mat", DenseTable),
        ("hdf5", Kurt),
        ("merl", IsotropicTable),
        ("utia", DenseTable),
        ("utia-exr", DenseTable),
        ("rgl", RglBrdf),
    ],
)
def test_written_formats_are_recognised_by_content(tmp_path, format, kind):
    path = tmp_path / "material.data"
    saved = save_material(path, kurt_material("fabric041"), format, **COARSE.get(format, {}))
    assert saved.bytes == path.stat().st_size and saved.format == format
    assert file_format(path) == format
    assert isinstance(load_material(path), kind)
    assert (saved.error.mean_relative == 0.0) == (format == "hdf5")
    assert saved.error.weighted_relative < 0.3


def test_format_comes_from_the_ending(tmp_path):
    for name, about in FORMATS.items():
        if about.write is None:
            continue
        path = tmp_path / f"x{about.suffixes[0]}"
        given = {key: value for key, value in COARSE.get(name, {}).items() if key in about.takes}
        assert save_material(path, Lambert(), **given).format == name
    refused("names no format", save_material, tmp_path / "x.txt", Lambert())
    refused("did you mean 'merl'", save_material, tmp_path / "x", Lambert(), "merrl")
    refused("did you mean 'layout'", save_material, tmp_path / "x", Lambert(), "utia", layouts=3)


def test_utia_layout_is_an_option(tmp_path):
    layout = UtiaLayout(n_theta=4, n_phi=8, theta_step_deg=25.0)
    saved = save_material(tmp_path / "x.bin", kurt_material("wood01"), layout=layout)
    assert saved.bytes == layout.bytes
    assert 0.0 < saved.error.median_relative < 0.2


def test_table_on_the_layout_is_written_as_it_is(tmp_path, rng):
    values = rng.uniform(0.2, 1.0, (6, 6, 48, 48, 3))
    table = DenseTable(values, np.radians(15.0))
    assert save_material(tmp_path / "x.bin", table).error.worst_relative < 1e-12


def test_merl_conversion_of_an_anisotropic_material_states_its_error(tmp_path):
    isotropic = save_material(tmp_path / "a.binary", Ward(m_x=0.3, m_y=0.3))
    anisotropic = save_material(tmp_path / "b.binary", Ward(m_x=0.1, m_y=0.5))
    assert isotropic.error.mean_relative < 0.01
    assert anisotropic.error.mean_relative > 0.1
    assert "mean relative error" in str(anisotropic.error)


@pytest.mark.parametrize(
    "content,message",
    [
        (b"", "is empty"),
        (b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n", "Radiance HDR picture"),
        (b"\x89PNG\r\n\x1a\n....", "a PNG picture"),
        (b"<?xml version='1.0'?>", "an XML file"),
        (b"\x80\x04\x95pickle\0", "a Python pickle"),
        (b"\x93NUMPY\x01\0", "a single NumPy array"),
        (b"400 0.1\n410 0.2\n420 0.3\n", "a spectrum"),
        (b"1 2 3\n4 5 6\n7 8 9\n", "a table of 3 numeric columns"),
        ("ein Text über etwas\n".encode(), "a text file"),
        (bytes(range(256)) * 3, "no format that is known"),
    ],
)
def test_other_files_are_refused_by_what_they_are(tmp_path, content, message):
    path = tmp_path / "file"
    path.write_bytes(content)
    refused(message, load_material, path)


def test_measurement_is_not_a_material(tmp_path):
    path = tmp_path / "measurement.h5"
    with hdf5.create(path, "measurement"):
        pass
    refused("reconstruct it first", load_material, path)


def test_sparse_samples_are_refused_with_the_reason(tmp_path):
    path = tmp_path / "tape.dat"
    path.write_text("#DIM 3 1\n#PARAM_IN ISOTROPIC_TV_TL_DPHI\n0.1 0.2 0.3 1\n0.1 0.4 0.3 1\n")
    refused("2 ALTA samples at 2 incidences: too sparse to render", load_material, path)


def test_negative_noise_can_be_clamped(tmp_path):
    path = tmp_path / "noisy.bin"
    save_material(path, Lambert())
    flat = np.fromfile(path, dtype="<f8")
    flat[-1] = -1e-3
    flat.tofile(path)
    refused("--clamp-negative', or clamp_negative=True", load_material, path)
    assert load_material(path, clamp_negative=True).values.min() == 0.0


@pytest.mark.parametrize(
    "name,expected",
    [
        ("rgl/aurora_white_rgb.bsdf", RglBrdf),
        ("cornell/cayman.brdf", IsotropicTable),
        ("ubo2014/carpet07_mean_151x151.npz", DenseTable),
    ],
)
def test_measured_materials_load(shared_data, name, expected):
    assert isinstance(load_material(shared_data(name)), expected)


@pytest.mark.parametrize(
    "name,message",
    [
        ("alta/retro-gray-tape.dat", "7405 ALTA samples at 3 incidences"),
        ("envmaps/grace_probe_latlong.hdr", "environment map"),
        ("spectra/macbeth-1.spd", "a spectrum"),
        ("vectors/ciede2000_test_data.txt", "numeric columns"),
    ],
)
def test_other_measured_data_are_refused(shared_data, name, message):
    refused(message, load_material, shared_data(name))

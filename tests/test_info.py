"""``simrig info``: any file, what it says, what becomes of it."""

from __future__ import annotations

import zipfile

import h5py
import numpy as np
import pytest

import simrig as sr
from command_line import done, refusal, simrig
from simrig.brdf import Lambert
from simrig.btf.stack import BtfStack
from simrig.btf.synthetic import bumps
from simrig.core.colour import TO_XYZ
from simrig.files import hdf5
from simrig.files.btf.hdf5 import write_btf
from simrig.files.btf.images import write_btf_images
from simrig.files.images import write_exr, write_png
from simrig.files.load import save_material


def test_pictures_say_what_they_hold(tmp_path) -> None:
    path = tmp_path / "a.exr"
    picture = np.full((12, 24, 3), 0.5, dtype=np.float32)
    picture[0, 0] = -0.1
    write_exr(path, picture)
    about = done("info", path)
    assert (about["kind"], about["format"]) == ("picture", "OpenEXR")
    assert about["facts"]["negative_pixels"] == 1
    assert "latitude and longitude" in about["use"][1]
    assert about["made"] == ["values taken as they are: linear RGB with sRGB primaries"]
    write_png(tmp_path / "a.png", np.maximum(picture, 0.0), exposure=2.0)
    about = done("info", tmp_path / "a.png")
    assert about["says"]["Exposure"] == "2" and about["made"] == ["decoded from sRGB"]


def test_materials_say_what_is_made_of_them(tmp_path) -> None:
    path = tmp_path / "a.astm"
    save_material(path, Lambert([0.2, 0.1, 0.05]))
    about = done("info", path)
    assert about["kind"] == "material" and about["format"].startswith("astm")
    assert "note: the same for all directions (Lambertian)" in about["made"]
    np.testing.assert_allclose(about["facts"]["albedo_0"], [0.2, 0.1, 0.05], rtol=1e-3)
    assert "albedo_60" in simrig("info", path).output


def test_files_that_need_an_option_name_it(tmp_path) -> None:
    path = tmp_path / "a.npz"
    np.savez(path, f=np.full((3, 3, 12, 12), 0.1))
    about = done("info", path)
    assert about["kind"] == "material" and "--axes" in about["made"][0]
    axes = "theta_i=0:60,theta_v=0:60,phi_i,phi_v"
    assert done("info", path, "--axes", axes)["facts"]["model"] == "DenseTable"


def test_btfs_folders_archives_and_measurements(tmp_path) -> None:
    whole = bumps((2, 3), (1.0, 1.0), "uniform_1")
    stack = BtfStack(whole.values[::40], whole.angles[::40], whole.size_mm)
    path = write_btf(tmp_path / "bumps.h5", stack)
    assert done("info", path)["kind"] == "BTF"
    write_btf_images(tmp_path / "folder", stack)
    about = done("info", tmp_path / "folder")
    assert about["kind"] == "folder of pictures"
    assert about["facts"]["pictures"] == len(stack)
    with zipfile.ZipFile(tmp_path / "all.zip", "w") as archive:
        for picture in (tmp_path / "folder").rglob("*.exr"):
            archive.write(picture, picture.name)
    assert done("info", tmp_path / "all.zip")["facts"]["pictures"] == len(stack)
    with hdf5.create(tmp_path / "m.h5", "measurement of slices"):
        pass
    about = done("info", tmp_path / "m.h5")
    assert about["kind"] == "measurement of slices" and about["use"] == ["simrig reconstruct"]


@pytest.mark.parametrize(
    "content,kind,use",
    [
        ("<scene version='3.0.0'/>", "a Mitsuba scene", "simrig render"),
        ("400 0.1\n410 0.2\n420 0.3\n", "a table of two columns", None),
        ("Symmetry A\nScatterRadial 5\n", "a LightTools BSDF file", None),
    ],
)
def test_other_files_are_named(tmp_path, content, kind, use) -> None:
    path = tmp_path / "file"
    path.write_text(content)
    about = done("info", path)
    assert about["kind"] == "another file" and about["format"].startswith(kind)
    assert bool(about["use"]) == (use is not None)


def test_damage_is_refused(tmp_path) -> None:
    path = tmp_path / "a.exr"
    write_exr(path, np.random.default_rng(0).uniform(0, 1, (40, 40, 3)))
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    assert "damaged OpenEXR" in refusal("info", path)
    assert "there is no file" in refusal("info", tmp_path / "nothing.exr")
    path.write_bytes(bytes(range(256)))
    assert "no format that is known" in refusal("info", path)


def test_pictures_and_materials_are_compared_by_content(tmp_path) -> None:
    """A UTIA table in OpenEXR beside a material; two of simrig's own beside each other."""
    table, picture = tmp_path / "a.exr", tmp_path / "b.exr"
    save_material(table, Lambert([0.2, 0.1, 0.05]), "utia-exr")
    compared = done("compare", "lambert", table, "--step", "15")
    assert compared["theta_max_deg"] == 75.0
    assert done("compare", table, table, "--step", "15")["mre"] == 0.0
    values = np.random.default_rng(0).uniform(0.1, 0.9, (12, 16, 3)).astype(np.float32)
    write_exr(picture, values)
    assert "not one of each" in refusal("compare", "lambert", tmp_path / "none.png")
    cropped = tmp_path / "c.exr"
    write_exr(cropped, values[:, :14])
    message = refusal("compare", picture, cropped)
    assert "'" + str(picture) + "' has 16 × 12 pixels" in message and "14 × 12 pixels" in message


def test_pictures_of_other_exposures_are_brought_together(tmp_path) -> None:
    values = np.random.default_rng(0).uniform(0.05, 0.4, (12, 16, 3))
    write_exr(tmp_path / "a.exr", values)
    write_png(tmp_path / "a.png", values, exposure=2.0)
    compared = done("compare", tmp_path / "a.exr", tmp_path / "a.png")
    assert compared["delta_e"] < 0.5
    assert (
        "divided by the exposure 2"
        in simrig("compare", tmp_path / "a.exr", tmp_path / "a.png").output
    )


def test_utia_options_at_the_command_line(tmp_path) -> None:
    import OpenEXR

    base = np.full((36, 36, 3), [0.2, 0.16, 0.1])
    xyz = (base @ TO_XYZ.T * 100).astype(np.float32)
    about = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    named = tmp_path / "named.exr"
    OpenEXR.File(about, {"RGB": xyz}).write(str(named))
    assert "say which grid it is, --layout" in refusal("materials", named)
    assert "--colour xyz" in refusal("materials", named, "--layout", "3x12")
    found = done(
        *("convert", named, tmp_path / "x.h5", "--layout", "3x12"),
        *("--colour", "xyz", "--factor", "0.01"),
    )
    expected = np.pi * base[0, 0]
    np.testing.assert_allclose(found["plausibility"]["albedo"][0], expected, rtol=1e-3)
    with h5py.File(tmp_path / "x.h5") as file:
        assert "plausibility" in file.attrs["provenance"]
    assert "360x" not in refusal("materials", named, "--layout", "3by12")


def test_pictures_are_compared_at_the_exposure_of_the_reference(tmp_path) -> None:
    """That of its plan, which its file states; the one that is given replaces it."""
    first, second = (np.full((16, 16, 3), level, dtype=np.float32) for level in (0.01, 0.02))
    for name, image in (("planned", first), ("other", second)):
        write_exr(tmp_path / f"{name}.exr", image, {"exposure": 25.0} if name == "planned" else {})
    planned, other = tmp_path / "planned.exr", tmp_path / "other.exr"
    found = sr.compare(planned, other)
    assert found.exposure == 25.0 and "exposure 25 of its plan" in str(found.made)
    assert found.delta_e == pytest.approx(sr.compare(first, second, exposure=25.0).delta_e)
    assert sr.compare(planned, other, exposure=2.0).exposure == 2.0
    assert sr.compare(other, planned).exposure == 1.0

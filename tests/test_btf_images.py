"""BTFs as folders of pictures: the published names, and what the pictures hold."""

from __future__ import annotations

import zipfile
from pathlib import Path

import mitsuba as mi
import numpy as np
import OpenEXR
import pytest

from refusals import refused
from simrig.btf.stack import BtfStack
from simrig.btf.synthetic import bumps, grid_angles
from simrig.core.errors import SimrigError
from simrig.directions import scheme
from simrig.files.btf.images import PixelValues, import_btf, write_btf_images
from simrig.files.btf.source import find_pictures
from simrig.files.images import decode_srgb, write_exr, write_png

UTIA = "tv{tv:03d}_pv{pv:03d}/tl{tl:03d}_pl{pl:03d}_tv{tv:03d}_pv{pv:03d}.exr"
BONN = "tv{tv:03d}_pv{pv:03d}/{n:05d} tl{tl:03d} pl{pl:03d} tv{tv:03d} pv{pv:03d}.jpg"


def path_of(folder: Path, pattern: str, number: int, angles: np.ndarray) -> Path:
    tl, tv, pl, pv = (round(a) for a in np.degrees(angles).tolist())
    path = folder / pattern.format(n=number, tl=tl, tv=tv, pl=pl, pv=pv)
    path.parent.mkdir(parents=True, exist_ok=True)
    return path


def test_our_own_pictures_come_back(tmp_path) -> None:
    whole = bumps((3, 5), (5.0, 3.0))
    stack = BtfStack(whole.values[::9], whole.angles[::9], whole.size_mm)
    write_btf_images(tmp_path / "folder", stack)
    again = import_btf(tmp_path / "folder", tmp_path / "a.h5", stack.size_mm, dtype=np.float32)
    order = np.lexsort(stack.angles[:, [3, 1, 2, 0]].T)
    np.testing.assert_allclose(again.angles, stack.angles[order], atol=1e-12)
    np.testing.assert_array_equal(again.values[()], stack.values[order])


def test_two_pictures_of_one_pair_are_refused_by_name(tmp_path) -> None:
    for pattern in (UTIA, BONN.replace("jpg", "exr")):
        path_of(tmp_path, pattern, 7, np.radians([30.0, 15.0, 90.0, 0.0])).touch()
    refused(r"00007 tl030 pl090.*and .*tl030_pl090.*: remove one", find_pictures, tmp_path)


def test_all_names_of_81_by_81_differ_and_are_understood(tmp_path) -> None:
    angles = grid_angles(scheme("hemisphere_81"))
    for pattern in (UTIA, BONN):
        folder = tmp_path / pattern[-3:]
        for number in range(0, 6561, 40):
            path_of(folder, pattern, number, angles[number]).touch()
        found = find_pictures(folder)
        assert len(found.names) == len(range(0, 6561, 40))
        np.testing.assert_allclose(found.angles, angles[::40], atol=1e-12)


def test_xyz_stored_as_rgb_is_stated(tmp_path) -> None:
    red = np.array([0.4124, 0.2126, 0.0193], dtype=np.float32)
    for number, angles in enumerate(np.radians([[0.0, 0.0, 0, 0], [60.0, 15.0, 90.0, 0.0]])):
        path = path_of(tmp_path / "in", UTIA, number, angles)
        write_exr(path, np.broadcast_to(red * 0.5, (2, 3, 3)))
    size = (1.0, 1.0)
    values = PixelValues("xyz")
    stack = import_btf(tmp_path / "in", tmp_path / "x.h5", size, values, dtype=np.float32)
    expected = np.broadcast_to([0.5, 0.0, 0.0], stack.values.shape)
    # the four digits of the matrix that made the picture are not those of the one that reads it
    np.testing.assert_allclose(stack.values[()], expected, atol=5e-5)
    options = PixelValues("xyz", factor=1.0 / np.pi, with_cosine=True)
    stack = import_btf(tmp_path / "in", tmp_path / "y.h5", size, options, dtype=np.float32)
    np.testing.assert_allclose(stack.values[:, 0, 0, 0], [0.5 / np.pi, 1.0 / np.pi], rtol=1e-4)


@pytest.mark.parametrize("suffix", ["png", "jpg"])
def test_display_pictures_are_decoded(suffix, tmp_path) -> None:
    grey = np.full((8, 8, 3), 100, dtype=np.uint8)
    for number, angles in enumerate(np.radians([[0.0, 0.0, 0, 0], [15.0, 15.0, 60.0, 0.0]])):
        path = path_of(tmp_path / "in", BONN.replace("jpg", suffix), number, angles)
        if suffix == "png":
            write_png(path, grey)
        else:
            mi.Bitmap(grey).write(str(path), quality=100)
    stack = import_btf(tmp_path / "in", tmp_path / "x.h5", (1.0, 1.0), dtype=np.float32)
    np.testing.assert_allclose(stack.values[()], decode_srgb(np.array(100 / 255)), atol=5e-3)


def test_bad_folders_are_refused(tmp_path) -> None:
    refused("there is no folder", find_pictures, tmp_path / "nowhere")
    (tmp_path / "picture.exr").touch()
    refused("named by its angles", find_pictures, tmp_path)
    (tmp_path / "picture.exr").unlink()
    for number, size in enumerate((2, 3)):
        path = path_of(tmp_path, UTIA, number, np.radians([15.0 * number, 0.0, 0.0, 0.0]))
        write_exr(path, np.ones((size, 2, 3)))
    with pytest.raises(SimrigError, match=r"tl015_pl000_tv000_pv000\.exr' has 3 × 2 pixels"):
        import_btf(tmp_path, tmp_path / "x.h5", (1.0, 1.0))


DECIMAL = "tl{tl:g}_pl{pl:.1f}_tv{tv:g}_pv{pv:.1f}.png"
SEVEN = [(0.0, 0.0)] + [(52.5, p) for p in range(0, 360, 60)]


def seven_by_seven(folder: Path, pattern: str) -> None:
    folder.mkdir()
    for tl, pl in SEVEN:
        for tv, pv in SEVEN:
            values = np.full((4, 5, 3), 128, np.uint8)
            write_png(folder / pattern.format(tl=tl, pl=float(pl), tv=tv, pv=float(pv)), values)


def test_decimal_angles_are_understood(tmp_path) -> None:
    seven_by_seven(tmp_path / "in", DECIMAL)
    found = find_pictures(tmp_path / "in")
    assert len(found.names) == 49
    assert set(np.round(np.degrees(found.angles[:, 0]), 6)) == {0.0, 52.5}


def test_zip_archives_are_read(tmp_path) -> None:
    seven_by_seven(tmp_path / "in", DECIMAL)
    with zipfile.ZipFile(tmp_path / "in.zip", "w") as archive:
        for path in (tmp_path / "in").iterdir():
            archive.write(path, f"some/where/{path.name}")
        archive.writestr("readme.txt", "no picture")
    folder = import_btf(tmp_path / "in", tmp_path / "a.h5", (1.0, 1.0))
    packed = import_btf(tmp_path / "in.zip", tmp_path / "b.h5", (1.0, 1.0))
    np.testing.assert_array_equal(folder.values[()], packed.values[()])
    assert packed.provenance["skipped"] == "1 files that are no pictures left out: readme.txt"
    content = (tmp_path / "in.zip").read_bytes()
    (tmp_path / "in.zip").write_bytes(content[: len(content) // 2])
    with pytest.raises(SimrigError, match="neither a folder of pictures nor a zip"):
        import_btf(tmp_path / "in.zip", tmp_path / "c.h5", (1.0, 1.0))


@pytest.mark.parametrize("stray", ["preview.png", "tl0_pl0_tv0.tif", "tlX_pl0_tv0_pv0.exr"])
def test_pictures_are_not_left_out_in_silence(tmp_path, stray) -> None:
    seven_by_seven(tmp_path / "in", DECIMAL)
    (tmp_path / "in" / stray).write_bytes(b"II*\0")
    refused(f"1 pictures that are not named.*'{stray}'", find_pictures, tmp_path / "in")


def test_channels_say_whether_they_are_rgb_or_xyz(tmp_path) -> None:
    """Radiance HDR and OpenEXR: RGB by their names, XYZ by their names or header."""
    rgb, red = np.float32([0.3, 0.2, 0.1]), np.float32([0.4124, 0.2126, 0.0193])
    pictures = {
        "rgb": {c: np.full((2, 3), v, np.float32) for c, v in zip("RGB", rgb, strict=True)},
        "xyz": {c: np.full((2, 3), v, np.float32) for c, v in zip("XYZ", red, strict=True)},
    }
    for name, channels in pictures.items():
        (tmp_path / name).mkdir()
        for tl in (0, 15):
            path = tmp_path / name / f"tl{tl:03d}_pl000_tv000_pv000.exr"
            OpenEXR.File({"type": OpenEXR.scanlineimage}, channels).write(str(path))
        stack = import_btf(tmp_path / name, tmp_path / f"{name}.h5", (1.0, 1.0), dtype=np.float32)
        expected = rgb if name == "rgb" else [1.0, 0.0, 0.0]
        np.testing.assert_allclose(stack.values[0, 0, 0], expected, atol=1e-4)
    assert stack.provenance["read"] == ["CIE XYZ to RGB"]

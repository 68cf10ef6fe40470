"""Radiance pictures: what their headers say, every orientation, every packing, and damage."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from refusals import refused
from simrig.core.colour import TO_XYZ
from simrig.files.pictures import read_picture
from simrig.files.pictures.primaries import rgb_to_xyz

HEIGHT, WIDTH = 6, 9
RGBE = "FORMAT=32-bit_rle_rgbe"


@pytest.fixture
def rgb(rng: np.random.Generator) -> np.ndarray:
    """Values that RGBE holds exactly: mantissas of 8 bits with one exponent."""
    mantissas = rng.integers(1, 256, (HEIGHT, WIDTH, 3))
    mantissas[..., 0] |= 128
    return (mantissas / 256.0).astype(np.float32)


def packed(rgb: np.ndarray) -> np.ndarray:
    largest = rgb.max(axis=-1)
    exponent = np.floor(np.log2(largest)) + 1
    mantissas = np.clip(rgb * (256.0 / 2.0**exponent)[..., None], 0, 255)
    return np.concatenate([mantissas, exponent[..., None] + 128], axis=-1).astype(np.uint8)


def write(path: Path, body: bytes, size: str, *lines: str) -> Path:
    head = "\n".join(["#?RADIANCE", *lines, "", size, ""])
    path.write_bytes(head.encode() + body)
    return path


def flat(path: Path, rgb: np.ndarray, *lines: str) -> Path:
    return write(path, packed(rgb).tobytes(), f"-Y {len(rgb)} +X {rgb.shape[1]}", *lines)


def run_length(lines: np.ndarray) -> bytes:
    """Return scanlines in the newer coding, each plane as runs and literals."""
    out = b""
    for line in lines:
        out += b"\2\2" + len(line).to_bytes(2, "big")
        for plane in line.T:
            position = 0
            while position < len(plane):
                run = 1
                while run < 127 and plane[position : position + run + 1].tolist() == [
                    plane[position]
                ] * (run + 1):
                    run += 1
                if run > 2:
                    out += bytes([128 + run, plane[position]])
                else:
                    run = 1
                    out += bytes([1, plane[position]])
                position += run
    return out


def test_plain_pixels(tmp_path, rgb) -> None:
    np.testing.assert_array_equal(read_picture(flat(tmp_path / "a.hdr", rgb, RGBE)).pixels, rgb)


def test_run_lengths_new_and_old(tmp_path, rgb) -> None:
    rgb[2] = rgb[2, :1]  # a constant line
    size = f"-Y {HEIGHT} +X {WIDTH}"
    path = write(tmp_path / "new.hdr", run_length(packed(rgb)), size, RGBE)
    np.testing.assert_array_equal(read_picture(path).pixels, rgb)
    lines = [line.tobytes() for line in packed(rgb)]
    lines[2] = lines[2][:4] + bytes([1, 1, 1, WIDTH - 1])
    path = write(tmp_path / "old.hdr", b"".join(lines), size, RGBE)
    np.testing.assert_array_equal(read_picture(path).pixels, rgb)


def test_long_old_runs(tmp_path) -> None:
    width = 700  # 699 = 187 + 2 · 256
    line = bytes([200, 100, 50, 129, 1, 1, 1, 187, 1, 1, 1, 2])
    pixels = read_picture(write(tmp_path / "a.hdr", line, f"-Y 1 +X {width}", RGBE)).pixels
    expected = np.broadcast_to(np.float32([200, 100, 50]) / 128, (1, width, 3))
    np.testing.assert_array_equal(pixels, expected)


def test_exposure_and_colour_correction_are_divided_out(tmp_path, rgb) -> None:
    lines = ("EXPOSURE=2", "EXPOSURE= 4.0", "COLORCORR=1 2 0.5", RGBE)
    picture = read_picture(flat(tmp_path / "a.hdr", rgb, *lines))
    np.testing.assert_allclose(picture.pixels, rgb / [8, 16, 4], rtol=1e-6)
    assert picture.made == ("divided by the exposure 8 16 4",)
    for bad in ("EXPOSURE=0", "EXPOSURE=-1", "EXPOSURE=nan", "EXPOSURE=", "COLORCORR=1 2"):
        refused(bad.split("=")[0], read_picture, flat(tmp_path / "a.hdr", rgb, bad, RGBE))


def test_lines_of_the_pictures_it_was_made_from_do_not_count(tmp_path, rgb) -> None:
    """Radiance indents the headers of what a picture was composed of."""
    lines = ("pcomb a.hdr b.hdr", "a.hdr:", "\tEXPOSURE=8", "\tPRIMARIES=1 2", RGBE)
    picture = read_picture(flat(tmp_path / "a.hdr", rgb, *lines))
    np.testing.assert_array_equal(picture.pixels, rgb)
    assert picture.made == ()


def test_xyz_and_primaries(tmp_path, rgb) -> None:
    xyz = rgb @ TO_XYZ.T
    path = flat(tmp_path / "a.hdr", xyz, "FORMAT=32-bit_rle_xyze")
    np.testing.assert_allclose(read_picture(path).pixels, rgb, atol=0.02)
    p3 = (0.68, 0.32, 0.265, 0.69, 0.15, 0.06, 0.3127, 0.329)
    stated = "PRIMARIES=" + " ".join(map(str, p3))
    to_p3 = np.linalg.inv(rgb_to_xyz(p3, "P3")) @ TO_XYZ
    other = read_picture(flat(tmp_path / "b.hdr", rgb @ to_p3.T, RGBE, stated))
    np.testing.assert_allclose(other.pixels, rgb, atol=0.02)
    assert "from its primaries" in other.made[0]


def test_what_photoshop_writes_says_nothing(tmp_path, rgb) -> None:
    lines = ("# Made with Adobe Photoshop", "GAMMA=1", "PRIMARIES=0 0 0 0 0 0 0 0", RGBE)
    picture = read_picture(flat(tmp_path / "a.hdr", rgb, *lines))
    np.testing.assert_array_equal(picture.pixels, rgb)
    assert picture.made == ()


def test_gamma_is_undone(tmp_path, rgb) -> None:
    picture = read_picture(flat(tmp_path / "a.hdr", rgb, "GAMMA=2.2", RGBE))
    np.testing.assert_allclose(picture.pixels, rgb**2.2, rtol=1e-5)
    refused("GAMMA=-1", read_picture, flat(tmp_path / "a.hdr", rgb, "GAMMA=-1", RGBE))


@pytest.mark.parametrize("vertical", "+-")
@pytest.mark.parametrize("horizontal", "+-")
@pytest.mark.parametrize("columns", [False, True])
def test_every_orientation(tmp_path, rgb, vertical, horizontal, columns) -> None:
    stored = rgb[::-1] if vertical == "+" else rgb
    stored = stored[:, ::-1] if horizontal == "-" else stored
    y, x = f"{vertical}Y {HEIGHT}", f"{horizontal}X {WIDTH}"
    body = packed(stored.swapaxes(0, 1) if columns else stored)
    size = f"{x} {y}" if columns else f"{y} {x}"
    path = write(tmp_path / "a.hdr", body.tobytes(), size, RGBE)
    np.testing.assert_array_equal(read_picture(path).pixels, rgb)


@pytest.mark.parametrize("line", ["FORMAT=32-bit_rle_spectral", "FORMAT=ascii", "PRIMARIES=1 2"])
def test_what_cannot_be_used_is_named(tmp_path, rgb, line) -> None:
    refused(line.split("=")[1], read_picture, flat(tmp_path / "a.hdr", rgb, line))


def test_damage_is_refused(tmp_path, rgb) -> None:
    path = flat(tmp_path / "a.hdr", rgb, RGBE)
    content = path.read_bytes()
    path.write_bytes(content[:-1])
    refused("scanline 5 of 6", read_picture, path)
    for size, message in (("-Y 9999 +X 999999", "pixels; we read"), ("-Y 900 +X 900", "it ends")):
        refused(message, read_picture, write(path, b"\0" * 100, size, RGBE))
    for size in ("-Y 3", "-Y 3 +Y 3", "-Y 0x3 +X 3", "no size"):
        refused("header is broken", read_picture, write(path, b"\0" * 100, size, RGBE))

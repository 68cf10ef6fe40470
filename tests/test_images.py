"""Image files and the sRGB encoding."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from hypothesis import given
from hypothesis import strategies as st

from refusals import refused
from simrig.core.errors import SimrigError
from simrig.files.images import (
    LARGEST_IMAGE,
    decode_srgb,
    encode_srgb,
    read_image,
    to_srgb8,
    write_exr,
    write_png,
)


@pytest.fixture
def picture(rng: np.random.Generator) -> np.ndarray:
    """An image with a range of 28 EV, not square."""
    return (2.0 ** rng.uniform(-14, 14, (13, 31, 3))).astype(np.float32)


def _raw_exr(path: Path, channels: dict[str, np.ndarray]) -> Path:
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, channels).write(str(path))
    return path


@given(st.floats(0.0, 1.0))
def test_srgb_round_trip(value):
    assert decode_srgb(encode_srgb(np.float64(value))) == pytest.approx(value, abs=1e-7)


def test_srgb_agrees_with_colour_science():
    import colour

    linear = np.linspace(0.0, 1.0, 4097)
    np.testing.assert_allclose(
        encode_srgb(linear), colour.cctf_encoding(linear, function="sRGB"), atol=1e-12
    )


def test_srgb8_clips_and_applies_exposure():
    values = np.array([-1.0, 0.0, 0.25, 0.5, 7.0])
    np.testing.assert_array_equal(to_srgb8(values), [0, 0, 137, 188, 255])
    np.testing.assert_array_equal(to_srgb8(values, exposure=2.0), [0, 0, 188, 255, 255])


def test_exr_keeps_every_bit_and_the_metadata(tmp_path, picture):
    path = tmp_path / "picture.exr"
    write_exr(path, picture, {"comments": "a sphere", "exposure": 1.5, "spp": 16, "done": True})
    assert read_image(path).tobytes() == picture.tobytes()
    header = OpenEXR.File(str(path), header_only=True).header()
    assert header["comments"] == "a sphere"
    assert (header["exposure"], header["spp"], header["done"]) == (1.5, 16, "true")


def test_png_shows_what_the_display_shows(tmp_path, rng):
    path = tmp_path / "picture.png"
    linear = rng.uniform(0.0, 0.8, (9, 7, 3))
    write_png(path, linear, exposure=1.7, metadata={"Title": "test"})
    np.testing.assert_array_equal(to_srgb8(read_image(path)), to_srgb8(linear, 1.7))
    content = path.read_bytes()
    assert b"sRGB, 8 bit" in content and b"Exposure" in content and b"1.7" in content


def test_png_keeps_encoded_bytes(tmp_path, rng):
    path = tmp_path / "picture.png"
    encoded = rng.integers(0, 256, (5, 6, 3)).astype(np.uint8)
    write_png(path, encoded)
    np.testing.assert_array_equal(to_srgb8(read_image(path)), encoded)


def test_radiance_hdr_values(tmp_path):
    # three flat RGBE pixels: value = mantissa / 256 * 2 ** (exponent - 128)
    path = tmp_path / "picture.hdr"
    pixels = bytes([128, 64, 32, 129, 255, 0, 0, 120, 0, 0, 0, 0])
    path.write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 3\n" + pixels)
    expected = [[[1.0, 0.5, 0.25], [255 / 256 * 2.0**-8, 0.0, 0.0], [0.0, 0.0, 0.0]]]
    np.testing.assert_allclose(read_image(path), expected, rtol=1e-6)


def test_environment_map_of_the_thesis(shared_data):
    image = read_image(shared_data("envmaps/grace_probe_latlong.hdr"))
    assert image.shape == (512, 1024, 3)
    assert image.min() >= 0.0 and image.max() > 500.0


def test_channels_are_found_by_name(tmp_path, picture):
    height_width = picture[..., 0].copy()
    mixed = _raw_exr(tmp_path / "mixed.exr", {"RGB": picture, "A": height_width, "Z": height_width})
    np.testing.assert_array_equal(read_image(mixed), picture)
    grey = _raw_exr(tmp_path / "grey.exr", {"Y": height_width})
    np.testing.assert_array_equal(read_image(grey), np.repeat(picture[..., :1], 3, axis=2))
    depth = _raw_exr(tmp_path / "depth.exr", {"Z": height_width})
    refused(r"no channels R, G, B or Y, only: Z", read_image, depth)


def test_missing_folder_and_other_formats(tmp_path):
    refused("no file", read_image, tmp_path / "absent.exr")
    refused("is a folder", read_image, tmp_path)
    text = tmp_path / "text.png"
    text.write_text("not an image")
    refused("not an image we read", read_image, text)
    refused("does not exist", write_exr, tmp_path / "absent" / "a.exr", np.zeros((2, 2, 3)))


@pytest.mark.parametrize("suffix", ["exr", "png", "hdr"])
@pytest.mark.parametrize("kept", [0.05, 0.3, 0.9])
def test_truncated_files_are_refused(tmp_path, rng, suffix, kept):
    path = tmp_path / f"picture.{suffix}"
    image = rng.uniform(0.0, 1.0, (40, 50, 3))
    if suffix == "hdr":
        head = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 40 +X 50\n"
        path.write_bytes(head + bytes([90]) * 4 * 40 * 50)
    else:
        {"exr": write_exr, "png": write_png}[suffix](path, image)
    assert read_image(path).shape == image.shape
    content = path.read_bytes()
    path.write_bytes(content[: max(12, int(kept * len(content)))])
    refused("damaged", read_image, path)


def test_a_header_cannot_make_us_allocate(tmp_path):
    png = tmp_path / "huge.png"
    side = int(LARGEST_IMAGE**0.5) + 1
    chunk = b"IHDR" + struct.pack(">IIBBBBB", side, side, 8, 2, 0, 0, 0)
    png.write_bytes(b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + chunk + b"\0" * 4)
    hdr = tmp_path / "huge.hdr"
    hdr.write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 99999 +X 99999\n" + b"\0" * 64)
    exr = tmp_path / "huge.exr"
    write_exr(exr, np.zeros((4, 8, 3)))
    small, huge = (struct.pack("<iiii", 0, 0, w - 1, h - 1) for w, h in ((8, 4), (99999, 99999)))
    exr.write_bytes(exr.read_bytes().replace(small, huge))
    for path in (png, hdr, exr):
        refused("pixels; we read images of 1 to", read_image, path)


def test_damaged_bytes_never_crash(tmp_path, rng, picture):
    path = tmp_path / "picture.exr"
    write_exr(path, picture)
    content = np.frombuffer(path.read_bytes(), dtype=np.uint8)
    refused = 0
    for _ in range(60):
        damaged = content.copy()
        damaged[rng.integers(4, len(content), 4)] = rng.integers(0, 256, 4)
        path.write_bytes(damaged.tobytes())
        try:
            assert read_image(path).ndim == 3
        except SimrigError:
            refused += 1
    assert refused > 0


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_not_finite_values_are_refused(tmp_path, bad):
    image = np.ones((4, 5, 3), dtype=np.float32)
    image[2, 3, 1] = bad
    for write in (write_exr, write_png):
        refused("row 2, column 3", write, tmp_path / "a.exr", image)
    path = _raw_exr(tmp_path / "raw.exr", {"RGB": image})
    refused("row 2, column 3", read_image, path)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["raw.exr"]


@pytest.mark.parametrize("shape", [(3,), (4, 5, 2), (0, 5, 3), (2, 4, 5, 3)])
def test_wrong_shapes_are_refused(tmp_path, shape):
    refused("must have the shape", write_exr, tmp_path / "a.exr", np.zeros(shape))

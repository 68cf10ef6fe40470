"""PNG, JPEG and PFM: curves, primaries, profiles, depth, alpha, orientation, and damage."""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from PIL import Image, ImageCms

from refusals import refused
from simrig.core.colour import decode_srgb
from simrig.core.errors import SimrigError
from simrig.files.pictures import read_picture
from simrig.files.pictures.primaries import ADOBE_RGB, to_srgb

GREY = 100


def chunk(name: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))


def png(path: Path, values: np.ndarray, *chunks: bytes) -> Path:
    """Write 8 or 16 bits, grey to RGBA, with chunks before the pixels."""
    depth = 8 * values.dtype.itemsize
    channels = 1 if values.ndim == 2 else values.shape[2]
    kind = {1: 0, 2: 4, 3: 2, 4: 6}[channels]
    height, width = values.shape[:2]
    rows = values.astype(">u2") if depth == 16 else values
    packed = zlib.compress(b"".join(b"\0" + row.tobytes() for row in rows))
    head = struct.pack(">IIBBBBB", width, height, depth, kind, 0, 0, 0)
    parts = [chunk(b"IHDR", head), *chunks, chunk(b"IDAT", packed), chunk(b"IEND", b"")]
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(parts))
    return path


@pytest.fixture
def picture(rng: np.random.Generator) -> np.ndarray:
    return rng.integers(0, 256, (9, 12, 3)).astype(np.uint8)


def test_png_without_a_word_is_srgb(tmp_path, picture) -> None:
    pixels = read_picture(png(tmp_path / "a.png", picture)).pixels
    np.testing.assert_allclose(pixels, decode_srgb(picture / 255.0), atol=1e-6)


@pytest.mark.parametrize("gamma", [1.0, 1 / 2.2, 1 / 1.8])
def test_png_gamma(tmp_path, picture, gamma) -> None:
    said = chunk(b"gAMA", struct.pack(">I", round(gamma * 1e5)))
    read = read_picture(png(tmp_path / "a.png", picture, said))
    np.testing.assert_allclose(read.pixels, (picture / 255.0) ** (1 / gamma), atol=2e-5)
    assert read.says["gAMA"] == f"{round(gamma * 1e5) / 1e5:g}"
    # sRGB goes before gAMA
    both = png(tmp_path / "b.png", picture, chunk(b"sRGB", b"\0"), said)
    np.testing.assert_allclose(read_picture(both).pixels, decode_srgb(picture / 255.0), atol=1e-6)


def test_png_primaries(tmp_path, picture) -> None:
    gamma = chunk(b"gAMA", struct.pack(">I", 45455))
    white_first = [*ADOBE_RGB[6:], *ADOBE_RGB[:6]]
    said = chunk(b"cHRM", struct.pack(">8I", *(round(v * 1e5) for v in white_first)))
    pixels = read_picture(png(tmp_path / "a.png", picture, gamma, said)).pixels
    matrix = to_srgb(ADOBE_RGB, "")
    assert matrix is not None
    expected = (picture / 255.0) ** 2.2 @ matrix.T
    np.testing.assert_allclose(pixels, expected, atol=1e-4)


def test_png_sixteen_bits_grey_and_alpha(tmp_path, rng) -> None:
    deep = rng.integers(0, 65536, (5, 7, 3)).astype(np.uint16)
    pixels = read_picture(png(tmp_path / "a.png", deep)).pixels
    np.testing.assert_allclose(pixels, decode_srgb(deep / 65535.0), atol=1e-6)
    grey = deep[..., 0]
    pixels = read_picture(png(tmp_path / "b.png", grey)).pixels
    np.testing.assert_allclose(pixels[..., 1], decode_srgb(grey / 65535.0), atol=1e-6)
    layered = np.concatenate([deep, np.full((5, 7, 1), 32768, np.uint16)], axis=-1)
    read = read_picture(png(tmp_path / "c.png", layered))
    half = 32768 / 65535
    np.testing.assert_allclose(read.pixels, decode_srgb(deep / 65535.0) * half, atol=1e-5)
    assert read.made == ("transparent pixels put on black",)


def test_png_palettes_and_single_bits(tmp_path, picture) -> None:
    Image.fromarray(picture).quantize(16).save(tmp_path / "a.png")
    shown = np.asarray(Image.open(tmp_path / "a.png").convert("RGB"))
    np.testing.assert_allclose(
        read_picture(tmp_path / "a.png").pixels, decode_srgb(shown / 255.0), atol=1e-6
    )
    Image.fromarray(picture[..., 0] > 128).save(tmp_path / "b.png")
    expected = (picture[..., 0] > 128).astype(np.float32)
    np.testing.assert_array_equal(read_picture(tmp_path / "b.png").pixels[..., 0], expected)


def test_png_cicp(tmp_path, picture) -> None:
    linear = chunk(b"cICP", bytes([1, 8, 0, 1]))
    pixels = read_picture(png(tmp_path / "a.png", picture, linear)).pixels
    np.testing.assert_allclose(pixels, picture / 255.0, atol=1e-6)
    with pytest.raises(SimrigError, match="perceptual quantizer"):
        read_picture(png(tmp_path / "b.png", picture, chunk(b"cICP", bytes([9, 16, 0, 1]))))


NOTHING: Mapping[bytes, bytes] = {}


def profile_of(
    matrix_columns: np.ndarray, curve: bytes, more: Mapping[bytes, bytes] = NOTHING
) -> bytes:
    """Return an ICC profile of a matrix and one curve for all channels, and more tags."""
    xyz = {f"{c}XYZ".encode(): v for c, v in zip("rgb", matrix_columns.T, strict=True)}
    tags = {
        name: b"XYZ \0\0\0\0" + struct.pack(">3i", *(round(x * 65536) for x in v))
        for name, v in xyz.items()
    }
    tags |= {f"{c}TRC".encode(): curve for c in "rgb"}
    tags[b"wtpt"] = b"XYZ \0\0\0\0" + struct.pack(">3i", 63190, 65536, 54061)
    text = b"test profile\0"
    tags[b"desc"] = b"desc\0\0\0\0" + struct.pack(">I", len(text)) + text + bytes(12 + 67)
    tags[b"cprt"] = b"text\0\0\0\0none\0"
    tags |= more
    position = 128 + 4 + 12 * len(tags)
    table, body = struct.pack(">I", len(tags)), b""
    for name, tag in tags.items():
        tag += b"\0" * (-len(tag) % 4)
        table += struct.pack(">4sII", name, position + len(body), len(tag))
        body += tag
    head = bytearray(128)
    head[:4] = struct.pack(">I", position + len(body))
    head[8:12] = b"\2\x40\0\0"
    head[12:16], head[16:20], head[20:24], head[36:40] = b"mntr", b"RGB ", b"XYZ ", b"acsp"
    head[68:80] = struct.pack(">3i", 63190, 65536, 54061)
    return bytes(head) + table + body


WIDE = np.array([[0.6097, 0.2053, 0.1492], [0.3111, 0.6257, 0.0632], [0.0195, 0.0609, 0.7446]])
SRGB_CURVE = (2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045)
STEPS = (65535 * (np.arange(256) / 255) ** 1.8).astype(">u2")
FIXED = struct.pack(">5i", *(round(v * 65536) for v in SRGB_CURVE))
CURVES = {
    "gamma": b"curv\0\0\0\0" + struct.pack(">IH", 1, round(2.2 * 256)),
    "table": b"curv\0\0\0\0" + struct.pack(">I", 256) + STEPS.tobytes(),
    "parametric": b"para\0\0\0\0" + struct.pack(">HH", 3, 0) + FIXED,
}


def test_profiles_that_say_more_than_matrix_and_curves(tmp_path, picture) -> None:
    """A table beside the matrix is said; HDR, whose curves are a stand-in, is refused by name."""
    path = tmp_path / "a.png"
    tables = profile_of(WIDE, CURVES["gamma"], {b"A2B0": bytes(64)})
    Image.fromarray(picture).save(path, icc_profile=tables)
    assert "look-up table A2B0 is not used" in read_picture(path).says["iCCP"]
    for transfer, name in ((16, "perceptual quantizer"), (18, "hybrid log-gamma")):
        said = b"cicp\0\0\0\0" + bytes([9, transfer, 0, 1])
        Image.fromarray(picture).save(
            path, icc_profile=profile_of(WIDE, CURVES["gamma"], {b"cicp": said})
        )
        with pytest.raises(SimrigError, match=name):
            read_picture(path)


@pytest.mark.parametrize("curve", CURVES)
@pytest.mark.parametrize("suffix", ["png", "jpg"])
def test_profiles_as_littlecms_applies_them(tmp_path, rng, curve, suffix) -> None:
    """Within the gamut of sRGB, where an 8-bit reference does not clip."""
    base = rng.integers(80, 180, (8, 8, 1)) + rng.integers(-12, 13, (8, 8, 3))
    profile = profile_of(WIDE, CURVES[curve])
    path = tmp_path / f"a.{suffix}"
    options: dict[str, Any] = {} if suffix == "png" else {"quality": 100, "subsampling": 0}
    Image.fromarray(base.astype(np.uint8)).save(path, icc_profile=profile, **options)
    read = read_picture(path)
    with Image.open(path) as stored:
        shown = ImageCms.profileToProfile(
            stored, ImageCms.ImageCmsProfile(io.BytesIO(profile)), ImageCms.createProfile("sRGB")
        )
    assert shown is not None
    expected = decode_srgb(np.asarray(shown) / 255.0)
    np.testing.assert_allclose(read.pixels, expected, atol=0.006)  # a step of 8 bits is up to 0.009
    assert abs(float((read.pixels - expected).mean())) < 5e-4
    assert "test profile" in read.made[0]


def test_profiles_that_are_not_read_are_named(tmp_path, picture) -> None:
    lab = ImageCms.ImageCmsProfile(ImageCms.createProfile("LAB")).tobytes()
    Image.fromarray(picture).save(tmp_path / "a.png", icc_profile=lab)
    refused(r"profile .* of look-up tables.*convert it", read_picture, tmp_path / "a.png")


def test_jpeg_is_srgb_and_grey_too(tmp_path) -> None:
    grey = np.full((8, 8, 3), GREY, np.uint8)
    for values in (grey, grey[..., 0]):
        Image.fromarray(values).save(tmp_path / "a.jpg", quality=100)
        pixels = read_picture(tmp_path / "a.jpg").pixels
        np.testing.assert_allclose(pixels, decode_srgb(np.array(GREY / 255)), atol=5e-3)


@pytest.mark.parametrize("orientation", range(1, 9))
def test_jpeg_orientation_as_pillow_applies_it(tmp_path, orientation) -> None:
    from PIL import ImageOps

    values = np.zeros((16, 24, 3), np.uint8)
    values[:8, :8], values[8:, 16:] = (200, 40, 40), (40, 200, 40)
    exif = Image.Exif()
    exif[0x0112] = orientation
    path = tmp_path / "a.jpg"
    Image.fromarray(values).save(path, exif=exif, quality=95)
    with Image.open(path) as stored:
        expected = decode_srgb(np.asarray(ImageOps.exif_transpose(stored)) / 255.0)
    np.testing.assert_allclose(read_picture(path).pixels, expected, atol=1e-5)


def test_inks_and_truncated_jpegs_are_refused(tmp_path, rng) -> None:
    values = rng.integers(0, 256, (64, 64, 3)).astype(np.uint8)
    Image.fromarray(values).convert("CMYK").save(tmp_path / "a.jpg")
    refused("CMYK", read_picture, tmp_path / "a.jpg")
    Image.fromarray(values).save(tmp_path / "b.jpg")
    content = (tmp_path / "b.jpg").read_bytes()
    (tmp_path / "b.jpg").write_bytes(content[: len(content) // 2])
    refused("damaged JPEG", read_picture, tmp_path / "b.jpg")


def test_bombs_are_refused_before_they_are_unpacked(tmp_path, picture) -> None:
    path = png(tmp_path / "a.png", picture)
    content = bytearray(path.read_bytes())
    content[16:24] = struct.pack(">II", 8000, 8000)
    path.write_bytes(content)
    refused("cannot hold them", read_picture, path)
    Image.fromarray(picture).save(tmp_path / "b.jpg")
    content = bytearray((tmp_path / "b.jpg").read_bytes())
    frame = content.index(b"\xff\xc0")
    content[frame + 5 : frame + 9] = struct.pack(">HH", 8000, 8000)
    (tmp_path / "b.jpg").write_bytes(content)
    refused("cannot hold them", read_picture, tmp_path / "b.jpg")


@pytest.mark.parametrize("scale", [-1.0, 1.0, -0.5])
def test_pfm(tmp_path, rng, scale) -> None:
    values = rng.uniform(0, 5, (5, 4, 3)).astype("<f4" if scale < 0 else ">f4")
    path = tmp_path / "a.pfm"
    path.write_bytes(f"PF\n4 5\n{scale}\n".encode() + values[::-1].tobytes())
    np.testing.assert_allclose(read_picture(path).pixels, abs(scale) * values, rtol=1e-6)
    path.write_bytes(path.read_bytes()[:-1])
    refused("damaged PFM", read_picture, path)


@pytest.mark.parametrize("suffix", ["tif", "bmp", "webp", "gif"])
def test_other_pictures_are_named(tmp_path, picture, suffix) -> None:
    path = tmp_path / f"a.{suffix}"
    Image.fromarray(picture).save(path)
    name = {"tif": "TIFF", "bmp": "BMP", "webp": "WebP", "gif": "GIF"}[suffix]
    refused(f"is a {name} picture.*not an image we read", read_picture, path)


@pytest.mark.parametrize("suffix", ["png", "jpg", "hdr", "exr", "pfm"])
def test_damaged_bytes_never_crash(tmp_path, rng, picture, suffix, capfd) -> None:
    path = tmp_path / f"a.{suffix}"
    if suffix == "exr":
        from simrig.files.images import write_exr

        write_exr(path, picture / 255.0)
    elif suffix == "pfm":
        path.write_bytes(b"PF\n12 9\n-1\n" + (picture / 255.0).astype("<f4").tobytes())
    else:
        values = picture.astype(np.float32) / 255 if suffix == "hdr" else picture
        cv2.imwrite(str(path), values)
    content = np.frombuffer(path.read_bytes(), dtype=np.uint8)
    refused = 0
    for number in range(120):
        damaged = content.copy()
        where = rng.integers(4, len(content) if number % 2 else min(len(content), 200), 4)
        damaged[where] = rng.choice([0, 1, 127, 255, *rng.integers(0, 256, 4)], 4)
        cut = len(damaged) if number % 3 else int(rng.integers(5, len(damaged)))
        path.write_bytes(damaged[:cut].tobytes())
        try:
            assert read_picture(path).pixels.ndim == 3
        except SimrigError:
            refused += 1
    assert refused > 0
    assert capfd.readouterr() == ("", "")

"""OpenEXR as it is found: primaries, XYZ, layers, parts, windows, chroma, tiles, and damage."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import colour
import mitsuba as mi
import numpy as np
import OpenEXR
import pytest

from refusals import refused
from simrig.core.colour import TO_XYZ
from simrig.core.errors import SimrigError
from simrig.files.pictures import LARGEST_IMAGE, read_picture
from subsampled_exr import write_subsampled

HEIGHT, WIDTH = 24, 32
ACES_CG = (0.713, 0.293, 0.165, 0.83, 0.128, 0.044, 0.32168, 0.33767)
XYZ_E = (1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1 / 3, 1 / 3)


@pytest.fixture
def rgb() -> np.ndarray:
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH]
    columns = [0.1 + 0.6 * x / WIDTH, 0.2 + 0.4 * y / HEIGHT, 0.5 - 0.3 * x / WIDTH]
    return np.stack(columns, axis=-1).astype(np.float32)


def write(path: Path, channels: dict[str, Any], **header: Any) -> Path:
    about = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage} | header
    OpenEXR.File(about, channels).write(str(path))
    return path


def planes(pixels: np.ndarray, names: str, layer: str = "") -> dict[str, np.ndarray]:
    return {layer + n: pixels[..., k].copy() for k, n in enumerate(names)}


def test_xyz_channels_become_rgb(tmp_path, rgb) -> None:
    path = write(tmp_path / "a.exr", planes((rgb @ TO_XYZ.T).astype(np.float32), "XYZ"))
    picture = read_picture(path)
    np.testing.assert_allclose(picture.pixels, rgb, atol=1e-5)
    assert picture.made == ("CIE XYZ to RGB",)


@pytest.mark.parametrize("space", ["ACEScg", "ACES2065-1", "ITU-R BT.2020", "P3-D65", "DCI-P3"])
def test_stated_primaries_are_converted(tmp_path, rgb, space) -> None:
    about = colour.RGB_COLOURSPACES[space]
    chromaticities = (*about.primaries.ravel(), *about.whitepoint)
    matrix = colour.matrix_RGB_to_RGB("sRGB", space, "Bradford").astype(np.float32)
    path = write(tmp_path / "a.exr", {"RGB": rgb @ matrix.T}, chromaticities=chromaticities)
    picture = read_picture(path)
    np.testing.assert_allclose(picture.pixels, rgb, atol=1e-3)
    assert "from its primaries" in picture.made[0]


def test_primaries_of_xyz_are_not_adapted(tmp_path, rgb) -> None:
    xyz = (rgb @ TO_XYZ.T).astype(np.float32)
    path = write(tmp_path / "a.exr", {"RGB": xyz}, chromaticities=XYZ_E)
    np.testing.assert_allclose(read_picture(path).pixels, rgb, atol=1e-5)


def test_the_aces_flag_and_interop_ids_state_primaries(tmp_path, rgb) -> None:
    to_ap0 = colour.matrix_RGB_to_RGB("sRGB", "ACES2065-1", "Bradford").astype(np.float32)
    for number, header in enumerate(
        ({"acesImageContainerFlag": 1}, {"colorInteropID": "lin_ap0_scene"})
    ):
        path = write(tmp_path / f"{number}.exr", {"RGB": rgb @ to_ap0.T}, **header)
        np.testing.assert_allclose(read_picture(path).pixels, rgb, atol=1e-3)
    path = write(tmp_path / "s.exr", {"RGB": rgb}, **{"oiio:ColorSpace": "scene_linear"})
    np.testing.assert_array_equal(read_picture(path).pixels, rgb)


def test_encoded_values_are_decoded_or_refused(tmp_path, rgb) -> None:
    encoded = np.where(rgb <= 0.0031308, 12.92 * rgb, 1.055 * rgb ** (1 / 2.4) - 0.055)
    encoded = encoded.astype(np.float32)
    path = write(tmp_path / "a.exr", {"RGB": encoded}, colorInteropID="srgb_rec709_scene")
    np.testing.assert_allclose(read_picture(path).pixels, rgb, atol=1e-5)
    path = write(tmp_path / "b.exr", {"RGB": rgb}, colorInteropID="pq_rec2020_display")
    refused(r"pq_rec2020_display.*not read", read_picture, path)


def test_contradictions_and_impossible_primaries_are_refused(tmp_path, rgb) -> None:
    both = {"chromaticities": ACES_CG, "colorInteropID": "lin_rec709_scene"}
    refused("contradicts itself", read_picture, write(tmp_path / "a.exr", {"RGB": rgb}, **both))
    for number, bad in enumerate(([0.0] * 8, [0.3] * 8, [np.nan] * 8)):
        path = write(tmp_path / f"{number}.exr", {"RGB": rgb}, chromaticities=tuple(bad))
        refused("cannot be", read_picture, path)


def test_mitsubas_own_layers(tmp_path, variant_llvm) -> None:
    """An XYZA film inside an aov integrator, as Mitsuba writes it."""
    scene = {
        "type": "scene",
        "light": {"type": "constant"},
        "body": {"type": "sphere", "bsdf": {"type": "diffuse"}},
        "sensor": {
            "type": "perspective",
            "to_world": mi.ScalarTransform4f().look_at([0, -4, 2], [0, 0, 0], [0, 0, 1]),
            "film": {"type": "hdrfilm", "width": 16, "height": 12},
        },
    }
    pictures = {}
    for form, aov in (("rgb", False), ("xyz", False), ("xyza", True)):
        inner: dict[str, Any] = {"type": "path", "max_depth": 3}
        outer = {"type": "aov", "aovs": "nn:sh_normal", "inner": inner} if aov else inner
        scene["sensor"]["film"]["pixel_format"] = form  # type: ignore[index]
        loaded = mi.load_dict({**scene, "integrator": outer})
        mi.render(loaded, spp=16)
        loaded.sensors()[0].film().bitmap().write(str(tmp_path / f"{form}.exr"))
        pictures[form] = read_picture(tmp_path / f"{form}.exr")
    for form in ("xyz", "xyza"):
        np.testing.assert_allclose(pictures[form].pixels, pictures["rgb"].pixels, atol=2e-3)
    assert "layer 'main' taken" in pictures["xyza"].made[0]


def test_layers_are_named_or_asked_for(tmp_path, rgb) -> None:
    diffuse, normal = planes(rgb, "RGB", "diffuse."), planes(rgb, "XYZ", "normal.")
    depth = {"depth.Z": rgb[..., 0].copy()}
    path = write(tmp_path / "one.exr", diffuse | normal | depth)
    np.testing.assert_array_equal(read_picture(path).pixels, rgb)
    path = write(tmp_path / "two.exr", diffuse | planes(2 * rgb, "RGB", "specular."))
    refused(r"several layers.*diffuse, specular.*--layer", read_picture, path)
    np.testing.assert_array_equal(read_picture(path, "specular").pixels, 2 * rgb)
    refused("unknown layer", read_picture, path, "speculr")
    combined = planes(3 * rgb, "RGBA"[:3], "ViewLayer.Combined.")
    path = write(tmp_path / "blender.exr", combined | planes(rgb, "RGB", "ViewLayer.DiffCol."))
    np.testing.assert_array_equal(read_picture(path).pixels, 3 * rgb)
    with pytest.raises(SimrigError, match=r"has no channels R, G, B or Y, only: depth\.Z"):
        read_picture(write(tmp_path / "depth.exr", depth))


def test_parts_are_told_apart(tmp_path, rgb) -> None:
    def part(name: str, channels: dict[str, Any]) -> Any:
        return OpenEXR.Part({"type": OpenEXR.scanlineimage}, channels, name)

    depth = part("depth", {"Z": rgb[..., 0].copy()})
    path = str(tmp_path / "parts.exr")
    OpenEXR.File([depth, part("beauty", planes(rgb, "RGB"))]).write(path)
    np.testing.assert_array_equal(read_picture(path).pixels, rgb)
    both = [part("left", planes(rgb, "RGB")), part("right", planes(2 * rgb, "RGB"))]
    OpenEXR.File(both).write(path)
    refused(r"several layers.*left, right", read_picture, path)
    np.testing.assert_array_equal(read_picture(path, "right").pixels, 2 * rgb)


def test_windows_are_kept(tmp_path, rgb) -> None:
    display = ((0, 0), (WIDTH - 1, HEIGHT - 1))
    whole = np.zeros_like(rgb)
    whole[6:18, 4:20] = rgb[6:18, 4:20]
    part = rgb[6:18, 4:20].copy()
    path = tmp_path / "a.exr"
    write(path, {"RGB": part}, displayWindow=display, dataWindow=((4, 6), (19, 17)))
    picture = read_picture(path)
    np.testing.assert_array_equal(picture.pixels, whole)
    assert picture.window == (4, 6, 20, 18)
    # the same with a display window that does not start at zero
    moved = {"displayWindow": ((100, -50), (131, -27)), "dataWindow": ((104, -44), (119, -33))}
    np.testing.assert_array_equal(read_picture(write(path, {"RGB": part}, **moved)).pixels, whole)
    # overscan is cut off
    over = {"displayWindow": ((4, 6), (19, 17)), "dataWindow": display}
    picture = read_picture(write(path, {"RGB": rgb}, **over))
    np.testing.assert_array_equal(picture.pixels, part)
    assert picture.window is None
    outside = {"displayWindow": display, "dataWindow": ((40, 6), (55, 17))}
    refused("shows nothing", read_picture, write(path, {"RGB": part}, **outside))


def test_luminance_and_chroma(tmp_path, rgb) -> None:
    weights = np.array([0.2126, 0.7152, 0.0722], np.float32)
    y = rgb @ weights
    chroma = [(rgb[..., k] - y) / y for k in (0, 2)]
    full = {"Y": y, "RY": chroma[0], "BY": chroma[1]}
    path = write(tmp_path / "full.exr", full)
    np.testing.assert_allclose(read_picture(path).pixels, rgb, atol=1e-4)
    halved = {"Y": y} | {
        name: plane[::2, ::2].copy() for name, plane in zip(("RY", "BY"), chroma, strict=True)
    }
    path = write_subsampled(tmp_path / "half.exr", halved, {"RY": 2, "BY": 2})
    pixels = read_picture(path).pixels
    np.testing.assert_allclose(pixels[::2, ::2], rgb[::2, ::2], atol=1e-4)
    # chroma is held beyond the border: there and within the filter's reach of it the error is more
    np.testing.assert_allclose(pixels[4:-4, 4:-4], rgb[4:-4, 4:-4], atol=4e-3)
    grey = write(tmp_path / "grey.exr", {"Y": y})
    np.testing.assert_array_equal(read_picture(grey).pixels, np.repeat(y[..., None], 3, -1))


def test_chroma_uses_the_files_primaries(tmp_path, rgb) -> None:
    matrix = colour.matrix_RGB_to_RGB("sRGB", "ACEScg", "Bradford").astype(np.float32)
    ap1 = rgb @ matrix.T
    weights = colour.RGB_COLOURSPACES["ACEScg"].matrix_RGB_to_XYZ[1]
    y = (ap1 @ weights / weights.sum()).astype(np.float32)
    channels = {"Y": y} | {n: (ap1[..., k] - y) / y for n, k in (("RY", 0), ("BY", 2))}
    channels = {name: plane.astype(np.float32) for name, plane in channels.items()}
    path = write(tmp_path / "a.exr", channels, chromaticities=ACES_CG)
    np.testing.assert_allclose(read_picture(path).pixels, rgb, atol=1e-3)


def test_half_tiles_levels_and_alpha(tmp_path, rgb) -> None:
    half = write(tmp_path / "half.exr", {"RGB": rgb.astype(np.float16)})
    np.testing.assert_allclose(read_picture(half).pixels, rgb, atol=5e-4)
    tiles = OpenEXR.TileDescription()
    tiles.xSize, tiles.ySize, tiles.mode = 16, 16, OpenEXR.ONE_LEVEL
    tiled = write(tmp_path / "t.exr", {"RGB": rgb}, type=OpenEXR.tiledimage, tiles=tiles)
    np.testing.assert_array_equal(read_picture(tiled).pixels, rgb)
    alpha = np.full((HEIGHT, WIDTH, 1), 0.5, np.float32)
    premultiplied = np.concatenate([0.5 * rgb, alpha], axis=-1)
    path = write(tmp_path / "alpha.exr", {"RGBA": premultiplied})
    picture = read_picture(path)
    np.testing.assert_array_equal(picture.pixels, 0.5 * rgb)
    assert "premultiplied" in picture.says["alpha"]


def test_decreasing_lines_and_other_names(tmp_path, rgb) -> None:
    path = write(tmp_path / "a.exr", {"RGB": rgb}, lineOrder=OpenEXR.DECREASING_Y)
    np.testing.assert_array_equal(read_picture(path).pixels, rgb)
    named = {n: rgb[..., k].copy() for k, n in enumerate(("red", "green", "blue"))}
    np.testing.assert_array_equal(read_picture(write(tmp_path / "b.exr", named)).pixels, rgb)


def test_missing_pixels_are_not_whatever_was_in_memory(tmp_path, rng, capfd) -> None:
    values = rng.uniform(0.0, 1.0, (64, 64, 3)).astype(np.float32)
    path = write(tmp_path / "a.exr", {"RGB": values})
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    refused("pixels are missing", read_picture, path)
    assert capfd.readouterr() == ("", "")


def test_a_header_cannot_make_us_allocate(tmp_path, rgb) -> None:
    # 256 scanlines a chunk: a large height whose table of chunks is a part of a small file
    path = write(tmp_path / "a.exr", {"RGB": rgb}, compression=OpenEXR.DWAB_COMPRESSION)
    content = path.read_bytes()
    small = np.array([0, 0, WIDTH - 1, HEIGHT - 1], "<i4").tobytes()
    huge = np.array([0, 0, (1 << 21) - 1, 255], "<i4").tobytes()
    path.write_bytes(content.replace(small, huge))
    refused(f"images of 1 to {LARGEST_IMAGE} pixels", read_picture, path)
    path = write(tmp_path / "b.exr", {"RGB": rgb}, compression=OpenEXR.ZIP_COMPRESSION)
    huge = np.array([0, 0, (1 << 21) - 1, 15], "<i4").tobytes()
    path.write_bytes(path.read_bytes().replace(small, huge))
    refused("cannot hold them", read_picture, path)
    empty = {"displayWindow": ((0, 0), (7999, 7999)), "dataWindow": ((0, 0), (31, 23))}
    write(path, {"RGB": rgb}, **empty)
    refused("crop the window first", read_picture, path)

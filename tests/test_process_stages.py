"""The stages between merging and registration, each against what it should undo."""

import colour
import numpy as np
import pytest

from simrig.core.colour import FROM_XYZ, TO_XYZ
from simrig.core.errors import SimrigError
from simrig.imaging.chart import adaptation, chart_xyz, colour_matrix, read_patches
from simrig.imaging.flat import Illumination, flat_field, flattened
from simrig.imaging.mosaic import PATTERNS, channels_of, demosaic, fill_defects, find_defects
from simrig.imaging.tiling import find_tiling, seam_of


def scene(side=64):
    """A smooth picture in colours."""
    y, x = np.mgrid[:side, :side] / side
    return np.stack([1 + np.sin(9 * x), 1.5 + np.cos(7 * y + 2 * x), 1.2 + np.sin(5 * x * y)], -1)


def mosaic_of(picture, pattern):
    channels = channels_of(pattern, picture.shape[:2])
    return np.take_along_axis(picture, channels[..., None], axis=2)[..., 0]


def psnr(made, truth):
    inner = (slice(4, -4), slice(4, -4))
    return 10.0 * np.log10(truth.max() ** 2 / np.mean((made[inner] - truth[inner]) ** 2))


@pytest.mark.parametrize("pattern", PATTERNS)
def test_colours_come_back_from_a_mosaic(pattern):
    pytest.importorskip("colour_demosaicing")
    rng = np.random.default_rng(0)
    grain = 0.3 * rng.normal(size=(64, 64, 1))  # fine structure without colour
    truth = scene() + np.clip(np.cumsum(grain, axis=1), -1, 1)
    mosaic = mosaic_of(truth, pattern)
    malvar, bilinear = (psnr(demosaic(mosaic, pattern, m), truth) for m in ("malvar", "bilinear"))
    assert malvar > bilinear + 3.0
    assert np.array_equal(mosaic_of(demosaic(mosaic, pattern), pattern), mosaic)


def test_planes_keep_means_exactly():
    truth = np.broadcast_to([0.2, 0.5, 0.9], (7, 9, 3))
    for pattern in PATTERNS:
        made = demosaic(mosaic_of(truth, pattern), pattern, "planes")
        assert made.shape == (3, 4, 3) and np.allclose(made, [0.2, 0.5, 0.9], atol=0, rtol=1e-15)


@pytest.mark.parametrize("pattern", [None, "GRBG"])
def test_defects_are_found_and_filled(pattern):
    rng = np.random.default_rng(1)
    truth = scene().mean(axis=-1) if pattern is None else mosaic_of(scene(), pattern)
    dead, hot = np.zeros((2, 64, 64), dtype=bool)
    dead.flat[rng.choice(4096, 20, replace=False)] = True
    hot.flat[rng.choice(4096, 20, replace=False)] = True
    hot &= ~dead
    dark = np.where(hot, 900.0, rng.normal(64.0, 2.0, truth.shape))
    white = np.where(dead, 3.0, 5000.0 + rng.normal(0.0, 70.0, truth.shape))
    bad = find_defects(dark, white, pattern)
    assert np.array_equal(bad, dead | hot)
    filled = fill_defects(np.where(bad, 77.0, truth), bad, pattern)
    assert np.array_equal(filled[~bad], truth[~bad])
    assert np.abs(filled - truth)[2:-2, 2:-2].max() < 0.06
    # without noise nothing is defective, though nothing is quite flat
    assert not find_defects(np.full(truth.shape, 64.0), 500.0 + mosaic_of(scene(), "GRBG")).any()
    with pytest.raises(SimrigError, match="no good ones"):
        fill_defects(truth, np.ones_like(bad), pattern)


def test_a_flat_field_undoes_vignetting_and_each_pixel():
    rng = np.random.default_rng(2)
    y, x = np.mgrid[-1:1:32j, -1:1:32j]
    response = (1 - 0.2 * (x**2 + y**2)) * rng.normal(1.0, 0.01, x.shape)
    flat = flat_field(5000.0 * response, "RGGB")
    made = flattened(0.3 * response, flat)
    channels = channels_of("RGGB", made.shape)
    for channel in range(3):
        assert np.ptp(made[channels == channel]) < 1e-12
    with pytest.raises(SimrigError, match="black or negative"):
        flat_field(np.zeros((4, 4)))
    with pytest.raises(SimrigError, match="flat field is"):
        flattened(np.ones((3, 4)), flat)


def test_the_light_is_a_polynomial_beyond_outliers():
    rng = np.random.default_rng(3)
    x, y = rng.uniform(-100.0, 100.0, (2, 60))

    def light(x, y):
        return 900.0 + 0.4 * x - 0.2 * y - 0.01 * x * x + 0.003 * x * y

    read = light(x, y) * rng.normal(1.0, 1e-3, 60)
    read[7] = 3.0
    found = Illumination.fitted(x, y, read)
    inside = np.linspace(-80.0, 80.0, 9)
    assert np.allclose(found.at(inside, 20.0), light(inside, 20.0), rtol=3e-3)
    assert found.error == pytest.approx(1e-3, rel=0.4)
    for arguments, message in (
        ((x[:5], y[:5], read[:5]), "at least 6"),
        ((x, x, read), "on a line"),
        ((x, y, -read), "above 0"),
        ((x, y[:-1], read), "differ in number"),
        ((x, y, read, 9), "degree"),
    ):
        with pytest.raises(SimrigError, match=message):
            Illumination.fitted(*arguments)


def test_a_camera_that_is_linear_in_xyz_is_found_again():
    xyz, white = chart_xyz()
    assert white[1] == pytest.approx(1.0)
    # the published chart under D65: white patch and dark skin (colour-science's own conversion)
    shape = colour.SpectralShape(360.0, 780.0, 5.0)
    known = colour.sd_to_XYZ(
        colour.SDS_COLOURCHECKERS["ColorChecker N Ohta"]["dark skin"].copy().align(shape),
        cmfs=colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"].copy().align(shape),
        illuminant=colour.SDS_ILLUMINANTS["D65"].copy().align(shape),
    )
    assert np.allclose(xyz[0], known / 100.0, atol=3e-4)
    sees = np.array([[0.9, 0.3, 0.1], [0.2, 1.1, -0.1], [0.0, 0.2, 0.8]])
    found = colour_matrix(xyz @ sees.T, xyz, white)
    assert np.allclose(found.matrix @ sees, np.eye(3), atol=1e-9) and found.errors.max() < 1e-6
    assert np.allclose(found.srgb(sees @ white), 1.0, atol=1e-3)
    warm = chart_xyz([380.0, 780.0], [0.1, 1.0])[1]
    assert np.allclose(adaptation(warm) @ (warm / warm[1]), TO_XYZ.sum(axis=1))
    assert np.allclose(FROM_XYZ @ TO_XYZ, np.eye(3))
    with pytest.raises(SimrigError, match="three colours"):
        colour_matrix(np.ones((5, 3)), xyz[:5], white)
    with pytest.raises(SimrigError, match="450 to 650"):
        chart_xyz([500.0, 600.0], [1.0, 1.0])


def test_patches_are_read_through_a_perspective():
    values = np.random.default_rng(4).uniform(0.1, 1.0, (24, 3))
    picture = np.zeros((90, 130, 3))
    for number, value in enumerate(values):
        row, column = divmod(number, 6)
        picture[10 + 18 * row : 28 + 18 * row, 8 + 19 * column : 27 + 19 * column] = value
    corners = [[7.5, 9.5], [121.5, 9.5], [121.5, 81.5], [7.5, 81.5]]
    assert np.allclose(read_patches(picture, corners), values)
    with pytest.raises(SimrigError, match="not in the picture"):
        read_patches(picture, np.array(corners) + 60.0)


def test_tiles_join_along_the_least_difference():
    rng = np.random.default_rng(5)
    from scipy import ndimage

    grain = ndimage.gaussian_filter(rng.normal(size=(140, 150)), 2.0)
    pictures = np.stack([grain, grain**2 + 0.2 * grain, 3.0 * grain + 1.0])
    tiling = find_tiling(pictures, 96, 100)
    tiles = np.array([tiling.cut(picture) for picture in pictures])
    assert tiles.shape == (3, 96, 100)
    assert tiling.plain_seam > 4.0 and tiling.seam < 0.45 * tiling.plain_seam
    assert seam_of(tiles) < 1.3  # hardly more than between any two neighbours
    # every texel of every picture comes from the same place
    colours = np.stack([tiling.cut(np.stack([p] * 3, -1)) for p in pictures])
    assert np.array_equal(colours[..., 1], tiles)
    assert np.isin(tiles[0], grain).all()
    with pytest.raises(SimrigError, match="need pictures of"):
        find_tiling(pictures, 140, 100)


def test_a_periodic_surface_is_cut_without_a_seam():
    y, x = np.mgrid[:80, :80]
    weave = np.sin(2 * np.pi * x / 16) * np.cos(2 * np.pi * y / 12)
    tiling = find_tiling(weave[None], 48, 48)
    twice = np.tile(tiling.cut(weave), (2, 1))[:32]
    phase = weave[tiling.row % 12 :, tiling.column % 16 :][:32, :48]
    assert np.allclose(twice, phase) and tiling.seam < 1.01 * tiling.plain_seam


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: demosaic(np.ones((8, 8)), "RGBG"), "unknown colour filter array"),
        (lambda: demosaic(np.ones((8, 8)), "RGGB", "best"), "unknown method"),
        (lambda: demosaic(np.ones((2, 8)), "RGGB"), "4 × 4"),
        (lambda: demosaic(np.ones((8, 8, 3)), "RGGB"), "dimensions"),
        (lambda: find_defects(np.ones((4, 4)), np.ones((4, 5))), "dark picture"),
        (lambda: fill_defects(np.ones((4, 4)), np.ones((3, 4))), "defects"),
        (lambda: find_tiling(np.ones((1, 50, 50)), 4, 20), "8 × 8"),
        (lambda: find_tiling(np.ones((1, 50, 50)), 20, 20, 15), "overlap"),
        (lambda: read_patches(np.ones((9, 9, 3)), [[0, 0]] * 4), "line"),
    ],
)
def test_what_cannot_be_is_refused(call, message):
    with pytest.raises(SimrigError, match=message):
        call()

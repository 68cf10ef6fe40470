"""Image metrics against published values, libraries and each other."""

from __future__ import annotations

import io
import json
import math

import numpy as np
import pytest
from rich.console import Console

from refusals import refused
from simrig.brdf import Lambert, kurt_material
from simrig.core.colour import to_lab
from simrig.core.errors import SimrigError
from simrig.evaluation.metrics import images as metrics
from simrig.evaluation.metrics.comparison import compare_brdfs, compare_images, metric_table
from simrig.evaluation.metrics.meanings import IMAGE_METRICS
from simrig.files.images import encode_srgb, to_srgb8

# Sharma, Wu, Dalal: "The CIEDE2000 Color-Difference Formula: Implementation Notes, Supplementary
# Test Data, and Mathematical Observations", 2005, table 1: pairs 7, 13, 17, 20, 25, 34, which sRGB
# holds. They cover the hue wrap, the achromatic case and large differences.
SHARMA_PAIRS = [
    ((50.0, 0.0, 0.0), (50.0, -1.0, 2.0), 2.3669),
    ((50.0, -0.001, 2.49), (50.0, 0.0009, -2.49), 4.8045),
    ((50.0, 2.5, 0.0), (73.0, 25.0, -18.0), 27.1492),
    ((50.0, 2.5, 0.0), (50.0, 3.2592, 0.335), 1.0),
    ((60.2574, -34.0099, 36.2677), (60.4626, -34.1751, 39.4387), 1.2644),
    ((2.0776, 0.0795, -1.135), (0.9033, -0.0636, -0.5514), 0.9082),
]


@pytest.fixture
def pair(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """An image and the same with noise; some values are above 1."""
    reference = rng.uniform(0.0, 1.2, (40, 48, 3))
    return reference, np.clip(reference + rng.normal(0.0, 0.02, reference.shape), 0.0, None)


def _linear_from_lab(lab: np.ndarray) -> np.ndarray:
    import colour

    return colour.XYZ_to_sRGB(colour.Lab_to_XYZ(lab), apply_cctf_encoding=False)


@pytest.mark.parametrize("first, second, expected", SHARMA_PAIRS)
def test_pixels_of_the_published_pairs_have_the_published_difference(first, second, expected):
    first, second = (_linear_from_lab(np.array([[lab]])) for lab in (first, second))
    found = metrics.delta_e_map(first, second, formula="2000")
    np.testing.assert_allclose(found, expected, atol=2e-3)  # four-digit sRGB matrices


def test_lab_is_that_of_colour_science(rng):
    import colour

    linear = np.concatenate([rng.uniform(0.0, 1.0, (500, 3)), 10.0 ** rng.uniform(-6, 0, (500, 3))])
    expected = colour.XYZ_to_Lab(colour.sRGB_to_XYZ(linear, apply_cctf_decoding=False))
    np.testing.assert_allclose(to_lab(linear), expected, atol=0.02)  # of 100: digits of the white
    np.testing.assert_allclose(to_lab(np.full((5, 3), 0.3))[:, 1:], 0.0, atol=1e-12)  # grey is grey


def test_the_srgb_curve_is_that_of_colour_science(rng):
    import colour

    linear = np.concatenate([rng.uniform(0.0, 1.0, 500), 10.0 ** rng.uniform(-6, 0, 500)])
    expected = colour.cctf_encoding(linear, function="sRGB")
    np.testing.assert_allclose(encode_srgb(linear), expected, atol=1e-7)


def test_delta_e_1976_is_the_distance_in_lab():
    first = np.array([[[50.0, 10.0, -5.0], [70.0, -8.0, 20.0]]])
    second = np.array([[[52.0, 7.0, -1.0], [70.0, -8.0, 20.0]]])
    found = metrics.delta_e_map(_linear_from_lab(first), _linear_from_lab(second))
    np.testing.assert_allclose(found, [[math.sqrt(4 + 9 + 16), 0.0]], atol=2e-3)


def test_delta_e_of_white_against_black_is_100():
    white, black = np.ones((2, 2, 3)), np.zeros((2, 2, 3))
    np.testing.assert_allclose(metrics.delta_e_map(white, black), 100.0, atol=0.02)


def test_mse_and_psnr_by_hand():
    reference = np.zeros((20, 20, 3))
    image = reference.copy()
    image[3, 4, 1] = 1.0  # one channel of one pixel differs by 255
    found = metrics.mse(reference, image)
    assert found == pytest.approx(255.0**2 / 1200)
    assert metrics.psnr_from_mse(found) == pytest.approx(10.0 * math.log10(1200))


def test_psnr_agrees_with_scikit_image(pair):
    from skimage.metrics import peak_signal_noise_ratio

    shown = [metrics.displayed(image.astype(np.float32)) for image in pair]
    expected = peak_signal_noise_ratio(*shown, data_range=255.0)
    assert metrics.psnr_from_mse(metrics.mse(*pair)) == pytest.approx(expected, abs=1e-9)


def test_differences_below_one_step_count():
    reference = np.full((12, 12, 3), 0.5)
    image = reference * (1.0 + 1e-4)
    assert np.array_equal(to_srgb8(reference), to_srgb8(image))
    assert 0.0 < metrics.mse(reference, image) < 0.01


def test_ssim_is_that_of_its_paper(pair):
    """Equation 13 of [WBSS04], window by window of 11 × 11 pixels."""
    along = np.exp(-((np.arange(11) - 5.0) ** 2) / (2.0 * 1.5**2))
    window = np.outer(along, along) / along.sum() ** 2
    c_1, c_2 = (0.01 * 255.0) ** 2, (0.03 * 255.0) ** 2

    def windows(image: np.ndarray) -> np.ndarray:
        shown = metrics.displayed(image.astype(np.float32))
        return np.lib.stride_tricks.sliding_window_view(shown, (11, 11), axis=(0, 1))

    def mean(values: np.ndarray) -> np.ndarray:
        return (window * values).sum(axis=(-1, -2))

    x, y = (windows(image) for image in pair)
    m_x, m_y = mean(x), mean(y)
    variances = mean(x * x) - m_x**2 + mean(y * y) - m_y**2
    numerator = (2.0 * m_x * m_y + c_1) * (2.0 * (mean(x * y) - m_x * m_y) + c_2)
    expected = numerator / ((m_x**2 + m_y**2 + c_1) * (variances + c_2))
    found = metrics.ssim_map(*pair)
    np.testing.assert_allclose(found[5:-5, 5:-5], expected.mean(axis=-1), atol=1e-9)
    everything = np.ones(found.shape, dtype=bool)
    assert metrics.ssim_mean(found, everything) == pytest.approx(float(expected.mean()), abs=1e-9)


def test_ssim_sees_structure_and_not_only_the_error_energy(rng):
    reference = rng.uniform(0.2, 0.8, (40, 40, 3))
    brighter = reference * 1.1
    noise = brighter - reference
    scrambled = reference + rng.permuted(noise.reshape(-1)).reshape(noise.shape)
    everything = np.ones((40, 40), dtype=bool)
    similar = [
        metrics.ssim_mean(metrics.ssim_map(reference, image), everything)
        for image in (brighter, scrambled)
    ]
    assert similar[0] > similar[1]


def test_log_psnr_by_hand():
    reference = np.array([1.0, 10.0, 0.01, 5.0])
    # a factor of ten everywhere is one decade of error, whatever the value
    assert metrics.log_psnr(reference, 10.0 * reference) == pytest.approx(20 * math.log10(4.0))
    assert metrics.log_psnr(reference, reference) == math.inf
    # zeros are raised to the floor: 1e-5 against 1e-4 is one decade
    assert metrics.log_psnr(np.zeros(3), np.full(3, 1e-4)) == pytest.approx(20 * math.log10(4.0))


def test_flip_bounds_and_known_extremes():
    black, white = np.zeros((32, 32, 3)), np.ones((32, 32, 3))
    assert metrics.flip_map(black, black).max() == 0.0
    # Andersson et al. 2020: two pixels differ most when green and blue are compared
    green, blue = black + np.array([0.0, 1.0, 0.0]), black + np.array([0.0, 0.0, 1.0])
    assert metrics.flip_map(green, blue).min() == pytest.approx(1.0, abs=1e-2)
    assert 0.9 < metrics.flip_map(black, white).mean() < 1.0


def test_hdr_flip_agrees_with_the_evaluator_when_nothing_is_black(pair):
    import flip_evaluator

    first, second = (np.maximum(image, 0.01).astype(np.float32) for image in pair)
    _, expected, _ = flip_evaluator.evaluate(first, second, "HDR", applyMagma=False)
    assert metrics.flip_map(first, second, hdr=True).mean() == pytest.approx(expected, rel=1e-3)


def test_hdr_flip_survives_black_images(pair):
    # the evaluator's own choice of exposures ends the process when the reference is black
    black = np.zeros_like(pair[0])
    assert metrics.flip_map(black, black, hdr=True).max() == 0.0
    assert metrics.flip_map(black, pair[0], hdr=True).mean() > 0.5
    assert metrics.flip_map(pair[0], black, hdr=True).mean() > 0.5


def test_hdr_flip_ignores_how_much_background_there_is(pair):
    first, second = pair
    border = ((60, 60), (60, 60), (0, 0))
    framed = metrics.flip_map(np.pad(first, border), np.pad(second, border), hdr=True)
    plain = metrics.flip_map(first, second, hdr=True)
    inner = (slice(70, -70), slice(70, -70))
    np.testing.assert_allclose(framed[inner], plain[10:-10, 10:-10], atol=0.02)


def test_difference_image():
    reference = np.zeros((3, 3, 3))
    image = reference.copy()
    image[0, 0] = 4.0 / 255.0 / 12.92  # encodes to 4
    image[1, 1] = 1.0
    found = metrics.difference_image(reference, image, scale=10.0)
    assert found.dtype == np.uint8
    assert (found[0, 0] == 215).all() and (found[1, 1] == 0).all() and (found[2, 2] == 255).all()
    refused("must be positive", metrics.difference_image, reference, image, scale=0.0)


def test_exposure_only_affects_what_is_displayed(pair):
    first, second = pair
    dark, shown = compare_images(first / 8, second / 8), compare_images(first, second)
    lifted = compare_images(first / 8, second / 8, exposure=8.0)
    assert lifted.psnr == pytest.approx(shown.psnr, abs=1e-4)
    assert dark.delta_e < shown.delta_e
    assert dark.log_psnr == pytest.approx(lifted.log_psnr)


def test_mask_chooses_the_pixels(pair):
    first, second = (image.copy() for image in pair)
    second[:, :24] = first[:, :24]
    left = np.zeros(first.shape[:2], dtype=bool)
    left[:, :24] = True
    everything = compare_images(first, second)
    assert compare_images(first, second, left).mse == 0.0
    right = compare_images(first, second, ~left)
    assert right.pixels == 40 * 24
    assert right.mse == pytest.approx(2.0 * everything.mse)
    assert right.delta_e > everything.delta_e
    assert right.ssim < everything.ssim
    assert compare_images(first, second, np.ones_like(left)) == everything


def test_foreground_mask():
    first, second = np.zeros((4, 4, 3)), np.zeros((4, 4, 3))
    first[1, 1, 0], second[2, 2, 2] = 1e-6, 3.0
    expected = np.zeros((4, 4), dtype=bool)
    expected[1, 1] = expected[2, 2] = True
    np.testing.assert_array_equal(metrics.foreground_mask(first, second), expected)


def test_every_metric_gets_worse_with_more_noise(rng):
    reference = rng.uniform(0.1, 0.9, (32, 32, 3))
    noise = rng.normal(0.0, 1.0, reference.shape)
    results = [
        compare_images(reference, np.clip(reference + s * noise, 0.0, None))
        for s in (0.005, 0.02, 0.08)
    ]
    for name, meaning in IMAGE_METRICS.items():
        values = [getattr(result, name) for result in results]
        expected = sorted(values, reverse=not meaning.lower_is_better)
        assert values == expected and len(set(values)) == 3, name


def test_identical_images_are_json_safe(pair):
    result = compare_images(pair[0], pair[0])
    assert result.psnr == math.inf and result.ssim == pytest.approx(1.0)
    numbers = json.loads(json.dumps(result.to_dict(), allow_nan=False))
    assert numbers["psnr"] is None and numbers["mse"] == 0.0 and numbers["pixels"] == 1920


def test_table_says_unit_and_direction(pair):
    from rich.console import Console

    result = compare_images(*pair)
    console = Console(width=140, file=io.StringIO(), record=True)
    console.print(result.table())
    text = console.export_text()
    for meaning in IMAGE_METRICS.values():
        assert meaning.label in text
    assert f"{result.psnr:.4g}" in text and "higher" in text and "dB" in text
    assert metric_table({"a": {}, "b": {}}, {}, "empty").row_count == 0


@pytest.mark.parametrize(
    "reference, image, mask, message",
    [
        (np.ones((12, 12, 3)), np.ones((12, 13, 3)), None, "differ in size: 12 × 12 and 13 × 12"),
        (np.ones((12, 12, 3)), np.full((12, 12, 3), np.nan), None, "NaN or infinite"),
        (np.ones((12, 12, 3)), np.ones((12, 12, 3)), np.zeros((12, 12)), "leaves no pixel"),
        (np.ones((12, 12, 3)), np.ones((12, 12, 3)), np.ones((3, 3)), "mask must have the shape"),
        (np.ones((10, 12, 3)), np.ones((10, 12, 3)), None, "at least 11 × 11"),
        (np.ones((12, 12)), np.ones((12, 12, 4)), None, "must have the shape"),
    ],
)
def test_images_that_cannot_be_compared(reference, image, mask, message):
    refused(message, compare_images, reference, image, mask)


def test_a_mask_on_the_border_has_no_ssim():
    mask = np.zeros((20, 20), dtype=bool)
    mask[0] = True
    with pytest.raises(SimrigError, match="five pixels from the border"):
        compare_images(np.ones((20, 20, 3)), np.ones((20, 20, 3)), mask)


def test_unknown_formula():
    with pytest.raises(SimrigError, match="unknown ΔE formula"):
        metrics.delta_e_map(np.ones((2, 2, 3)), np.ones((2, 2, 3)), formula="1994")


def test_brdfs_compared_by_hand():
    truth, double = Lambert((0.2, 0.4, 0.3)), Lambert((0.4, 0.8, 0.6))
    result = compare_brdfs(truth, double, step_deg=20.0)
    assert result.mre == pytest.approx(100.0, rel=1e-6)
    assert result.median_relative_error == pytest.approx(100.0, rel=0.006)
    logs = [math.log((2 * a / math.pi + 1e-3) / (a / math.pi + 1e-3)) for a in (0.2, 0.4, 0.3)]
    assert result.log_error == pytest.approx(100.0 * sum(logs) / 3, rel=1e-5)
    assert result.delta_e > 10.0
    mean_square = (0.2**2 + 0.4**2 + 0.3**2) / 3 / math.pi**2
    assert result.rmse == pytest.approx(math.sqrt(mean_square), rel=1e-6)
    expected = 20.0 * math.log10(4.0 / math.log10(2.0))
    assert result.log_psnr == pytest.approx(expected, rel=1e-6)


def test_brdfs_log_psnr_agrees_with_the_definition_on_arrays():
    from simrig.brdf import evaluate
    from simrig.directions import to_vector

    truth, other = kurt_material("fabric112"), kurt_material("fabric112_rescaled")
    theta, phi = np.radians(np.arange(0, 81, 20)), np.radians(np.arange(0, 360, 20))
    ti, tv, pi, pv = np.meshgrid(theta, theta, phi, phi, indexing="ij")
    wi, wv = to_vector(ti, pi), to_vector(tv, pv)
    f, g = evaluate(truth, wi, wv), evaluate(other, wi, wv)
    result = compare_brdfs(truth, other, step_deg=20.0)
    assert result.log_psnr == pytest.approx(metrics.log_psnr(f, g), abs=1e-3)
    assert result.rmse == pytest.approx(float(np.sqrt(np.mean((f - g) ** 2))), rel=1e-4)
    assert result.to_dict()["excluded"] == 0
    same = compare_brdfs(truth, truth, step_deg=20.0)
    assert same.mre == 0.0 and same.to_dict()["log_psnr"] is None


def test_a_black_material_beside_others():
    black, white = Lambert((0.0, 0.0, 0.0)), Lambert((1.0, 1.0, 1.0))
    found = compare_brdfs(black, white, step_deg=20.0)
    assert found.to_dict()["mre"] is None and "MRE none" in str(found)
    assert found.log_error == pytest.approx(100.0 * math.log(1.0 + 1000.0 / math.pi), rel=1e-5)
    assert found.delta_e > 50.0
    same = compare_brdfs(black, black, step_deg=20.0)
    assert (same.delta_e, same.log_error) == (0.0, 0.0)
    assert (
        compare_brdfs(white, np.ones((5, 5, 18, 18, 3)), step_deg=20.0).to_dict()["delta_e"] is None
    )


def test_negative_pixels_are_counted_and_set_to_zero(rng) -> None:
    reference = rng.uniform(0.0, 1.0, (12, 12, 3))
    ringing = reference.copy()
    ringing[2, 3, 1] = ringing[4, 5] = -0.02
    clamped = np.maximum(ringing, 0.0)
    compared = compare_images(reference, ringing)
    assert compared.negative == (0, 2)
    assert compared.to_dict()["negative_pixels"] == {"reference": 0, "image": 2}
    assert compared.delta_e == compare_images(reference, clamped).delta_e
    console = Console(width=200, record=True, file=io.StringIO())
    console.print(compared.table())
    assert "negative pixels" in console.export_text()
    refused("negative values", metrics.check_pair, reference, ringing)

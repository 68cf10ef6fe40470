"""Features, saliency, structure sizes and distances, against closed forms."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from refusals import refused
from simrig.perception import (
    PUBLISHED_MODELS,
    contrast,
    contrast_sensitivity,
    cycles_per_degree,
    fit_distances,
    luminance,
    luminance_contrast,
    perceptual_difference,
    pixels_per_degree,
    predict_distance,
    saliency,
    saliency_maps,
    structural_difference,
    structure_size,
    texture_contrast,
)
from simrig.perception.features import SSIM_K
from simrig.perception.structure import METHODS

PPD = 61.0
OF_PAIRS = {
    "contrast": contrast,
    "ssim": structural_difference,
    "flip": lambda plain, textured: perceptual_difference(plain, textured, PPD),
}
OF_ONE = {
    "luminance": luminance,
    "luminance_contrast": luminance_contrast,
    "texture_contrast": texture_contrast,
    "saliency": saliency,
}


def stripes(
    period: float, shape: tuple[int, int] = (200, 256), contrast: float = 0.6
) -> np.ndarray:
    wave = np.sin(2.0 * np.pi * np.arange(shape[1]) / period + 0.3)
    return np.tile(0.5 + 0.5 * contrast * wave, (shape[0], 1))


@pytest.mark.parametrize("grey", [0.0, 0.37, 1.0])
def test_nothing_is_found_where_nothing_is(grey: float) -> None:
    flat = np.full((48, 64), grey)
    assert luminance(flat) == pytest.approx(grey)
    for name, feature in OF_PAIRS.items():
        assert feature(flat, flat) == pytest.approx(0.0, abs=1e-12), name
    for name in ("luminance_contrast", "texture_contrast", "saliency"):
        assert OF_ONE[name](flat) == 0.0, name
    for method in METHODS:
        assert structure_size(flat, 0.2, method) == 0.0
        assert structure_size(flat[:1, :1], 0.2, method) == 0.0, "a tile of one pixel"


def test_a_constant_difference_is_no_contrast_but_a_difference() -> None:
    """Of two flat images SSIM is its luminance term, (2ab + C1) / (a² + b² + C1)."""
    a, b = 0.4, 0.5
    first, second = np.full((32, 32), a), np.full((32, 32), b)
    c_1 = SSIM_K[0] ** 2
    similarity = (2 * a * b + c_1) / (a * a + b * b + c_1)
    assert structural_difference(first, second) == pytest.approx(1.0 - similarity, rel=1e-9)
    assert contrast(first, second) == pytest.approx(0.0, abs=1e-9)
    assert perceptual_difference(first, second, PPD) > 0.01


def test_contrast_of_noise_is_its_standard_deviation(rng: np.random.Generator) -> None:
    """Within the window's own fluctuation: Σw² of a Gaussian with σ = 1.5 is 1/(4πσ²)."""
    noise = 0.05 * rng.standard_normal((256, 256))
    flat = np.full(noise.shape, 0.5)
    expected = 0.05 * np.sqrt(1.0 - 1.0 / (4.0 * np.pi * 1.5**2))
    assert contrast(flat, flat + noise) == pytest.approx(expected, rel=0.02)


def test_gradients_of_a_ramp() -> None:
    """A slope g per pixel is 2^k g on level k: C_L is (1 + 2 + ... + 16)·g, C_T nothing."""
    down, right = 0.0003, 0.0004
    rows, columns = np.mgrid[:1024, :1024]
    first, second = saliency_maps(0.2 + down * rows + right * columns)
    middle = (slice(448, 576),) * 2
    np.testing.assert_allclose(first[middle], 31.0 * np.hypot(down, right), rtol=1e-9)
    np.testing.assert_allclose(second[middle], 0.0, atol=1e-12)


@pytest.mark.parametrize("place", [(40, 90), (64, 64), (100, 31)])
def test_saliency_peaks_at_a_planted_spot(place: tuple[int, int], rng: np.random.Generator) -> None:
    rows, columns = np.mgrid[:128, :160]
    spot = np.exp(-0.5 * ((rows - place[0]) ** 2 + (columns - place[1]) ** 2) / 2.0**2)
    image = 0.4 + 0.002 * rng.standard_normal(spot.shape) + 0.5 * spot
    first, second = saliency_maps(image)
    peak = np.unravel_index(np.argmax(first + 10.0 * second), spot.shape)
    assert np.hypot(peak[0] - place[0], peak[1] - place[1]) <= 4.0, "on the spot or its flank"


def test_saliency_is_the_published_sum_and_grows_with_contrast() -> None:
    image = stripes(9.0)
    total = luminance_contrast(image) + 10.0 * texture_contrast(image)
    assert saliency(image) == pytest.approx(total, rel=1e-12)
    assert saliency(image) == pytest.approx(3.0 * saliency(stripes(9.0, contrast=0.2)), rel=1e-9)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("period", [4.0, 8.0, 12.5, 16.0, 20.0, 31.0])
def test_a_sinusoid_has_its_period(method: str, period: float) -> None:
    for image in (stripes(period), stripes(period).T):
        assert structure_size(image, 1.0, method) == pytest.approx(period, abs=1.0)
        assert structure_size(image, 0.25, method) == pytest.approx(0.25 * period, abs=0.25)


def test_pixels_need_not_be_square() -> None:
    across = structure_size(stripes(16.0), (0.5, 0.1))
    down = structure_size(stripes(16.0).T, (0.5, 0.1))
    assert across == pytest.approx(8.0, rel=0.03) and down == pytest.approx(1.6, rel=0.03)


def test_shading_is_no_structure() -> None:
    image = 0.5 * stripes(8.0) + np.linspace(0.0, 0.4, 256)
    assert structure_size(image, 1.0) == pytest.approx(8.0, abs=1.0)


def test_the_larger_of_two_structures_counts() -> None:
    both = 0.5 * stripes(32.0) + 0.5 * stripes(6.0)
    assert structure_size(both, 1.0) == pytest.approx(32.0, abs=1.5)


def test_float32_changes_nothing(rng: np.random.Generator) -> None:
    textured = rng.random((64, 64)).astype(np.float32)
    plain = np.full(textured.shape, 0.5, dtype=np.float32)
    twice = textured.astype(np.float64)
    for name, of_one in OF_ONE.items():
        assert of_one(textured) == of_one(twice), name
    for name, feature in OF_PAIRS.items():
        assert feature(plain, textured) == feature(plain.astype(np.float64), twice), name
    low = np.float32(1e-4) * textured + np.float32(0.999)  # small contrast near white
    assert contrast(np.full_like(low, 0.999), low) == pytest.approx(1e-4 * 12**-0.5, rel=0.1)


NAN = np.full((64, 64), np.nan)
GOOD = np.full((64, 64), 0.5)


@pytest.mark.parametrize(
    ("bad", "reason"),
    [
        (NAN, "NaN"),
        (np.full((64, 64), np.inf), "NaN or infinite"),
        (GOOD + 0.6, "from 0 to 1"),
        (GOOD - 0.6, "from 0 to 1"),
        (GOOD[:1, :1], "at least"),
        (GOOD[:0], "of shape"),
        (np.full((64, 64, 3), 0.5), "of shape"),
    ],
)
def test_bad_images_are_refused(bad: np.ndarray, reason: str) -> None:
    refused(reason, saliency, bad)
    refused(reason, contrast, GOOD[: bad.shape[0], : bad.shape[1]], bad)


def test_bad_options_are_refused() -> None:
    refused("differ in size", contrast, GOOD, GOOD[:32])
    refused("pixels per degree", perceptual_difference, GOOD, GOOD, 0.0)
    refused("did you mean 'spectrum'", structure_size, GOOD, 1.0, "spectum")
    refused("> 0 mm", structure_size, GOOD, np.nan)


@pytest.mark.parametrize("speed", [0.3, 1.0, 3.0, 10.0])
def test_sensitivity_peaks_where_kelly_says(speed: float) -> None:
    """At constant speed v = f_t/f_s the peak is at f_s = 45.9 / (2π (v + 2)), Kelly 1979."""
    expected = 45.9 / (2.0 * np.pi * (speed + 2.0))
    spatial = expected * np.linspace(0.5, 2.0, 3001)
    peak = spatial[np.argmax(contrast_sensitivity(spatial, speed * spatial))]
    assert peak == pytest.approx(expected, rel=1e-3)


def test_sensitivity_falls_with_distance_and_motion() -> None:
    """Beyond its peak; faster flicker at high frequencies lowers it (thesis section 3.3.2)."""
    distances = np.linspace(600.0, 4400.0, 50)
    assert (np.diff(contrast_sensitivity(cycles_per_degree(1.0, distances))) < 0.0).all()
    assert contrast_sensitivity(10.0, 8.0) < contrast_sensitivity(10.0, 1.0)


def test_angles() -> None:
    assert cycles_per_degree(1.0, 1000.0) == pytest.approx(17.4533, rel=1e-4)
    assert pixels_per_degree(0.1713, 600.0) == pytest.approx(61.1, abs=0.1)
    for bad in (0.0, -1.0, np.nan, np.inf):
        refused("positive", cycles_per_degree, bad, 600.0)
        refused("positive", contrast_sensitivity, bad)


def test_published_models_are_those_of_table_3_2() -> None:
    printed = {
        "ssim": (1.582, 0.044, 1.748, 0.053),
        "vdp2": (1.777, 0.033, 18.694, 0.384),
        "saliency": (1.292, 0.023, 1.201, 0.015),
    }
    found = {n: (m.k_1, m.k_1_std, m.k_2, m.k_2_std) for n, m in PUBLISHED_MODELS.items()}
    assert found == printed
    assert predict_distance("saliency", 3.0, 0.5) == pytest.approx(1.292 + 1.201 * 1.5)
    assert predict_distance("ssim", 5.0, 0.0) == 1.582


def test_bad_predictions_are_refused() -> None:
    refused("did you mean 'saliency'", predict_distance, "salience", 1.0, 1.0)
    for size, value in ((-1.0, 0.1), (1.0, -0.1), (np.nan, 0.1), (1.0, np.inf)):
        refused("finite and >= 0", predict_distance, "ssim", size, value)


def planted(rng: np.random.Generator, count: int = 25) -> tuple[np.ndarray, ...]:
    sizes, features = rng.uniform(0.3, 10.0, count), rng.uniform(0.2, 0.8, count)
    return sizes, features, 1.3 + 1.2 * sizes * features + 0.05 * rng.standard_normal(count)


def test_a_planted_line_is_found_among_outliers(rng: np.random.Generator) -> None:
    pytest.importorskip("statsmodels")
    sizes, features, distances = planted(rng)
    outliers = [2, 11, 17]
    distances[outliers] += (4.0, -3.0, 6.0)
    fit = fit_distances(sizes, features, distances)
    assert fit.model.k_1 == pytest.approx(1.3, abs=0.06)
    assert fit.model.k_2 == pytest.approx(1.2, abs=0.02)
    assert np.flatnonzero(fit.weights == 0.0).tolist() == outliers
    slope, offset = np.polyfit(sizes * features, distances, 1)
    assert abs(slope - 1.2) + abs(offset - 1.3) > 0.2, "least squares is led astray"


def test_what_is_left_out_does_not_take_part(rng: np.random.Generator) -> None:
    pytest.importorskip("statsmodels")
    sizes, features, distances = planted(rng)
    fit = fit_distances(sizes, features, distances)
    error = fit.left_out - distances
    assert 0.03 < error.std() < 0.08, "the planted noise of 0.05"
    others = np.arange(len(sizes)) != 7
    without = fit_distances(sizes[others], features[others], distances[others])
    assert fit.left_out[7] == pytest.approx(
        float(without.model.distance(sizes[7], features[7])), rel=1e-9
    )
    changed = distances.copy()
    changed[7] += 2.0
    again = fit_distances(sizes, features, changed)
    assert again.left_out[7] == pytest.approx(fit.left_out[7], rel=1e-12)
    assert fit.correlation > 0.99


@given(k_1=st.floats(-3.0, 3.0), k_2=st.floats(-3.0, 3.0))
def test_an_exact_line_is_its_own_fit(k_1: float, k_2: float) -> None:
    pytest.importorskip("statsmodels")
    sizes = np.array([0.5, 1.0, 2.0, 3.0, 7.0])
    fit = fit_distances(sizes, np.ones(5), k_1 + k_2 * sizes)
    assert (fit.model.k_1, fit.model.k_2) == pytest.approx((k_1, k_2), abs=1e-9)
    assert max(fit.model.k_1_std, fit.model.k_2_std) < 1e-9


def test_bad_fits_are_refused() -> None:
    ones, ramp = np.ones(5), np.arange(1.0, 6.0)
    for arguments, reason in (
        ((ramp[:3], ones[:3], ones[:3]), "at least 4"),
        ((ramp, ones, ones[:4]), "one distance of each"),
        ((ramp, ones * np.nan, ones), "finite"),
        ((ones, ones, ramp), "the same for all"),
        ((np.array([1.0, 1.0, 1.0, 1.0, 2.0]), ones, ramp), "the same for all"),
    ):
        refused(reason, fit_distances, *arguments)


def test_a_missing_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "statsmodels.api", None)
    ramp = np.arange(1.0, 6.0)
    refused(r"pip install 'simrig\[perception\]'", fit_distances, ramp, np.ones(5), ramp**2)

"""Scattered measurements: Cornell, ALTA and UBO2014 files, and their interpolation."""

from __future__ import annotations

import zipfile

import numpy as np
import pytest

from refusals import refused
from simrig.brdf import Ward, evaluate
from simrig.brdf.tables.scattered import (
    IsotropicInterpolator,
    ScatteredSamples,
    barycentric_weights,
    interpolate_isotropic,
    residual,
    subset,
)
from simrig.directions import to_vector
from simrig.files.alta import read_alta
from simrig.files.cornell import load_cornell, read_cornell
from simrig.files.spectra import rgb_weights
from simrig.files.ubo import load_ubo, read_ubo


def test_constant_spectrum_is_white():
    for wavelengths in (np.arange(400.0, 701.0, 10.0), np.linspace(360.0, 1000.0, 195)):
        np.testing.assert_allclose(rgb_weights(wavelengths).sum(axis=0), 1.0, rtol=1e-12)


def test_spectra_agree_with_colour_science():
    import colour

    wavelengths = np.arange(360.0, 781.0, 5.0)
    spectrum = 0.2 + 0.6 * np.exp(-(((wavelengths - 600.0) / 40.0) ** 2))
    distribution = colour.SpectralDistribution(dict(zip(wavelengths, spectrum, strict=True)))
    shape = colour.SpectralShape(360, 780, 5)
    xyz = colour.sd_to_XYZ(
        distribution,
        colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"].copy().align(shape),
        colour.SDS_ILLUMINANTS["D65"].copy().align(shape),
        method="Integration",
    )
    expected = colour.RGB_COLOURSPACES["sRGB"].matrix_XYZ_to_RGB @ (xyz / 100.0)
    np.testing.assert_allclose(spectrum @ rgb_weights(wavelengths), expected, atol=5e-4)


@pytest.mark.parametrize(
    "wavelengths,message",
    [([500.0], "must increase"), ([500.0, 400.0], "must increase"), ([0.4, 0.7], "do not cover")],
)
def test_bad_wavelengths_are_refused(wavelengths, message):
    refused(message, rgb_weights, np.array(wavelengths))


def ward_samples(rng: np.random.Generator, count: int = 600) -> tuple[Ward, ScatteredSamples]:
    material = Ward((0.1, 0.2, 0.3), (0.3, 0.2, 0.1), 0.25, 0.25)
    theta = rng.uniform(0.1, 1.3, (2, count))
    phi = rng.uniform(0.0, 2.0 * np.pi, (2, count))
    values = evaluate(material, to_vector(theta[0], phi[0]), to_vector(theta[1], phi[1]))
    angles = theta[0], phi[0], theta[1], phi[1]
    return material, ScatteredSamples(*angles, values, "ward", isotropic=True)


def cross_validated(samples, part):
    """Compare the interpolation with samples that it was not given, part by part."""
    wi, wv = samples.directions
    tested = [part == number for number in np.unique(part)]
    predicted = np.full_like(samples.values, np.nan)
    for held_out in tested[1:-1] or tested:
        kept = IsotropicInterpolator(subset(samples, ~held_out))
        predicted[held_out] = kept(wi[held_out], wv[held_out])
    known = np.isfinite(predicted).all(axis=1)
    return residual(subset(samples, known), predicted[known])


def test_interpolation_finds_an_isotropic_material(rng):
    material, samples = ward_samples(rng)
    table = interpolate_isotropic(samples, (45, 30, 36))
    wi, wv = (to_vector(rng.uniform(0.1, 1.2, 300), rng.uniform(0, 6.28, 300)) for _ in range(2))
    relative = np.abs(evaluate(table, wi, wv) / evaluate(material, wi, wv) - 1.0)
    assert np.median(relative) < 0.01 and relative.mean() < 0.05
    assert table.theta_max == pytest.approx(1.3, abs=0.02)


def test_interpolation_holds_beyond_the_data(rng):
    _, samples = ward_samples(rng, 200)
    interpolator = IsotropicInterpolator(samples)
    wi, wv = (to_vector(rng.uniform(0.0, 1.57, 100), rng.uniform(0, 6.28, 100)) for _ in range(2))
    mirror = np.array([1.0, -1.0, 1.0])
    np.testing.assert_allclose(interpolator(wi, wv), interpolator(wi * mirror, wv * mirror))
    assert interpolator(wi, wv).max() <= 1.001 * samples.values.max()
    assert interpolator(wi, wv).min() >= 0.0
    phi = np.zeros(2)
    steep = to_vector(np.array([interpolator.theta_max, 1.56]), phi)
    held = interpolator(steep, to_vector(np.array([0.5, 0.5]), phi + 1.0))
    np.testing.assert_allclose(held[0], held[1])


def test_interpolation_keeps_the_order_of_the_directions(rng):
    """Samples that lose light with the light's polar angle alone: so does the table."""
    theta_i, theta_v = rng.uniform(0.0, 1.4, (2, 500))
    phi = rng.uniform(0.0, 6.28, (2, 500))
    values = np.repeat(np.cos(theta_i)[:, None] ** 2, 3, axis=1)
    table = interpolate_isotropic(ScatteredSamples(theta_i, phi[0], theta_v, phi[1], values))
    assert not table.reciprocal
    steep, flat = to_vector(1.2, 0.3), to_vector(0.4, 2.0)
    np.testing.assert_allclose(evaluate(table, steep, flat), np.cos(1.2) ** 2, rtol=0.05)
    np.testing.assert_allclose(evaluate(table, flat, steep), np.cos(0.4) ** 2, rtol=0.05)


def test_too_few_samples_are_refused(rng):
    _, samples = ward_samples(rng, 2)
    refused("too few different directions", IsotropicInterpolator, samples)


@pytest.mark.parametrize(
    "change,message",
    [
        (lambda a: a.update(theta_i=np.array([np.nan, 0.1])), "NaN or infinite"),
        (lambda a: a.update(theta_v=np.array([45.0, 0.1])), "outside 0° to 90°"),
        (lambda a: a.update(phi_i=np.zeros(3)), "as many of each"),
        (lambda a: a.update(values=np.ones((2, 2))), "values of shape"),
    ],
)
def test_samples_are_checked(change, message):
    arrays = {name: np.full(2, 0.3) for name in ("theta_i", "phi_i", "theta_v", "phi_v")}
    arrays["values"] = np.ones((2, 3))
    change(arrays)
    refused(message, ScatteredSamples, **arrays)


def cornell_text(rows: list[str], wavelengths: str = "400 500\n600 700", count: int = 4) -> str:
    return f"# num wls\n{count}\n\n# wls\n{wavelengths}\n\n# samples\n" + "\n".join(rows) + "\n"


def test_cornell_rows_are_read(tmp_path):
    path = tmp_path / "paint.brdf"
    path.write_text(cornell_text(["0.1 0 0.2 -0.5 0.5 0.5 0.5 0.5", "0.3 0 0.4 1 0 0 0 0"]))
    samples = read_cornell(path)
    assert len(samples) == 2 and samples.isotropic and samples.name == "paint"
    np.testing.assert_allclose(samples.values, [[0.5] * 3, [0.0] * 3], atol=1e-12)
    np.testing.assert_allclose(samples.phi_v, [-0.5, 1.0])


@pytest.mark.parametrize(
    "text,message",
    [
        ("# num wls\n", "gives no number of wavelengths"),
        (cornell_text([], count=2**31), "gives no number of wavelengths"),
        (cornell_text(["0.1 0 0.2 0 1 1 1 1"], count=9), "truncated|wavelengths"),
        (cornell_text(["0.1 0 0.2 0 1 1 1"]), "7 numbers instead of 8"),
        (cornell_text(["0.1 0 0.2 0 1 x 1 1"]), "line 9 .* not numeric"),
        (cornell_text(["0.1 0 0.2 0 1 nan 1 1"]), "NaN or infinite"),
        (cornell_text(["0.1 0 0.2 0 1 -1 1 1"]), "1 negative of 4 values"),
        (cornell_text([]), "has no samples"),
    ],
)
def test_cornell_refuses_damage(tmp_path, text, message):
    path = tmp_path / "bad.brdf"
    path.write_text(text)
    refused(message, read_cornell, path)


def test_measured_paint_is_interpolated(shared_data):
    samples = read_cornell(shared_data("cornell/krylon_blue.brdf"))
    assert len(samples) == 1439
    assert cross_validated(samples, np.round(np.degrees(samples.theta_i))).median < 0.02
    table = load_cornell(shared_data("cornell/krylon_blue.brdf"))
    assert residual(samples, evaluate(table, *samples.directions)).median < 0.03
    assert np.degrees(table.theta_max) == pytest.approx(80.0, abs=0.1)


ALTA = "#DIM 3 1\n#VS 0\n#PARAM_IN ISOTROPIC_TL_TV_PROJ_DPHI\n"


def test_alta_rows_are_read(tmp_path):
    path = tmp_path / "tape.dat"
    path.write_text(ALTA + "0.5 0.3 0.4 7\n0.5 -0.2 0 8\n")
    samples = read_alta(path)
    np.testing.assert_allclose(samples.theta_i, 0.5)
    np.testing.assert_allclose(samples.theta_v, [0.5, 0.2])
    np.testing.assert_allclose(samples.phi_v, [np.arctan2(0.4, 0.3), np.pi])
    np.testing.assert_allclose(samples.values, [[7.0] * 3, [8.0] * 3])


@pytest.mark.parametrize(
    "name,row",
    [
        ("ISOTROPIC_TV_TL_DPHI", "0.5 0.3 1.0"),
        ("SPHERICAL_TL_PL_TV_PV", "0.3 0.2 0.5 1.2"),
        ("CARTESIAN", " ".join(f"{x:.17g}" for x in (*to_vector(0.5, 1.2), *to_vector(0.3, 0.2)))),
    ],
)
def test_alta_parameterisations_agree(tmp_path, name, row):
    path = tmp_path / "x.dat"
    path.write_text(f"#DIM {len(row.split())} 3\n#PARAM_IN {name}\n{row} 1 2 3\n")
    samples = read_alta(path)
    angles = samples.theta_i[0], samples.theta_v[0], samples.phi_v[0] - samples.phi_i[0]
    np.testing.assert_allclose(angles, (0.3, 0.5, 1.0))
    np.testing.assert_allclose(samples.values, [[1.0, 2.0, 3.0]])


@pytest.mark.parametrize(
    "text,message",
    [
        ("#DIM 3 1\n1 2 3 4\n", "PARAM_IN"),
        ("#DIM x 1\n#PARAM_IN CARTESIAN\n", "PARAM_IN"),
        ("#DIM 3 1\n#PARAM_IN CARTESIEN\n1 2 3 4\n", "did you mean 'CARTESIAN'"),
        ("#DIM 4 1\n#PARAM_IN CARTESIAN\n1 2 3 4 5\n", "4 inputs and 1 outputs"),
        (ALTA.replace("VS 0", "VS 1") + "0.5 0.3 0.4 7\n", "confidences"),
        (ALTA, "no samples"),
        (ALTA + "0.5 0.3 0.4\n", "3 numbers instead of 4"),
        (ALTA + "0.5 0.3 0.4 inf\n", "NaN or infinite"),
        (ALTA + "0.5 0.3 0.4 -1\n", "1 negative of 1 values"),
        (ALTA + "0.5 0.3 0.4 y\n", "not numeric"),
    ],
)
def test_alta_refuses_damage(tmp_path, text, message):
    path = tmp_path / "bad.dat"
    path.write_text(text)
    refused(message, read_alta, path)


def test_measured_tape_returns_light_to_its_source(shared_data):
    samples = read_alta(shared_data("alta/retro-gray-tape.dat"))
    assert len(samples) == 7405
    for theta_i in np.radians([15.0, 30.0]):
        part = np.abs(samples.theta_i - theta_i) < 1e-6
        brightest = np.flatnonzero(part)[np.argmax(samples.values[part, 0])]
        assert samples.theta_v[brightest] == pytest.approx(theta_i, abs=np.radians(1.0))
        assert samples.phi_v[brightest] == pytest.approx(0.0, abs=0.05)


def ring_directions() -> np.ndarray:
    theta = np.radians([0.0] + [30.0] * 6 + [60.0] * 12)
    phi = np.radians([0.0, *range(0, 360, 60), *range(0, 360, 30)])
    return to_vector(theta, phi)


def test_barycentric_weights_are_exact_and_inside(rng):
    nodes = ring_directions()
    np.testing.assert_allclose(barycentric_weights(nodes, nodes), np.eye(len(nodes)), atol=1e-9)
    targets = to_vector(rng.uniform(0, 1.0, 100), rng.uniform(0, 6.28, 100))
    weights = barycentric_weights(nodes, targets)
    np.testing.assert_allclose(weights.sum(axis=1), 1.0)
    assert weights.min() >= 0.0 and (weights > 0.0).sum(axis=1).max() <= 3
    reconstructed = weights @ nodes
    reconstructed /= np.linalg.norm(reconstructed, axis=1, keepdims=True)
    np.testing.assert_allclose(reconstructed, targets, atol=1e-9)


def test_barycentric_weights_do_not_extrapolate():
    nodes = ring_directions()
    weights = barycentric_weights(nodes, to_vector(np.full(3, 1.5), np.array([0.0, 0.3, 2.0])))
    assert weights.min() >= 0.0
    assert np.all(weights[:, :7] == 0.0)  # only the outermost ring takes part
    refused("surround the normal", barycentric_weights, nodes[7:13], nodes)


def write_ubo(path, **changes) -> None:
    directions = ring_directions()
    count = len(directions)
    rng = np.random.default_rng(3)
    fields = {
        "theta": np.arccos(np.clip(directions[:, 2], -1, 1)),
        "phi": np.arctan2(directions[:, 1], directions[:, 0]),
        "f_view_light_rgb": rng.uniform(0.1, 1.0, (count, count, 3)).astype(np.float32),
    }
    fields.update(changes)
    np.savez(path, **{name: array for name, array in fields.items() if array is not None})


def test_ubo_is_view_first_in_the_file_and_light_first_here(tmp_path):
    write_ubo(tmp_path / "x.npz")
    directions, values = read_ubo(tmp_path / "x.npz")
    stored = np.load(tmp_path / "x.npz")["f_view_light_rgb"]
    np.testing.assert_array_equal(values[3, 8], stored[8, 3])
    table = load_ubo(tmp_path / "x.npz")
    assert not table.reciprocal and np.degrees(table.theta_max) == pytest.approx(60.0)
    for light, view in ((3, 8), (0, 5), (18, 7)):
        found = evaluate(table, directions[light], directions[view])
        np.testing.assert_allclose(found, stored[view, light], rtol=1e-5)


def test_measured_carpet_is_exact_where_nodes_coincide(shared_data):
    path = shared_data("ubo2014/carpet07_mean_151x151.npz")
    directions, values = read_ubo(path)
    table = load_ubo(path)
    theta = np.degrees(np.arccos(directions[:, 2]))
    phi = np.degrees(np.arctan2(directions[:, 1], directions[:, 0]))
    on_grid = np.abs(theta / 7.5 - np.round(theta / 7.5)) < 1e-4
    on_grid &= np.abs(phi / 7.5 - np.round(phi / 7.5)) < 1e-3
    index = np.flatnonzero(on_grid)
    assert len(index) > 100
    found = evaluate(table, directions[index][:, None], directions[index][None])
    np.testing.assert_allclose(found, values[np.ix_(index, index)], rtol=1e-5)
    everywhere = evaluate(table, directions[:, None], directions[None])
    assert np.abs(everywhere / values - 1.0).mean() < 0.005


@pytest.mark.parametrize(
    "changes,message",
    [
        ({"phi": None}, "lacks phi"),
        ({"phi": np.zeros(3)}, "do not fit together"),
        ({"f_view_light_rgb": np.full((19, 19, 3), np.nan)}, "NaN"),
        ({"f_view_light_rgb": np.full((19, 19, 3), -1.0)}, "1083 negative"),
        ({"theta": np.full(19, 30.0)}, "outside 0° to 90°"),
        ({"theta": np.array([{"a": 1}] * 19, dtype=object)}, r"claims more|Object arrays"),
    ],
)
def test_ubo_refuses_bad_arrays(tmp_path, changes, message):
    write_ubo(tmp_path / "bad.npz", **changes)
    refused(message, read_ubo, tmp_path / "bad.npz")


def test_ubo_refuses_damaged_archives(tmp_path):
    path = tmp_path / "x.npz"
    write_ubo(path)
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    refused("no zip archive", read_ubo, path)
    path.write_bytes(content[:900] + b"\xff" * 64 + content[964:])
    refused(r"damaged|claims", read_ubo, path)


def test_ubo_refuses_a_header_larger_than_its_data(tmp_path):
    path = tmp_path / "x.npz"
    write_ubo(path)
    with zipfile.ZipFile(path) as archive:
        members = {entry.filename: archive.read(entry) for entry in archive.infolist()}
    original = b"(19, 19, 3)"
    members["f_view_light_rgb.npy"] = members["f_view_light_rgb.npy"].replace(
        original, b"(9999999,3)"
    )
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    refused("claims more than the file holds", read_ubo, path)

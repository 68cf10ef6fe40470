"""The multi-axial model: against Kurt's where both are one, its fit, its plugin."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from simrig.brdf import Kurt, KurtLobe, evaluate, kurt_material
from simrig.brdf.multiaxial import ROUGHNESS, Mode, Multiaxial
from simrig.core.errors import SimrigError
from simrig.directions import to_vector
from simrig.files.hdf5 import read_brdf, write_brdf
from simrig.plugins import make_bsdf
from simrig.reconstruction.multiaxial import fit_multiaxial


def _pairs(count: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    thetas = np.radians(80.0 * np.sqrt(rng.random((count, 2))))
    return np.concatenate([thetas, 2.0 * np.pi * rng.random((count, 2))], axis=1)


def _values(brdf, angles: np.ndarray) -> np.ndarray:
    light, view = to_vector(angles[:, 0], angles[:, 2]), to_vector(angles[:, 1], angles[:, 3])
    return np.asarray(brdf.eval(light, view))


def _turned(angles: np.ndarray, degrees: float) -> np.ndarray:
    return angles - np.radians([0.0, 0.0, degrees, degrees])


def test_a_mode_is_a_turned_lobe_of_kurt() -> None:
    lobe = KurtLobe((0.3, 0.2, 0.1), 0.25, 0.4, 0.1, 0.3)
    height = np.array(lobe.k_s) * lobe.f_0 / (4.0 * np.pi * lobe.m_x * lobe.m_y)
    mode = Mode(tuple(height.tolist()), np.radians(35.0), 0.4, 0.1, 0.3, 3.0)
    angles = _pairs(2000, 1)
    ours = _values(Multiaxial((0.1, 0.1, 0.1), (mode,)), angles)
    kurt = _values(Kurt((0.1, 0.1, 0.1), (lobe,)), _turned(angles, 35.0))
    assert ours == pytest.approx(kurt, rel=1e-10)


def test_intuitive_numbers_say_what_is_seen() -> None:
    mode = Mode.of(20.0, 30.0, 40.0, 0.2, (1.0, 0.5, 0.0))
    assert mode.width_deg == pytest.approx(30.0)
    brdf = Multiaxial((0.0, 0.0, 0.0), (mode,))
    up = np.array([0.0, 0.0, 1.0])
    at = np.radians([20.0, 35.0, 5.0])
    main, left, right = brdf.eval(to_vector(np.radians(50.0), at), up)[:, 0]
    assert [left / main, right / main] == pytest.approx([0.5, 0.5])
    with pytest.raises(SimrigError, match="width"):
        Mode.of(0.0, 200.0, 30.0, 0.1)


@pytest.mark.parametrize(
    ("name", "error"),
    [("yellow_satin", 0.03), ("brushed_aluminium", 0.02), ("fabric041", 0.02), ("fabric139", 0.03)],
)
def test_fit_finds_modes_by_themselves(name: str, error: float) -> None:
    truth, turn = kurt_material(name), 25.0
    angles = _pairs(5000, 2)
    fitted = fit_multiaxial(angles, _values(truth, _turned(angles, turn)))
    other = _pairs(4000, 3)
    expected = _values(truth, _turned(other, turn))
    assert np.abs(_values(fitted, other) - expected).mean() < error * expected.mean()


def test_fit_of_three_axes() -> None:
    modes = tuple(Mode.of(15.0 + 60.0 * k, 20.0, 35.0, 0.1) for k in range(3))
    truth, angles = Multiaxial((0.2, 0.2, 0.2), modes), _pairs(8000, 4)
    fitted = fit_multiaxial(angles, _values(truth, angles))
    found = sorted(np.degrees(m.axis) for m in fitted.modes if max(m.colour) > 0.01)
    assert found == pytest.approx([15.0, 75.0, 135.0], abs=1.0)


def test_useless_samples_are_refused() -> None:
    angles = _pairs(100, 5)
    with pytest.raises(SimrigError, match="at least"):
        fit_multiaxial(angles[:10], np.ones((10, 3)))
    with pytest.raises(SimrigError, match="finite"):
        fit_multiaxial(angles, np.full((100, 3), np.nan))
    black = fit_multiaxial(angles, np.zeros((100, 3)))
    assert _values(black, angles).max() == 0.0


def test_stored_and_read_again(tmp_path, brdf) -> None:
    write_brdf(tmp_path / "m.h5", brdf("multiaxial"))
    again = read_brdf(tmp_path / "m.h5")
    angles = _pairs(50, 6)
    assert np.array_equal(_values(again, angles), _values(brdf("multiaxial"), angles))


def test_float32_is_near_float64(brdf, variant_llvm) -> None:
    angles = _pairs(5000, 7)
    light, view = to_vector(angles[:, 0], angles[:, 2]), to_vector(angles[:, 1], angles[:, 3])
    single = evaluate(brdf("multiaxial"), light, view, mi.Float)
    assert single == pytest.approx(evaluate(brdf("multiaxial"), light, view), rel=2e-4, abs=1e-7)


@pytest.mark.parametrize("theta_deg", [5.0, 50.0, 80.0])
def test_samples_follow_the_density(theta_deg, brdf, tools, variant_llvm):
    test, accepted = tools.chi_square(
        make_bsdf(brdf("multiaxial"), rotation_deg=20.0), tools.direction(theta_deg, 30.0)
    )
    assert accepted, test.messages


def test_plugin_by_name_and_its_derivative(variant_llvm) -> None:
    bsdf = mi.load_dict(
        {
            "type": "simrig_multiaxial",
            "axis": 10.0,
            "width": 20.0,
            "strength_2": 0.3,
            "axis_2": 95.0,
        }
    )
    params = mi.traverse(bsdf)
    assert float(np.ravel(params["mode_2_axis"])[0]) == pytest.approx(np.radians(95.0))
    key = "mode_1_axis"
    dr.enable_grad(params[key])
    params.update()
    si = dr.zeros(mi.SurfaceInteraction3f)
    si.wi = mi.Vector3f(*to_vector(0.1, 0.3).tolist())
    wo = mi.Vector3f(*to_vector(0.6, 0.5).tolist())
    value = bsdf.eval(mi.BSDFContext(), si, wo)[0]
    dr.backward(value)
    slope, step = float(np.ravel(dr.grad(params[key]))[0]), 1e-3
    modes = bsdf.brdf.modes
    there, here = (
        Multiaxial(
            bsdf.brdf.k_d,
            (Mode(*[getattr(modes[0], f) + (s if f == "axis" else 0) if f == "axis"
                    else getattr(modes[0], f) for f in Mode.__dataclass_fields__]), modes[1]),
        ).eval(to_vector(0.6, 0.5), to_vector(0.1, 0.3))[0] * np.cos(0.6)
        for s in (step, -step)
    )  # fmt: skip
    assert slope == pytest.approx((there - here) / (2.0 * step), rel=1e-2)
    for stray in ("axis_2", "strength_3"):
        with pytest.raises(RuntimeError, match=f"'{stray}' needs 'strength_2'"):
            mi.load_dict({"type": "simrig_multiaxial", stray: 3.0})


def test_the_narrowest_modes_are_as_narrow_as_any_can_be() -> None:
    thin, short = Mode.of(0.0, 1e-300, 35.0, 0.1), Mode.of(0.0, 40.0, 1e-300, 0.1)
    assert (thin.m_across, thin.m_along) == (ROUGHNESS[0], pytest.approx(0.841, abs=1e-3))
    assert short.m_along == short.m_across == ROUGHNESS[0]

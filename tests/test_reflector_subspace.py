"""Subspaces by a swept ray: patterns, Lambertian and directional truths, noise, refusals."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from simrig.brdf import kurt_material
from simrig.brdf.analytic import Lambert
from simrig.cli.app import app
from simrig.core.errors import SimrigError
from simrig.files.pictures.reader import read_picture
from simrig.instruments.description import shipped
from simrig.plans.registry import make_plan
from simrig.rigs.measurements.measurement import Measurement
from simrig.rigs.reflector.mirror import CONJUGATE, Reflector
from simrig.rigs.reflector.subspace import (
    Projector,
    light_patterns,
    measure_subspace,
    true_subspace,
)
from simrig.rigs.registry import make_rig, rig_of

THETA = float(np.radians(50.0))


def test_hadamard_patterns_are_s_matrices() -> None:
    """S Sᵀ = (n + 1) / 4 (I + J): Sloane and Harwit 1976."""
    patterns = light_patterns("hadamard", 1.0)
    count = len(patterns)
    assert count == 359 and set(np.unique(patterns)) == {0.0, 1.0}
    expected = 0.25 * (count + 1) * (np.eye(count) + np.ones((count, count)))
    assert np.array_equal(patterns @ patterns.T, expected)
    assert np.array_equal(light_patterns("ray", 10.0), np.eye(36))


@pytest.mark.parametrize("patterns", ["ray", "hadamard"])
def test_a_lambertian_sample_is_flat(patterns: str) -> None:
    found = measure_subspace(
        Lambert((0.2, 0.4, 0.6)), THETA, THETA, patterns=patterns, step_deg=10.0, noise=False
    )
    for channel, albedo in enumerate((0.2, 0.4, 0.6)):
        assert found.values[..., channel] == pytest.approx(albedo / np.pi, rel=1e-9)


def test_directions_are_those_of_the_brdf() -> None:
    """Pupils of a point on the axis: the foci's directions are exact, retro-reflection too."""
    mirror = replace(CONJUGATE, lens_diameter_mm=1.0)
    projector = Projector(beside_mm=0.0)
    material = kurt_material("fabric135")
    for theta_i, theta_v in ((50.0, 50.0), (35.0, 60.0)):
        angles = np.radians(theta_i), np.radians(theta_v)
        found = measure_subspace(
            material, *angles, mirror=mirror, projector=projector, step_deg=2.0, rotation_deg=33.0,
            noise=False,
        )  # fmt: skip
        truth = true_subspace(material, *angles, found.phi, 33.0)
        assert np.isfinite(found.values).all()
        assert np.abs(found.values - truth).mean() < 0.01 * truth.mean()


def test_many_lights_help_where_light_is_scarce() -> None:
    """The gain of S-matrices for noise that does not grow with light: (n + 1) / (2 √n)."""
    material, errors = kurt_material("purple_satin"), {}
    for patterns in ("ray", "hadamard"):
        own = {"patterns": patterns, "step_deg": 8.0, "projector": Projector(lumens=0.5)}
        clear = measure_subspace(material, THETA, THETA, noise=False, **own)
        noisy = measure_subspace(material, THETA, THETA, seed=3, **own)
        errors[patterns] = np.sqrt(np.mean((noisy.values - clear.values) ** 2))
    count = 43
    assert errors["ray"] / errors["hadamard"] == pytest.approx(
        0.5 * (count + 1) / count**0.5, rel=0.35
    )


def test_time_is_that_of_the_thesis() -> None:
    found = measure_subspace(Lambert(), THETA, THETA, patterns="ray", step_deg=1.0, noise=False)
    assert len(found.phi) == 360
    assert found.hardware_seconds == pytest.approx(12.0, abs=0.4)
    assert found.exposure_s <= 1.0 / 30.0


@pytest.mark.parametrize(
    ("angle", "options", "says"),
    [
        (10.0, {}, "covers polar angles"),
        (95.0, {}, "covers polar angles"),
        (float("nan"), {}, "covers polar angles"),
        (50.0, {"step_deg": 0.1}, "0.5 to 30"),
        (50.0, {"step_deg": float("nan")}, "0.5 to 30"),
        (50.0, {"patterns": "fourier"}, "pattern"),
        (50.0, {"mirror": Reflector()}, "far focus"),
        (50.0, {"rotation_deg": float("inf")}, "finite"),
    ],
)
def test_impossible_sweeps_are_refused(angle: float, options: dict, says: str) -> None:
    with pytest.raises(SimrigError, match=says):
        measure_subspace(Lambert(), np.radians(angle), THETA, **options)


def test_black_samples_and_projectors_are_refused() -> None:
    with pytest.raises(SimrigError, match="black"):
        measure_subspace(Lambert((0.0, 0.0, 0.0)), THETA, THETA, step_deg=30.0)
    for changes in ({"lumens": 0.0}, {"contrast": float("nan")}, {"frame_mm": (1.0, -1.0)}):
        with pytest.raises(SimrigError, match="finite and above 0"):
            Projector(**changes)


def test_the_rig_measures_what_the_sweep_does(tmp_path: Path) -> None:
    output = tmp_path / "m.h5"
    asked = ["measure", "fabric112", "--rig", "reflector", "--azimuths", "36", "-o", str(output)]
    made = CliRunner().invoke(app, asked)
    assert made.exit_code == 0, made.output
    measured = Measurement.load(output)
    swept = measure_subspace(
        kurt_material("fabric112"), THETA, THETA, mirror=replace(CONJUGATE, slope_rms_mrad=1.0),
        step_deg=10.0,
    )  # fmt: skip
    seen = np.isfinite(swept.values).all(axis=-1)
    assert len(measured) == seen.sum() == 36 * 36 - measured.provenance["unseen"]
    assert measured.values == pytest.approx(np.maximum(swept.values[seen], 0.0), rel=1e-3, abs=1e-6)
    assert measured.cost.hardware_seconds == pytest.approx(46.0 / 30.0)


@pytest.mark.parametrize(
    ("rig", "plan", "says"),
    [
        ("reflector", ("slices", {}), "whole subspaces"),
        ("reflector", ("subspace", {"subspace_theta_v": 10.0}), "covers polar angles"),
        ("flash", ("subspace", {}), "no .projector."),
        ("hadamard", ("subspace", {"azimuths": 36}), "--azimuths 31"),
    ],
)
def test_what_the_rig_does_not_measure(rig: str, plan: tuple, says: str) -> None:
    rigs = {
        "flash": lambda: rig_of(shipped("reflector")),
        "hadamard": lambda: make_rig("reflector", patterns="hadamard"),
    }
    own = rigs.get(rig, lambda: make_rig(rig))()
    with pytest.raises(SimrigError, match=says):
        own.check(Lambert(), make_plan(plan[0], None, **plan[1]))


def test_command(tmp_path: Path) -> None:
    output = tmp_path / "subspace.exr"
    asked = ["reflector", "subspace", "fabric112", "-o", str(output), "--step", "10", "--json"]
    made = CliRunner().invoke(app, asked)
    assert made.exit_code == 0, made.output
    told = json.loads(made.stdout)
    assert told["azimuths"] == 36 and told["relative_rmse"] < 0.2
    assert read_picture(output).pixels.shape[:2] == (36, 36)
    assert CliRunner().invoke(app, [*asked, "--theta-i", "5", "--overwrite"]).exit_code == 2

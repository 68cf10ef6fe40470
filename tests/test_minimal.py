"""Measuring with a database: the basis, its solvers, designs of directions, the process."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import minimize

from refusals import refused
from simrig.brdf import Lambert, kurt_material
from simrig.brdf.kriging.symmetry import Symmetry
from simrig.brdf.tables.dense import DenseTable
from simrig.database import design, linear
from simrig.database.grid import EPSILON
from simrig.database.known import Known, known
from simrig.database.posterior import Posterior
from simrig.database.process import OPPONENT, RotationProcess
from simrig.directions.half_difference import from_half_difference
from simrig.directions.spherical import to_angles, to_vector
from simrig.files.hdf5 import write_brdf
from simrig.methods import METHODS
from simrig.plans.registry import make_plan
from simrig.reconstruction.basis.table import slice_table
from simrig.rigs.direct.gonioreflectometer import Gonioreflectometer
from simrig.rigs.measurements.measurement import Measurement

RIG = Gonioreflectometer()


@pytest.fixture(scope="module")
def own(small_database: Path) -> Known:
    return known(str(small_database))


def _samples(half: np.ndarray, name: str = "fabric002"):
    wi, wv = from_half_difference(*half.T)
    return wi, wv, kurt_material(name).eval(wi, wv)


def _slices_of(own: Known, name: str, rows: np.ndarray, turns: np.ndarray):
    """Return ln(f w + ε) less the mean at rows and rotations, (n, r, 3)."""
    half = np.concatenate([np.insert(own.basis.grid.angles[[r]], 1, t, axis=1)
                           for r in rows for t in turns])  # fmt: skip
    _, _, values = _samples(half, name)
    values = values.reshape(len(rows), len(turns), 3)
    return own.basis.grid.mapped(values, rows) - own.basis.mean[rows][:, None, None]


def _energy(c, rows, values, zero, shape, steps, mean, constrained: bool) -> float:
    """Eq. 7.5 as it is written, of one channel; with shifts where they are given."""
    own = np.sum((values - rows @ c) ** 2) + linear.ETA * np.sum(c**2)
    at = mean[:, None] + zero @ c
    if steps is not None:
        grid = at.reshape(*shape, -1)
        at = np.stack([np.roll(grid[..., j], s, axis=1).ravel() for j, s in enumerate(steps)], 1)
    apart = at - at.mean(axis=1, keepdims=True)
    return own + (linear.LAMBDA * np.sum(apart**2) if constrained else 0.0)


@pytest.mark.parametrize("solver", linear.SOLVERS)
def test_closed_forms_are_the_minimum_of_what_the_thesis_minimises(own: Known, solver: str) -> None:
    basis = own.basis.first(6)
    rng = np.random.default_rng(3)
    chosen = design.reachable(basis)[rng.integers(3000, size=5)]
    turns = np.radians([0.0, 40.0, 155.0])
    values = _slices_of(own, "fabric112", chosen, turns)
    base = basis.mean[basis.grid.specular.ravel()]
    found = linear.solved(basis, basis.principal[chosen], values, turns, solver, mean=base)[..., 0]
    zero = basis.principal[basis.grid.specular.ravel()]
    steps = np.round(turns * 36 / np.pi).astype(int) if solver == "shifted" else None
    mean = base if solver == "shifted" else 0.0 * base

    def energy(c: np.ndarray) -> float:
        return _energy(
            c.reshape(6, 3), basis.principal[chosen], values[..., 0], zero,
            basis.grid.specular.shape, steps, mean, solver != "ridge",
        )  # fmt: skip

    here = energy(found)
    best = minimize(energy, (found + rng.normal(scale=1e-3, size=found.shape)).ravel())
    assert here <= best.fun * (1.0 + 1e-9)
    for _ in range(20):  # convex: no step goes down
        assert energy(found + 1e-4 * rng.normal(size=found.shape)) >= here


def test_solvers_in_single_precision_are_near_those_in_double(own: Known) -> None:
    basis = own.basis
    rows = design.least_condition(basis, 5, starts=1, restarts=1)
    turns = 2.0 * np.pi / 8 * np.arange(8)
    values = _slices_of(own, "fabric112", rows, turns)
    base = basis.mean[basis.grid.specular.ravel()]
    for solver in linear.SOLVERS:
        wide = linear.solved(basis, basis.principal[rows], values, turns, solver, mean=base)
        narrow = linear.solved(
            basis, basis.principal[rows].astype(np.float32), values.astype(np.float32), turns,
            solver, mean=base.astype(np.float32),
        )  # fmt: skip
        logs = [basis.principal @ c[:, 0, 0] for c in (wide, narrow)]
        assert np.abs(logs[0] - logs[1]).max() < 1e-3


def test_conditions_are_updated_as_if_computed_anew() -> None:
    rng = np.random.default_rng(0)
    for rows_, k in ((4, 5), (7, 8), (1, 2), (12, 6)):
        rows, candidates = rng.normal(size=(rows_, k)), rng.normal(size=(40, k))
        found = design.updated_conditions(rows, candidates)
        exact = [np.linalg.cond(np.vstack([rows, c])) for c in candidates]
        assert np.allclose(found, exact, rtol=1e-6)


def test_designs_are_better_than_chance(own: Known) -> None:
    basis = own.process.basis
    whitened = basis.components * basis.deviations
    allowed = design.reachable(basis)
    rng = np.random.default_rng(1)

    def left(rows: np.ndarray) -> float:
        q = whitened[rows] / 0.02
        covariance = np.linalg.inv(np.eye(q.shape[1]) + q.T @ q)
        return float(np.sum((whitened.T @ whitened) * covariance))

    chance = min(left(rng.choice(allowed, 6, replace=False)) for _ in range(40))
    found = {c: left(design.optimal(basis, 6, c)) for c in ("i", "a", "d")}
    assert found["i"] < chance and found["i"] <= 1.05 * min(found.values())
    kappa = design.least_condition(own.basis, 5, starts=2, restarts=2)
    others = (rng.choice(allowed, 5, replace=False) for _ in range(200))
    few = own.basis.principal[:, :5]
    assert design.condition(few[kappa]) < 0.8 * min(design.condition(few[o]) for o in others)
    assert len(set(kappa)) == 5


def test_a_joint_design_begins_with_the_shorter_one(own: Known) -> None:
    long, short = (design.joint(own.process, n) for n in (40, 12))
    assert np.array_equal(long[:12], short)
    wi, wv = from_half_difference(*long.T)
    assert min(wi[:, 2].min(), wv[:, 2].min()) >= np.cos(np.radians(75.0)) - 1e-6
    assert len(np.unique(np.round(long, 6), axis=0)) > 30


def test_features_have_the_covariance_of_the_coefficients(own: Known) -> None:
    """Rotated at random, the database's coefficients have the process's covariance."""
    process = own.process
    basis = process.basis
    spectra = process.spectra[0]
    rows = basis.components[[100, 2000, 4000]]
    phi = np.radians([0.0, 30.0, 95.0])
    features = spectra.features(rows, phi)
    brightness = np.einsum("mkrc,c->mkr", basis.coefficients, OPPONENT[0])
    logs = np.einsum("nk,mkr->nmr", rows, brightness)
    steps = np.round(np.degrees(phi) / 5.0).astype(int)
    turned = np.stack([np.roll(own_, -s, axis=1) for own_, s in zip(logs, steps, strict=True)])
    empirical = np.einsum("amr,bmr->ab", turned, turned) / turned[0].size
    share = 4.0 / (4.0 + 2.0)  # of what is not shrunk
    found = features @ features.T
    scale = np.sqrt(np.outer(np.diag(found), np.diag(found)))
    assert np.abs((found - empirical) / scale).max() < 0.1 + (1.0 - share)
    weights = np.random.default_rng(2).normal(size=spectra.size)
    c = spectra.coefficients(weights, basis.grid.rotations)
    there = spectra.features(rows, np.full(3, np.radians(35.0))) @ weights
    assert np.allclose(rows @ c[:, 7], there)


def test_the_process_beats_the_thesis_and_says_how_far_off_it_is(own: Known) -> None:
    slices = own.slices
    number = slices.names.index("fabric112")
    basis = slices.basis([number])
    process, truth = RotationProcess.of(basis), slices.logs(number)
    low = design.reachable(basis)
    brdf = own.database.entries[number].load()
    errors = {}
    for count in (20, 80):
        wi, wv = from_half_difference(*design.joint(process, count).T)
        posterior = Posterior.of(process, wi, wv, brdf.eval(wi, wv))
        errors[count] = float(np.sqrt(np.mean((posterior.logs()[low] - truth[low]) ** 2)))
        assert 0.5 < posterior.error() / errors[count] < 2.0
    rows = design.least_condition(basis, 10, starts=2, restarts=2)
    turns = 2.0 * np.pi / 8 * np.arange(8)
    half = design.rotated(rows, basis, 8, staggered=False)
    wi, wv = from_half_difference(*half.T)
    logs = np.log(brdf.eval(wi, wv) * np.maximum(wi * wv, EPSILON)[:, 2:] + EPSILON)
    values = logs.reshape(10, 8, 3) - basis.mean[rows][:, None, None]
    c = linear.over_rotations(linear.solved(basis, basis.principal[rows], values, turns), turns, 72)
    ridge = np.einsum("pk,krc->prc", basis.principal, c) + basis.mean[:, None, None]
    thesis = float(np.sqrt(np.mean((ridge[low] - truth[low]) ** 2)))
    assert errors[80] < errors[20] and errors[80] < 0.7 * thesis


def test_a_table_of_slices_is_continuous_where_angles_mean_nothing(own: Known) -> None:
    grid = own.basis.grid
    logs = own.slices.logs(0)
    table = slice_table(grid, logs, "x")
    assert table.symmetry == Symmetry(reciprocal=True)
    rng = np.random.default_rng(0)
    theta, phi = rng.uniform(0.1, 1.2, 50), rng.uniform(0.0, 6.28, 50)
    mirror = to_vector(theta, phi + np.pi)
    for off in (1e-7, -1e-7):
        near = table.eval(to_vector(theta, phi), to_vector(theta + off, phi + np.pi + off))
        assert np.allclose(near, table.eval(to_vector(theta, phi), mirror), rtol=0.05)
    back = to_vector(theta, phi)
    assert np.allclose(
        table.eval(back, back), table.eval(back, to_vector(theta + 1e-7, phi)), rtol=0.05
    )


def _measured(name_or_brdf, database: Path, **options):
    material = kurt_material(name_or_brdf) if isinstance(name_or_brdf, str) else name_or_brdf
    plan = make_plan("minimal", material, database=str(database), **options)
    return RIG.measure(material, plan)


@pytest.mark.parametrize(
    ("layout", "criterion"),
    [("joint", "i"), ("staggered", "d"), ("regular", "kappa"), ("adaptive", "i")],
)
def test_every_layout_is_measured_reconstructed_and_renders(
    small_database: Path, layout: str, criterion: str
) -> None:
    few = {} if layout == "joint" else {"directions": 4, "criterion": criterion}
    measured = _measured("fabric139", small_database, samples=40, layout=layout, **few)
    assert 0 < len(measured) <= 40
    made = METHODS["basis"].reconstruct(measured)
    assert made.brdf.in_kernels and "predicted error" in " ".join(made.notes)
    w = to_vector(np.radians([10.0, 40.0, 70.0]), np.radians([0.0, 100.0, 200.0]))
    truth = kurt_material("fabric139").eval(w[:, None], w[None])
    found = made.brdf.eval(w[:, None], w[None])
    assert np.median(np.abs(np.log((found + 1e-3) / (truth + 1e-3)))) < 0.6
    if layout == "regular":
        for solver in linear.SOLVERS:
            other = METHODS["basis"].reconstruct(measured, solver=solver)
            assert np.all(np.isfinite(other.brdf.logs)) and "condition" in other.notes[1]
    elif layout in ("joint", "staggered"):
        refused("same directions at each rotation", METHODS["basis"].reconstruct, measured,
                solver="ridge")  # fmt: skip


def test_directions_about_the_normal_are_the_same_at_each_rotation(
    small_database: Path, tmp_path: Path
) -> None:
    """At theta_h = 0 directions are told by turned azimuths, and by none along the normal."""
    directions = np.radians(
        [[0.0, 0.0, 0.0], [0.0, 30.0, 0.0], [0.0, 30.0, 20.0], [50.0, 15.0, 30.0]]
    )
    half = np.concatenate([np.insert(directions, 1, turn, axis=1)
                           for turn in np.arange(8) * np.pi / 4.0])  # fmt: skip
    (theta_i, phi_i), (theta_v, phi_v) = map(to_angles, from_half_difference(*half.T))
    pairs = tmp_path / "pairs.txt"
    order = np.random.default_rng(0).permutation(len(half))
    for shown, others in ((order, 0), (np.arange(len(half)), 1)):  # whole, and a rotation missing
        angles = np.degrees(np.column_stack([theta_i, theta_v, phi_i, phi_v]))[shown]
        np.savetxt(pairs, angles[: len(angles) - others], fmt="%.10f")
        measured = RIG.measure(
            kurt_material("fabric139"), make_plan("directions", None, pairs=str(pairs))
        )
        for solver in linear.SOLVERS:
            options = {"solver": solver, "database": str(small_database)}
            if others:
                refused("same directions at each rotation", METHODS["basis"].reconstruct, measured,
                        **options)  # fmt: skip
            else:
                made = METHODS["basis"].reconstruct(measured, **options)
                found = made.brdf.eval(*(to_vector(0.0, 0.0),) * 2)
                truth = kurt_material("fabric139").eval(*(to_vector(0.0, 0.0),) * 2)
                assert np.allclose(found, truth, rtol=0.3)


def test_a_measurement_stops_at_the_wished_error(small_database: Path) -> None:
    loose, tight = (
        _measured("fabric135", small_database, samples=96, predicted_error=e) for e in (1.0, 0.06)
    )
    assert len(loose) < len(tight) and len(loose) % 16 == 0


def test_adaptive_rotations_go_where_slices_differ(small_database: Path) -> None:
    options = {"samples": 64, "directions": 4, "layout": "adaptive"}
    round_ = _measured(Lambert(), small_database, **options)
    shiny = _measured("purple_satin", small_database, threshold=0.05, **options)
    assert len(round_) == 32 and len(shiny) > 32


def test_hard_cases_are_finite_or_refused(small_database: Path, tmp_path: Path) -> None:
    basis = METHODS["basis"]
    one = _measured("fabric112", small_database, samples=1)
    assert np.all(np.isfinite(basis.reconstruct(one).brdf.logs))
    black = DenseTable(np.zeros((6, 6, 12, 12, 3)), np.radians(15.0), name="black")
    dark = basis.reconstruct(_measured(black, small_database, samples=16))
    assert float(dark.brdf.eval(*(to_vector(0.3, 0.1),) * 2).max()) < 0.05
    write_brdf(tmp_path / "black.h5", black)
    alone = basis.reconstruct(_measured("fabric112", tmp_path, samples=30))
    assert np.all(np.isfinite(alone.brdf.logs))
    pairs = tmp_path / "pairs.txt"
    pairs.write_text("30 40 10 20\n" * 5 + "60 60 0 180\n")  # the same five times
    plan = make_plan("directions", None, pairs=str(pairs))
    twice = RIG.measure(kurt_material("fabric112"), plan)
    made = basis.reconstruct(twice, database=str(small_database))
    assert np.all(np.isfinite(made.brdf.logs))
    refused("needs --database", basis.reconstruct, twice)
    refused("needs --database", make_plan, "minimal", None)
    refused("there is no database", make_plan, "minimal", None, database="nowhere")
    refused("leave out --directions", make_plan, "minimal", None, database=str(small_database),
            directions=4)  # fmt: skip
    refused("finite", Posterior.of, known(str(small_database)).process, *[to_vector(0.1, 0.2)[None]]
            * 2, np.full((1, 3), np.nan))  # fmt: skip


def test_what_no_material_of_the_database_has_is_said(own: Known) -> None:
    """A mirror's lobe is outside of the basis: the stated error is larger."""
    half = design.joint(own.process, 60)
    wi, wv = from_half_difference(*half.T)
    usual = Posterior.of(own.process, wi, wv, kurt_material("fabric002").eval(wi, wv)).error()
    lobe = 200.0 * np.exp(-((half[:, :1] / 0.05) ** 2)) + 1e-4 * np.ones(3)
    assert Posterior.of(own.process, wi, wv, lobe).error() > 2.0 * usual


def test_a_stored_measurement_needs_no_database(small_database: Path, tmp_path: Path) -> None:
    measured = _measured("fabric112", small_database, samples=8)
    measured.save(tmp_path / "m.h5")
    again = Measurement.load(tmp_path / "m.h5")
    assert again.plan.settings() == measured.plan.settings()
    assert METHODS["basis"].reconstruct(again, database=str(small_database)).notes

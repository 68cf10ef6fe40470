"""Scattered data in the stability table: splines of nearly singular systems, triangulations."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from simrig.brdf.tables.scattered import (
    IsotropicInterpolator,
    ScatteredSamples,
    barycentric_weights,
    spline_monomials,
    spline_system,
)
from simrig.brdf.tables.thin_plate import thin_plate
from simrig.core.errors import SimrigError
from simrig.directions import to_vector
from simrig.evaluation.stability.methods import method_row, refused_row
from simrig.evaluation.stability.rows import StabilityRow

_COUNT, _QUERIES = 40, 200


def scattered_rows() -> list[StabilityRow]:
    """Return the rows of thin-plate splines through scattered samples, with condition numbers."""
    return [_spline_row(samples) for samples in _scattered()]


def _scattered() -> Iterator[ScatteredSamples]:
    rng = np.random.default_rng(0)
    theta_i, theta_v = rng.uniform(0.0, 1.3, (2, _COUNT))
    phi_v = rng.uniform(0.0, 2.0 * np.pi, _COUNT)
    value = rng.uniform(0.1, 1.0, (_COUNT, 3))

    def make(name: str, t_i=theta_i, t_v=theta_v, phi=phi_v, v=value) -> ScatteredSamples:
        return ScatteredSamples(t_i, np.zeros(len(t_i)), t_v, phi, v, name, isotropic=True)

    def repeated(a: np.ndarray) -> np.ndarray:
        return np.concatenate([a, a])

    yield make("random")
    yield make("one sample", theta_i[:1], theta_v[:1], phi_v[:1], value[:1])
    four = [np.repeat(a[:1], 4, axis=0) for a in (theta_i, theta_v, phi_v, value)]
    yield make("one sample, four times", *four)
    yield make("duplicate samples", *(repeated(a) for a in (theta_i, theta_v, phi_v, value)))
    others = np.concatenate([value, value[::-1]])
    i, v, phi = (repeated(a) for a in (theta_i, theta_v, phi_v))
    yield make("duplicates with other values", i, v, phi, others)
    for distance in (1e-4, 1e-8, 1e-12):
        beside = np.concatenate([theta_v, np.abs(theta_v - distance)])
        yield make(
            f"duplicates {distance:g} rad apart", repeated(theta_i), beside, repeated(phi_v), others
        )
    for distance in (1e-4, 1e-8, 1e-12, 0.0):
        along = np.abs(theta_i + distance * rng.standard_normal(_COUNT))
        yield make(f"theta_v = theta_i to {distance:g} rad", t_v=along)
    spike = np.where(np.arange(_COUNT) == 7, 1e5, 1.0)[:, None] * value
    yield make("spike", v=spike)
    yield make("six-to-minus-twelve", v=10.0 ** rng.uniform(-12.0, 6.0, (_COUNT, 3)))
    yield make("all-zero", v=np.zeros((_COUNT, 3)))
    yield make("denormal", v=1e-310 * value)
    yield make("negative channels", v=value - 0.5)


def _spline_row(samples: ScatteredSamples) -> StabilityRow:
    name = "scattered, thin-plate spline"
    try:
        interpolator = IsotropicInterpolator(samples)
    except SimrigError as error:
        return refused_row(samples.name, name, error)
    rng = np.random.default_rng(1)
    wi, wv = (_hemisphere(rng) for _ in range(2))
    colours = interpolator(wi, wv)
    points = interpolator.coordinates(wi, wv)
    logarithms = interpolator.limited(interpolator.spline(points))
    exact = interpolator.limited(_extended_spline(interpolator.spline, points))
    scale = max(float(np.abs(interpolator.spline.d).max()), 1.0)
    wrong = int(np.sum(colours < 0.0)) + int(np.sum(~np.isfinite(colours)))
    return method_row(
        samples.name,
        name,
        logarithms,
        exact,
        scale,
        condition=interpolator.condition,
        conditioning="the spline's linear system; values stay within those of the samples",
        negative=wrong,
    )


def _hemisphere(rng: np.random.Generator) -> np.ndarray:
    phi = rng.uniform(0.0, 2.0 * np.pi, _QUERIES)
    return to_vector(np.arccos(rng.uniform(0.0, 1.0, _QUERIES)), phi)


def _extended_spline(spline, points: np.ndarray) -> np.ndarray:
    """Solve the system of a spline in extended precision and evaluate it at points."""
    nodes, points = spline.y.astype(np.longdouble), points.astype(np.longdouble)
    right = np.zeros((len(nodes) + len(spline.powers), spline.d.shape[1]), dtype=np.longdouble)
    right[: len(nodes)] = spline.d
    weights = solve_extended(spline_system(spline, nodes), right)
    basis = np.concatenate([thin_plate(points, nodes), spline_monomials(spline, points)], axis=1)
    return (basis @ weights).astype(np.float64)


def solve_extended(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solve a linear system in extended precision, by elimination with the largest pivots.

    Where the matrix is singular to that precision the undetermined unknowns are 0.

    Args:
        matrix: (n, n) longdouble.
        right: (n, c) longdouble.
    """
    a, b = matrix.copy(), right.copy()
    smallest = np.abs(a).max() * len(a) * np.finfo(np.longdouble).eps
    for k in range(len(a)):
        pivot = k + int(np.argmax(np.abs(a[k:, k])))
        a[[k, pivot]], b[[k, pivot]] = a[[pivot, k]], b[[pivot, k]]
        if np.abs(a[k, k]) > smallest:
            factor = a[k + 1 :, k] / a[k, k]
            a[k + 1 :] -= factor[:, None] * a[k]
            b[k + 1 :] -= factor[:, None] * b[k]
    solution = np.zeros_like(b)
    for k in reversed(range(len(a))):
        if np.abs(a[k, k]) > smallest:
            solution[k] = (b[k] - a[k, k + 1 :] @ solution[k + 1 :]) / a[k, k]
    return solution


def barycentric_rows() -> list[StabilityRow]:
    """Return the rows of barycentric weights: they sum to 1 and reproduce the directions."""
    name = "scattered, barycentric"
    rng = np.random.default_rng(0)
    phi = np.arange(12) * (np.pi / 6.0)
    pole = to_vector(np.zeros(1), np.zeros(1))
    ring = to_vector(np.full(12, 1.2), phi)
    nodes = np.concatenate([pole, to_vector(np.full(12, 0.6), phi), ring])
    near = np.concatenate([nodes, to_vector(np.full(12, 0.6 + 1e-9), phi)])
    plans = {
        "rings": nodes,
        "duplicate nodes": np.concatenate([nodes, nodes]),
        "nodes 1e-9 rad apart": near,
        "one node": pole,
        "all on one circle": ring,
        "three nodes": nodes[[0, 13, 17]],
    }
    inside = to_vector(rng.uniform(0.0, 1.1, 100), rng.uniform(0.0, 2.0 * np.pi, 100))
    rows = []
    for case, own in plans.items():
        targets = np.concatenate([own, inside])
        try:
            weights = barycentric_weights(own, targets)
        except SimrigError as error:
            rows.append(refused_row(case, name, error))
            continue
        mean = weights @ own
        mean /= np.linalg.norm(mean, axis=1, keepdims=True)
        found = np.concatenate([weights.sum(axis=1), mean.ravel()])
        exact = np.concatenate([np.ones(len(targets)), targets.ravel()])
        rows.append(method_row(case, name, found, exact, 1.0, negative=int(np.sum(weights < 0.0))))
    return rows

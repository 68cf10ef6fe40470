"""The methods for samples at listed directions in the stability table.

Barycentric interpolation and the regular grid: hard signals on a scheme, over all hard directions,
float32 beside float64. Radial basis functions: hard lists of samples, where the result must return
the samples' values as far as the condition of its system allows, and never leave their range.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from simrig.brdf import Brdf, evaluate
from simrig.core.errors import SimrigError
from simrig.directions import to_vector
from simrig.directions.schemes import HemisphereScheme, uniform_scheme
from simrig.evaluation.stability.hard_cases import HardCase
from simrig.evaluation.stability.judgement import direction_rows
from simrig.evaluation.stability.methods import method_row, refused_row, signals
from simrig.evaluation.stability.rows import StabilityRow
from simrig.evaluation.stability.subjects import FAINT, BrdfSubject
from simrig.methods import METHODS
from simrig.plans.uniform import RegularGrid
from simrig.reconstruction.scattered.rbf import reconstruct_rbf
from simrig.rigs.measurements.measurement import Measurement

_SAMPLES, _QUERIES = 40, 200
_MERGED = 1e-8  # radians between the samples of the closest case, which are merged
_IN_A_ROW, _BESIDE = 5, 3e-5  # samples and radians between them: nearly singular, not merged
_LOGARITHMIC = 1e2  # what rounding of logarithms over 18 orders (up to 42) does to values
_PRECISIONS = ("numpy-float64", "drjit-float32")


@dataclass(frozen=True, eq=False)
class _TableSubject(BrdfSubject):
    """A table; weights that vanish at a node let neighbours in by their rounding error, so errors
    are relative to the largest value."""

    def scale(self, reference: np.ndarray) -> np.ndarray:
        largest = float(self.brdf.data()["values"].max())
        return np.full_like(reference, max(largest, FAINT))


def _measured(
    plan: HemisphereScheme, name: str, signal: Callable[[np.ndarray], np.ndarray]
) -> Measurement:
    angles = plan.pair_angles(reciprocal=True)
    values = np.repeat(signal(angles)[:, None], 3, axis=1)
    return Measurement(angles, values, name)


def uniform_rows(cases: list[HardCase], backend_name: str) -> list[StabilityRow]:
    """Return the rows of barycentric and multilinear tables of hard signals.

    Args:
        backend_name: ``"llvm"`` or ``"cuda"``.
    """
    wi, wv = (np.concatenate([getattr(case, key) for case in cases]) for key in ("wi", "wv"))
    plans = {
        "barycentric": uniform_scheme(3),
        "regular-grid": RegularGrid(4, 9, float(np.radians(80.0))).scheme(),
    }
    rows = []
    for method, plan in plans.items():
        for name, signal in signals().items():
            made = METHODS[method].reconstruct(_measured(plan, name, signal))
            made.brdf.name = f"reconstruct, {method}"
            case = HardCase(name, "all directions of the list", wi, wv)
            subject = _TableSubject(made.brdf)
            rows += direction_rows(subject, [case], _PRECISIONS, backend_name)
        rows += list_rows(method, plan)
    return rows


def list_rows(method: str, plan: HemisphereScheme) -> list[StabilityRow]:
    """Return the rows of hard lists of samples, beside the table of an easy list.

    Duplicates must give the table of their means, azimuths of other turns the same table; one
    sample is too few and refused.
    """
    easy = _measured(plan, "samples", lambda a: 1.0 + np.cos(a[:, 2] - a[:, 3]) * np.cos(a[:, 0]))
    rng = np.random.default_rng(4)
    change = easy.values * rng.uniform(0.0, 0.5, easy.values.shape)
    both = np.concatenate([easy.values + change, easy.values - change])
    wrapped, beside = easy.angles.copy(), easy.angles.copy()
    wrapped[:, 2:] += 2.0 * np.pi * rng.integers(-1, 2, (len(wrapped), 2))
    beside[:, 2:] += 1e-9 * rng.choice([-1.0, 1.0], (len(wrapped), 2))  # also below azimuth 0
    lists = {
        "duplicates": (np.tile(easy.angles, (2, 1)), np.tile(easy.values, (2, 1))),
        "duplicates with other values": (np.tile(easy.angles, (2, 1)), both),
        "azimuths of other turns": (wrapped, easy.values),
        "on both sides of azimuth 0": (beside, easy.values),
        "one sample": (easy.angles[-1:], easy.values[-1:]),
    }
    name, rows = f"reconstruct, {method}", []
    reference = METHODS[method].reconstruct(easy).brdf.data()["values"]
    for case, (angles, values) in lists.items():
        try:
            made = METHODS[method].reconstruct(Measurement(angles, values, case))
        except SimrigError as error:
            rows.append(refused_row(case, name, error))
            continue
        found = made.brdf.data()["values"]
        rows.append(method_row(case, name, found, reference, float(reference.max()), single=True))
    return rows


def rbf_rows() -> list[StabilityRow]:
    """Return the rows of global and local radial basis functions through hard samples."""
    return [
        rbf_row(case, _rbf_name(neighbours, logarithms), measurement, neighbours, logarithms)
        for case, measurement in hard_samples()
        for neighbours in (None, 20)
        for logarithms in (False, True)
    ]


def _rbf_name(neighbours: int | None, logarithms: bool) -> str:
    return f"RBF, {'global' if neighbours is None else 'local'}{', log' if logarithms else ''}"


def rbf_row(
    case: str,
    name: str,
    measurement: Measurement,
    neighbours: int | None,
    logarithms: bool,
    reciprocal: bool = True,
) -> StabilityRow:
    """Return the row of radial basis functions: the samples' own values, and their range elsewhere.

    Args:
        neighbours, logarithms, reciprocal: see
        ``simrig.reconstruction.scattered.rbf.reconstruct_rbf``.
    """
    try:
        result = reconstruct_rbf(
            measurement, neighbours, logarithms=logarithms, reciprocal=reciprocal
        )
    except SimrigError as error:
        return refused_row(case, name, error)
    found = _at(result.brdf, measurement.angles)
    low, high = (edge(measurement.values, axis=0) for edge in (np.min, np.max))
    rng = np.random.default_rng(2)
    theta = np.arccos(rng.uniform(0.0, 1.0, (_QUERIES, 2)))
    queries = np.concatenate([theta, rng.uniform(0.0, 7.0, (_QUERIES, 2))], axis=1)
    anywhere = _at(result.brdf, queries)
    wrong = int(np.sum(~((anywhere >= low) & (anywhere <= high))))
    scale = max(float(measurement.values.max()), float(np.finfo(np.float64).tiny))
    # samples that are merged lie as far from their node
    moved = _at(result.brdf, measurement.angles + _MERGED) - found
    slope = float(np.abs(moved).max()) / scale if "merged" in str(result.notes) else 0.0
    smoothed = max((fit.residual for fit in result.fits if fit.smoothed), default=0.0)
    # of the system of all samples: those of local splines are parts of it
    condition = reconstruct_rbf(measurement, reciprocal=reciprocal).condition or 1.0
    return method_row(
        case,
        name,
        found,
        _means_of_repeated(measurement),
        scale,
        sensitivity=max(slope, smoothed),
        condition=max(condition, _LOGARITHMIC if logarithms else 1.0),
        conditioning="; ".join(result.notes),
        negative=wrong,
    )


def _at(brdf: Brdf, angles: np.ndarray) -> np.ndarray:
    """Return f_r at angles (n, 4) theta_i, theta_v, phi_i, phi_v, shape (n, 3)."""
    theta_i, theta_v, phi_i, phi_v = angles.T
    return evaluate(brdf, to_vector(theta_i, phi_i), to_vector(theta_v, phi_v))


def _means_of_repeated(measurement: Measurement) -> np.ndarray:
    """Return the mean of the values of all samples at the same directions (to 1e-4 rad)."""
    wi = to_vector(measurement.theta_i, measurement.phi_i)
    wv = to_vector(measurement.theta_v, measurement.phi_v)
    places = np.concatenate([wi, wv], axis=1)
    distance = np.abs(places[:, None] - places[None]).max(axis=-1)
    same = (distance < 1e-5).astype(np.float64)
    return same @ measurement.values / same.sum(axis=1, keepdims=True)


def hard_samples() -> Iterator[tuple[str, Measurement]]:
    """Yield lists of samples that are hard for a linear system, with their names."""
    rng = np.random.default_rng(0)
    theta = rng.uniform(0.1, 1.3, (2, _SAMPLES))
    phi = rng.uniform(0.0, 2.0 * np.pi, (2, _SAMPLES))
    angles = np.concatenate([theta, phi]).T
    value = rng.uniform(0.1, 1.0, (_SAMPLES, 3))

    def make(own: np.ndarray, values: np.ndarray) -> Measurement:
        return Measurement(own, values, "hard samples")

    yield "one sample", make(angles[:1], value[:1])
    yield "two samples", make(angles[:2], value[:2])
    both, others = np.tile(angles, (2, 1)), np.concatenate([value, value[::-1]])
    yield "duplicates with other values", make(both, others)
    for distance in (1e-3, 1e-4, _MERGED):
        beside = np.concatenate([angles, angles + distance * rng.uniform(0.5, 1.0, angles.shape)])
        yield f"duplicates {distance:g} rad apart", make(beside, np.tile(value, (2, 1)))
    steps = np.repeat(np.arange(_IN_A_ROW), _SAMPLES)[:, None] * [_BESIDE, 0.0, 0.0, 0.0]
    row = np.tile(angles, (_IN_A_ROW, 1)) + steps
    varied = np.tile(value, (_IN_A_ROW, 1)) * rng.uniform(0.99, 1.01, (len(row), 1))
    yield "five in a row, hardly apart", make(row, varied)
    normal = angles.copy()
    normal[:, 0] = 0.0
    yield "all with the light along the normal", make(normal, value)
    normal[:, 1] = 0.0
    yield "all along the normal", make(normal, value)
    plane = angles.copy()
    plane[:, 2:] = 0.0
    yield "all in one plane", make(plane, value)
    around = angles.copy()
    around[:, 3] = np.where(np.arange(_SAMPLES) % 2, 2.0 * np.pi - 1e-4, 1e-4)
    yield "on both sides of azimuth 0", make(around, value)
    for name, values in _hard_values(value, rng).items():
        yield name, make(angles, values)


def _hard_values(value: np.ndarray, rng: np.random.Generator) -> Mapping[str, np.ndarray]:
    spike = np.where(np.arange(_SAMPLES) == 7, 1e5, 1.0)[:, None]
    return {
        "all-zero": np.zeros_like(value),
        "spike": spike * value,
        "six-to-minus-twelve": 10.0 ** rng.uniform(-12.0, 6.0, value.shape),
        "denormal": 1e-310 * value,
    }

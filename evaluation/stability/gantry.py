"""The gantry in the stability table: hard slices, the Minnaert fit, optimal transport.

Two laws hold for methods B and BD whatever was measured: a material that is brighter by a power of
two gives the same result times that, digit by digit, and a material turned by half a turn gives
the same result turned. So values of any size are compared with those near 1, and values across the
seam at 0/360° with those away from it. The Minnaert fit is compared with the model that made the
values, and transport with the total mass that it must keep. Method A is held to what holds for
every radial basis function: the subspaces' own values at their nodes, and their range elsewhere.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from simrig.brdf.minnaert import fit_minnaert
from simrig.core.transport.grid import displacement, transport_rows
from simrig.evaluation.stability.methods import method_row, signals
from simrig.evaluation.stability.rows import StabilityRow
from simrig.evaluation.stability.uniform import rbf_row
from simrig.plans.gantry import GantryPlan
from simrig.reconstruction.gantry.brdfs import SubspaceNodes
from simrig.reconstruction.gantry.polar_angles import Blend, fill_thetas, linear
from simrig.reconstruction.gantry.subspace import subspaces
from simrig.rigs.measurements.measurement import Measurement

_AZIMUTHS = 8
_SMALLEST = float(np.nextafter(0.0, 1.0))
_WANTED = np.radians([0.0, 15.0, 30.0, 52.5, 75.0])
_CASES: tuple[tuple[str, GantryPlan, Blend], ...] = (
    ("gantry, B", GantryPlan(), linear),
    ("gantry, B, isotropic", GantryPlan(axial=0), linear),
    ("gantry, B, 3 + 3 slices", GantryPlan(axial=3, diagonal=3), linear),
    ("gantry, BD", GantryPlan(), transport_rows),
)


def gantry_rows() -> list[StabilityRow]:
    """Return the rows of all cases: slices, fits, transport."""
    rows = []
    for name, plan, blend in _CASES:
        for case, signal in signals().items():
            rows += [_scaled(name, case, plan, blend, signal), _turned(name, case, plan, signal)]
    return [*rows, *_spline_rows(), *_fit_rows(), *_transport_rows()]


def _spline_rows() -> list[StabilityRow]:
    """Return the rows of method A: splines through the subspaces of hard slices."""
    plan, rows = GantryPlan(), []
    for case, signal in signals().items():
        values = np.repeat(signal(plan.angles())[:, None], 3, axis=1)
        nodes = SubspaceNodes.of(plan.thetas, subspaces(plan, values, _AZIMUTHS), case)
        angles = np.stack([nodes.theta_i, nodes.theta_v, nodes.phi_i, nodes.phi_v], axis=1)
        samples = Measurement(angles, nodes.values, case)
        rows.append(rbf_row(case, "gantry, A", samples, None, True, reciprocal=False))
    return rows


def _reconstructed(plan: GantryPlan, values: np.ndarray, blend: Blend) -> np.ndarray:
    measured = subspaces(plan, np.repeat(values[:, None], 3, axis=1), _AZIMUTHS)
    return fill_thetas(measured, np.array(plan.thetas), _WANTED, blend)


def _scaled(name: str, case: str, plan: GantryPlan, blend: Blend, signal: Callable) -> StabilityRow:
    """Compare values as they are with the same values brought near 1."""
    values = signal(plan.angles())
    peak = float(values.max())
    exponent = int(np.frexp(peak)[1]) if peak > 0.0 else 0
    near_one = np.ldexp(values, -exponent)
    reference = _reconstructed(plan, near_one, blend)
    # what one unit in the last place of the values changes; of denormal ones it is large
    ulp = np.ldexp(np.spacing(values), -exponent)
    signs = np.random.default_rng(0).choice([-1.0, 1.0], len(values))
    moved = _reconstructed(plan, np.maximum(near_one + signs * ulp, 0.0), blend)
    found = _reconstructed(plan, values, blend)
    scale = max(peak, _SMALLEST)
    return method_row(
        case,
        name,
        found,
        np.ldexp(reference, exponent),
        scale,
        sensitivity=float(np.abs(moved - reference).max() + ulp.max()),
        conditioning="few digits of denormal values; a transport that may go either way round",
        negative=int(np.sum(found < 0.0)),
    )


def _turned(name: str, case: str, plan: GantryPlan, signal: Callable) -> StabilityRow:
    """Compare a material turned by 180° with the turned result, linearly between polar angles."""
    values, first = signal(plan.angles()), plan.knots().first
    slices = [values[a:b] for a, b in pairwise(first)]
    turned = np.concatenate([np.roll(one, len(one) // 2) for one in slices])
    half = (_AZIMUTHS // 2,) * 2
    return method_row(
        f"{case}, half a turn",
        name,
        _reconstructed(plan, turned, linear),
        np.roll(_reconstructed(plan, values, linear), half, axis=(2, 3)),
        max(float(values.max()), _SMALLEST),
        sensitivity=1e-11,
        conditioning="positions along slices are kept to 1e-12 rad",
    )


def _fit_rows() -> list[StabilityRow]:
    """Return the rows of the Minnaert fit: exponents found, beside those that made the values."""
    theta = np.radians(np.linspace(5.0, 80.0, 16))
    cosines = np.log(np.cos(theta) ** 2)
    rows = []
    for exponent in (-2.0, 0.0, 1e-6, 3.0, 15.0):
        for k in (1e-300, 1e-30, 1.0, 1e30):
            found = fit_minnaert(theta, theta, k * np.exp(exponent * cosines))
            rows.append(
                method_row(
                    f"exponent {exponent:g}, k = {k:g}",
                    "Minnaert fit",
                    np.array([found.exponent, found.k / k]),
                    np.array([exponent, 1.0]),
                    max(abs(exponent), 1.0),
                )
            )
    for case, values in {
        "all zero": np.zeros(16),
        "constant": np.full(16, 0.3),
        "one positive value": np.eye(16)[3],
        "one polar angle": np.full(16, 0.3),
    }.items():
        own = np.full(16, 0.7) if case == "one polar angle" else theta
        found = fit_minnaert(own, own, values)
        found_values = np.array([found.exponent, found.k])
        expected = np.array([0.0, values.mean()])
        rows.append(method_row(case, "Minnaert fit", found_values, expected, 1.0))
    return rows


def _transport_rows() -> list[StabilityRow]:
    """Return the rows of displacement: the mass half way, and both ends."""
    phi = np.arange(24) * (2.0 * np.pi / 24)
    lobe = np.exp(-((phi - 3.0) ** 2))
    spike = np.where(phi == phi[5], 1e5, 1.0)
    pairs = {
        "no mass at all": (np.zeros(24), np.zeros(24)),
        "no mass at one end": (np.zeros(24), lobe),
        "the same lobe": (lobe, lobe),
        "opposite": (lobe, np.roll(lobe, 12)),
        "across the seam": (np.roll(lobe, 12), np.roll(lobe, 14)),
        "spike": (spike, np.roll(spike, 7)),
        "five orders apart": (1e-5 * lobe, np.roll(lobe, 3)),
        "negligible at one end": (1e-20 * lobe, np.roll(lobe, 3)),
        "denormal": (1e-310 * lobe, 1e-310 * np.roll(lobe, 3)),
        "one node": (np.eye(24)[0], np.eye(24)[11]),
    }
    rows = []
    for case, (first, second) in pairs.items():
        moved = displacement(first, second, np.array([0.0, 0.5, 1.0]))
        largest = max(float(first.max()), float(second.max()), np.finfo(float).tiny)
        middle = 0.5 * (first.sum() + second.sum())
        values = np.concatenate([moved[0], moved[2], [moved[1].sum() / 24.0]])
        reference = np.concatenate([first, second, [middle / 24.0]])
        rows.append(
            method_row(
                case,
                "optimal transport",
                values,
                reference,
                largest,
                sensitivity=float(np.spacing(largest)) / largest,
                conditioning="few digits of denormal values",
                negative=int(np.sum(moved < 0.0)),
            )
        )
    return rows

"""Interpolation along highlights in the stability table: subspaces where φ_h is hard.

Hard slices (all zero, spikes five orders above their neighbours, eighteen orders, denormals) with
one and three slices of each kind, down to one sample per crossing, at polar angles that differ
widely, hardly, by rounding or not at all, next to the pole; azimuths on the slices, at the mirror
direction and within one unit in the last place of a whole turn. Float32 is compared with float64.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from simrig.core import backend
from simrig.directions.spherical import TWO_PI
from simrig.evaluation.stability.rows import StabilityRow
from simrig.evaluation.stability.subjects import FAINT
from simrig.plans.adaptive import sample_adaptively
from simrig.plans.placement import SubspacePlacement
from simrig.reconstruction.slices.highlights import (
    HighlightSubspace,
    reconstruct_subspace_along_highlights,
)

# theta_i and theta_v in degrees
_THETAS = {
    "apart": (30.0, 75.0),
    "equal": (60.0, 60.0),
    "equal but for rounding": (60.0, float(np.nextafter(60.0, 61.0))),
    "a millionth of a degree apart": (60.0, 60.000001),
    "beside the pole": (1e-6, 40.0),
}
_SLICES = (1, 3)  # of a kind
Signal = Callable[[np.ndarray], np.ndarray]


def highlight_rows(signals: Mapping[str, Signal], backend_name: str) -> list[StabilityRow]:
    """Return one row per signal, pair of polar angles and number of slices.

    Args:
        signals: angles (m, 4) to one value each, (m,).
        backend_name: ``"llvm"`` or ``"cuda"``.
    """
    from simrig.evaluation.stability.methods import method_row

    rows = []
    for name, signal in signals.items():
        for apart, degrees in _THETAS.items():
            for slices in _SLICES:
                subspace = _reconstructed(signal, degrees, slices)
                phi_i, phi_v = _azimuths(slices)
                reference = subspace.eval(phi_i, phi_v)
                single = _on_device(subspace, phi_i, phi_v, backend_name)
                scale = max(float(reference.max()), FAINT)
                rows.append(
                    method_row(
                        f"{name}, {apart}",
                        f"subspace along highlights, {slices} + {slices} slices",
                        single,
                        reference,
                        scale,
                        sensitivity=_sensitivity(subspace, phi_i, phi_v) / scale,
                        conditioning="the slope of the slices over rounded azimuths",
                        negative=int(np.sum(single < 0.0) + np.sum(reference < 0.0)),
                        single=True,
                    )
                )
    return rows


def _reconstructed(signal: Signal, degrees: tuple[float, float], slices: int) -> HighlightSubspace:
    where = SubspacePlacement(*np.radians([*degrees, 360.0 / slices]).tolist())

    def measure(angles: np.ndarray, _: np.ndarray) -> np.ndarray:
        return np.repeat(signal(angles)[:, None], 3, axis=1)

    # one slice of each kind: only the samples where they cross
    count = where.intersections + (0 if slices == 1 else 60)
    found = sample_adaptively(measure, where, count, slice_types="axial-diagonal")[0]
    return reconstruct_subspace_along_highlights(found, where, "pchip", 360)


def _azimuths(slices: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(7)
    anywhere = rng.uniform(0.0, TWO_PI, (2, 300))
    start = rng.uniform(0.0, TWO_PI, 100)
    mirror = np.stack([start, start + np.pi + 10.0 ** rng.uniform(-12.0, -1.0, 100)])
    on_slices = rng.integers(0, 2 * slices, (2, 60)) * (np.pi / slices)
    turns = rng.choice([0.0, np.pi, TWO_PI], (2, 60))
    wrap = np.abs(turns + rng.integers(-1, 2, turns.shape) * np.spacing(turns))
    phi_i, phi_v = np.concatenate([anywhere, mirror, on_slices, wrap], axis=1)
    return phi_i, phi_v


def _on_device(
    subspace: HighlightSubspace, phi_i: np.ndarray, phi_v: np.ndarray, backend_name: str
) -> np.ndarray:
    types = backend.types("float32", backend_name)
    return np.array(subspace.eval(types.Float(phi_i), types.Float(phi_v)), dtype=np.float64).T


def _sensitivity(subspace: HighlightSubspace, phi_i: np.ndarray, phi_v: np.ndarray) -> float:
    """Return the largest change of the value by what float32 does to the azimuths."""
    reference, changes = subspace.eval(phi_i, phi_v), [0.0]
    rng = np.random.default_rng(8)
    for _ in range(4):
        steps = rng.choice([-1.0, 1.0], (2, len(phi_i))) * np.float64(np.finfo(np.float32).eps)
        moved = subspace.eval(phi_i + TWO_PI * steps[0], phi_v + TWO_PI * steps[1])
        changes.append(float(np.abs(moved - reference).max()))
    return max(changes)

"""From samples at any directions to a table, by kriging of logarithms (``simrig.brdf.kriging``).

The measurement says which symmetries its plan found; of one that says nothing the symmetries are
those under which left-out samples are predicted best.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np

from simrig.brdf.kriging.choice import choose_model, final_model
from simrig.brdf.kriging.model import KrigingModel
from simrig.brdf.kriging.samples import Samples
from simrig.brdf.kriging.symmetry import Symmetry
from simrig.brdf.tables.half_difference import HalfDifferenceTable, node_angles
from simrig.plans.auto.findings import findings_of, has_findings
from simrig.plans.protocol import Measured
from simrig.reconstruction.result import Reconstructed

_ISOTROPIC_NODES, _ANISOTROPIC_NODES = 240_000, 1_500_000  # at most
_FEWEST_NODES = {True: 20_000, False: 240_000}  # isotropic or not
_NODES_PER_SAMPLE = {True: 60, False: 120}
_USUAL_RATIO = 10.0  # of the lengths of the covariance along theta_h and theta_d, at most
_TRIED_NODES, _FAR_APART = 500, 0.3  # lengths of the covariance between nodes of one block
_PROFILE_NODES = 1500  # of a curve over theta_h, some four to each of its own
# of 2 × 2 × 2 (× 2) nodes together; measured isotropic materials change within few samples
_BLOCK_NEIGHBOURS = {True: 24, False: 48}
# nodes of theta_h, phi_h, theta_d and phi_d (over full turns) to one another
_ISOTROPIC_SHAPE, _ANISOTROPIC_SHAPE = (4.0, 1.0, 1.7, 2.0), (4.0, 8.0, 3.4, 2.8)


def reconstruct_kriging(measurement: Measured) -> Reconstructed:
    """Return the table that kriging makes of a measurement.

    Args:
        measurement: samples at any directions; ``layout`` is what its plan found.

    Raises:
        SimrigError: fewer than two samples.
    """
    samples = Samples.recorded(measurement.angles, measurement.values)
    if has_findings(measurement.layout):
        findings = findings_of(measurement.layout)
        model = final_model(samples, findings.symmetry)
        said = [findings.why(), findings.predicted(), *_contradicted(samples, model)]
    else:
        model = choose_model(samples, final=True)
        said = [f"{model.symmetry.describe()} (by left-out samples)"]
    if samples.dark_beyond:
        end = np.degrees(max(samples.theta_i_max, samples.theta_v_max))
        said.append(f"black beyond {end:.1f}°, where nothing but 0 was measured")
    table = tabulated(model, measurement.material)
    return Reconstructed(table, table.stored_bytes, (*said, nodes_in_words(table)))


def _contradicted(samples: Samples, model: KrigingModel) -> list[str]:
    """Return what became of samples that others contradict, in words."""
    again, out = int(samples.again.sum()), len(samples) - len(model.samples)
    said = [f"{again} measured again"] if again else []
    said += [f"{out} left out, nothing confirms them"] if out else []
    return [f"samples that all others about them contradict: {', '.join(said)}"] if said else []


def tabulated(model: KrigingModel, name: str) -> HalfDifferenceTable:
    """Return a table of a model; blocks of up to 2 × 2 × 2 × 2 nodes share their neighbours."""
    symmetry, stretch = model.symmetry, model.coordinates.stretch
    shape = table_shape(symmetry, len(model.samples), _moved(model))
    stretch_d = model.coordinates.stretch_d
    axes = node_angles(shape, symmetry, stretch, stretch_d)
    sizes = _block_sizes(model, axes)
    first = np.meshgrid(
        *(np.arange(0, count, size) for count, size in zip(shape, sizes, strict=True)),
        indexing="ij",
    )
    nodes = np.array(  # (corners, 4, blocks)
        [
            [
                np.minimum(index.ravel() + step, count - 1)
                for index, step, count in zip(first, corner, shape, strict=True)
            ]
            for corner in product(*map(range, sizes))
        ]
    )
    angles = np.stack([axis[nodes[:, k]] for k, axis in enumerate(axes)], axis=-1)
    neighbours = min(_BLOCK_NEIGHBOURS[symmetry.isotropic], len(model.features))
    logs, _ = model.at_blocks(angles.swapaxes(0, 1), neighbours)
    values = np.empty((*shape, 3), dtype=np.float32)
    values[tuple(nodes.transpose(1, 2, 0))] = logs
    return HalfDifferenceTable(
        values,
        symmetry,
        stretch,
        model.transform.floor,
        model.transform.power,
        model.samples.theta_i_max,
        name,
        stretch_d,
        _curve(model),
        model.samples.dark_beyond,
    )


def _block_sizes(model: KrigingModel, axes: Sequence[np.ndarray]) -> list[int]:
    """Return how many nodes share neighbours along each axis: one where they are far apart."""
    rng = np.random.default_rng(0)
    places = [rng.integers(0, max(len(axis) - 1, 1), _TRIED_NODES) for axis in axes]
    own = model.coordinates(_angles_at(axes, places))
    sizes = []
    for k, axis in enumerate(axes):
        beside = [place + (k == other) for other, place in enumerate(places)]
        if len(axis) == 1:
            sizes.append(1)
            continue
        apart = np.linalg.norm(model.coordinates(_angles_at(axes, beside)) - own, axis=1)
        sizes.append(1 if np.median(apart) > _FAR_APART else 2)
    return sizes


def _angles_at(axes: Sequence[np.ndarray], places: Sequence[np.ndarray]) -> np.ndarray:
    return np.stack([axis[place] for axis, place in zip(axes, places, strict=True)], axis=-1)


def _curve(model: KrigingModel) -> np.ndarray | None:
    """Return the profile of a model at even steps of its stretched theta_h, (m, 3)."""
    if model.profile is None:
        return None
    return model.profile(model.coordinates.stretch.inverse(np.linspace(0.0, 1.0, _PROFILE_NODES)))


def _moved(model: KrigingModel) -> float:
    """Return by how much nodes are denser along theta_d, and fewer along theta_h, than usually.

    More than 1 where a material changes much faster along theta_d: light that goes back.
    """
    along_h, along_d = model.coordinates.lengths[:2]
    if not model.symmetry.isotropic:
        return 1.0
    return float(np.clip((along_h / along_d / _USUAL_RATIO) ** 0.4, 1.0, 4.0))


def table_shape(symmetry: Symmetry, samples: int, moved: float = 1.0) -> tuple[int, int, int, int]:
    """Return how many nodes a table has along theta_h, phi_h, theta_d and phi_d.

    Args:
        moved: factor of the nodes along theta_d, taken from those along theta_h.
    """
    isotropic = symmetry.isotropic
    ratios = np.array(_ISOTROPIC_SHAPE if isotropic else _ANISOTROPIC_SHAPE)
    most = _ISOTROPIC_NODES if isotropic else _ANISOTROPIC_NODES
    (turn_h, turn_d), folded = symmetry.extent, symmetry.folded
    ratios *= (1.0 / moved, 1.0, moved, 1.0)
    ratios[1] *= 1.0 if isotropic else turn_h / (2.0 * np.pi) * (0.5 if folded[0] else 1.0)
    ratios[3] *= turn_d / (2.0 * np.pi) * (0.5 if folded[1] else 1.0)
    if symmetry.bivariate:
        ratios[3] = 2.0  # the fewest that a table has, and all the same
    target = min(most, _FEWEST_NODES[isotropic] + _NODES_PER_SAMPLE[isotropic] * samples)
    scale = (target / ratios.prod()) ** (1.0 / symmetry.dimensions)
    counts = [max(round(ratio * scale), 4) for ratio in ratios]
    last = 2 if symmetry.bivariate else counts[3]
    return (counts[0], 1 if isotropic else counts[1], counts[2], last)


def nodes_in_words(table: HalfDifferenceTable) -> str:
    """Return the size of a table in words."""
    n_h, n_p, n_d, n_q = table.logs.shape[:4]
    return f"table of {n_h} × {n_p} × {n_d} × {n_q} nodes"

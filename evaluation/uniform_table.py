"""The conventional baseline: a regular table of directions, looked up by multilinear interpolation.

A rig without any adaptivity steps both arms through the same elevations and azimuths. Light and
view may change places, so each unordered pair of the D directions is measured once:
n = D·(D + 1)/2 samples; the direction at theta = 0 has one azimuth.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np

from simrig.cost import Cost
from simrig.errors import SimrigError
from simrig.reflectance.dense import DenseTable
from simrig.reflectance.protocol import Reflectance
from simrig.rigs.gonioreflectometer import Gonioreflectometer

# Candidates that use at least this share of the wished samples compete by their shape
_LEAST_SHARE = 0.85


@dataclass(frozen=True)
class UniformPlan:
    """A regular grid of directions, the same for illumination and view.

    Attributes:
        elevations: number of elevations, from 0 to theta_max.
        azimuths: number of azimuths of each elevation but 0.
        theta_max: largest elevation, in radians.
    """

    elevations: int
    azimuths: int
    theta_max: float

    @property
    def directions(self) -> int:
        """D, the number of different directions."""
        return 1 + (self.elevations - 1) * self.azimuths

    @property
    def samples(self) -> int:
        """Number of unordered pairs of directions, each of which is measured once."""
        return self.directions * (self.directions + 1) // 2

    @property
    def theta_step(self) -> float:
        """Step of the elevations, in radians."""
        return self.theta_max / (self.elevations - 1)

    def describe(self) -> str:
        """Return the steps in words."""
        return (
            f"regular grid, {math.degrees(self.theta_step):.3g}° in theta, "
            f"{360.0 / self.azimuths:.3g}° in phi, theta_max = {math.degrees(self.theta_max):g}°"
        )


def uniform_plan(samples: int, theta_max: float) -> UniformPlan:
    """Return a regular grid of at most ``samples`` samples, nearly all of them used.

    Of the grids that use 85 % of the samples or more (else: the most), the one whose neighbours
    in elevation and in azimuth are most nearly equally far apart at half of theta_max.

    Args:
        samples: wished number of samples.
        theta_max: largest elevation, in radians.

    Raises:
        SimrigError: fewer samples than the smallest grid (two elevations, three azimuths) has.
    """
    most = int((math.sqrt(8.0 * samples + 1.0) - 1.0) / 2.0)  # largest D
    plans = [
        UniformPlan(rows + 1, (most - 1) // rows, theta_max)
        for rows in range(1, max(2, most))
        if (most - 1) // rows >= 3
    ]
    if not plans:
        raise SimrigError(f"{samples} samples are too few for a regular grid, it needs at least 10")
    enough = [plan for plan in plans if plan.samples >= _LEAST_SHARE * samples]

    def unevenness(plan: UniformPlan) -> float:
        across = 2.0 * math.pi / plan.azimuths * math.sin(0.5 * theta_max)
        return abs(math.log(plan.theta_step / across))

    if enough:
        return min(enough, key=unevenness)
    return max(plans, key=lambda plan: (plan.samples, -unevenness(plan)))


def measure_uniform(
    rig: Gonioreflectometer, reflectance: Reflectance, plan: UniformPlan
) -> tuple[DenseTable, Cost]:
    """Measure a regular grid and return it as a table, with its cost.

    Where the material is not reciprocal, the measured half is the one of theta_i <= theta_v, as
    with slices.

    Args:
        rig: measures the directions.
        reflectance: the material.
        plan: the grid.

    Returns:
        The table (values (n_theta, n_theta, n_phi, n_phi, 3)) and the cost of measuring it.
    """
    start = time.perf_counter()
    n, m = plan.elevations, plan.azimuths
    theta = np.repeat(np.arange(n), m) * plan.theta_step
    theta[-m:] = plan.theta_max
    phi = np.tile(np.arange(m) * (2.0 * math.pi / m), n)
    number = np.concatenate([np.zeros(m, dtype=np.int64), 1 + np.arange((n - 1) * m)])
    place = np.concatenate([[0], np.arange(m, n * m)])  # one node of each direction
    first, second = np.triu_indices(plan.directions)
    angles = np.stack(
        [theta[place[first]], theta[place[second]], phi[place[first]], phi[place[second]]], axis=1
    )
    measured = rig.measure_directions(reflectance, angles)
    pairs = np.empty((plan.directions, plan.directions, 3))
    pairs[first, second] = measured
    pairs[second, first] = measured
    values = pairs[number[:, None], number[None, :]].reshape(n, m, n, m, 3).swapaxes(1, 2)
    table = DenseTable(
        values.astype(np.float32),
        plan.theta_step,
        plan.theta_max,
        reciprocal=True,
        name=f"{reflectance.name}, uniform",
    )
    cost = Cost(
        samples=len(measured),
        hardware_seconds=rig.timing.seconds(len(measured), adaptive=False),
        compute_seconds=time.perf_counter() - start,
        bytes=angles.nbytes + measured.nbytes,
    )
    return table, cost

"""A BRDF as kriging of the logarithms of its samples; its parameters by leaving samples out."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from simrig.brdf.kriging.coordinates import (
    Coordinates,
    half_difference_angles,
    prior_of,
    stretch_of_theta_d,
)
from simrig.brdf.kriging.displayed import displayed_pairs, typical_level
from simrig.brdf.kriging.likelihood import NEAR, likeliest, others
from simrig.brdf.kriging.local import predict
from simrig.brdf.kriging.profile import Profile
from simrig.brdf.kriging.samples import Samples
from simrig.brdf.kriging.symmetry import Symmetry

_FEWEST = 6  # samples; the parameters of fewer are the expected ones
_LEFT_OUT, _MOST_LEFT_OUT = 300, 1000  # samples whose prediction chooses the parameters
_STEPS, _FINAL_STEPS = 5, 8  # of the search for the parameters
_LEVEL_PAIRS = 2048
_FLOORS = {True: 0.01, False: 0.001}  # of the logarithm, over the level: isotropic or not
_LOWEST_FLOOR, _DARKEST = 1e-6, 0.5  # over the level; the percentile of values that is dark


@dataclass(frozen=True)
class Transform:
    """From f_r to what is interpolated and back: log(f_r · cos(theta_i)^power + floor).

    Attributes:
        floor: in the unit of f_r; what is far below it shows in no picture.
        power: 1, or 0 where the cosine of one direction would break reciprocity.
    """

    floor: float
    power: int

    def forward(self, values: np.ndarray, cos_i: np.ndarray) -> np.ndarray:
        """Return the logarithms (n, 3) of f_r (n, 3) at the cosines (n,)."""
        return np.asarray(np.log(values * cos_i[:, None] ** self.power + self.floor))

    def radiance(self, logs: np.ndarray) -> np.ndarray:
        """Return f_r · cos(theta_i)^power of logarithms, >= 0."""
        return np.maximum(np.exp(logs) - self.floor, 0.0)


@dataclass(frozen=True, eq=False)
class KrigingModel:
    """Samples with coordinates in which their logarithms are interpolated.

    Attributes:
        transform: to logarithms.
        level: typical f_r · cos(theta_i)^power in a picture.
        parameters: of the coordinates, to start another fit from.
        profile: a curve of theta_h that the logarithms hold beside what is interpolated.
    """

    samples: Samples
    coordinates: Coordinates
    transform: Transform
    level: float
    parameters: np.ndarray
    profile: Profile | None = None

    @cached_property
    def logs(self) -> np.ndarray:
        """(n, 3) logarithms of the samples."""
        return self.transform.forward(self.samples.values, self.samples.wi[:, 2])

    @cached_property
    def interpolated(self) -> np.ndarray:
        """(n, 3) of them what is interpolated: all but the profile."""
        return self.logs - self._profile_at(self.samples_angles)

    @cached_property
    def samples_angles(self) -> np.ndarray:
        """The half-difference angles (n, 4) of the samples."""
        return half_difference_angles(self.samples.wi, self.samples.wv, self.symmetry.axis)

    @cached_property
    def features(self) -> np.ndarray:
        """(i·n, f) coordinates of the samples and of their images."""
        return self.coordinates(self.symmetry.images(self.samples_angles))

    @cached_property
    def tree(self) -> cKDTree:
        """Of the features."""
        return cKDTree(self.features)

    @property
    def symmetry(self) -> Symmetry:
        return self.coordinates.symmetry

    @property
    def neighbours(self) -> int:
        """How many samples (or images) predict a value."""
        return min(32 if self.symmetry.isotropic else 40, len(self.features))

    def at(self, angles: np.ndarray, neighbours: int | None = None) -> tuple[np.ndarray, ...]:
        """Return logarithms (n, 3) and their relative deviations (n,) at angles (n, 4)."""
        logs, spread = self.at_blocks(angles[:, None, :], neighbours)
        return logs[:, 0] + self._profile_at(angles), spread[:, 0]

    def at_blocks(
        self, angles: np.ndarray, neighbours: int | None = None
    ) -> tuple[np.ndarray, ...]:
        """Return the same, but for the profile, of groups of angles (b, p, 4).

        Each group has one set of neighbours.

        Returns:
            (b, p, 3) logarithms and (b, p) deviations.
        """
        points = self.coordinates(angles.reshape(-1, 4)).reshape(*angles.shape[:2], -1)
        count = min(neighbours or self.neighbours, len(self.features))
        _, near = self.tree.query(points.mean(axis=1), k=count)
        near = near.reshape(len(points), count)
        return predict(self.features, self._of_images, points, near, self.coordinates.nugget)

    @property
    def _of_images(self) -> np.ndarray:
        """(i·n, 3) what is interpolated, of the samples and their images."""
        return np.tile(self.interpolated, (len(self.features) // len(self.samples), 1))

    def _profile_at(self, angles: np.ndarray) -> np.ndarray | float:
        return 0.0 if self.profile is None else self.profile(angles[:, 0])

    @cached_property
    def left_out(self) -> tuple[np.ndarray, np.ndarray]:
        """What all other samples say of each, less the sample, and the deviation expected.

        (n, 3) differences of logarithms and (n,) deviations over that of the signal.
        """
        own = np.arange(len(self.samples))
        return self.without(own, own[:, None])

    def without(self, own: np.ndarray, excluded: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the same of samples ``own`` (m,), predicted without those ``excluded`` (m, e)."""
        points, near = self.features[own][:, None, :], self.nearest(own, excluded, NEAR)
        nugget = self.coordinates.nugget
        made, spread = predict(self.features, self._of_images, points, near, nugget)
        return made[:, 0] - self.interpolated[own], spread[:, 0]

    def nearest(self, own: np.ndarray, excluded: np.ndarray, wanted: int) -> np.ndarray:
        """Return the nearest features to samples ``own``, of none ``excluded``, (m, k)."""
        return others(self.tree, self.features[own], excluded, len(self.samples), wanted)


def fit_model(
    samples: Samples,
    symmetry: Symmetry,
    start: np.ndarray | None = None,
    steps: int = _STEPS,
    final: bool = False,
    profile: Profile | None = None,
) -> KrigingModel:
    """Return the model whose parameters predict left-out samples best.

    Args:
        samples: at least two.
        symmetry: which images they have.
        start: parameters to start from; by default the expected ones.
        steps: of the search (``likeliest``).
        final: leave more samples out, and search longer.
        profile: what of the logarithms is not interpolated.
    """
    power = 0 if symmetry.reciprocal else 1
    angles = half_difference_angles(samples.wi, samples.wv, symmetry.axis)
    prior = prior_of(symmetry)
    images = symmetry.images(angles)
    stretch_d = stretch_of_theta_d(angles, samples.values)
    expected = prior.coordinates(prior.mean, symmetry, stretch_d)
    level = _level(samples, expected(images), expected, power)
    floor = _FLOORS[symmetry.isotropic] * level
    dark = float(np.percentile(samples.values, _DARKEST))
    if dark > 0.0 and not symmetry.isotropic:  # channels that are dark, and not black
        floor = min(floor, max(0.1 * dark, _LOWEST_FLOOR * level))
    transform = Transform(floor, power)
    parameters = prior.mean if start is None or len(start) != len(prior.mean) else start
    model = KrigingModel(samples, expected, transform, level, parameters, profile)
    if len(samples) >= _FEWEST:
        chosen = np.random.default_rng(0).permutation(len(samples))
        chosen = chosen[: _MOST_LEFT_OUT if final else _LEFT_OUT]
        logs = model.interpolated
        steps = _FINAL_STEPS if final else steps
        parameters = likeliest(images, logs, chosen, expected, parameters, steps)
    coordinates = prior.coordinates(parameters, symmetry, stretch_d)
    return replace(model, coordinates=coordinates, parameters=parameters)


def _level(samples: Samples, features: np.ndarray, expected: Coordinates, power: int) -> float:
    """Return the typical radiance of a picture, by the nearest sample of each of its pairs."""
    wi, wv = displayed_pairs(_LEVEL_PAIRS, samples.theta_i_max, samples.theta_v_max)
    angles = half_difference_angles(wi, wv, expected.symmetry.axis)
    _, near = cKDTree(features).query(expected(angles))
    near = near % len(samples)
    cosines = samples.wi[near, 2:] ** power
    return typical_level(samples.values[near] * cosines)

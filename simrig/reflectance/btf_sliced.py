"""A BTF from a few images: every pair's image as a weighted sum of measured ones.

A gantry measures slices of 168 images in place of 6,561 (thesis section 6.3.5). A method that is
linear in the measured values has the same weights for every texel and channel, so a whole
BTF is the measured images and one matrix. Methods that are not linear (moving or warping
highlights, displacement interpolation, a fitted model, logarithms) have no such matrix and are
refused: they have to be run per texel, and their result is a stack like any other.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from simrig.errors import SimrigError
from simrig.reflectance.btf import BtfStack

_LINEAR = 1e-5  # largest deviation from linearity, relative to the largest value
_PROBES = 4  # random inputs that a method is tried on
_IGNORED = 1e-12  # of a weight


class WeightedImages:
    """The product of weights and images, made row by row when it is asked for; never negative.

    Weights may be negative, reflectance may not: what falls below zero is black there.

    Args:
        weights: (pairs, s).
        images: (s, H, W, 3).
    """

    dtype = np.dtype(np.float32)

    def __init__(self, weights: np.ndarray, images: np.ndarray):
        self.weights = np.ascontiguousarray(weights, dtype=np.float32)
        self.images = np.ascontiguousarray(images, dtype=np.float32)

    @property
    def shape(self) -> tuple[int, ...]:
        """Of the product."""
        return (len(self.weights), *self.images.shape[1:])

    def __getitem__(self, key: Any) -> np.ndarray:
        rows, *rest = key if isinstance(key, tuple) else (key,)
        images = self.images[(slice(None), *rest)]
        return np.maximum(np.tensordot(self.weights[rows], images, (-1, 0)), 0.0)


def linear_weights(
    method: Callable[[np.ndarray], np.ndarray], count: int, seed: int = 0
) -> np.ndarray:
    """Return the matrix of a reconstruction method that is linear in the measured values.

    Args:
        method: takes values of shape (count,), returns those of all pairs, shape (pairs,).
        count: number of measured values.
        seed: of the inputs on which linearity is tried.

    Returns:
        Weights of shape (pairs, count).

    Raises:
        SimrigError: the method is not linear, with how far it is off.
    """
    unit = np.eye(count)
    weights = np.stack([np.asarray(method(row), dtype=np.float64) for row in unit], axis=1)
    rng = np.random.default_rng(seed)
    for values in rng.random((_PROBES, count)):
        expected = weights @ values
        found = np.asarray(method(values), dtype=np.float64)
        off = np.abs(found - expected).max() / max(float(np.abs(expected).max()), 1e-300)
        if not off <= _LINEAR:
            raise SimrigError(
                f"the method is not linear (off by {100 * off:.2g} % of its largest value): "
                "reconstruct each texel by itself"
            )
    return np.where(np.abs(weights) > _IGNORED, weights, 0.0)


def sliced_stack(measured: BtfStack, weights: np.ndarray, angles: np.ndarray) -> BtfStack:
    """Return the stack of all pairs that a few measured images make; it takes no more memory.

    Args:
        measured: the images of the slices; held in memory as float32.
        weights: (pairs, images), as from ``linear_weights``.
        angles: theta_i, theta_v, phi_i, phi_v of the pairs in radians, shape (pairs, 4).

    Raises:
        SimrigError: weights that do not fit the images, or are not finite.
    """
    if np.shape(weights) != (len(angles), len(measured)) or not np.all(np.isfinite(weights)):
        raise SimrigError(
            f"{len(measured)} images and {len(angles)} pairs need finite weights of shape "
            f"({len(angles)}, {len(measured)}), got {np.shape(weights)}"
        )
    images = np.concatenate([block for _, block in measured.blocks()])
    return BtfStack(
        WeightedImages(weights, images),
        angles,
        measured.size_mm,
        f"{measured.name}, from {len(measured)} images",
        {**measured.provenance, "images": len(measured)},
    )

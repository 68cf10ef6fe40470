"""Direction pairs that hypothesis draws: extreme floats that no list would think of."""

from __future__ import annotations

import numpy as np

from simrig.evaluation.stability.hard_cases import HardCase

FUZZ_PAIRS = 128


def fuzz_cases(count: int = FUZZ_PAIRS, seed: int = 0) -> list[HardCase]:
    """Return the case ``fuzz``, or nothing where hypothesis is not installed.

    hypothesis is a tool of development (``pip install simrig[dev]``). What the list of hard cases
    holds without it includes random bit patterns.

    Args:
        seed: another one draws other pairs.
    """
    try:
        pairs = _draw(count, seed)
    except ImportError:
        return []
    return [HardCase("fuzz", "drawn by hypothesis, many at special floats", *pairs)]


def _draw(count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    import hypothesis
    from hypothesis import strategies

    component = strategies.floats(-1.0, 1.0)
    height = strategies.floats(0.0, 1.0, exclude_min=True)
    direction = strategies.tuples(component, component, height)
    found: list[tuple] = []

    @hypothesis.seed(seed)
    @hypothesis.settings(
        max_examples=count,
        database=None,
        deadline=None,
        phases=[hypothesis.Phase.generate],
        suppress_health_check=list(hypothesis.HealthCheck),
    )
    @hypothesis.given(direction, direction)
    def collect(wi: tuple, wv: tuple) -> None:
        found.append((wi, wv))

    collect()
    pairs = np.array(found, dtype=np.float64)
    return unit(pairs[:, 0]), unit(pairs[:, 1])


def unit(v: np.ndarray) -> np.ndarray:
    """Return vectors (n, 3) of any length, denormal ones too, scaled to unit length."""
    largest = np.abs(v).max(axis=-1, keepdims=True)
    _, exponent = np.frexp(largest)
    scaled = np.ldexp(v, -exponent)  # exact, where a division by a denormal would overflow
    return scaled / np.linalg.norm(scaled, axis=-1, keepdims=True)

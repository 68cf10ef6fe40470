"""A chair with armrests: cushions of one material, a frame of another.

x to the right of who looks at it, y up, z to its front; it stands on y = 0; millimetres.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np

from simrig.scenes.meshes import Surface, joined, rounded_box

WIDTH, DEPTH = 520.0, 520.0  # mm, between the outer sides of the legs
_SEAT, _ARM = 430.0, 650.0  # heights of the seat's underside and of the arms' middle
_LEG = 42.0  # mm, across
_LEAN_DEG = 12.0  # of the back
_UPRIGHT = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])  # z of a box becomes up
_ACROSS = np.array([[0, 0, 1], [0, 1, 0], [-1, 0, 0]])  # z of a box becomes right
_FORWARD = np.eye(3)


@cache
def cushions() -> Surface:
    """Return seat and back, stuffed and rounded; v runs away from the front and up."""
    inside = WIDTH - 2.0 * _LEG
    seat = rounded_box((inside - 6.0, 470.0, 110.0), 38.0, crown=22.0, flat_steps=10)
    back = rounded_box((inside - 6.0, 470.0, 90.0), 36.0, crown=20.0, flat_steps=10)
    return joined(
        [
            seat.moved(_UPRIGHT, (0.0, _SEAT + 55.0, 10.0)),
            back.moved(_lean(), (0.0, _SEAT + 350.0, -238.0)),
        ]
    )


@cache
def frame() -> Surface:
    """Return legs, rails, posts and arms; the grain (v) runs along each."""
    bars = []
    for side in (-1.0, 1.0):
        x = side * (WIDTH - _LEG) / 2.0
        front, behind = (DEPTH - _LEG) / 2.0, -(DEPTH - _LEG) / 2.0
        bars += [
            _bar((_LEG, _LEG, _ARM), _UPRIGHT, (x, _ARM / 2.0, front)),
            _bar((_LEG, _LEG, _SEAT + 20.0), _UPRIGHT, (x, _SEAT / 2.0 + 10.0, behind)),
            _bar((_LEG, _LEG, 600.0), _lean() @ _UPRIGHT, (x, _SEAT + 290.0, behind - 58.0)),
            _bar((56.0, 26.0, DEPTH + 70.0), _FORWARD, (x, _ARM + 13.0, -20.0)),
            _bar((26.0, 60.0, DEPTH - _LEG), _FORWARD, (x, _SEAT - 32.0, 0.0)),
        ]
    inside = WIDTH - _LEG
    bars += [
        _bar((26.0, 60.0, inside), _ACROSS, (0.0, _SEAT - 32.0, (DEPTH - _LEG) / 2.0)),
        _bar((26.0, 60.0, inside), _ACROSS, (0.0, _SEAT - 32.0, -(DEPTH - _LEG) / 2.0)),
        _bar((26.0, 50.0, inside), _ACROSS, (0.0, _SEAT + 560.0, -350.0)),
    ]
    return joined(bars)


def _bar(size: Sequence[float], rotation: np.ndarray, centre: Sequence[float]) -> Surface:
    """Return a bar of wood, its length along z before it is turned."""
    return rounded_box(size, 6.0).moved(rotation, centre)


def _lean() -> np.ndarray:
    """Return the rotation that leans the top of the back away from the front."""
    angle = -np.radians(_LEAN_DEG)
    cos, sin = np.cos(angle), np.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, cos, -sin], [0.0, sin, cos]])

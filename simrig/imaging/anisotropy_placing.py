"""How a picture is turned, by what it repeats itself: alignment without a reference."""

from __future__ import annotations

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize_scalar

from simrig.core.blas import one_thread
from simrig.imaging.anisotropy import Lighting, block_values
from simrig.imaging.anisotropy_opening import Opening, cut_out

_STEP_DEG = 3.0
_BESIDE_DEG = 7.5  # turns so near to the best one are no others
_EXACT_DEG = 0.02
_CLEAR = 0.5  # of what any other turn leaves
_COARSE = 4  # of so many blocks the search looks at one
_NOISE = 1e-5  # variance of the values, for what is expected of the unknowns


@one_thread()
def turn_of(photograph: np.ndarray, opening: Opening, lighting: Lighting) -> float | None:
    """Return by how many degrees, counter-clockwise, the light of a photograph is turned.

    Light that is turned against the model's shows rings and caustics where no material can have
    any: the turn is that which leaves least of the picture unexplained. Highlights that are sharper
    than the unknowns can be leave much of it anyway.

    Args:
        photograph: (height, width, 3) linear RGB, NaN where unknown.
        opening: in it.
        lighting: of the picture that is cut out.

    Returns:
        The turn against the lighting's flash; None where too little of the picture is known, or no
        turn stands out.
    """
    system = lighting.system

    def unexplained(turn_deg: float, some: int = 1) -> float:
        picture = cut_out(photograph, opening, lighting.pixels, turn_deg=turn_deg)
        seen, known = block_values(picture, lighting)
        if known.sum() < 0.5 * len(known):
            return np.inf
        values = seen[known][::some] / seen[known].mean() - 1.0
        matrix = system.matrix[known][::some]
        gram = system.gram if len(matrix) == len(known) else matrix.T @ matrix
        factor = cho_factor(gram + np.diag(_NOISE / system.expected**2))
        left = values - matrix @ cho_solve(factor, matrix.T @ values)
        return float(np.mean(left**2))

    turns = np.arange(0.0, 360.0, _STEP_DEG)
    errors = np.array([unexplained(turn, _COARSE) for turn in turns])
    best = float(turns[np.argmin(errors)])
    if not np.isfinite(errors).all():
        return None  # the analysis says what is wrong
    found = minimize_scalar(
        unexplained,
        bounds=(best - _STEP_DEG, best + _STEP_DEG),
        method="bounded",
        options={"xatol": _EXACT_DEG},
    )
    others = np.abs((turns - best + 180.0) % 360.0 - 180.0) > _BESIDE_DEG
    return float(found.x) if found.fun < _CLEAR * errors[others].min() else None

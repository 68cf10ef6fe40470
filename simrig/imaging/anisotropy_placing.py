"""How a picture is turned, by what it repeats itself: alignment without a reference."""

from __future__ import annotations

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize_scalar

from simrig.core.blas import one_thread
from simrig.imaging.anisotropy import Lighting, block_values
from simrig.imaging.anisotropy_opening import Opening, cut_out

_LARGEST_DEG = 14.0
_STEP_DEG = 1.0
_EXACT_DEG = 0.02
_CLEAR = 0.5  # least share of what was unexplained that a turn leaves
_NOISE = 1e-5  # variance of the values, for what is expected of the unknowns


@one_thread()
def turn_of(photograph: np.ndarray, opening: Opening, lighting: Lighting) -> float:
    """Return by how many degrees, counter-clockwise, the light of a photograph is turned.

    Light that is turned against the model's shows rings and caustics where no material can have
    any: the turn is that which leaves least of the picture unexplained. Highlights that are sharper
    than the unknowns can be leave much of it anyway; then nothing is turned.

    Args:
        photograph: (height, width, 3) linear RGB, NaN where unknown.
        opening: in it.
        lighting: of the picture that is cut out, its flash some degrees from the photograph's.

    Returns:
        The turn, within ±14; 0 where too little of the picture is known, or no turn stands out.
    """
    system = lighting.system

    def unexplained(turn_deg: float) -> float:
        picture = cut_out(photograph, opening, lighting.pixels, turn_deg=turn_deg)
        seen, known = block_values(picture, lighting)
        if known.sum() < 0.5 * len(known):
            return 0.0  # the analysis says what is wrong
        values = seen[known] / seen[known].mean() - 1.0
        matrix = system.matrix[known]
        gram = system.gram if known.all() else matrix.T @ matrix
        factor = cho_factor(gram + np.diag(_NOISE / system.expected**2))
        left = values - matrix @ cho_solve(factor, matrix.T @ values)
        return float(np.mean(left**2))

    turns = np.arange(-_LARGEST_DEG, _LARGEST_DEG + 0.5 * _STEP_DEG, _STEP_DEG)
    errors = [unexplained(turn) for turn in turns]
    least = int(np.argmin(errors))
    if least in (0, len(turns) - 1):
        return 0.0
    found = minimize_scalar(
        unexplained,
        bounds=(turns[least - 1], turns[least + 1]),
        method="bounded",
        options={"xatol": _EXACT_DEG},
    )
    return float(found.x) if found.fun < _CLEAR * np.median(errors) else 0.0

"""Mitsuba's samplers: which numbers of samples each can draw."""

from __future__ import annotations

from simrig.core.errors import SimrigError, unknown_name

SAMPLERS = ("independent", "stratified", "multijitter", "orthogonal", "ldsampler")
_PRIMES = (2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37, 41, 43, 47, 53, 59, 61)


def samples_for(sampler: str, wanted: int) -> int:
    """Return a number of samples per pixel near ``wanted`` that a sampler draws without rounding.

    ``orthogonal`` takes squares of primes only (Jarosz et al. 2019), ``ldsampler`` at least 4;
    otherwise all take every power of four, to which ``stratified`` and ``ldsampler`` round.

    Raises:
        SimrigError: an unknown sampler, or a number that is no power of four (4096 at most).
    """
    if sampler not in SAMPLERS:
        raise unknown_name("sampler", sampler, SAMPLERS)
    if wanted not in (1, 4, 16, 64, 256, 1024, 4096):
        raise SimrigError(f"samplers are compared at powers of 4 up to 4096, got {wanted}")
    if sampler == "orthogonal":
        return min((prime**2 for prime in _PRIMES), key=lambda count: abs(count - wanted))
    return max(wanted, 4) if sampler == "ldsampler" else wanted

"""Effects of filming, beside those of a camera that takes single pictures."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from simrig.brdf.protocol import evaluate
from simrig.directions.spherical import to_vector
from simrig.instruments.description import GantryDescription
from simrig.rigs.direct.effects import RigSubject
from simrig.rigs.imaging.effects import EFFECTS, Bounding, PictureEffect, Subject

# what a video has whatever happens (eight bits), and what is not simulated in one
_LEFT = ("quantisation", "light-size", "aperture-size", "drift", "defects", "dark-current")


def film_effects(description: GantryDescription) -> tuple[PictureEffect, ...]:
    """Return the effects of an instrument that films.

    What changes where things are seen, or what eight bits make of it, has no bound and stays on.
    """
    film = description.film
    assert film is not None

    def there(value: float) -> bool:
        return value != 0.0

    def whole(share: float, said: str) -> Bounding:
        return lambda _, direct: (share * direct.values, said)

    sweep = 2.0 * np.pi * film.shutter_s.value / description.timing.slice_s.value

    def blurred(_: Subject, direct: RigSubject) -> tuple[np.ndarray, str]:
        ends = []
        for side in (-0.5, 0.5):
            turn = np.array([0.0, 0.0, -side * sweep, side * sweep])
            theta_i, theta_v, phi_i, phi_v = (direct.angles + turn).T
            wi, wv = to_vector(theta_i, phi_i), to_vector(theta_v, phi_v)
            ends.append(np.abs(evaluate(direct.brdf, wi, wv) - direct.values))
        return np.maximum(*ends), f"arms turn by {np.degrees(sweep):.2g}° while a frame is exposed"

    drift, mixed = film.drift_ev.value, film.crosstalk.value
    rows: tuple[tuple[str, str, bool, Bounding | None], ...] = (
        ("motion-blur", "arms that move while a frame is exposed", True, blurred),
        ("vibration", "a shaken camera", there(film.vibration_deg.value), None),
        (
            "auto-exposure",
            "an exposure that adapts and strays",
            True,
            whole(2.0**drift, f"strays by {drift:g} EV and follows the brightness"),
        ),
        (
            "camera-colours",
            "colours that the camera mixes",
            there(mixed),
            whole(2.0 * mixed, f"{100 * mixed:g} % of the other colours"),
        ),
        ("occlusion", "the light's arm before the camera", True, None),
        ("compression", "M-JPEG", film.quality < 100, None),
    )
    own = tuple(PictureEffect(name, said, _known(on), bound) for name, said, on, bound in rows)
    return (*(effect for effect in EFFECTS if effect.name not in _LEFT), *own)


def _known(on: bool) -> Callable[[Subject], bool]:
    return lambda _: on


def checked(description: GantryDescription) -> GantryDescription:
    """Return a description whose sensor has the bits that it converts with before it encodes."""
    camera, film = description.camera, description.film
    assert camera is not None and film is not None
    black = camera.black_DN.model_copy(update={"value": 2.0 ** (film.raw_bits - 6)})
    update = {"bits": film.raw_bits, "black_DN": black, "K_DN_e": None}
    return description.model_copy(update={"camera": camera.model_copy(update=update)})

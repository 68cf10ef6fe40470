"""How surfaces reflect: built-in Mitsuba BSDFs as plain dictionaries that take a part's colours.

In Mitsuba's ``principled`` an anisotropic lobe is wide along the tangent u and narrow across it.
Parts of fibres therefore let u run *across* the fibres: a bundle of cylinders scatters around
its axis and hardly along it.
"""

from __future__ import annotations

from typing import Any

from simrig.mesostructure.tile import COLOURS


def fibre(
    roughness: float = 0.6,
    anisotropic: float = 0.7,
    sheen: float = 0.3,
    transmission: float = 0.0,
    tint: float = 0.3,
) -> dict[str, Any]:
    """Return the look of fibres.

    Args:
        roughness: 0.25 for filaments such as silk and nylon, 0.5 and more for staple fibres.
        anisotropic: 0 to 1, how much narrower the lobe is along the fibre.
        sheen: brightening at grazing angles by what sticks out of a fibre.
        transmission: share of the diffuse light that goes through, 0 to 1.
        tint: how much of the colour the gloss takes on, 0 to 1.
    """
    look: dict[str, Any] = {
        "base_color": COLOURS,
        "roughness": roughness,
        "anisotropic": anisotropic,
        "sheen": sheen,
        "sheen_tint": 0.5,
        "spec_tint": tint,
    }
    if transmission > 0.0:
        # of ``principledthin`` 2 stands for everything
        return {"type": "principledthin", "diff_trans": 2.0 * transmission, "eta": 1.5, **look}
    return {"type": "principled", "specular": 0.5, **look}


def solid(
    roughness: float, specular: float = 0.5, clearcoat: float = 0.0, anisotropic: float = 0.0
) -> dict[str, Any]:
    """Return the look of an opaque, closed surface with a colour below a gloss.

    Args:
        roughness: of the gloss, 0 to 1.
        specular: its strength; 0.5 is a refractive index of 1.5.
        clearcoat: strength of a thin, smooth coat on top.
        anisotropic: see ``fibre``.
    """
    return {
        "type": "principled",
        "base_color": COLOURS,
        "roughness": roughness,
        "specular": specular,
        "clearcoat": clearcoat,
        "clearcoat_gloss": 0.9,
        "anisotropic": anisotropic,
    }

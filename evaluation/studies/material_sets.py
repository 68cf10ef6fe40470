"""The sets of Kurt materials that studies show side by side: as printed, and rescaled."""

from __future__ import annotations

from collections.abc import Sequence

from simrig.brdf import KURT_MATERIALS


def material_sets(materials: Sequence[str]) -> dict[str, list[str]]:
    """Divide materials of Table D.1 into the printed set and the one with inferred factors.

    Args:
        materials: names; those of the inferred set end with ``_rescaled``.

    Returns:
        ``as printed``, and, where any is rescaled, ``rescaled``: these in the place of their
        printed ones, with the one-lobe materials. A set that would be empty is left out.
    """
    doubled = [name.removesuffix("_rescaled") for name in materials if name.endswith("_rescaled")]
    sets = {"as printed": [name for name in materials if name in KURT_MATERIALS]}
    if doubled:
        sets["rescaled"] = [name for name in materials if name not in doubled]
    return {about: names for about, names in sets.items() if names}

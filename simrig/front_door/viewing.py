"""Materials side by side in the browser."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import TYPE_CHECKING, Any

from simrig.brdf.protocol import Brdf
from simrig.core.errors import SimrigError
from simrig.front_door.materials import as_brdf, load
from simrig.front_door.pictures import looked_up
from simrig.rigs.measurements.measurement import Measurement
from simrig.web.viewer.page import Shown

if TYPE_CHECKING:
    from simrig.web.viewer.opening import Viewer


def view(*materials: Any, measurement: Measurement | None = None, port: int = 0) -> Viewer:
    """Show materials side by side in the browser.

    Args:
        materials: BRDFs and BTFs, their names or their files.
        measurement: whose sample positions are drawn on the pictures of the subspaces.
        port: 0 takes a free one.

    Returns:
        The viewer that runs: ``address`` is to be opened in a browser, ``stop()`` ends it. It is
        reached from this machine only.

    Raises:
        SimrigError: no material, or what ``load`` refuses.
    """
    from simrig.web.viewer.opening import Viewer  # starting a server takes a second

    viewer = Viewer(shown_of(materials, measurement), port)
    threading.Thread(target=viewer.serve, name="viewer", daemon=True).start()
    return viewer


def shown_of(materials: Any, measurement: Measurement | None = None) -> list[Shown]:
    """Return materials as the viewer shows them.

    Raises:
        SimrigError: none or too many of them, or what ``load`` refuses.
    """
    if not 1 <= len(materials) <= 8:
        raise SimrigError(f"give one to eight materials, got {len(materials)}")
    found = []
    for material in materials:
        brdf = _brdf_of(material)
        name = material if isinstance(material, str | Path) else brdf.name
        found.append(Shown(brdf.name, brdf, str(name), measurement))
    return found


def _brdf_of(material: Any) -> Brdf:
    """Return a BRDF, or a BTF as what is looked up over footprints and has a BRDF in the mean."""
    is_file = isinstance(material, str | Path) and Path(material).is_file()
    item = load(material) if is_file else material
    return as_brdf(looked_up(item))

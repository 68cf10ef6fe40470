"""The materials of Table D.1 as a database, for what has to run without one that was built."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from simrig.brdf import KURT_MATERIALS, kurt_material
from simrig.brdf.tables.resample import resample_dense
from simrig.database.known import Known
from simrig.database.store import Database
from simrig.files.hdf5 import write_brdf

_AZIMUTHS = 24
_kept: list[TemporaryDirectory] = []  # removed when the process ends


@lru_cache(maxsize=1)
def built_in() -> Known:
    """Return a database of the ten materials on a grid of 15° × 15°; families are their kinds."""
    place = TemporaryDirectory(prefix="simrig-database-")
    _kept.append(place)
    for name in KURT_MATERIALS:
        kind = "fabric" if "fabric" in name or "satin" in name else "other"
        folder = Path(place.name) / kind
        folder.mkdir(exist_ok=True)
        brdf = kurt_material(name)
        table = resample_dense(brdf, np.radians(15.0), _AZIMUTHS, np.radians(75.0))
        write_brdf(folder / f"{name}.h5", table)
    database = Database.open(place.name)
    return Known(database, database.fingerprint)

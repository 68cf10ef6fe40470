"""Build the virtual database: measure the collection with the BTF rig, average, resample, align.

Thesis section A.4. A material is finished when its files stand and the index names it, so a build
that was interrupted goes on from there, and a small database grows into the whole one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from simrig.brdf.protocol import Brdf
from simrig.brdf.tables.barycentric import BarycentricBrdf
from simrig.core.errors import SimrigError
from simrig.core.progress import Progress
from simrig.database.resampling import resampled, shift_to, turned
from simrig.database.store import INDEX, Database, read_index, write_index
from simrig.directions.schemes import hemisphere_81
from simrig.evaluation.database.character import characterised
from simrig.evaluation.studies.engine.run import finished_cells
from simrig.files.atomic import atomic_write
from simrig.files.hdf5 import read_brdf, write_brdf
from simrig.files.utia import write_utia_exr
from simrig.mesostructure.collection import WHOLE, collection

RAW, UTIA = "raw", "utia"  # folders of what was measured, and of the tables in UTIA's layout
TEXELS, SPP = 32, 4  # of an image that is averaged


def build_database(
    folder: str | Path,
    count: int = WHOLE,
    seed: int = 0,
    *,
    texels: int = TEXELS,
    spp: int = SPP,
    scheduler: str | None = None,
    workers: int = 1,
    progress: Progress | None = None,
) -> Database:
    """Build a virtual database, or what is missing of it.

    Args:
        folder: where it stands; made if need be.
        count: materials, up to 150.
        seed: of the materials and of the samples.
        scheduler, workers: see ``run_study``.

    Raises:
        SimrigError: numbers that cannot be, a folder of something else or of other settings.
    """
    recipes = {recipe.name: recipe for recipe in collection(count, seed)}
    settings = {"seed": int(seed), "texels": int(texels), "spp": int(spp)}
    folder = Path(folder)
    done = _begun(folder, settings)
    report = progress or (lambda *_: None)
    left = [{"name": name} for name in recipes if name not in done]
    report(len(recipes) - len(left), len(recipes))
    config = {**settings, "count": int(count)}
    for cell, rows, seconds in finished_cells(measure_recipe, config, left, scheduler, workers):
        recipe = recipes[cell["name"]]
        entry = {
            "name": recipe.name,
            "category": recipe.category,
            "generator": recipe.generator,
            "noise": rows[0]["noise"],
            "seconds": round(seconds, 2),
        }
        done[recipe.name] = entry | _kept(folder, recipe.name, rows[0]["values"], settings)
        write_index(folder, settings, [done[name] for name in sorted(done)])
        report(sum(name in done for name in recipes), len(recipes))
    return Database.open(folder)


def measure_recipe(config: Mapping[str, Any], cell: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Measure one material at 81 × 81 directions (a cell, as studies run them).

    Returns:
        One row: ``values`` (81, 81, 3) f_r, light first, and ``noise``, the standard error of the
        averages over their mean.
    """
    from simrig.rigs.btf.rig import btf_angles, measure_btf

    recipe = {r.name: r for r in collection(config["count"], config["seed"])}[cell["name"]]
    stack = measure_btf(
        recipe.tile(),
        resolution=(config["texels"], config["texels"]),
        spp=config["spp"],
        bounces=recipe.bounces,
        seed=config["seed"],
        dtype=np.float32,
    )
    means = stack.mean().values
    scheme = hemisphere_81()
    count = len(scheme)
    if len(means) != count**2 or not np.allclose(stack.angles, btf_angles()):
        raise SimrigError(f"'{recipe.name}' was not measured at 81 × 81 directions")
    values = means.reshape(count, count, 3).swapaxes(0, 1)  # measured view by view
    mean = max(float(values.mean()), np.finfo(np.float32).tiny)
    texels = float(config["texels"]) ** 2
    noise = float(stack.provenance["standard_error"] or 0.0) / np.sqrt(texels) / mean
    return [{"values": values.astype(np.float32), "noise": round(noise, 5)}]


def _begun(folder: Path, settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return the finished materials of a folder by name; make the folder where there is none."""
    if folder.exists() and not folder.is_dir():
        raise SimrigError(f"'{folder}' is a file: name a folder for the database")
    done: dict[str, Any] = {}
    if (folder / INDEX).is_file():
        index = read_index(folder)
        if index["settings"] != dict(settings):
            raise SimrigError(
                f"'{folder}' was built with {index['settings']}, asked for is {dict(settings)}: "
                "name another folder"
            )
        done = {one["name"]: one for one in index["materials"]}
    elif folder.is_dir() and any(folder.iterdir()):
        raise SimrigError(f"'{folder}' is no database and not empty: name another folder")
    for place in (folder, folder / RAW, folder / UTIA):
        try:
            place.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise SimrigError(f"cannot write '{place}': {error.strerror}") from error
    if not done:
        write_index(folder, settings, [])
    return {name: one for name, one in done.items() if (folder / f"{name}.h5").is_file()}


def _kept(
    folder: Path, name: str, values: np.ndarray, settings: Mapping[str, Any]
) -> dict[str, Any]:
    """Write what was measured and the table of it; return what the index says about it."""
    scheme = hemisphere_81()
    raw = BarycentricBrdf(scheme.theta, scheme.phi, values, name=name)
    table = resampled(values, name)
    shift = _aligned(folder, name, table.values)
    table = turned(table, shift)
    says = {"database": "virtual", **settings, "aligned_by_azimuths": shift}
    written: list[tuple[Path, Callable[[Path, Brdf], Any]]] = [
        (folder / RAW / f"{name}.h5", lambda path, _: write_brdf(path, raw, says)),
        (folder / UTIA / f"{name}.exr", write_utia_exr),  # type: ignore[list-item]
        (folder / f"{name}.h5", lambda path, brdf: write_brdf(path, brdf, says)),
    ]
    for path, write in written:
        with atomic_write(path) as temporary:
            write(temporary, table)
    return {"shift": shift, **characterised(table.values)}


def _aligned(folder: Path, name: str, values: np.ndarray) -> int:
    """Return the shift to the template, the database's first fabric (A.4.2)."""
    template = folder / "fabric001.h5"
    if name == "fabric001" or not template.is_file():
        return 0
    return shift_to(read_brdf(template).values, values)  # type: ignore[attr-defined]

"""A recording as a user asks for it: plain values, from which any process makes the same one."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from simrig.core.effects import EffectPlan, Overrides, Tolerance, in_order, parse_tolerance
from simrig.core.errors import SimrigError
from simrig.files import hdf5
from simrig.files.btf.hdf5 import CONTENT as BTF
from simrig.files.btf.hdf5 import read_btf
from simrig.files.load import load_material
from simrig.instruments.description import Description, described
from simrig.mesostructure import PRESETS, Tile, build_tile
from simrig.plans.protocol import ListedPlan, Plan
from simrig.rigs.btf.rig import view_order
from simrig.rigs.imaging.effects import EFFECT_NAMES, plan_pictures
from simrig.rigs.imaging.optics import Optics
from simrig.rigs.imaging.recorder import Camera, Recording


@dataclass(frozen=True)
class Request:
    """What to record.

    Attributes:
        material: a name or a file.
        instrument: what its file says.
        angles: theta_i, theta_v, phi_i, phi_v of every pose in radians, in their order.
        plan: what it is called.
        sample_mm: side of the sample; the instrument's diameter where None.
        pixels: (width, height) that are read out; what the frame needs where None.
        spp, bounces: of a tile with structure.
        frames: exposures of a picture, at most.
        seed: of all chance.
        effects: that are simulated.
        not_reached: poses of the plan that are left out, by reason.
    """

    material: str
    instrument: Mapping[str, Any]
    angles: tuple[tuple[float, ...], ...]
    plan: str
    sample_mm: float | None = None
    pixels: tuple[int, int] | None = None
    spp: int = 4
    bounces: int = 1
    frames: int = 6
    seed: int = 0
    effects: tuple[str, ...] = ()
    not_reached: Mapping[str, int] | None = None

    def as_text(self) -> str:
        """Return it as JSON, for workers."""
        return json.dumps(vars(self))

    def optics(self) -> Optics:
        """Return the instrument at work (see ``Optics.of``)."""
        description = described(self.instrument)
        return Optics.of(description, self.sample_mm, self.pixels, self.seed)

    def recording(self) -> Recording:
        """Return what is recorded."""
        angles = np.array(self.angles)
        steepest = float(angles[:, :2].max())
        camera = Camera(
            self.optics(),
            material_of(self.material, self.seed),
            in_order("effect of a camera", self.effects, EFFECT_NAMES),
            self.seed,
            self.spp,
            self.bounces,
            self.frames,
            steepest,
        )
        return Recording(camera, angles, self.plan, self.not_reached or {})


def request_of(material: str, description: Description, plan: Plan, **wishes: Any) -> Request:
    """Return a request, without effects, for the poses of a plan that are reached.

    Poses are taken view by view; what an arm hides or an axis does not reach is left out and
    counted.

    Raises:
        SimrigError: a plan whose directions are not known before, or of which none is reached;
            what ``Optics.of`` refuses.
    """
    if not isinstance(plan, ListedPlan):
        raise SimrigError(
            f"a recording needs directions that are known before, not plan '{plan.name}': use plan "
            "'scheme' or 'directions'"
        )
    angles = np.asarray(plan.angles(), dtype=np.float64)
    request = Request(
        material,
        description.model_dump(mode="json", exclude_none=True),
        (),
        plan.describe(),
        **wishes,
    )
    placed = request.optics().moves.placed(angles)
    missed = Counter(str(fault) for fault in placed.fault[~placed.reached])
    angles = angles[placed.reached]
    if not len(angles):
        reasons = ", ".join(f"{count} {why}" for why, count in missed.items())
        raise SimrigError(f"none of the {missed.total()} poses is reached: {reasons}")
    angles = angles[view_order(angles)]
    listed = tuple(tuple(float(a) for a in row) for row in angles)
    return replace(request, angles=listed, not_reached=dict(missed))


def planned(
    request: Request, material: Any, tolerance: str | None, overrides: Overrides
) -> tuple[Request, EffectPlan]:
    """Return a request with the effects and bounces that a tolerance calls for, and how.

    Raises:
        SimrigError: no tolerance, or an unknown effect.
    """
    allowed: Tolerance = parse_tolerance(tolerance or "dE=0.5")
    angles, optics = np.array(request.angles), request.optics()
    chosen = plan_pictures(material, optics, angles, allowed, overrides)
    bounces = 1
    if isinstance(material, Tile):
        from simrig.core import backend
        from simrig.rigs.btf.bounces import plan_bounces

        backend.select("auto")
        shape = optics.sensor.pixels[::-1]
        orders = plan_bounces(
            material, angles, allowed, resolution=shape, spp=request.spp, seed=request.seed
        )
        bounces = int(orders.settings["bounces"])
        chosen = replace(chosen, effects=(*chosen.effects, *orders.effects))
    effects = tuple(chosen.settings["effects"])
    return replace(request, effects=effects, bounces=bounces), chosen


def material_of(source: str, seed: int = 0) -> Any:
    """Return the BRDF, BTF or tile that a name or a file is.

    Raises:
        SimrigError: there is none.
    """
    path = Path(source)
    if source.partition("+")[0] in PRESETS and not path.exists():
        return build_tile(source, seed=seed)
    if path.suffix == ".h5" and path.is_file() and hdf5.content_of(path) == BTF:
        return read_btf(path)
    return load_material(source)


def record_cell(config: Mapping[str, Any], cell: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Record some poses of one view in a worker.

    Args:
        config: ``folder``, which all workers reach under this name, ``request`` as text, and the
            ``fingerprint`` of its material.
        cell: ``numbers`` of the poses.

    Raises:
        SimrigError: the material is another one here.
    """
    recording = _made(config["request"], config["fingerprint"])
    return [{"poses": recording.take(Path(config["folder"]), np.array(cell["numbers"]))}]


@lru_cache(maxsize=1)
def _made(text: str, fingerprint: str) -> Recording:
    """Return a recording; a worker lives on, and its material's file may hold another by then."""
    said = json.loads(text)
    said["angles"] = tuple(tuple(row) for row in said["angles"])
    for name in ("pixels", "effects"):
        said[name] = None if said[name] is None else tuple(said[name])
    made = Request(**said).recording()
    if made.about()["fingerprint"] != fingerprint:
        raise SimrigError(f"'{said['material']}' is another material for this worker: share it")
    return made

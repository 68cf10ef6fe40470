"""A multi-angle reflectometer over a rotary stage (thesis section 7.2.7)."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

from simrig.core.errors import SimrigError, check_known
from simrig.core.options import Option
from simrig.plans.protocol import ListedPlan

if TYPE_CHECKING:
    from simrig.brdf.protocol import Brdf

_SHIPPED = "reflectometers.toml"
_MOST_BYTES = 1 << 20


@dataclass(frozen=True)
class ReflectometerPlan(ListedPlan):
    """The geometries of a hand-held device, at even rotations of the material.

    Attributes:
        device: its name.
        geometries: theta_i, phi_i, theta_v, phi_v in degrees.
        rotations: of a full turn.

    Raises:
        SimrigError: geometries or rotations that cannot be.
    """

    name: ClassVar[str] = "reflectometer"
    about: ClassVar[str] = "a multi-angle reflectometer over a rotary stage (7.2.7)"
    options: ClassVar[tuple[Option, ...]] = (
        Option("device", str, "MA68, MA98, BYK-mac, MultiFX10, or FILE.toml:NAME.", "MA68"),
        Option("rotations", int, "Of the material, over a full turn.", 8, least=1, most=360),
    )

    device: str
    geometries: tuple[tuple[float, ...], ...]
    rotations: int = 8

    def __post_init__(self) -> None:
        even = len({len(own) for own in self.geometries}) == 1
        listed = np.array(self.geometries if even else [], dtype=np.float64)
        shape = listed.ndim == 2 and listed.shape[1] == 4
        if not shape or not np.all(np.isfinite(listed)):
            raise SimrigError(
                f"device '{self.device}' needs geometries of four finite angles in degrees"
            )
        if listed[:, [0, 2]].min() < 0.0 or listed[:, [0, 2]].max() >= 90.0:
            raise SimrigError(f"device '{self.device}' has a polar angle outside 0 to 90 degrees")
        if not 1 <= self.rotations <= 360:
            raise SimrigError(f"a turn has 1 to 360 rotations, got {self.rotations}")
        object.__setattr__(self, "geometries", tuple(tuple(g) for g in listed.tolist()))

    @classmethod
    def for_material(  # type: ignore[override]
        cls, material: Brdf | None = None, device: str = "MA68", rotations: int = 8
    ) -> Self:
        """Return the plan of a device by name.

        Raises:
            SimrigError: an unknown device, or a file that cannot be read.
        """
        path, _, name = device.rpartition(":")
        known = _devices(Path(path) if path else None)
        check_known("reflectometer", name, known)
        about = known[name]
        if not isinstance(about, dict) or not isinstance(about.get("geometries"), list):
            raise SimrigError(f"reflectometer '{name}' lists no geometries")
        try:
            listed = tuple(tuple(float(x) for x in one) for one in about["geometries"])
        except (TypeError, ValueError) as error:
            raise SimrigError(
                f"reflectometer '{name}' needs geometries of four angles in degrees"
            ) from error
        return cls(name, listed, rotations)

    def angles(self) -> np.ndarray:
        """Return (n, 4) theta_i, theta_v, phi_i, phi_v in radians, rotation by rotation."""
        own = np.radians(np.array(self.geometries))[:, [0, 2, 1, 3]]
        turns = 2.0 * np.pi / self.rotations * np.arange(self.rotations)
        found = np.tile(own, (self.rotations, 1))
        found[:, 2:] += np.repeat(turns, len(own))[:, None]
        return found

    @property
    def theta_max(self) -> float:
        """The largest polar angle in radians."""
        return float(self.angles()[:, :2].max())

    def describe(self) -> str:
        """Return the plan in words."""
        return f"{self.device}, {len(self.geometries)} geometries, {self.rotations} rotations"


def _devices(path: Path | None) -> dict[str, Any]:
    if path is None:
        return tomllib.loads(files(__package__).joinpath(_SHIPPED).read_text("utf-8"))
    if not path.is_file() or path.stat().st_size > _MOST_BYTES:
        raise SimrigError(f"there is no file of reflectometers '{path}'")
    try:
        return tomllib.loads(path.read_text("utf-8"))
    except (OSError, ValueError) as error:
        text = " ".join(str(error).split())
        raise SimrigError(f"'{path}' is no file of reflectometers: {text}") from error

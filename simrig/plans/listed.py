"""Plans whose directions a user lists, or a scheme names."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

from simrig.core.errors import SimrigError, unknown_name
from simrig.core.options import Option
from simrig.directions.schemes import SCHEMES, HemisphereScheme, scheme, uniform_scheme
from simrig.plans.protocol import ListedPlan

if TYPE_CHECKING:
    from simrig.brdf.protocol import Brdf

_BY_COUNT = {"81x81": "hemisphere_81", "151x151": "hemisphere_151"}
_LARGEST_FILE = 1 << 28  # bytes; some four million pairs


@dataclass(frozen=True, eq=False)
class Directions(ListedPlan):
    """Direction pairs in any order.

    Args:
        listed: (n, 4) theta_i, theta_v, phi_i, phi_v in radians, n >= 1.
        title: what the list is called.

    Raises:
        SimrigError: another shape, NaN, or polar angles outside [0, 90°).
    """

    name: ClassVar[str] = "directions"
    about: ClassVar[str] = "the direction pairs of a file"
    implied_by: ClassVar[tuple[str, ...]] = ("pairs",)
    options: ClassVar[tuple[Option, ...]] = (
        Option(
            "pairs", str, "A file of theta_i, theta_v, phi_i, phi_v in degrees, one pair a line."
        ),
    )

    listed: np.ndarray
    title: str = "list of directions"

    def __post_init__(self) -> None:
        listed = np.array(self.listed, dtype=np.float64)
        if listed.ndim != 2 or listed.shape[1] != 4 or len(listed) == 0:
            raise SimrigError(f"a plan needs directions (n, 4), n >= 1, got {listed.shape}")
        theta = listed[:, :2]
        good = np.isfinite(listed).all(axis=1) & ((theta >= 0.0) & (theta < np.pi / 2)).all(axis=1)
        if not good.all():
            number = int(np.argmin(good))
            row = ", ".join(f"{angle:g}" for angle in np.degrees(listed[number]))
            raise SimrigError(
                f"pair {number + 1} (theta_i, theta_v, phi_i, phi_v = {row} degrees): a plan needs "
                "finite directions with polar angles in [0, 90) degrees"
            )
        listed.flags.writeable = False
        object.__setattr__(self, "listed", listed)

    @classmethod
    def for_material(  # type: ignore[override]
        cls, material: Brdf | None = None, *, pairs: str | Path = ""
    ) -> Self:
        """Return the plan of a file of pairs (see ``read_pairs``)."""
        if not str(pairs):
            raise SimrigError("the plan 'directions' needs --pairs, a file of direction pairs")
        return cls(read_pairs(pairs), Path(pairs).name)

    def angles(self) -> np.ndarray:
        """Return (n, 4) theta_i, theta_v, phi_i, phi_v in radians."""
        return self.listed

    @property
    def theta_max(self) -> float:
        """The largest polar angle in radians."""
        return float(self.listed[:, :2].max())

    def describe(self) -> str:
        """Return what the list is called."""
        return self.title

    def settings(self) -> dict[str, Any]:
        """Return what the list is called; the directions are those of the measurement."""
        return {"title": self.title}

    @classmethod
    def restored(cls, settings: Mapping[str, Any], angles: np.ndarray) -> Self:
        """Return the plan of a stored measurement (see ``Plan.restored``)."""
        return cls(angles, **settings)


@dataclass(frozen=True, eq=False)
class SchemePlan(Directions):
    """All pairs of the directions of a scheme (thesis section D.3); see ``of``."""

    name: ClassVar[str] = "scheme"
    about: ClassVar[str] = "all pairs of the directions of a scheme"
    implied_by: ClassVar[tuple[str, ...]] = ()
    options: ClassVar[tuple[Option, ...]] = (
        Option("scheme", str, "1 to 30, 81x81, 151x151 or a name.", default="81x81"),
        Option("reciprocal", bool, "Each pair in one order; as the material is, unless given."),
    )

    title: str = "scheme"
    reciprocal: bool = True

    @property
    def one_order(self) -> bool:
        """Whether a pair is measured in one order alone."""
        return self.reciprocal

    def settings(self) -> dict[str, Any]:
        """Return what the scheme is called, and whether pairs are unordered."""
        return {"title": self.title, "reciprocal": self.reciprocal}

    @classmethod
    def of(cls, directions: HemisphereScheme, reciprocal: bool = True) -> Self:
        """Return the plan of a scheme.

        Args:
            directions: n of them, the same for illumination and view.
            reciprocal: each unordered pair once, n(n + 1)/2 samples, the direction that the
                scheme names first (with rings: the steeper one) as illumination; or all n²
                ordered pairs.
        """
        pairs = "each unordered pair once" if reciprocal else "all ordered pairs"
        title = f"scheme {directions.name}, {len(directions)} directions, {pairs}"
        return cls(directions.pair_angles(reciprocal), title, reciprocal)

    @classmethod
    def for_material(  # type: ignore[override]
        cls, material: Brdf | None = None, *, scheme: str = "81x81", reciprocal: bool | None = None
    ) -> Self:
        """Return the plan of a named scheme; pairs are unordered where the material allows."""
        return cls.of(named_scheme(scheme), once(material, reciprocal))


def once(material: Brdf | None, reciprocal: bool | None) -> bool:
    """Return whether one order of each pair is measured: as wished, or as the material is."""
    return bool(material is None or material.reciprocal) if reciprocal is None else reciprocal


def named_scheme(text: str) -> HemisphereScheme:
    """Return the fixed list of directions that a user names.

    Args:
        text: ``81x81`` or ``151x151``, ``1`` to ``30`` of the uniform schemes, or a name of
            ``simrig.directions.schemes``.

    Raises:
        SimrigError: there is none of this name.
    """
    name = _BY_COUNT.get(text, text)
    if name.isdecimal():
        return uniform_scheme(int(name))
    if name not in SCHEMES:
        raise unknown_name("scheme", text, (*_BY_COUNT, *SCHEMES))
    return scheme(name)


def read_pairs(path: str | Path) -> np.ndarray:
    """Return the pairs of a text file, (n, 4) in radians.

    The file has one pair a line, theta_i, theta_v, phi_i, phi_v in degrees, separated by blanks,
    commas or semicolons; what follows a ``#`` is left out.

    Raises:
        SimrigError: no such file, too large a one, or no list of pairs.
    """
    path = Path(path)
    if not path.is_file():
        raise SimrigError(f"there is no file '{path}'")
    if path.stat().st_size > _LARGEST_FILE:
        raise SimrigError(f"'{path}' is too large for a list of pairs ({_LARGEST_FILE} bytes)")
    try:
        rows = (line.split("#")[0] for line in path.read_text(encoding="utf-8").splitlines())
        words = (row.replace(",", " ").replace(";", " ").split() for row in rows)
        listed = np.array([[float(word) for word in row] for row in words if row])
    except ValueError:  # no numbers, no text, or lines of different lengths
        listed = np.empty(0)
    if listed.ndim != 2 or listed.shape[1] != 4:
        raise SimrigError(
            f"'{path}' is no list of pairs: four angles in degrees a line, theta_i, theta_v, "
            "phi_i, phi_v"
        )
    return np.radians(listed)

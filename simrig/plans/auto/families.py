"""The families of the automatic plan: what a material's class makes of coordinates and samples.

A *shape* says in which coordinates the logarithm of the BRDF is measured and interpolated; one is
measured at a time. An *addition* says where more samples go, whatever the shape; any number of
them can be mixed in. Each says by itself whether it suits what the pilot saw, and why.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from simrig.brdf.kriging.symmetry import Symmetry
from simrig.core.errors import unknown_name
from simrig.plans.auto.description import Description

_BACK = 1.5  # light that goes back outshines what lies beside by so much


@dataclass(frozen=True)
class Shares:
    """Which candidates samples are chosen from; the rest is as pictures show it.

    Attributes:
        even: in all angles.
        cores: near highlights; more than this was never better, and up to seven times worse.
        back: where light goes back to where it is from.
    """

    even: float
    cores: float = 0.05
    back: float = 0.05


@dataclass(frozen=True)
class Family:
    """A way to measure a class of materials.

    Attributes:
        name: its key in ``FAMILIES``, lower case with hyphens.
        about: one line.
        why: what in a description calls for it, in words; empty where nothing does.
        shape: the symmetry that it makes of the one that was found; None of an addition.
        even: share of candidates that are even in all angles (of a shape).
        back: share of candidates where light goes back that it asks for (of an addition).
    """

    name: str
    about: str
    why: Callable[[Description], str]
    shape: Callable[[Symmetry], Symmetry] | None = None
    even: float = 0.1
    back: float = 0.0


@dataclass(frozen=True)
class Choice:
    """What is measured, and why.

    Attributes:
        families: a shape, then additions.
        symmetry: of the shape.
        why: one line.
        forced: the family that the user decided; None where the pilot did.
    """

    families: tuple[Family, ...]
    symmetry: Symmetry
    why: str
    forced: str | None = None

    @property
    def shares(self) -> Shares:
        """Of the candidates."""
        usual = Shares(shape_of(self.symmetry).even)
        back = max([usual.back, *(family.back for family in self.families)])
        return replace(usual, back=back)


def choose(seen: Description, forced: str | None = None) -> Choice:
    """Return the families that suit a description.

    Args:
        seen: by the pilot.
        forced: a family that is measured, whatever the pilot says; the others are chosen still.
    """
    own = None if forced is None else family_named(forced)
    symmetry = seen.symmetry
    shape = own if own is not None and own.shape is not None else shape_of(symmetry)
    assert shape.shape is not None
    symmetry = shape.shape(symmetry)
    added = [f for f in FAMILIES.values() if f.shape is None and (f is own or f.why(seen))]
    reasons = []
    for family in (shape, *added):
        said = "as you wished" if family is own else family.why(seen)
        reasons.append(f"{family.name} ({said})")
    return Choice((shape, *added), symmetry, ", ".join(reasons), forced)


def shape_of(symmetry: Symmetry) -> Family:
    """Return the shape in which a material of such a symmetry is measured."""
    names = {2: "bivariate", 3: "isotropic", 4: "anisotropic"}
    return FAMILIES[names[symmetry.dimensions]]


def family_named(name: str) -> Family:
    """Return a family by name.

    Raises:
        SimrigError: unknown name, with the nearest known one.
    """
    if name not in FAMILIES:
        raise unknown_name("family", name, FAMILIES)
    return FAMILIES[name]


def _isotropic(found: Symmetry) -> Symmetry:
    mirror = found.mirror or not found.isotropic
    return Symmetry(True, found.reciprocal, mirror, True)


def _bivariate(found: Symmetry) -> Symmetry:
    return Symmetry(True, True, True, True, bivariate=True)


def _anisotropic(found: Symmetry) -> Symmetry:
    return replace(found, isotropic=False, bivariate=False)


def _differs(seen: Description, name: str) -> str:
    return f"values differ by {seen.tests[name]}"


def _why_isotropic(seen: Description) -> str:
    return f"turned about the normal {_differs(seen, 'isotropic')}"


def _why_bivariate(seen: Description) -> str:
    return f"turned by 90° in phi_d {_differs(seen, 'bivariate')}"


def _why_back(seen: Description) -> str:
    return (
        f"light that goes back is {seen.retro:.2g} times what lies beside"
        if seen.retro > _BACK
        else ""
    )


_ALL = (
    Family(
        "bivariate", "theta_h and theta_d alone: phi_d does not matter", _why_bivariate, _bivariate
    ),
    Family("isotropic", "half-difference angles in three dimensions", _why_isotropic, _isotropic),
    Family(
        "anisotropic",
        "half vector and difference vector, turned to the axes found",
        _why_isotropic,
        _anisotropic,
        even=0.5,
    ),
    Family("retro-reflective", "more where light goes back to its source", _why_back, back=0.15),
)
FAMILIES: dict[str, Family] = {family.name: family for family in _ALL}
"""Every family. A new one is one more entry."""

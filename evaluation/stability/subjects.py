"""What the stability table runs over the hard cases: BRDFs and parameterisations."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from simrig.brdf import (
    KURT_MATERIALS,
    RESCALED_MATERIALS,
    Brdf,
    Kurt,
    KurtLobe,
    Lambert,
    Ward,
    evaluate,
    kurt_material,
)
from simrig.brdf.multiaxial import Mode, Multiaxial
from simrig.brdf.slices.slices import SliceBrdf
from simrig.core.arrays import vector_type
from simrig.directions import (
    from_half_difference,
    from_onion,
    to_angles,
    to_half_difference,
    to_onion,
    to_vector,
)
from simrig.evaluation.stability.hard_cases import BRDF_VALUES, ROUGHNESS

# Relative errors of BRDFs are relative to at least this (1/sr): 66 EV below white, where
# products in float32 start to lose digits to underflow
FAINT = 1e-20


class Subject(Protocol):
    """Something that is computed from direction pairs in several precisions."""

    @property
    def name(self) -> str:
        """What the table calls it."""

    @property
    def reads_angles(self) -> bool:
        """Whether the values depend on the directions through their angles, as in a table."""

    @property
    def conditioning(self) -> str:
        """What makes the values sensitive to the directions, in words."""

    def reference(self, wi: np.ndarray, wv: np.ndarray) -> np.ndarray:
        """Return the right values, shape (n, k), in the precision of the directions."""

    def compute(self, wi: np.ndarray, wv: np.ndarray, float_type: type | None) -> np.ndarray:
        """Return the values, shape (n, k), in NumPy (None) or in a Dr.Jit float type."""

    def with_rounded_data(
        self, wi: np.ndarray, wv: np.ndarray, rng: np.random.Generator
    ) -> np.ndarray | None:
        """Return the reference with every stored value moved as far as its storage rounds it.

        None where the data are stored as precisely as they are computed with.
        """

    def scale(self, reference: np.ndarray) -> np.ndarray:
        """Return what errors are relative to, shape (n, k), positive."""

    def negative(self, values: np.ndarray) -> np.ndarray:
        """Return the mask, shape (n,), of finite values that have the wrong sign or range."""


@dataclass(frozen=True, eq=False)
class BrdfSubject:
    """A BRDF: its values are f_r in three channels."""

    brdf: Brdf

    @property
    def name(self) -> str:
        return self.brdf.name

    @property
    def reads_angles(self) -> bool:
        return any(np.ndim(array) > 1 for array in self.brdf.data().values())

    @property
    def conditioning(self) -> str:
        return conditioning_of(self.brdf)

    def reference(self, wi: np.ndarray, wv: np.ndarray) -> np.ndarray:
        return self.brdf.eval(wi, wv)

    def compute(self, wi: np.ndarray, wv: np.ndarray, float_type: type | None) -> np.ndarray:
        return evaluate(self.brdf, wi, wv, float_type)

    def with_rounded_data(
        self, wi: np.ndarray, wv: np.ndarray, rng: np.random.Generator
    ) -> np.ndarray | None:
        return None

    def scale(self, reference: np.ndarray) -> np.ndarray:
        return np.maximum(np.abs(reference), FAINT)

    def negative(self, values: np.ndarray) -> np.ndarray:
        return np.any(values < 0.0, axis=-1)


def conditioning_of(brdf: Brdf) -> str:
    """Return in words what makes a BRDF sensitive to its directions."""
    if isinstance(brdf, SliceBrdf) and brdf.bilinear:
        return (
            "the lower limit of formula D.1, the smallest of 32 slice values, jumps at the borders "
            "of cells; 1 ulp of the directions crosses them"
        )
    if any(np.ndim(array) > 1 for array in brdf.data().values()):
        return "the slope of the table over angles that 1 ulp of the directions moves"
    return "the slope of the lobe: the value changes as much with 1 ulp of the directions"


@dataclass(frozen=True, eq=False)
class RoundTripSubject:
    """A parameterisation: its values are both directions after a round trip, and its angles.

    Attributes:
        to: from a direction pair to four angles.
        back: from the four angles to the direction pair.
        low, high: range of the four angles in radians, high excluded for azimuths only.
    """

    name: str
    to: Callable[[Any, Any], tuple]
    back: Callable[..., tuple]
    low: tuple[float, float, float, float]
    high: tuple[float, float, float, float]

    @property
    def reads_angles(self) -> bool:
        return True

    @property
    def conditioning(self) -> str:
        return "an azimuth at the pole, and angles of a half vector that nearly vanishes"

    def reference(self, wi: np.ndarray, wv: np.ndarray) -> np.ndarray:
        return np.concatenate([wi, wv, np.zeros((len(wi), 1))], axis=-1)

    def compute(self, wi: np.ndarray, wv: np.ndarray, float_type: type | None) -> np.ndarray:
        make = vector_type(float_type) if float_type else None
        pair = [make(*v.T.copy()) if make else v for v in (wi, wv)]
        angles = tuple(self.to(*pair))
        returned = [np.array(v, dtype=np.float64) for v in self.back(*angles)]
        vectors = [v.T if make else v for v in returned]
        return np.concatenate([*vectors, self._outside(angles)[:, None]], axis=-1)

    def _outside(self, angles: tuple) -> np.ndarray:
        """Return how far angles lie outside of their range, in radians, shape (n,)."""
        values = np.stack([np.array(angle, dtype=np.float64) for angle in angles], axis=-1)
        return np.maximum(self.low - values, values - self.high).max(axis=-1).clip(min=0.0)

    def with_rounded_data(
        self, wi: np.ndarray, wv: np.ndarray, rng: np.random.Generator
    ) -> np.ndarray | None:
        return None

    def scale(self, reference: np.ndarray) -> np.ndarray:
        return np.ones_like(reference)  # the directions are unit vectors

    def negative(self, values: np.ndarray) -> np.ndarray:
        return values[:, -1] > 1e-6  # π/2 and 2π in float32 exceed those in float64


def _spherical(wi: Any, wv: Any) -> tuple:
    return (*to_angles(wi), *to_angles(wv))


def _from_spherical(theta_i: Any, phi_i: Any, theta_v: Any, phi_v: Any) -> tuple:
    return to_vector(theta_i, phi_i), to_vector(theta_v, phi_v)


def default_parameterisations() -> list[RoundTripSubject]:
    """Return the parameterisations of direction pairs."""
    quarter, whole = np.pi / 2, 2.0 * np.pi
    polar = ((0.0, 0.0, 0.0, 0.0), (quarter, whole, quarter, whole))
    slices = ((-quarter,) * 4, (quarter,) * 4)
    return [
        RoundTripSubject("spherical", _spherical, _from_spherical, *polar),
        RoundTripSubject("half-difference", to_half_difference, from_half_difference, *polar),
        RoundTripSubject("onion", to_onion, from_onion, *slices),
    ]


def default_brdfs() -> list[Brdf]:
    """Return the BRDFs of the table: all analytic models at their extremes, and tables."""
    return [*_analytic(), *_tabulated()]


def _analytic() -> Iterable[Brdf]:
    yield Lambert((0.0, 0.0, 0.0), name="lambert_0")
    yield Lambert((1.0, 1.0, 1.0), name="lambert_1")
    yield Lambert((1e-310, 1e-40, 1e-38), name="lambert_denormal")
    for value in BRDF_VALUES:
        yield Ward((value,) * 3, (value,) * 3, 0.2, 0.2, name=f"ward_value_{value:g}")
    for name in KURT_MATERIALS + RESCALED_MATERIALS:
        yield kurt_material(name)
    for m in (min(ROUGHNESS), max(ROUGHNESS)):
        lobe = KurtLobe(k_s=(1.0, 1.0, 1.0), f_0=0.0, m_x=m, m_y=m, alpha=1.0)
        yield Kurt(k_d=(0.0, 0.0, 0.0), lobes=(lobe,), name=f"kurt_{m:g}")
    for low, high in ((0.005, 0.005), (0.005, 30.0), (30.0, 30.0)):
        sharp = Mode((1.0, 1.0, 1.0), 0.4, high, low, alpha=1.0, grazing=100.0)
        wide = Mode((0.1, 0.0, 0.2), 2.0, 0.5, 0.2)
        yield Multiaxial((0.1, 0.1, 0.1), (sharp, wide), name=f"multiaxial_{low:g}_{high:g}")
    black = (0.0, 0.0, 0.0)
    for variant in Ward.VARIANTS:
        for m in ROUGHNESS:
            yield Ward(k_d=black, m_x=m, m_y=m, variant=variant, name=f"ward_{variant}_{m:g}")
        yield Ward(black, m_x=0.005, m_y=3.0, variant=variant, name=f"ward_{variant}_0.005_3")


def _tabulated() -> Iterable[Brdf]:
    """Yield one material in every kind of table, coarsely: the nodes are hard, not the data."""
    from simrig.brdf.tables.resample import resample_isotropic

    yield small_slices()
    yield small_table()
    material = resample_isotropic(kurt_material("fabric112"), (30, 30, 60), rotations=4)
    yield _renamed(material, "isotropic_table")


def small_slices() -> Brdf:
    """Return a material measured and reconstructed along few slices."""
    from simrig.plans.along_slices import SlicePlan
    from simrig.plans.placement import SlicePlacement
    from simrig.reconstruction.slices.tables import reconstruct
    from simrig.rigs.direct.gonioreflectometer import Gonioreflectometer

    placement = SlicePlacement.from_degrees(20.0, 60.0)
    measurement = Gonioreflectometer().measure(
        kurt_material("fabric112"), SlicePlan(placement, 2000)
    )
    return _renamed(reconstruct(measurement), "slices")


def small_table() -> Brdf:
    """Return a material in a coarse table over all four angles."""
    from simrig.brdf.tables.resample import resample_dense

    table = resample_dense(kurt_material("fabric112"), np.radians(10.0), 36)
    return _renamed(table, "dense_table")


def _renamed(brdf: Brdf, name: str) -> Brdf:
    brdf.name = name
    return brdf

"""What the tests of the plugins share: materials, interactions, chi-square and Z-tests."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from types import SimpleNamespace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from scipy import stats

from simrig.brdf.analytic import Kurt, KurtLobe, Lambert, Ward
from simrig.brdf.kurt_materials import kurt_material
from simrig.brdf.multiaxial import Mode, Multiaxial
from simrig.brdf.protocol import Brdf
from simrig.brdf.slices.slices import SliceBrdf
from simrig.brdf.tables.barycentric import BarycentricBrdf
from simrig.brdf.tables.dense import DenseTable
from simrig.core.arrays import Array, components, vector
from simrig.directions import to_vector
from simrig.directions.schemes import scheme
from simrig.plans.along_slices import SlicePlan
from simrig.plans.placement import SlicePlacement
from simrig.reconstruction.slices.tables import reconstruct
from simrig.rigs.direct.gonioreflectometer import Gonioreflectometer

TABLE_SHAPE = (4, 4, 8, 8)  # theta_i, theta_v, phi_i, phi_v; 30° and 45° steps


class OneWay(Brdf):
    """f_r = 0.2 + 0.1 x_i + 0.15 y_v: tells illumination from view, and x from y."""

    name = "one way"
    reciprocal = False

    def data(self) -> Mapping[str, np.ndarray]:
        return {"base": np.asarray(0.2)}

    def look_up(self, wi: Array, wv: Array, tables: Mapping[str, Array]) -> Array:
        value = tables["base"] + 0.1 * components(wi)[0] + 0.15 * components(wv)[1]
        return vector(value, 0.5 * value, 0.25 * value, like=wi)


def small_table(seed: int = 7) -> DenseTable:
    """Return a coarse random table that is not reciprocal."""
    rng = np.random.default_rng(seed)
    values = rng.uniform(0.02, 0.4, (*TABLE_SHAPE, 3)).astype(np.float32)
    return DenseTable(values, np.radians(30.0), name="small table")


def barycentric(seed: int = 7) -> BarycentricBrdf:
    """Return random values, not reciprocal, on the sparsest uniform scheme."""
    directions = scheme("uniform_1")
    rng = np.random.default_rng(seed)
    values = rng.uniform(0.02, 0.4, (len(directions), len(directions), 3)).astype(np.float32)
    return BarycentricBrdf(directions.theta, directions.phi, values)


@cache
def slices(seed: int = 1) -> SliceBrdf:
    """Return a coarse reconstruction of a built-in material, for example number 1."""
    material = kurt_material(("yellow_satin", "fabric112", "wood01")[seed])
    placement = SlicePlacement.from_degrees(40.0, 90.0)
    return reconstruct(Gonioreflectometer().measure(material, SlicePlan(placement, 300)))


def narrow(m_x: float, m_y: float) -> Kurt:
    """Return a Kurt material of one narrow lobe."""
    lobe = KurtLobe(k_s=(0.05, 0.04, 0.03), f_0=0.9, m_x=m_x, m_y=m_y, alpha=0.1)
    return Kurt(k_d=(0.05, 0.04, 0.03), lobes=(lobe,), name=f"narrow {m_x:g} {m_y:g}")


BRDFS: dict[str, Callable[[], Brdf]] = {
    "lambert": Lambert,
    "one_way": OneWay,
    "table": small_table,
    "barycentric": barycentric,
    "slices": slices,
    "ward": lambda: Ward(m_x=0.1, m_y=0.4),
    "multiaxial": lambda: Multiaxial(
        (0.1, 0.2, 0.1), tuple(Mode.of(60.0 * k, 25.0, 20.0 + 5.0 * k, 0.1) for k in range(3))
    ),
    "brushed_aluminium": lambda: kurt_material("brushed_aluminium"),
    "fabric112": lambda: kurt_material("fabric112"),
    "narrow": lambda: narrow(0.005, 0.005),
    "narrow_anisotropic": lambda: narrow(0.005, 0.03),
}


@pytest.fixture
def brdf() -> Callable[[str], Brdf]:
    """Return the function that makes a test material by name."""
    return lambda name: BRDFS[name]()


def direction(theta_deg: float, phi_deg: float = 0.0) -> tuple[float, float, float]:
    """Return a unit vector as three floats."""
    x, y, z = to_vector(np.radians(theta_deg), np.radians(phi_deg)).tolist()
    return x, y, z


def interaction(wi: np.ndarray, wavelengths: Any = None) -> Any:
    """Return surface interactions with incident directions of shape (n, 3)."""
    si = dr.zeros(mi.SurfaceInteraction3f, len(wi))
    si.wi = mi.Vector3f(np.ascontiguousarray(wi.T))
    if wavelengths is not None:
        si.wavelengths = wavelengths
    return si


def chi_square(
    bsdf: Any, wi: tuple[float, float, float], res: int = 100, ires: int = 16, **options: Any
) -> Any:
    """Return the finished chi-square test of ``sample`` against ``pdf`` and its verdict.

    The number of cells is even, so that the horizon, where the density ends, lies between two.
    """
    from mitsuba.chi2 import ChiSquareTest, SphericalDomain

    context = mi.BSDFContext()

    def make(count: int) -> Any:
        si = dr.zeros(mi.SurfaceInteraction3f, count)
        si.wi = mi.ScalarVector3f(*wi)
        return si

    def sample(u: Any) -> Any:
        bs, _ = bsdf.sample(context, make(dr.width(u)), u[0], mi.Point2f(u[1], u[2]))
        # a direction that was drawn below the horizon has no density, and rounding puts one that
        # was drawn just above it into the cell below
        return bs.wo, dr.select((bs.pdf > 0.0) & (bs.wo.z > 1e-6), mi.Float(1.0), 0.0)

    def pdf(wo: Any) -> Any:
        return bsdf.pdf(context, make(dr.width(wo)), wo)

    test = ChiSquareTest(
        SphericalDomain(), sample, pdf, sample_dim=3, res=res, ires=ires, **options
    )
    return test, test.run(significance_level=0.001, quiet=True)


def z_test(first: np.ndarray, second: np.ndarray) -> float:
    """Return the p-value of two estimators having the same expectation in every pixel.

    Args:
        first, second: independent renders, shape (seeds, pixels).

    Each pixel's Welch statistic becomes a standard normal; the sum of their squares is a
    chi-square over all pixels, so no correction for multiple tests is needed.
    """
    result = stats.ttest_ind(first, second, axis=0, equal_var=False)
    lit = np.ptp(np.concatenate([first, second]), axis=0) > 0.0
    z = stats.norm.isf(np.clip(result.pvalue[lit] / 2.0, 1e-300, 1.0))
    return float(stats.chi2.sf(np.sum(z * z), lit.sum()))


@pytest.fixture(scope="session")
def tools() -> SimpleNamespace:
    """Return the helpers of this file (a test module cannot import its conftest)."""
    return SimpleNamespace(
        OneWay=OneWay,
        chi_square=chi_square,
        direction=direction,
        interaction=interaction,
        narrow=narrow,
        slices=slices,
        small_table=small_table,
        z_test=z_test,
    )

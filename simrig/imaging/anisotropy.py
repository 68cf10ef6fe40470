"""Anisotropy from one picture under a mirror that lights from all azimuths (thesis section 3.1).

A picture is linear in the material: every pixel is a sum of f_r at the half vectors from which its
light comes, times known irradiances. So the unrolled picture (polar angle of the half vector by its
azimuth, thesis Fig. 3.3) is not cut out of the picture but solved for, by linear least squares in
splines and even harmonics: two branches that meet in a pixel are told apart, a centre beside the
middle does no harm, and every value has an uncertainty. Light that reaches the sample without the
mirror is a smooth pedestal of its own.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import BSpline
from scipy.linalg import cho_solve
from scipy.ndimage import maximum_filter, median_filter, minimum_filter
from scipy.sparse import csr_array

from simrig.core.errors import SimrigError
from simrig.imaging.anisotropy_gains import Side, Solution, solve, unevenness
from simrig.imaging.anisotropy_modes import Modes, find_modes

WORKING_PIXELS = 96  # blocks along a side that the least squares see
_EVEN, _RADIAL, _TILTED = 24, 5, 5  # splines over the polar angle: mean, harmonics, view
_DEGREE = 3
_HARMONICS = 24  # even ones: cos 2mφ
_PEDESTAL = 4  # degree in x and y of light without the mirror
# how large unknowns are expected to be, over the mean: harmonics of low order and their fall-off,
# what is even or without the mirror, first and second order in the small tilt of the view
_HARMONIC, _FALL_OFF, _EXPECTED, _TILT, _SECOND_TILT = 0.5, 8.0, 10.0, 0.3, 0.003
_BRIGHT = 6.0  # pixels with more than this times the median irradiance lie in the caustic
_SPECK = 1.3  # times the brightest neighbour, or below the darkest one by this
_WELL_LIT = (0.001, 0.95)  # quantiles of the half vectors' polar angles
_STEP_DEG = 1.0  # of profiles
_SPARSE = 10  # of their azimuths, for a mean


@dataclass(frozen=True, eq=False)
class Lighting:
    """From where the light of a square picture's pixels comes.

    Attributes:
        pixels: along each side.
        pixel: (n,) number of the pixel, row by row from the top.
        theta_h, phi_h: (n,) polar angle and azimuth of the half vector in radians; azimuths run
            counter-clockwise from the picture's right.
        view: (n, 2) components of the view along the half vector's azimuth and across it.
        irradiance: (n,) any unit.
        mirrored: (n,) whether the light came by the mirror.
    """

    pixels: int
    pixel: np.ndarray
    theta_h: np.ndarray
    phi_h: np.ndarray
    view: np.ndarray
    irradiance: np.ndarray
    mirrored: np.ndarray

    @cached_property
    def system(self) -> System:
        """The least squares of this lighting, made once."""
        return _system(self)

    @cached_property
    def total(self) -> np.ndarray:
        """Irradiance of every pixel, (pixels, pixels)."""
        count = self.pixels**2
        return np.bincount(self.pixel, self.irradiance, count).reshape(self.pixels, self.pixels)


@dataclass(frozen=True, eq=False)
class System:
    """Rows of the least squares: one for each block of pixels.

    Attributes:
        factor: pixels of a block along each side.
        blocks: (rows,) which blocks have a row.
        total: (blocks²,) irradiance of every block.
        matrix: (rows, unknowns), for the radiance over the irradiance.
        gram: its product with itself.
        sides: share of the light, and part of the matrix, of the near and the far side of the
            mirror: what crosses the axis on its way came from the far one.
        knots: of the splines of mean, harmonics and of how f_r depends on the view, in radians.
        expected: (unknowns,) size.
        theta: lowest and highest polar angle of half vectors that the mirror lights.
    """

    factor: int
    blocks: np.ndarray
    total: np.ndarray
    matrix: np.ndarray
    gram: np.ndarray
    sides: list[Side]
    knots: tuple[np.ndarray, np.ndarray, np.ndarray]
    expected: np.ndarray
    theta: tuple[float, float]

    def profile_basis(self, theta: np.ndarray, phi: np.ndarray) -> np.ndarray:
        """Return what gives f_r from the unknowns, (n, unknowns)."""
        count = len(theta)
        each = np.ones(count), np.arange(count), count
        basis = _basis(self.knots, theta, phi, np.zeros((count, 2)), *each)
        return np.pad(basis, ((0, 0), (0, self.matrix.shape[1] - basis.shape[1])))


@dataclass(frozen=True, eq=False)
class Anisotropy:
    """What a picture says about a material's anisotropy.

    Attributes:
        modes: the highlights, the strongest first.
        theta_h, phi_h: radians, of the unrolled picture and the profiles; phi_h from 0 to 180°.
        unrolled: (thetas, phis, 3) f_r in units of the picture over the irradiance, pedestal taken
            off.
        profile: (phis,) mean of channels and polar angles, by what they tell, less 1.
        profile_uncertainty: (phis,) its standard uncertainty.
        residual: root mean square that is left, over the mean.
        mirrored: mean of what the mirror lights, over the mean of the picture's ratio to the
            irradiance; small where light without the mirror makes a mirror-like highlight.
    """

    modes: Modes
    theta_h: np.ndarray
    phi_h: np.ndarray
    unrolled: np.ndarray
    profile: np.ndarray
    profile_uncertainty: np.ndarray
    residual: float
    mirrored: float

    def at(self, theta_h: float) -> np.ndarray:
        """Return the unrolled picture at one polar angle of the half vector, (phis, 3)."""
        place = np.interp(theta_h, self.theta_h, np.arange(len(self.theta_h)))
        low = min(int(place), len(self.theta_h) - 2)
        return np.asarray(
            self.unrolled[low] + (place - low) * (self.unrolled[low + 1] - self.unrolled[low])
        )


def analyse(
    picture: np.ndarray, lighting: Lighting, reference: np.ndarray | None = None
) -> Anisotropy:
    """Return the anisotropy that a picture shows.

    Args:
        picture: (pixels, pixels, 3) linear RGB; NaN and infinite pixels are left out.
        lighting: of that picture.
        reference: the same picture of an even, dull material; its ratio to the lighting corrects
            what the lighting does not know (dust, fall-off, the flash's profile).

    Raises:
        SimrigError: another shape, a black picture, or one with less than half of its pixels.
    """
    picture = _checked("the picture", picture, lighting)
    system = lighting.system
    side = lighting.pixels // system.factor
    blocked, known = _blocks(picture, lighting, system.factor)
    uneven = None
    if reference is not None:
        even, lit = _blocks(_checked("the reference", reference, lighting), lighting, system.factor)
        even, known = even.mean(axis=-1), known & lit
        scale = np.divide(even, system.total, out=np.zeros_like(even), where=system.total > 0.0)
        level = np.median(scale[system.blocks])
        known &= scale > 0.05 * max(level, 0.0)
        blocked = blocked * np.where(known, level / np.where(known, scale, 1.0), 0.0)[:, None]
        seen = system.blocks[known[system.blocks]]
        uneven = unevenness(scale[seen], seen, side)
    used = known[system.blocks]
    if used.sum() < 0.5 * len(used):
        raise SimrigError(
            f"{100.0 * (1.0 - used.mean()):.0f} % of the opening's pixels are unusable (saturated, "
            "black in the reference or not finite): take a picture with a shorter exposure"
        )
    rows = system.blocks[used]
    values = blocked[rows] / system.total[rows, None]
    mean = float(values.mean())
    if not mean > 0.0:
        raise SimrigError(
            "the opening is black: take a picture with the flash, or a longer exposure"
        )
    values = values / mean
    matrix = system.matrix[used]
    gram = system.gram if used.all() else matrix.T @ matrix
    sides = [(share[used], part[used]) for share, part in system.sides]
    # a dull, even material is what is expected: the unknowns are how far it is from that
    found = solve(matrix, gram, values, system.expected, sides, rows, side, uneven)
    return _read(system, found, mean)


def block_values(picture: np.ndarray, lighting: Lighting) -> tuple[np.ndarray, np.ndarray]:
    """Return the mean of channels over the irradiance, and whether it is known, (rows,) each."""
    system = lighting.system
    blocked, known = _blocks(picture, lighting, system.factor)
    return blocked[system.blocks].mean(axis=-1) / system.total[system.blocks], known[system.blocks]


def _checked(what: str, picture: np.ndarray, lighting: Lighting) -> np.ndarray:
    picture = np.asarray(picture, dtype=np.float64)
    wanted = (lighting.pixels, lighting.pixels, 3)
    if picture.shape != wanted:
        raise SimrigError(f"{what} must have the shape {wanted}, got {picture.shape}")
    return picture


def _blocks(picture: np.ndarray, lighting: Lighting, factor: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the blocks' sums after a median filter against specks, and which are whole.

    The filter sees the picture over the irradiance, which has no edges of its own.
    """
    good = np.isfinite(picture).all(axis=-1)
    lit = (lighting.total > 0.0)[..., None]
    ratio = np.divide(picture, lighting.total[..., None], out=np.zeros_like(picture), where=lit)
    ratio[~good] = 0.0
    around = np.ones((3, 3, 1), dtype=bool)
    around[1, 1] = False
    inner = minimum_filter(lit.astype(np.uint8), (3, 3, 1)).astype(bool)  # not across the rim
    high = maximum_filter(ratio, footprint=around)
    low = minimum_filter(ratio, footprint=around)
    speck = inner & ((ratio > _SPECK * high) | (ratio < low / _SPECK))
    clean = np.where(speck, median_filter(ratio, footprint=around), ratio)
    clean *= lighting.total[..., None]
    side = lighting.pixels // factor
    shape = (side, factor, side, factor)
    summed = clean.reshape(*shape, 3).sum(axis=(1, 3)).reshape(-1, 3)
    return summed, good.reshape(shape).all(axis=(1, 3)).ravel()


def _knots(count: int, low: float, high: float) -> np.ndarray:
    inner = np.linspace(low, high, count - _DEGREE + 1)[1:-1]
    return np.r_[[low] * (_DEGREE + 1), inner, [high] * (_DEGREE + 1)]


def _basis(
    knots: tuple[np.ndarray, np.ndarray, np.ndarray],
    theta: np.ndarray,
    phi: np.ndarray,
    view: np.ndarray,
    weight: np.ndarray,
    group: np.ndarray,
    groups: int,
) -> np.ndarray:
    """Return weighted sums by group of what gives f_r from the unknowns, (groups, unknowns).

    A place has four splines that are not zero: sums are products with sparse matrices.
    """
    count = len(theta)

    def summed(own: np.ndarray, factors: np.ndarray) -> np.ndarray:
        inside = np.clip(theta, own[0], np.nextafter(own[-1], 0.0))
        splines = csr_array(BSpline.design_matrix(inside, own, _DEGREE))
        number = len(own) - _DEGREE - 1
        place = splines.indices.reshape(count, -1) + number * group[:, None]
        values = splines.data.reshape(count, -1) * weight[:, None]
        column = np.repeat(np.arange(count), place.shape[1])
        shape = (groups * number, count)
        gathered = csr_array((values.ravel(), (place.ravel(), column)), shape=shape)
        return np.asarray(gathered @ factors).reshape(groups, number, -1)

    angles = 2.0 * np.arange(1, _HARMONICS + 1) * phi[:, None]
    around = np.concatenate([np.cos(angles), np.sin(angles)], axis=1)
    tilts = 100.0 * np.stack(
        [view[:, 0], 100.0 * view[:, 0] ** 2, 100.0 * view[:, 1] ** 2], axis=-1
    )
    parts = [summed(knots[0], np.ones((count, 1))), summed(knots[1], around),
             summed(knots[2], tilts).swapaxes(1, 2)]  # fmt: skip
    return np.concatenate([own.reshape(groups, -1) for own in parts], axis=1)


def _system(lighting: Lighting) -> System:
    factor = max(lighting.pixels // WORKING_PIXELS, 1)
    if lighting.pixels % factor:
        raise SimrigError(
            f"a picture of {lighting.pixels} pixels does not divide into blocks of {factor}: "
            f"take a multiple of {WORKING_PIXELS}"
        )
    side = lighting.pixels // factor
    row, column = np.divmod(lighting.pixel, lighting.pixels)
    block = (row // factor) * side + column // factor
    total = np.bincount(block, lighting.irradiance, side * side)
    count = np.bincount(np.unique(lighting.pixel) // lighting.pixels // factor * side
                        + np.unique(lighting.pixel) % lighting.pixels // factor,
                        minlength=side * side)  # fmt: skip
    usual = np.median(total[total > 0.0]) if np.any(total > 0.0) else 1.0
    kept = (count == factor * factor) & (total < _BRIGHT * usual)
    by_mirror = lighting.mirrored & kept[block]
    if by_mirror.sum() < 1000:
        raise SimrigError("the mirror lights too few pixels of this picture: take more pixels")
    low, high = np.quantile(lighting.theta_h[by_mirror], _WELL_LIT)
    # where few rays tell of a polar angle, none do
    strange = (lighting.theta_h > high) | (lighting.theta_h < low)
    kept[block[lighting.mirrored & strange]] = False
    by_mirror &= kept[block]
    theta = lighting.theta_h[by_mirror]
    knots = (
        _knots(_EVEN, low, high),
        _knots(_RADIAL, low, high),
        _knots(_TILTED, low, high),
    )
    place, rows = (np.cumsum(kept) - 1)[block], int(kept.sum())  # the row of a block
    # light that crosses the axis on its way came from the far side of the mirror
    x, y = (2.0 * (v[by_mirror] + 0.5) / lighting.pixels - 1.0 for v in (column, row))
    phi, light = lighting.phi_h[by_mirror], lighting.irradiance[by_mirror]
    group = place[by_mirror] + rows * (x * np.cos(phi) <= y * np.sin(phi))
    basis = _basis(knots, theta, phi, lighting.view[by_mirror], light, group, 2 * rows)
    basis = basis.reshape(2, rows, -1) / total[kept, None]
    share = np.bincount(group, light, 2 * rows).reshape(2, rows) / total[kept]
    sides = list(zip(share, basis, strict=True))
    matrix = sides[0][1] + sides[1][1]
    direct = ~lighting.mirrored & kept[block]
    x, y = (2.0 * (v[direct] + 0.5) / lighting.pixels - 1.0 for v in (column, row))
    powers = [(i, j) for i in range(_PEDESTAL + 1) for j in range(_PEDESTAL + 1 - i)]
    smooth = np.stack([x**i * y**j for i, j in powers], axis=-1)
    smooth *= lighting.irradiance[direct, None]
    pedestal = [np.bincount(place[direct], own, rows) for own in smooth.T]
    matrix = np.concatenate([matrix, np.stack(pedestal, axis=-1) / total[kept, None]], axis=1)
    order = np.tile(np.arange(1, _HARMONICS + 1) / _FALL_OFF, 2)
    expected = np.r_[
        np.full(_EVEN, _EXPECTED),
        np.tile(_HARMONIC / (1.0 + order**2), _RADIAL),
        np.full(_TILTED, _TILT),
        np.full(2 * _TILTED, _SECOND_TILT),
        np.full(len(powers), _EXPECTED if direct.any() else 1e-6),
    ]
    return System(
        factor,
        np.flatnonzero(kept),
        total,
        matrix,
        matrix.T @ matrix,
        sides,
        knots,
        expected,
        (float(low), float(high)),
    )


def _read(system: System, found: Solution, mean: float) -> Anisotropy:
    """Return the unrolled picture, its profile and the modes."""
    solved, variance = found.whole.factor, found.variance
    phi = np.deg2rad(np.arange(0.0, 180.0, _STEP_DEG))
    thetas = np.linspace(*system.theta, 9)
    basis = np.stack([system.profile_basis(np.full(len(phi), t), phi) for t in thetas])
    unrolled = basis @ found.whole.unknowns + 1.0  # (thetas, phis, 3)
    level = unrolled.mean(axis=1)
    overall = np.maximum(level, 1e-3)
    # what each polar angle and channel tells: modulation over its uncertainty
    spread = np.empty(len(thetas))
    for k in range(len(thetas)):
        sparse = basis[k, ::20]
        spread[k] = np.sqrt(np.mean(np.sum(sparse * cho_solve(solved, sparse.T).T, axis=1)))
    sigma = spread[:, None] * np.sqrt(variance)
    signal = unrolled - level[:, None]
    rows = (signal / sigma[:, None]).transpose(0, 2, 1).reshape(-1, len(phi))
    left, _, _ = np.linalg.svd(rows, full_matrices=False)
    weight = left[:, 0].reshape(len(thetas), 3)
    weight = np.maximum(weight * np.sign(weight.sum()), 0.0) / sigma
    share = float(np.sum(weight * overall) / np.sum(weight))
    weight = weight / np.sum(weight * overall)
    profile = np.einsum("kc,kpc->p", weight, signal)
    read = np.einsum("kc,kpu->cpu", weight, basis)
    read -= read.mean(axis=1, keepdims=True)
    covariance = np.zeros((len(phi), len(phi)))
    for own, noise in zip(read, variance, strict=True):
        covariance += noise * own @ cho_solve(solved, own.T)
    covariance *= found.excess(read[:, ::_SPARSE])
    modes = find_modes(phi, profile, covariance, unrolled.mean(axis=0), share)
    uncertainty = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return Anisotropy(
        modes, thetas, phi, unrolled * mean, profile, uncertainty, found.residual, share
    )

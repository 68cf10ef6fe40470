"""The true plane of a sample's surface, found by how well pictures align when it is taken for it.

Two ways to the least error of the principal component analysis (``simrig.imaging.alignment``):

- ``search_plane`` is the thesis's (section 4.2, appendix C.3): one of z, polar angle and azimuth
  after the other over its whole range in coarse steps, then near the minimum in fine ones;
- ``fit_plane`` sweeps z once, patch by patch, which tells where to begin, and goes down by
  Gauss-Newton. The components that are kept depend on the plane too; the derivative of the error is
  that of what they leave (variable projection: Golub and Pereyra 1973, Kaufman 1975).

The uncertainty adds two parts. One is that of a sum over views that are independent of each other
(a sandwich estimate, clustered by views): what a view shows differently from all others counts as
one error, however many pixels it has. The other is by how much the heights of the patches scatter
about the plane. How much the heights of small cells scatter is said too: where there is relief, the
plane that aligns best need not be that of the mean height.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from simrig.core.cost import stopwatch
from simrig.core.errors import SimrigError
from simrig.imaging.alignment import Alignment, Patches, Plane, Views, reach_of
from simrig.imaging.descent import Descent, descend, linearised

HEIGHT_MM, TILT_DEG = 2.0, 3.0  # of the search, thesis appendix C.3
_STEEPEST = 0.2  # share of the pictures that the highest plane may displace points by
_ACROSS, _SIDE = 4, 20  # patches in a row, pixels of a patch
_LEVELS = (4, 2, 1)  # thinning
_BLUR = 0.6  # standard deviation of the smoothing in thinned pixels
_FAINT = 0.25  # of the contrast that smoothing must leave for a level to count
_STARTS = 3
_SAME_MM, _SAME_TILT = 0.02, 5e-4  # of planes that count as one
_RIVAL = 0.1  # of the gain in error that another minimum may lack to count as a rival
_NO_GAIN = 0.98  # of the error that a plane must leave less of
_RELIEF_MM = 0.01  # beyond which it is said
_CYCLES = 8


@dataclass(frozen=True)
class PlaneFit:
    """A plane that was found.

    Attributes:
        plane: it.
        covariance: (3, 3) of z in mm and the two slopes; infinite where the views do not tell.
        error_before, error_after: of the principal component analysis for the reference plane and
            for this one, relative.
        evaluations: registrations of all views that it took.
        seconds: that it took.
        doubts: why it may be wrong; empty where nothing speaks against it.
        left_out: views too steep for the pictures' margins.
        relief_mm: standard deviation of the height of the structure about the plane.
        left_range: it is beyond what was searched.
    """

    plane: Plane
    covariance: np.ndarray
    error_before: float
    error_after: float
    evaluations: int
    seconds: float
    doubts: tuple[str, ...] = ()
    left_out: int = 0
    relief_mm: float = 0.0
    left_range: bool = False

    @property
    def u_z_mm(self) -> float:
        """Standard uncertainty of z, mm."""
        return float(np.sqrt(self.covariance[0, 0]))

    @property
    def u_tilt(self) -> float:
        """Standard uncertainty of the normal's direction, radians (both slopes together)."""
        return float(np.sqrt(self.covariance[1, 1] + self.covariance[2, 2]))

    def as_dict(self) -> dict[str, object]:
        """Return plain values, angles in degrees."""
        return {
            "z_mm": self.plane.z_mm,
            "theta_deg": float(np.degrees(self.plane.theta)),
            "phi_deg": float(np.degrees(self.plane.phi)),
            "u_z_mm": self.u_z_mm,
            "u_tilt_deg": float(np.degrees(self.u_tilt)),
            "relief_mm": self.relief_mm,
            "pca_error_before": self.error_before,
            "pca_error_after": self.error_after,
            "evaluations": self.evaluations,
            "seconds": self.seconds,
            "doubts": list(self.doubts),
            "left_out": self.left_out,
        }


def fit_plane(
    views: Views,
    *,
    height_mm: float = HEIGHT_MM,
    tilt_deg: float = TILT_DEG,
    components: int | None = None,
) -> PlaneFit:
    """Find the plane by one sweep and Gauss-Newton.

    Args:
        views: pictures registered to the reference plane.
        height_mm, tilt_deg: how far the surface may be from it.
        components: principal components that are kept; by default one for every 20 views.

    Raises:
        SimrigError: pictures without structure, or smaller than the search reaches.
    """
    elapsed = stopwatch()
    usable, margin, left_out = _usable(views, height_mm, tilt_deg)
    count = _components(components, usable)
    already = usable.evaluations
    levels = list(_aligned_levels(usable, margin, count))
    found = [descend(levels[0], start, height_mm) for start in _starts(levels[0], height_mm)]
    found = _promising(found, levels[0].error(Plane()))
    before, rivals = levels[-1].error(Plane()), []
    for level in levels[1:]:
        found = [descend(level, descent.plane, height_mm) for descent in _distinct(found)]
    found = _distinct(found)
    best = found[0]
    for other in found[1:]:
        apart = abs(other.plane.z_mm - best.plane.z_mm)
        close = other.error - best.error < _RIVAL * max(before - best.error, 0.0)
        if close and apart > 0.05:
            rivals.append(f"z = {other.plane.z_mm:.2f} mm is aligned almost as well")
    if best.error > _NO_GAIN * before and best.error > 0.5:
        best = replace(best, covariance=np.diag([np.inf] * 3))
    doubts = _doubts(best, height_mm, tilt_deg) + rivals[:1]
    return PlaneFit(
        best.plane,
        best.covariance,
        before,
        best.error,
        sum(level.views.evaluations for level in levels) - already,
        elapsed(),
        tuple(doubts),
        left_out,
        best.relief_mm,
        _beyond(best.plane, height_mm, tilt_deg),
    )


def search_plane(
    views: Views,
    *,
    height_mm: float = HEIGHT_MM,
    tilt_deg: float = TILT_DEG,
    components: int | None = None,
) -> PlaneFit:
    """Find the plane by the thesis's alternating search, on the same patches as ``fit_plane``.

    Steps of 0.1 mm, 0.1° and 10° over the whole ranges, then of 0.01 mm, 0.01° and 1° near the
    minimum, one parameter at a time until none changes.

    Raises:
        SimrigError: see ``fit_plane``.
    """
    elapsed = stopwatch()
    usable, margin, left_out = _usable(views, height_mm, tilt_deg)
    count = _components(components, usable)
    already = usable.evaluations
    measure = Alignment.of(usable, Patches.over(usable, margin, _ACROSS, _SIDE), count)
    before = measure.error(Plane())
    known: dict[tuple[int, int, int], float] = {}

    def error(at: np.ndarray) -> float:
        """Return the error at hundredths of mm, hundredths of degrees and whole degrees."""
        key = (int(at[0]), int(at[1]), int(at[2]) % 360)
        if key not in known:
            plane = Plane.tilted(key[0] / 100.0, np.radians(key[1] / 100.0), np.radians(key[2]))
            known[key] = measure.error(plane)
        return known[key]

    high, steep = round(100.0 * height_mm), round(100.0 * tilt_deg)
    whole = [np.arange(-high, high + 1, 10), np.arange(0, steep + 1, 10), np.arange(0, 360, 10)]
    near = [np.arange(-10, 11), np.arange(-10, 11), np.arange(-10, 11)]
    at = np.array([0, min(50, steep), 0])  # tilted a little, or no azimuth differs from another
    at = _alternate(error, at, lambda _: whole, (0, 2, 1))
    at = _alternate(error, at, lambda now: [n + value for n, value in zip(near, now, strict=True)])
    plane = Plane.tilted(at[0] / 100.0, np.radians(at[1] / 100.0), np.radians(float(at[2])))
    evaluations = usable.evaluations - already
    last = linearised(measure, plane)
    return PlaneFit(
        plane,
        last.covariance,
        before,
        last.error,
        evaluations,
        elapsed(),
        tuple(_doubts(last, height_mm, tilt_deg)),
        left_out,
        last.relief_mm,
        _beyond(plane, height_mm, tilt_deg),
    )


def _alternate(
    error: Callable[[np.ndarray], float],
    at: np.ndarray,
    around: Callable[[np.ndarray], list[np.ndarray]],
    order: tuple[int, ...] = (0, 1, 2),
) -> np.ndarray:
    """Change one parameter after the other to its best value, until none changes."""
    for _ in range(_CYCLES):
        before = at.copy()
        for number in order:
            tried = []
            for value in around(at)[number]:
                there = at.copy()
                there[number] = value
                if there[1] >= 0:
                    tried.append((error(there), tuple(there)))
            at = np.array(min(tried)[1])
        if np.array_equal(at, before):
            break
    return at


def _usable(views: Views, height_mm: float, tilt_deg: float) -> tuple[Views, float, int]:
    """Return the views that are not too steep for a search, and the margin that it takes."""
    if not (0.0 < height_mm < 1e3 and 0.0 <= tilt_deg < 45.0):
        raise SimrigError(
            f"a search reaches some mm and less than 45°, got {height_mm:g} mm and {tilt_deg:g}°"
        )
    edge = float(np.max(views.half_mm))
    highest = height_mm + np.tan(np.radians(tilt_deg)) * 0.5 * edge
    allowed = 2.0 * _STEEPEST * float(np.min(views.half_mm))
    away = np.hypot(views.cameras_mm[:, 0], views.cameras_mm[:, 1]) / views.cameras_mm[:, 2]
    keep = highest * away <= allowed
    if keep.sum() < 3:
        raise SimrigError(
            f"planes {height_mm:g} mm and {tilt_deg:g}° off displace points of all but "
            f"{int(keep.sum())} views by more than a fifth of the pictures: search less far, or "
            "register a larger area"
        )
    margin = reach_of(views.cameras_mm[keep], highest)
    if keep.all():
        return views, margin, 0
    chosen = Views(views.pictures[keep], views.pitch_mm, views.cameras_mm[keep])
    return chosen, margin, int((~keep).sum())


def _components(components: int | None, views: Views) -> int:
    return max(1, len(views.pictures) // 20) if components is None else components


def _aligned_levels(views: Views, margin: float, components: int) -> Iterator[Alignment]:
    """Yield the measure on smoothed and thinned pictures, the coarsest first.

    Levels where smoothing leaves no contrast are left out.
    """
    sharp = views.pictures.std(axis=(1, 2)).mean()
    for every in _LEVELS:
        size = min(views.pictures.shape[1:]) // every
        if every > 1:
            if size < 2 * _SIDE:
                continue
            level = views.smoothed(_BLUR * every * views.pitch_mm, every)
            if level.pictures.std(axis=(1, 2)).mean() < _FAINT * sharp:
                continue
        else:
            level = views
        side = _SIDE if every == 1 else max(12, 2 * _SIDE // every)
        yield Alignment.of(level, Patches.over(level, margin, _ACROSS, side), components)


def _starts(level: Alignment, height_mm: float) -> list[Plane]:
    """Sweep z, and return planes to begin from."""
    away = np.hypot(level.views.cameras_mm[:, 0], level.views.cameras_mm[:, 1])
    steep = float(np.percentile(away / level.views.cameras_mm[:, 2], 75.0))
    step = float(np.clip(level.views.pitch_mm / max(steep, 0.2), 0.02, 0.25))
    heights = np.linspace(-height_mm, height_mm, max(5, 2 * int(np.ceil(height_mm / step)) + 1))
    errors = np.array([level.errors_of_patches(Plane(float(z))) for z in heights])
    best = errors.argmin(axis=0)
    gain = np.median(errors, axis=0) - errors.min(axis=0)
    starts = []
    if errors.shape[1] >= 4:
        x, y = level.patches.x.mean(axis=1), level.patches.y.mean(axis=1)
        scale = np.sqrt(np.maximum(gain, 1e-12))

        def off(p: np.ndarray) -> np.ndarray:
            return scale * (p[0] + p[1] * x + p[2] * y - heights[best])

        spread = float(np.median(scale)) * 2.0 * step
        fitted = least_squares(
            off, [float(np.median(heights[best])), 0.0, 0.0], loss="soft_l1", f_scale=spread
        )
        starts.append(Plane(*(float(v) for v in fitted.x)))
    mean = errors.mean(axis=1)
    padded = np.concatenate([[np.inf], mean, [np.inf]])
    valleys = np.flatnonzero((mean <= padded[:-2]) & (mean <= padded[2:]))
    for number in valleys[np.argsort(mean[valleys])][: _STARTS - len(starts) + 1]:
        starts.append(Plane(float(heights[number])))
    return starts


def _promising(found: list[Descent], before: float) -> list[Descent]:
    """Return the descents that gained at least half of what the best one did."""
    least = min(descent.error for descent in found)
    return [d for d in found if d.error <= least + 0.5 * max(before - least, 0.0)]


def _distinct(found: list[Descent]) -> list[Descent]:
    """Return the descents that ended at planes of their own, the best first."""
    kept: list[Descent] = []
    for descent in sorted(found, key=lambda descent: descent.error):
        if all(
            abs(descent.plane.z_mm - other.plane.z_mm) > _SAME_MM
            or descent.plane.tilt_from(other.plane) > _SAME_TILT
            for other in kept
        ):
            kept.append(descent)
    return kept


def _doubts(best: Descent, height_mm: float, tilt_deg: float) -> list[str]:
    doubts = []
    u_z = float(np.sqrt(best.covariance[0, 0]))
    u_tilt = float(np.degrees(np.sqrt(best.covariance[1, 1] + best.covariance[2, 2])))
    if not u_z < 0.25 * height_mm:
        doubts.append("the views do not tell the plane: too few, too alike, or without structure")
    elif u_z > 0.02 or u_tilt > 0.1:
        doubts.append(f"uncertain: {u_z:.3g} mm and {u_tilt:.2g}° (k = 1)")
    if best.relief_mm > _RELIEF_MM:
        doubts.append(
            f"the structure is {best.relief_mm:.2g} mm rms deep: its mean height may be that far "
            "from the plane that aligns best"
        )
    if _beyond(best.plane, height_mm, tilt_deg):
        doubts.append(f"beyond what was searched, {height_mm:g} mm and {tilt_deg:g}°")
    return doubts


def _beyond(plane: Plane, height_mm: float, tilt_deg: float) -> bool:
    return bool(abs(plane.z_mm) > height_mm or np.degrees(plane.theta) > tilt_deg)

"""Noisy pictures and how far apart they really are.

A picture rendered twice with independent random numbers differs from itself. *Replicates* are
independent halves of one picture; what they differ by says how noisy their mean is, without any
model of the noise. With A₁, A₂ and B₁, B₂ the halves of two pictures, in a space where changes are
measured (CIE L*a*b*, displayed values, radiance),

    d = (A₁ + A₂)/2 − (B₁ + B₂)/2        what was measured, change and noise together,
    n = ((A₁ − B₁) − (A₂ − B₂))/2        pure noise, of the same distribution as that in d,

per pixel. The *noise floor* of a metric is the metric of n: what it would say of two renders of
the same thing. It holds for independent halves and for halves that share random numbers alike.
Pixels that are black in both pictures do not count.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from simrig.core.colour import to_lab
from simrig.core.effects import Tolerance
from simrig.core.errors import SimrigError
from simrig.evaluation.metrics.images import displayed, foreground_mask, psnr_from_mse
from simrig.rendering.render import RenderResult

# Of the least change that is certain: below this ΔE, or this part of the mean radiance, two
# pictures are equal as far as float32 goes.
ROUNDING = {"dE": 2e-3, "psnr": 2e-3, "relative": 2e-5}
_CERTAIN = 3.0  # standard errors


@dataclass(frozen=True, eq=False)
class Replicates:
    """A picture as two independent halves.

    Attributes:
        halves: float64 (2, height, width, 3), linear RGB, each rendered with its own seed.
        compile_seconds, run_seconds: of both together.
        fastest_seconds: run time of the faster half.
        batches: samples per pixel of each half, batch by batch.
    """

    halves: np.ndarray
    compile_seconds: float
    run_seconds: float
    fastest_seconds: float
    batches: tuple[int, ...]

    def __post_init__(self) -> None:
        if self.halves.ndim != 4 or self.halves.shape[0] != 2 or self.halves.shape[3] != 3:
            raise SimrigError(f"halves have shape (2, height, width, 3), got {self.halves.shape}")

    @property
    def spp(self) -> int:
        """Samples per pixel of both halves together."""
        return 2 * sum(self.batches)

    @property
    def image(self) -> np.ndarray:
        """The picture: the mean of its halves."""
        return self.halves.mean(axis=0)

    def standard_errors(self, exposure: float = 1.0) -> dict[str, float]:
        """Return the standard errors of the picture, by metric: half of what its halves differ by.

        Raises:
            SimrigError: a black picture.
        """
        mask = foreground_mask(*self.halves)
        if not mask.any():
            raise SimrigError("the picture is black: there is nothing to compare with")
        apart = distances(self.halves[0], self.halves[1], mask, exposure)
        return {metric: value / 2.0 for metric, value in apart.items()}


def replicates(
    render_one: Callable[[int, int], RenderResult], batches: Sequence[int], seed: int = 0
) -> Replicates:
    """Render a picture twice with independent random numbers.

    Two pictures of the same batches and seed share their random numbers as far as their
    integrators draw the same ones.

    Args:
        render_one: renders it with given samples per pixel and seed.
        batches: samples per pixel of each half, rendered one after the other and averaged.
        seed: all seeds are drawn from it.
    """
    parts = [_batch(render_one, spp, seed, index) for index, spp in enumerate(batches)]
    return _merged(parts)


def converged(
    render_one: Callable[[int, int], RenderResult],
    good: Callable[[Replicates], bool],
    seconds: float,
    seed: int = 0,
    first: int = 64,
    most: int = 1 << 18,
) -> Replicates:
    """Render a picture in growing batches until it is good enough or its time is spent.

    Args:
        render_one: renders it with given samples per pixel and seed.
        good: says of what there is so far whether it is good enough.
        seconds: of running, compilation apart; no batch but the first is begun that is expected
            to end later.
        seed: all seeds are drawn from it.
        first: samples per pixel of each half in the first batch; the others double them.
        most: samples per pixel in both halves after which it ends.
    """
    start = last = time.perf_counter()
    parts = [_batch(render_one, first, seed, 0)]
    while True:
        now = time.perf_counter()
        picture = _merged(parts)
        growth = 1.0 if len(parts) == 1 else 2.0  # of the next batch over the last one
        compiling = parts[-1].compile_seconds  # happens once, and is no measure of the next batch
        running = now - start - picture.compile_seconds
        late = running + growth * (now - last - compiling) > seconds
        if late or 2 * picture.spp > most or good(picture):
            return picture
        last = time.perf_counter()
        parts.append(_batch(render_one, picture.spp // 2, seed, len(parts)))


def _batch(
    render_one: Callable[[int, int], RenderResult], spp: int, seed: int, index: int
) -> Replicates:
    seeds = np.random.SeedSequence([seed, index]).generate_state(2)
    results = [render_one(spp, int(one)) for one in seeds]
    return Replicates(
        np.stack([result.image for result in results]).astype(np.float64),
        sum(result.compile_seconds for result in results),
        sum(result.run_seconds for result in results),
        min(result.run_seconds for result in results),
        (spp,),
    )


def _merged(parts: Sequence[Replicates]) -> Replicates:
    """Return batches as one picture, each weighted by its samples."""
    weights = np.array([part.spp for part in parts], dtype=np.float64)
    return Replicates(
        np.tensordot(weights / weights.sum(), np.stack([part.halves for part in parts]), axes=1),
        sum(part.compile_seconds for part in parts),
        sum(part.run_seconds for part in parts),
        sum(part.fastest_seconds for part in parts),
        tuple(spp for part in parts for spp in part.batches),
    )


@dataclass(frozen=True)
class Change:
    """By how much two pictures differ in one metric, and how much of that is noise.

    Attributes:
        measured: the metric of the two pictures, noise included.
        noise: what the metric says of noise alone.
        least: the change that is certain: no noise explains it (three standard errors).
    """

    measured: float
    noise: float
    least: float

    @property
    def corrected(self) -> float:
        """The change without the noise, which is independent of it: √(measured² − noise²)."""
        return math.sqrt(max(self.measured**2 - self.noise**2, 0.0))


@dataclass(frozen=True)
class Difference:
    """Two pictures compared in every metric that a tolerance may name.

    Attributes:
        changes: by metric: ``dE`` (mean CIE ΔE 1976), ``psnr`` (root mean square of displayed
            values, which is what a PSNR says, in steps of 255), ``relative`` (mean absolute
            change over mean value) and ``relative_rms`` (root mean square over mean value).
        largest_delta_e: of any pixel, with its noise taken off.
    """

    changes: dict[str, Change]
    largest_delta_e: float

    def of(self, tolerance: Tolerance) -> Change:
        """Return the change in the unit of a tolerance."""
        return self.changes[tolerance.metric]

    def as_dict(self) -> dict[str, float]:
        """Return plain numbers; a PSNR of identical pictures is infinite."""
        delta_e, display, relative = (self.changes[key] for key in ("dE", "psnr", "relative"))
        return {
            "delta_e": delta_e.measured,
            "delta_e_noise": delta_e.noise,
            "delta_e_corrected": delta_e.corrected,
            "delta_e_max": self.largest_delta_e,
            "psnr": psnr_from_mse(display.measured**2),
            "psnr_noise": psnr_from_mse(display.noise**2),
            "relative": relative.measured,
            "relative_noise": relative.noise,
            "relative_corrected": relative.corrected,
        }


def difference(
    reference: Replicates, other: Replicates, exposure: float = 1.0, mask: np.ndarray | None = None
) -> Difference:
    """Compare two pictures, change and noise apart.

    Args:
        reference, other: of the same size.
        exposure: factor from radiance to the displayed linear value.
        mask: pixels that count, (height, width); by default those not black in both pictures.

    Raises:
        SimrigError: pictures of different sizes, or a mask that does not fit or is empty.
    """
    if reference.halves.shape != other.halves.shape:
        raise SimrigError(
            f"the pictures differ in size: {reference.image.shape} and {other.image.shape}"
        )
    if mask is None:
        mask = foreground_mask(reference.image, other.image)
    if mask.shape != reference.halves.shape[1:3] or not mask.any():
        raise SimrigError(f"the mask of shape {mask.shape} does not fit or leaves no pixel")
    lab = _vectors(reference, other, lambda image: to_lab(exposure * image), mask)
    shown = _vectors(reference, other, lambda image: displayed(image, exposure), mask)
    radiance = _vectors(reference, other, lambda image: image, mask)
    mean = float(reference.image[mask].mean()) or 1.0
    delta_e = [np.linalg.norm(vectors, axis=-1) for vectors in lab]
    relative = [np.abs(vectors).mean(axis=-1) / mean for vectors in radiance]
    changes = {
        "dE": _mean_change(delta_e[0], delta_e[1], ROUNDING["dE"]),
        "psnr": _rms_change(shown[0], shown[1], ROUNDING["psnr"]),
        "relative": _mean_change(relative[0], relative[1], ROUNDING["relative"]),
        "relative_rms": _rms_change(radiance[0] / mean, radiance[1] / mean, 0.0),
    }
    largest = np.sqrt(np.maximum(delta_e[0] ** 2 - delta_e[1] ** 2, 0.0)).max()
    return Difference(changes, float(largest))


def _vectors(
    reference: Replicates,
    other: Replicates,
    space: Callable[[np.ndarray], np.ndarray],
    counted: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Return d and n of the counted pixels, each (pixels, 3); see this module's docstring."""
    measured = space(reference.image) - space(other.image)
    apart = [space(a) - space(b) for a, b in zip(reference.halves, other.halves, strict=True)]
    return measured[counted], (apart[0] - apart[1])[counted] / 2.0


def _mean_change(measured: np.ndarray, noise: np.ndarray, rounding: float) -> Change:
    """Return the change of a metric that is a mean of lengths, from the lengths per pixel.

    By the triangle inequality the true length is at least |d| − |noise in d|, on average over
    pixels |d| − |n|; the spread over the pixels gives the standard error of that.
    """
    sure = measured - noise
    spread = sure.std() / math.sqrt(sure.size)
    least = max(float(sure.mean() - _CERTAIN * spread) - rounding, 0.0)
    return Change(float(measured.mean()), float(noise.mean()), least)


def _rms_change(measured: np.ndarray, noise: np.ndarray, rounding: float) -> Change:
    """Return the change of a root mean square, of (pixels, 3); squares of change and noise add."""
    squares = (measured**2 - noise**2).mean(axis=-1)
    spread = squares.std() / math.sqrt(squares.size)
    certain = math.sqrt(max(float(squares.mean() - _CERTAIN * spread), 0.0))
    rms = [math.sqrt(float((v**2).mean())) for v in (measured, noise)]
    return Change(rms[0], rms[1], max(certain - rounding, 0.0))


def distances(
    reference: np.ndarray, image: np.ndarray, mask: np.ndarray, exposure: float = 1.0
) -> dict[str, float]:
    """Return how far one picture is from another, by metric as in ``Difference.changes``.

    ``dE_max`` is that of the worst pixel.

    Args:
        reference, image: (height, width, 3), linear RGB.
        mask: pixels that count, (height, width).
        exposure: factor from radiance to the displayed linear value.
    """
    first, second = reference[mask], image[mask]
    mean = float(first.mean()) or 1.0
    delta_e = np.linalg.norm(to_lab(exposure * first) - to_lab(exposure * second), axis=-1)
    shown = displayed(first, exposure) - displayed(second, exposure)
    return {
        "dE": float(delta_e.mean()),
        "dE_max": float(delta_e.max()),
        "psnr": math.sqrt(float((shown**2).mean())),
        "relative": float(np.abs(first - second).mean()) / mean,
        "relative_rms": math.sqrt(float(((first - second) ** 2).mean())) / mean,
    }

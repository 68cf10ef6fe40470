"""Rendering a scene to a NumPy picture, with its cost."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from simrig.core import backend
from simrig.core.cost import Cost
from simrig.core.effects import EffectPlan
from simrig.core.errors import SimrigError
from simrig.core.exposure import automatic_exposure, display_exposure
from simrig.core.progress import Progress
from simrig.core.shown import Exhibit, Shown
from simrig.files.images import to_srgb8
from simrig.plugins.make import building
from simrig.rendering import multijitter
from simrig.rendering.film import film_colours
from simrig.rendering.pixel_samples import ControlSamples, pixel_directions
from simrig.rendering.sampled_pass import sampled_pass, takes_colours
from simrig.rendering.sensors import sensor_of

__all__ = [
    "Clock",
    "ControlSamples",
    "RenderResult",
    "automatic_exposure",
    "display_exposure",
    "load",
    "pixel_directions",
    "render",
    "timed",
]

# Samples at work at once: one pass took about 200 MB in the scenes of this laboratory, and ends,
# so that an interrupt can take effect, in below a second on 2 cores under one lamp.
SAMPLES_PER_PASS = 1 << 24
_WAVEFRONT_LIMIT = 1 << 32  # Dr.Jit counts the elements of an array in 32 bits


@dataclass(frozen=True, eq=False, repr=False)
class RenderResult(Shown):
    """A rendered picture and what it cost; ``np.asarray`` gives the picture.

    Attributes:
        image: float32 (height, width, 3), linear RGB radiance, finite.
        compile_seconds: time spent generating and compiling kernels; about 0 when the same
            kernels were compiled before, in this process or (disk cache) an earlier one.
        run_seconds: everything else: tracing the program and running it.
        integrator: plugin name or class of the integrator.
        film: what the film recorded and was made RGB of; empty for a film of RGB.
        plan: what was simulated and why; None where nothing was planned.
    """

    image: np.ndarray
    compile_seconds: float
    run_seconds: float
    spp: int
    integrator: str
    variant: str
    film: str = ""
    plan: EffectPlan | None = None

    @property
    def cost(self) -> Cost:
        """The record of the time spent."""
        return Cost(compile_seconds=self.compile_seconds, compute_seconds=self.run_seconds)

    @property
    def error(self) -> float | None:
        """How far it is expected to be from the picture with everything simulated.

        In the unit of the plan's tolerance (``plan.tolerance.unit``); None where nothing was
        planned, or the plan cannot tell.
        """
        return None if self.plan is None else self.plan.about.get("expected_error")

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        """Return the picture as an array."""
        return np.array(self.image, dtype=dtype, copy=copy)

    def __str__(self) -> str:
        """Return what it is and what it cost, in one line."""
        height, width = self.image.shape[:2]
        return (
            f"{width} × {height} pixels, {self.spp} samples per pixel by {self.integrator}: "
            f"{self.cost}; error: {self._error_text()}"
        )

    def exhibit(self) -> Exhibit:
        """Return the picture, exposed so that it shows well, its cost and its error."""
        height, width = self.image.shape[:2]
        lit = bool(np.max(self.image) > 0.0)
        exposure = display_exposure(self.image) if lit else 1.0
        if self.plan is not None:
            exposure = float(self.plan.about["exposure"])
        facts = {
            "cost": str(self.cost),
            "error": self._error_text(),
            "rendered": f"{self.spp} samples per pixel, {self.integrator}, {self.variant}",
            "exposure": f"{exposure:.3g}",
        }
        picture = to_srgb8(np.maximum(self.image, 0.0), exposure)
        return Exhibit(f"Picture of {width} × {height} pixels", facts, picture)

    def _error_text(self) -> str:
        if self.plan is None:
            return "not known, nothing was planned"
        if self.error is None:
            return "not known, see the plan's advice"
        return (
            f"{self.error:.3g} {self.plan.tolerance.unit} expected at most, {self.plan.tolerance}"
        )


def load(scene: Any) -> Any:
    """Return a Mitsuba scene from a dictionary; a scene comes back as it is.

    Selects the automatic variant when none is set.

    Raises:
        SimrigError: Mitsuba cannot build it (unknown plugin, bad parameter), in one line.
    """
    backend.current()
    return _load_dict(scene, "scene") if isinstance(scene, dict) else scene


def _load_dict(description: dict[str, Any], what: str) -> Any:
    with building(f"the {what}"):
        return mi.load_dict(description)


def render(
    scene: Any,
    spp: int | None = None,
    seed: int = 0,
    integrator: Any = None,
    progress: Progress | None = None,
    samples_per_pass: int = SAMPLES_PER_PASS,
    sensor: int = 0,
    sampler: str = "",
) -> RenderResult:
    """Render a scene.

    A picture of more than ``samples_per_pass`` samples is rendered in passes with different
    random numbers and averaged, so memory stays bounded; an interrupt (Ctrl-C) takes effect
    after the pass at work.

    Args:
        scene: a dictionary (``simrig.scenes``) or a loaded Mitsuba scene.
        spp: samples per pixel, >= 1; by default what the scene's sampler says. The scenes of
            ``simrig.scenes`` are lit by delta lights: each sample is exact, and more of them
            only smooth edges and highlights within a pixel (16; 1 with ``pixel_centres``).
        seed: >= 0; the same seed gives the same picture.
        integrator: plugin name, dictionary or object; by default that of the scene.
        samples_per_pass: largest number of samples (pixels × spp) at work at once.
        sensor: which of the scene's sensors sees it.
        sampler: plugin name of the sampler, in place of the sensor's; spp is to be a number that
            it draws. Colours are red, green and blue then, whatever the film's are. Integrators
            that follow light instead of the camera's rays keep their own.

    Raises:
        SimrigError: bad arguments, or a result that is not finite (names the pixels).
    """
    scene = load(scene)
    camera = sensor_of(scene, sensor)
    spp = camera.sampler().sample_count() if spp is None else spp
    _check_whole("spp", spp, least=1)
    _check_whole("the seed", seed, least=0)
    integrator, name = _integrator(integrator, scene)
    width, height = camera.film().crop_size()
    passes = _passes(int(spp), int(width * height), samples_per_pass, sampler == multijitter.NAME)
    # one stream per pass and seed; consecutive numbers would share passes between seeds
    seeds = np.random.SeedSequence(int(seed)).generate_state(len(passes))

    total: Any = 0.0
    done = 0
    film = ""
    with timed() as clock:
        for pass_spp, pass_seed in zip(passes, seeds, strict=True):
            colours, film = _pass(scene, sensor, integrator, pass_spp, int(pass_seed), sampler)
            if len(passes) > 1:
                total = total + np.float64(pass_spp / spp) * colours
            done += pass_spp
            if progress:
                progress(done, spp)
        image = np.asarray(total if len(passes) > 1 else colours, dtype=np.float32)
    _check_finite(image)
    return RenderResult(
        image, clock.compile_seconds, clock.run_seconds, int(spp), name, str(mi.variant()), film
    )


def _pass(
    scene: Any, sensor: int, integrator: Any, spp: int, seed: int, sampler: str
) -> tuple[np.ndarray, str]:
    """Return the picture of one pass, and what its film records where that is not RGB."""
    camera = scene.sensors()[sensor]
    if sampler and isinstance(integrator, mi.SamplingIntegrator) and takes_colours(camera.film()):
        return sampled_pass(scene, camera, integrator, spp, seed, sampler), ""
    picture = mi.render(
        scene,
        sensor=sensor,
        integrator=integrator,
        spp=spp,
        seed=seed,  # type: ignore[arg-type]  # the stub knows no plain int
    )
    return _colours(camera.film(), np.array(picture))


def _colours(film: Any, picture: np.ndarray) -> tuple[np.ndarray, str]:
    """Return the colours that a film recorded, and what it records where that is not RGB."""
    to_rgb = film_colours(film)
    return to_rgb(picture), to_rgb.note


def made_integrator(integrator: dict[str, Any]) -> Any:
    """Return an integrator from its dictionary.

    Raises:
        SimrigError: Mitsuba cannot build it.
    """
    return _load_dict(integrator, "integrator")


def _check_whole(what: str, value: Any, least: int) -> None:
    try:
        whole = value == int(value) and value >= least
    except (TypeError, ValueError, OverflowError):
        whole = False
    if not whole:
        raise SimrigError(f"{what} must be a whole number >= {least}, got {value!r}")


def _integrator(integrator: Any, scene: Any) -> tuple[Any, str]:
    """Return the integrator object and its name."""
    if integrator is None:
        integrator = scene.integrator()
        if integrator is None:
            raise SimrigError("the scene has no integrator: name one, for example 'path'")
        return integrator, integrator.class_name()
    if isinstance(integrator, str):
        integrator = {"type": integrator}
    if not isinstance(integrator, dict):
        return integrator, integrator.class_name()
    return _load_dict(integrator, "integrator"), str(integrator["type"])


def _passes(spp: int, pixels: int, samples_per_pass: int, stratified: bool = False) -> list[int]:
    """Return the samples per pixel of each pass.

    Full passes take a power of two, because those share one kernel; the rest comes last. Stratified
    ones take numbers that ``multijitter`` draws.
    """
    limit = min(samples_per_pass, _WAVEFRONT_LIMIT - 1)
    if pixels > limit:
        raise SimrigError(
            f"the picture has {pixels} pixels but a pass may hold {limit} samples: "
            "render it smaller, or in crops"
        )
    if stratified:
        return _stratified_passes(spp, limit // pixels)
    if spp * pixels <= limit:
        return [spp]
    full = 1 << ((limit // pixels).bit_length() - 1)
    return [full] * (spp // full) + ([spp % full] if spp % full else [])


def _stratified_passes(spp: int, most: int) -> list[int]:
    """Return passes of numbers r · c with r = ⌊√n⌋, the largest that fit first."""
    full = 1 << (2 * ((most.bit_length() - 1) // 2))
    passes = [full] * (spp // full) if spp > most else []
    left = spp - sum(passes)
    while left:
        passes.append(multijitter.nearest_grid(min(left, most)))
        left -= passes[-1]
    return passes


@dataclass
class Clock:
    """Where the time of a block went.

    Attributes:
        compile_seconds: generating and compiling kernels.
        run_seconds: everything else.
        kernel_seconds: of that, kernels at work; the rest is tracing the program and NumPy.
    """

    compile_seconds: float = 0.0
    run_seconds: float = 0.0
    kernel_seconds: float = 0.0


_running: list[Clock] = []  # the clocks of the blocks at work, innermost last


@contextmanager
def timed() -> Iterator[Clock]:
    """Time a block by Dr.Jit's kernel history; an outer block's times include an inner one's."""
    clock = Clock()
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        _note_kernels()  # what ran before belongs to the outer block
        _running.append(clock)
        start = time.perf_counter()
        try:
            yield clock
        finally:
            wall = time.perf_counter() - start
            _note_kernels()
            _running.pop()
            clock.compile_seconds = min(clock.compile_seconds, wall)
            clock.run_seconds = wall - clock.compile_seconds
            if _running:
                _running[-1].compile_seconds += clock.compile_seconds
                _running[-1].kernel_seconds += clock.kernel_seconds


def _note_kernels() -> None:
    """Add the kernels since the last call to the innermost clock; forget them without one."""
    for kernel in dr.kernel_history():
        if _running:
            clock = _running[-1]
            compiling = kernel.get("codegen_time", 0.0) + kernel.get("backend_time", 0.0)
            clock.compile_seconds += compiling / 1000.0
            clock.kernel_seconds += kernel.get("execution_time", 0.0) / 1000.0


def _check_finite(image: np.ndarray) -> None:
    if np.isfinite(image.sum(dtype=np.float64)):  # quicker than pixel by pixel
        return
    bad = np.argwhere(~np.isfinite(image).all(axis=-1))
    if len(bad):
        named = ", ".join(f"({row}, {column})" for row, column in bad[:5].tolist())
        more = ", ..." if len(bad) > 5 else ""
        raise SimrigError(
            f"{len(bad)} pixels of the picture are not finite, at (row, column) {named}{more}: "
            "the material or the light gives NaN or infinity there"
        )

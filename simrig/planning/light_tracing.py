"""A second opinion on a picture: light followed from the lamps, where paths may fail.

A path that leaves a matte surface meets the image of a millimetre lamp in a mirror by luck only;
followed from the lamp the same light arrives without any. Mitsuba's ``ptracer`` connects every
particle to the camera, so it sees all but what the camera looks at through, or by way of, something
specular. Where both agree, nothing is missing that one of them can find.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mitsuba as mi
import numpy as np

from simrig.planning.change import Display
from simrig.planning.view import View
from simrig.rendering.render import timed

FEWEST, PARTICLES = 1 << 16, 1 << 19
_CERTAIN = 3.0  # standard errors
_CLEAR, _NEGLIGIBLE = 5.0, 0.02  # standard errors, and the part of the mean, of one block
_PARTS = 8  # independent of each other
_BLOCKS = 8  # of the picture along either side
_EVEN = "ConstantBackgroundEmitter"


@dataclass(frozen=True, eq=False)
class LightTraced:
    """The picture by particles, in independent parts.

    Attributes:
        parts: (m, height, width, 3) linear RGB.
        spp: particles per pixel of each part.
        seconds_per_sample: per particle.
    """

    parts: np.ndarray
    spp: int
    seconds_per_sample: float

    @property
    def picture(self) -> np.ndarray:
        """The mean of the parts."""
        return np.asarray(self.parts.mean(axis=0))


@dataclass(frozen=True)
class Verdict:
    """What light tracing says of a picture by paths, in the unit of a tolerance.

    Attributes:
        least: by how much they differ for certain.
        most: by how much they may differ.
        share: of the light that only the particles found; negative where paths found more.
        paths_see_more: whether some part of the picture is brighter by paths, for certain.
    """

    least: float
    most: float
    share: float
    paths_see_more: bool


def light_tracer() -> dict[str, Any]:
    """Return the integrator as a dictionary."""
    return {"type": "ptracer", "max_depth": -1}


def trace_light(view: View, particles: int = PARTICLES) -> LightTraced | None:
    """Return the picture by particles, None where Mitsuba cannot trace them.

    Under an environment map its particles carry the wrong amount of light: of an even one, turned
    by 90°, 2.5 times too much (Mitsuba 3.9.1).

    Args:
        view: of the picture.
        particles: about how many; ``FEWEST`` at least and ``PARTICLES`` at most.
    """
    around = view.scene.environment()
    if around is not None and around.class_name() != _EVEN:
        return None
    particles = min(max(particles, FEWEST), PARTICLES)
    spp = max(particles // _PARTS // view.pixels, 1)
    try:
        integrator = mi.load_dict(light_tracer())
        with timed() as clock:
            parts = [_render(view, integrator, spp, seed) for seed in range(_PARTS)]
    except RuntimeError:
        return None
    if not np.isfinite(parts).all():
        return None
    seconds = clock.kernel_seconds / (_PARTS * spp * view.pixels)
    return LightTraced(np.stack(parts), spp, seconds)


def _render(view: View, integrator: Any, spp: int, seed: int) -> np.ndarray:
    tracer: Any = mi.render  # its stub knows no plain int
    found = tracer(view.scene, sensor=view.index, integrator=integrator, spp=spp, seed=seed)
    picture = np.array(found, dtype=np.float64)
    if picture.shape[-1] < 3:
        picture = np.repeat(picture[..., :1], 3, axis=-1)
    return picture[..., :3]


def compare(view: View, traced: LightTraced, samples: np.ndarray, display: Display) -> Verdict:
    """Compare particles with paths, block by block of the picture.

    Args:
        view: of the picture.
        traced: by particles.
        samples: (n, m, 3) means of groups of paths in the looked-at pixels.
        display: measures changes.
    """
    block = view.parts(_BLOCKS)
    count = int(block.max()) + 1
    pixels = view.chosen[:, 1] * view.size[0] + view.chosen[:, 0]
    here = traced.parts.reshape(len(traced.parts), -1, 3)[:, pixels]
    paths, particles = (_means(x, block, count) for x in (samples.swapaxes(0, 1), here))
    step = display.coordinates(particles.mean(axis=0)) - display.coordinates(paths.mean(axis=0))
    surplus = (step**2).sum(axis=1) - sum(
        display.coordinates(one).var(axis=0, ddof=1).sum(axis=1) / len(one)
        for one in (paths, particles)
    )
    mean, error = float(surplus.mean()), float(surplus.std()) / np.sqrt(count)
    least, most = (float(np.sqrt(max(mean + k * error, 0.0))) for k in (-_CERTAIN, _CERTAIN))
    grey = [one.mean(axis=2) for one in (paths, particles)]
    level = [max(float(one.mean()), 1e-30) for one in grey]
    sigma = np.sqrt(sum(one.var(axis=0, ddof=1) / len(one) for one in grey))
    lack = grey[0].mean(axis=0) - grey[1].mean(axis=0)
    more = bool((lack > _CLEAR * sigma + _NEGLIGIBLE * level[0]).any())
    return Verdict(least, most, 1.0 - level[0] / level[1], more)


def _means(pictures: np.ndarray, block: np.ndarray, count: int) -> np.ndarray:
    """Return the means (m, blocks, 3) of the looked-at pixels (m, n, 3) of pictures."""
    share = np.zeros((count, len(block)))
    share[block, np.arange(len(block))] = 1.0
    share /= share.sum(axis=1, keepdims=True)
    return np.asarray(np.einsum("bn,mnc->mbc", share, pictures))

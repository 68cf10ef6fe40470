"""A small sphere under an environment, and how far a reconstruction is from the truth on it.

The environment is a number of directional lights that are all added up, and every pixel looks
through its centre: there is no noise, so two pictures differ by their materials alone. What can be
rendered is rendered by Mitsuba. Radial basis functions are too slow for a renderer; they are
evaluated at the very directions at which the pixels see the lights, which gives the same picture.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from simrig.brdf.analytic import Lambert
from simrig.brdf.protocol import Brdf, evaluate
from simrig.brdf.tables.rbf import RbfBrdf
from simrig.core import backend
from simrig.evaluation.metrics.images import delta_e_map, foreground_mask, mse, psnr_from_mse
from simrig.plugins import make_bsdf
from simrig.rendering.pixel_samples import ControlSamples, pixel_directions
from simrig.rendering.render import automatic_exposure, load, render, timed
from simrig.scenes import environment_sphere

_HIGHEST = 99.0  # dB: pictures that differ by less are equal


@dataclass(frozen=True)
class PictureError:
    """How far a picture is from that of the truth, over the pixels that are not black.

    Attributes:
        delta_e: mean CIE ΔE 1976.
        psnr: of the displayed picture in dB, at most 99.
        compile_seconds: generating and compiling kernels.
        seconds: everything else that the picture took.
        by: ``"plugin"``, or ``"look-ups"`` where no renderer could take it.
    """

    delta_e: float
    psnr: float
    compile_seconds: float
    seconds: float
    by: str


class SpherePicture:
    """The picture of a material, to compare those of its reconstructions with.

    Selects the automatic variant when none is set.
    """

    def __init__(self, truth: Brdf, pixels: int = 64, lights: int = 16):
        self.truth, self.pixels, self.lights = truth, pixels, lights
        self.image = self.rendered(truth)
        shown = self.image if self.image.any() else self.rendered(Lambert((1.0, 1.0, 1.0)))
        self.exposure = automatic_exposure(shown)  # black beside white

    def compare(self, brdf: Brdf) -> PictureError:
        """Return the error and the cost of the picture of a BRDF."""
        slow = isinstance(brdf, RbfBrdf)
        if slow:
            self._directions  # noqa: B018 (they are the scene's, not a cost of the method)
        with timed() as clock:
            image = self.looked_up(brdf) if slow else self.rendered(brdf)
        mask = foreground_mask(self.image, image)
        if not mask.any():
            mask[:] = True  # black beside black
        error = mse(self.image, image, mask, self.exposure)
        return PictureError(
            delta_e=float(delta_e_map(self.image, image, self.exposure)[mask].mean()),
            psnr=min(_HIGHEST, psnr_from_mse(error)),
            compile_seconds=clock.compile_seconds,
            seconds=clock.run_seconds,
            by="look-ups" if slow else "plugin",
        )

    def rendered(self, brdf: Brdf) -> np.ndarray:
        """Return the picture (pixels, pixels, 3) that Mitsuba renders, linear RGB.

        Channels of colours outside sRGB are 0, as displays show them.
        """
        return np.maximum(render(self._scene(brdf), spp=1).image, 0.0)

    def looked_up(self, brdf: Brdf) -> np.ndarray:
        """Return the same picture from the reflectance's own values."""
        wi, wv = (
            np.concatenate([getattr(light, side) for light in self._directions])
            for side in ("omega_i", "omega_v")
        )
        values = evaluate(brdf, wi, wv, backend.types("float32").Float)
        ends = np.cumsum([len(light) for light in self._directions])[:-1]
        parts = zip(self._directions, np.split(values, ends), strict=True)
        pictures = np.stack([light.picture(own) for light, own in parts])
        return np.maximum(pictures.sum(axis=0, dtype=np.float32), 0.0)

    @cached_property
    def _directions(self) -> list[ControlSamples]:
        scene = load(self._scene(self.truth))
        return [pixel_directions(scene, light) for light in range(self.lights)]

    def _scene(self, brdf: Brdf) -> dict:
        backend.current()
        bsdf = make_bsdf(brdf)
        return environment_sphere(bsdf, self.lights, self.pixels, pixel_centres=True)

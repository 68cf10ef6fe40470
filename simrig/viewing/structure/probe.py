"""What structure looks like from 0.6 m, its features, and the distances that follow from them.

The flat stimulus: a piece of the material as the first cylinder of thesis section B.2 shows it,
seen along the normal under two directional lights, 1.0 from the right and 0.3 from the left, at
the pixels of experiment B (1868 rows, 24 mm of sensor, 45 mm of focal length). Beside it stands
what a BRDF shows: the mean colour of the piece, since a BRDF is the spatial mean of a BTF.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from simrig import perception
from simrig.core.colour import LUMINANCE
from simrig.core.cost import Cost
from simrig.core.errors import SimrigError
from simrig.core.shown import Exhibit, Shown
from simrig.files.images import as_image, encode_srgb

if TYPE_CHECKING:
    from simrig.btf.stack import BtfStack
    from simrig.mesostructure.tile import Tile

VIEWING_MM = 600.0  # thesis section 3.3.1: screen and first cylinder
PIXEL_MM = VIEWING_MM * (24.0 / 45.0) / 1868  # on the first cylinder; thesis sections 3.3.1, B.2
PATCH = 256  # pixels of the piece, 44 mm: the lower half of the cylinder is 59 × 60 mm
LIGHT_THETA_DEG = 60.0  # the thesis says right and left only
LIGHTS = ((1.0, 0.0), (0.3, 180.0))  # strength and azimuth in degrees; thesis section B.2
_FINER = 2  # pixels of a rendered tile along one displayed pixel

# name: (textured, plain, pixels per degree) -> value; thesis Table 3.1, features 1 to 7
FEATURES: Mapping[str, Callable[[np.ndarray, np.ndarray, float], float]] = {
    "luminance": lambda textured, _plain, _ppd: perception.luminance(textured),
    "contrast": lambda textured, plain, _ppd: perception.contrast(plain, textured),
    "ssim": lambda textured, plain, _ppd: perception.structural_difference(plain, textured),
    "flip": lambda textured, plain, ppd: perception.perceptual_difference(plain, textured, ppd),
    "luminance_contrast": lambda textured, _plain, _ppd: perception.luminance_contrast(textured),
    "texture_contrast": lambda textured, _plain, _ppd: perception.texture_contrast(textured),
    "saliency": lambda textured, _plain, _ppd: perception.saliency(textured),
}
PREDICTING = ("ssim", "saliency")  # with published constants; FLIP has none


@dataclass(frozen=True, eq=False)
class Stimulus:
    """A piece of a material as displayed.

    Attributes:
        textured: displayed grey in [0, 1], shape (height, width).
        plain: what its BRDF shows, in grey: one value of a flat piece, else of the same shape.
        pixel_mm: side of a pixel on the material.
    """

    name: str
    textured: np.ndarray
    plain: float | np.ndarray
    pixel_mm: float = PIXEL_MM
    cost: Cost = Cost()  # noqa: RUF009 (frozen)


@dataclass(frozen=True)
class StructureProbe(Shown):
    """Features of a stimulus, its structure, and what follows.

    Attributes:
        features: name to value, as in ``FEATURES``.
        structure_mm: S that the distances are computed with.
        found_mm: S by each method of ``simrig.perception.structure_size``.
        distances_m: feature to critical viewing distance by the published constants.
    """

    features: dict[str, float]
    structure_mm: float
    found_mm: dict[str, float]
    distances_m: dict[str, float]
    cost: Cost

    def __str__(self) -> str:
        """Return the predicted distances in one line."""
        told = ", ".join(f"{value:.2f} m by {name}" for name, value in self.distances_m.items())
        return f"critical distance {told} (S = {self.structure_mm:.3g} mm)"

    def exhibit(self) -> Exhibit:
        """Return the predicted distances, the features and the cost."""
        facts = {
            f"critical distance by {name}": f"{value:.2f} m"
            for name, value in self.distances_m.items()
        }
        facts |= {name: f"{value:.4g}" for name, value in self.features.items()}
        facts |= {"structure": f"{self.structure_mm:.3g} mm", "cost": str(self.cost)}
        return Exhibit("Critical viewing distance", facts)


def probe(stimulus: Stimulus, structure_mm: float | None = None) -> StructureProbe:
    """Return features, structure and predicted distances of a stimulus.

    Args:
        structure_mm: size of the largest structural element, by hand; found in the spectrum else.

    Raises:
        SimrigError: a stimulus that is too small, or a size that is not positive.
    """
    from simrig.perception.structure import METHODS

    if structure_mm is not None and not 0.0 < structure_mm < np.inf:
        raise SimrigError(f"the size of the structure must be > 0 mm, got {structure_mm:g}")
    start = time.perf_counter()
    plain = np.broadcast_to(stimulus.plain, stimulus.textured.shape)
    scale = perception.pixels_per_degree(PIXEL_MM, VIEWING_MM)
    structure = np.clip(stimulus.textured - plain + plain.mean(), 0.0, 1.0)  # without the shading
    features = {name: of(stimulus.textured, plain, scale) for name, of in FEATURES.items()}
    found = {
        method: perception.structure_size(structure, stimulus.pixel_mm, method)
        for method in METHODS
    }
    size = found["spectrum"] if structure_mm is None else structure_mm
    distances = {n: perception.predict_distance(n, size, features[n]) for n in PREDICTING}
    spent = Cost(compute_seconds=time.perf_counter() - start)
    return StructureProbe(features, size, found, distances, stimulus.cost + spent)


def element_of_preset(name: str) -> float | None:
    """Return the size of the largest element in mm of a BTF that a preset of that name gave.

    Coarse texels hide fine elements, and what is found in their spectrum then is the tile's own
    period. None of any other BTF.
    """
    from simrig.mesostructure import PRESETS

    return PRESETS[name].structure.element_mm if name in PRESETS else None


def tile_stimulus(tile: Tile, pixels: int = PATCH, spp: int = 256, seed: int = 0) -> Stimulus:
    """Render a tile flat with all its shadows and inter-reflections, and repeat it.

    One period is rendered, ``_FINER`` times as fine as it is displayed.

    Args:
        pixels: along each side of the piece, ``PIXEL_MM`` each.
        spp: samples per displayed pixel; 256 in the thesis. Noise would count as structure.
    """
    from simrig.rendering.render import render
    from simrig.scenes.tile import tile_scene

    widest = max(tile.size_mm)
    resolution = max(1, round(_FINER * widest / PIXEL_MM))
    scene = tile_scene(
        tile,
        width_mm=widest,
        theta_v_deg=0.0,
        light_deg=(LIGHT_THETA_DEG, LIGHTS[0][1]),
        sky=0.0,
        resolution=resolution,
    )
    result = render(scene, spp=max(1, round(spp / _FINER**2)), seed=seed)
    kept = [max(1, round(resolution * side / widest)) for side in tile.size_mm]
    period = _middle(result.image, kept[1], kept[0])
    patch = _repeated(period, tile.size_mm, pixels)
    return _flat(tile.name, patch, result.cost)


def btf_stimulus(stack: BtfStack, pixels: int = PATCH) -> Stimulus:
    """Light a measured tile by the two lights, from its images of the nearest directions.

    Raises:
        SimrigError: no image within 10° of the view or of a light.
    """
    start = time.perf_counter()
    lit: Any = 0.0
    for strength, phi_deg in LIGHTS:
        index, cosine = _nearest(stack, np.radians(LIGHT_THETA_DEG), np.radians(phi_deg))
        radiance = np.pi * cosine * np.asarray(stack.values[index], dtype=np.float64)
        lit = lit + strength * radiance
    patch = _repeated(lit, stack.size_mm, pixels)
    return _flat(stack.name, patch, Cost(compute_seconds=time.perf_counter() - start))


def image_stimulus(image: np.ndarray, width_mm: float, name: str = "image") -> Stimulus:
    """Take a picture of a material, seen along its normal, brought to the display's pixels.

    Args:
        image: linear RGB, shape (height, width, 3); 1 is displayed as white. Of a large one the
            middle counts, ``PATCH`` pixels at most.
        width_mm: width of the material in the picture.

    Raises:
        SimrigError: not an image, or a width that is not positive.
    """
    linear = as_image(image, name)
    if not 0.0 < width_mm < np.inf:
        raise SimrigError(f"the width of '{name}' must be > 0 mm, got {width_mm:g}")
    shown = PIXEL_MM / (width_mm / linear.shape[1])  # pixels of the picture per displayed one
    kept = [min(count, max(1, round(PATCH * shown))) for count in linear.shape[:2]]
    patch = _middle(linear, kept[0], kept[1])
    rows, columns = (min(PATCH, max(1, round(count / shown))) for count in kept)
    return _flat(name, _resampled(patch, (rows, columns)), Cost())


def _nearest(stack: BtfStack, theta: float, phi: float) -> tuple[int, float]:
    """Return the image nearest to the normal view and a light, and the cosine of its light."""
    from simrig.directions.spherical import to_vector

    light, view = stack.directions
    off = np.maximum(
        np.arccos(np.clip(light @ to_vector(theta, phi), -1.0, 1.0)),
        np.arccos(np.clip(view[:, 2], -1.0, 1.0)),
    )
    index = int(np.argmin(off))
    if off[index] > np.radians(10.0):
        raise SimrigError(
            f"BTF '{stack.name}' has no image within 10° of the normal view and a light at "
            f"{np.degrees(theta):.0f}°, {np.degrees(phi):.0f}°"
        )
    return index, float(light[index, 2])


def _middle(image: np.ndarray, rows: int, columns: int) -> np.ndarray:
    """Return the middle of an image, cut to a size."""
    top, left = (image.shape[0] - rows) // 2, (image.shape[1] - columns) // 2
    return image[top : top + rows, left : left + columns]


def _repeated(period: np.ndarray, size_mm: tuple[float, float], pixels: int) -> np.ndarray:
    """Return a piece of display pixels, filled with a seamless tile of a size (width, height)."""
    rows, columns = period.shape[:2]
    side = pixels * PIXEL_MM
    down = np.arange(max(1, round(side / size_mm[1] * rows))) % rows
    right = np.arange(max(1, round(side / size_mm[0] * columns))) % columns
    return _resampled(period[down][:, right], (pixels, pixels))


def _resampled(patch: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Return a patch on the display's pixels, averaged where it has more of its own."""
    from skimage.transform import resize

    return resize(patch, (*shape, 3), order=1, anti_aliasing=True, mode="reflect")


def _flat(name: str, linear: np.ndarray, cost: Cost) -> Stimulus:
    """Return a flat piece beside its mean colour."""
    mean = np.asarray(linear, dtype=np.float64).mean(axis=(0, 1))
    return displayed(name, linear, mean, PIXEL_MM, cost)


def displayed(
    name: str, textured: np.ndarray, plain: np.ndarray, pixel_mm: float, cost: Cost
) -> Stimulus:
    """Return a stimulus from linear pictures.

    Args:
        textured: with structure, linear RGB, shape (height, width, 3).
        plain: without, of the same shape, or one colour (3,).
        pixel_mm: side of a pixel on the material.
    """
    with_structure, without = (
        encode_srgb(np.maximum(np.asarray(colours, dtype=np.float64) @ LUMINANCE, 0.0))
        for colours in (textured, plain)
    )
    grey = without if without.ndim else float(without)
    return Stimulus(name, with_structure, grey, pixel_mm, cost)

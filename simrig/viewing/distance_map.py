"""Where in a picture the structure of materials can be seen: a map for designers (thesis 3.3.4).

Every pixel is compared by its own distance from the camera: nearer than the critical viewing
distance of what it shows, the structure is visible and the material needs its BTF; beyond, a BRDF
looks the same.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from simrig.core import backend
from simrig.core.errors import SimrigError, check_known
from simrig.files.images import encode_srgb
from simrig.plugins.make import building
from simrig.rendering.pixel_samples import probe_centres, shape_numbers
from simrig.rendering.scene_file import SceneFile
from simrig.viewing.plots import finish_figure, new_figure

MM = 1e-3  # metres in a unit of our scenes
# by visibility; told apart by colour-blind readers, see simrig/viewing/plots.py
CLASSES = {
    "clearly visible (below half of the critical distance)": "#D55E00",
    "visible": "#E69F00",
    "not visible: a BRDF is enough": "#0072B2",
    "no critical distance given": "#999999",
}
_TINT = 0.55  # of the colour of a class over the grey picture


@dataclass(frozen=True, eq=False)
class DistanceMap:
    """Distances and critical distances of the pixels of one camera, shape (height, width).

    Attributes:
        distance_m: from the camera to the surface at the centre of the pixel; infinite where
            there is none.
        critical_m: of what is there; NaN where none was given.
        names: shapes and materials that the scene knows.
    """

    distance_m: np.ndarray
    critical_m: np.ndarray
    names: tuple[str, ...]

    @property
    def surface(self) -> np.ndarray:
        """Mask of the pixels that see a surface."""
        return np.isfinite(self.distance_m)

    @property
    def visible(self) -> np.ndarray:
        """Mask of the pixels where structure can be seen."""
        return self.distance_m < np.nan_to_num(self.critical_m, nan=0.0)

    def classes(self) -> np.ndarray:
        """Return the number of each pixel's entry in ``CLASSES``; -1 where there is no surface."""
        found = np.where(self.visible, 1, 2)
        found[self.visible & (self.distance_m < 0.5 * self.critical_m)] = 0
        found[np.isnan(self.critical_m)] = 3
        return np.where(self.surface, found, -1)

    def shares(self) -> dict[str, float]:
        """Return what share of the pixels with a surface each of ``CLASSES`` has."""
        classes, count = self.classes(), max(int(self.surface.sum()), 1)
        return {name: float((classes == k).sum() / count) for k, name in enumerate(CLASSES)}


def distance_map(
    scene: Any, critical_m: Mapping[str, float], metres_per_unit: float = MM
) -> DistanceMap:
    """Return where the structure of a scene's materials is visible from its first camera.

    Args:
        scene: a dictionary, the path of an XML file, a ``SceneFile``, or what
            ``load_as_written`` returns, with an LLVM or CUDA variant set.
        critical_m: critical viewing distances in metres, by the identifiers of shapes or of
            their BSDFs; a shape's own goes first.
        metres_per_unit: what one unit of the scene is; a millimetre by default.

    Raises:
        SimrigError: a name that the scene does not know, a distance or a unit that is not
            positive, no camera, or a scalar variant.
    """
    loaded = load_as_written(scene)
    backend.current()
    if not loaded.sensors():
        raise SimrigError("the scene has no camera: add a sensor")
    values = {"metres per unit": metres_per_unit, **critical_m}
    for name, value in values.items():
        if not 0.0 < value < np.inf:
            raise SimrigError(f"'{name}' must be a number of metres above 0, got {value:g}")
    names = [(shape.id(), shape.bsdf().id() if shape.bsdf() else "") for shape in loaded.shapes()]
    known = tuple(dict.fromkeys(name for pair in names for name in pair if name))
    for name in critical_m:
        check_known("shape or material of the scene", name, known)
    distance, index, shape = _first_hits(loaded)
    table = np.array([critical_m.get(own, critical_m.get(bsdf, np.nan)) for own, bsdf in names])
    critical = np.where(np.isfinite(distance), table[index], np.nan)
    return DistanceMap((metres_per_unit * distance).reshape(shape), critical.reshape(shape), known)


def load_as_written(scene: Any) -> Any:
    """Return a scene from a dictionary or an XML file with all of its shapes and BSDFs.

    Otherwise Mitsuba joins meshes, and BSDFs that are equal, and what it joins loses its name.
    A loaded scene comes back as it is.

    Raises:
        SimrigError: Mitsuba cannot build it, in one line.
    """
    if isinstance(scene, dict):
        with building("the scene"):
            return mi.load_dict(scene, optimize=False)
    if not isinstance(scene, Path | SceneFile):
        return scene
    file = scene if isinstance(scene, SceneFile) else SceneFile(scene)
    parameters: Mapping[str, Any] = file.parameters
    with building(f"the scene '{file.path}'"):
        return mi.load_file(str(file.path), optimize=False, **parameters)


def _first_hits(scene: Any) -> tuple[np.ndarray, np.ndarray, tuple[int, int]]:
    """Return distance in scene units and index of the shape at the centre of every pixel."""
    seen, width, height = probe_centres(scene)
    sensor = scene.sensors()[0]
    # from the camera, not from the near plane where its rays begin
    eye = sensor.world_transform() @ mi.Point3f(0.0)
    length = seen.t if "ortho" in sensor.class_name().lower() else dr.norm(seen.p - eye)
    distance = np.where(np.array(seen.is_valid()), np.array(length, dtype=np.float64), np.inf)
    return distance, shape_numbers(scene, seen), (height, width)


def draw_distance_map(
    found: DistanceMap, picture: np.ndarray, path: str | Path, exposure: float = 1.0
) -> None:
    """Write a PNG: the scene tinted by visibility beside its distances, with a legend.

    Args:
        picture: linear RGB of the same size.

    Raises:
        SimrigError: a picture of another size.
    """
    from matplotlib.colors import to_rgb
    from matplotlib.patches import Patch

    if picture.shape[:2] != found.distance_m.shape:
        raise SimrigError(
            f"the picture must be of the size of the map, {found.distance_m.shape}, "
            f"got {picture.shape[:2]}"
        )
    shown = encode_srgb(exposure * np.asarray(picture, dtype=np.float64))
    grey = np.repeat(shown.mean(axis=2, keepdims=True), 3, axis=2)
    classes = found.classes()
    colours = np.array([to_rgb(colour) for colour in CLASSES.values()])
    tinted = (1.0 - _TINT) * grey + _TINT * colours[np.maximum(classes, 0)]
    tinted[classes < 0] = grey[classes < 0]

    height, width = classes.shape
    figure = new_figure(11.0, max(2.4, 5.2 * height / width) + 1.0)
    left, right = figure.subplots(1, 2)
    left.imshow(tinted)
    left.set_title("visibility of structure", fontsize=10)
    distances = np.where(found.surface, found.distance_m, np.nan)
    image = right.imshow(distances, cmap="viridis")
    right.set_title("viewing distance", fontsize=10)
    for panel in (left, right):
        panel.set_axis_off()
    figure.colorbar(image, ax=right, label="distance [m]", shrink=0.8)
    shares = found.shares()
    handles = [
        Patch(color=colour, label=f"{name}: {100.0 * shares[name]:.0f} %")
        for name, colour in CLASSES.items()
        if shares[name] > 0.0
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=2, frameon=False, fontsize=9)
    finish_figure(figure, path)

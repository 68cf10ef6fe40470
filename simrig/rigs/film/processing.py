"""From films to a BTF: directions, exposure, colour, the true plane, tiles, reconstruction.

Thesis section 6.2.3 and Figure 6.12. The frames of every slice are selected once and kept
(``simrig.rigs.film.selection``), so what fails later, or a slice that is filmed again, costs no
other slice.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from simrig.btf.stack import LARGEST_HALF, BtfStack
from simrig.core.colour import FROM_XYZ, TO_XYZ
from simrig.core.errors import SimrigError
from simrig.core.progress import Progress
from simrig.directions.spherical import to_vector
from simrig.files.atomic import existing_file
from simrig.files.checkpoint import Checkpoint
from simrig.imaging.alignment import Plane
from simrig.imaging.camera import Camera
from simrig.imaging.chart import ColourMatrix, colour_matrix, read_patches
from simrig.imaging.checks import finite_array
from simrig.imaging.marks import frame_corners
from simrig.imaging.plane import PlaneFit, fit_plane
from simrig.imaging.registration import Area, projected, registered_views
from simrig.imaging.resampling import Spline, inside
from simrig.imaging.tiling import find_tiling
from simrig.plans.gantry import GantryPlan
from simrig.rigs.film.compensation import Light
from simrig.rigs.film.motion import coupled
from simrig.rigs.film.placing import Frame, calibrated, marks_of, placed, shifted
from simrig.rigs.film.recorder import targets
from simrig.rigs.film.selection import (
    FEWEST,
    Selected,
    fingerprint_of,
    linear,
    located,
    select_frames,
)
from simrig.rigs.film.setup import Setup

_PLANE_VIEWS = 60
_SURE_MM, _REACH_MM = 0.1, 1.0
_CLIPPED = 250  # of 255
_OVER, _LOST = 0.05, 0.5  # share of clipped texels that is said; of which nothing is left
_OVERLAP = 8  # an eighth of a tile is beyond it


@dataclass(frozen=True)
class FilmSettings:
    """What of films is made.

    Attributes:
        pixels: of the tile, a side.
        size_mm: of what is cut out, width and height; the instrument's spot unless given.
        tile: cut so that it repeats; else straight, and ``size_mm`` is the tile's.
        plane: ``"fit"`` finds the surface's plane, ``"marks"`` takes that of the border.
    """

    pixels: int = 128
    size_mm: tuple[float, float] | None = None
    tile: bool = True
    plane: str = "fit"


@dataclass(eq=False)
class FilmProcessing:
    """The stages on the videos of one material, in their order.

    Attributes:
        videos: of the slices in the order of the plan.
        plan: of the slices.
        setup: the instrument.
        settings: what is made.
        chart: a still of the colour chart with its albedos (24, 3) and side in mm; None without.
        checkpoint: where selected frames are kept; None keeps nothing.
        progress: called with steps done and in total.
        notes: what is worth saying, filled as stages run.
    """

    videos: Sequence[Path]
    plan: GantryPlan
    setup: Setup
    settings: FilmSettings = field(default_factory=FilmSettings)
    chart: tuple[Path, np.ndarray, float] | None = None
    checkpoint: Path | None = None
    progress: Progress | None = None
    notes: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        for video in self.videos:
            existing_file(video)
        wanted = len(self.plan.slices)
        if len(self.videos) != wanted:
            raise SimrigError(
                f"the plan has {wanted} slices, {len(self.videos)} videos are given: give one for "
                "each, in the order of the plan"
            )
        if self.settings.plane not in ("fit", "marks"):
            raise SimrigError(f"the plane is 'fit' or 'marks', got '{self.settings.plane}'")
        if self.settings.pixels < 8:
            raise SimrigError(f"a tile has at least 8 pixels a side, got {self.settings.pixels}")

    @cached_property
    def corners(self) -> np.ndarray:
        """Outer corners of the border, (4, 2) mm."""
        return frame_corners(self.setup.outer_mm, self.setup.outer_mm)

    @cached_property
    def selected(self) -> list[Selected]:
        """The frames of every slice that are taken; kept ones are not looked for again."""
        kept = Checkpoint(self.checkpoint, {"frames": "of films", "plan": asdict(self.plan)})
        found, expected = [], len(self.videos) * self.setup.frames
        for number, path in enumerate(self.videos):
            identity, piece = fingerprint_of(path), kept.get(f"slice-{number:02d}")
            if piece is not None and piece.record["video"] == identity:
                own = Selected.of_piece(piece)
            else:
                own = self._selected(number, path, expected)
                record, arrays = own.as_piece()
                kept.put(f"slice-{number:02d}", record | {"video": identity}, arrays)
            found.append(own)
            self.notes += own.notes
            if self.progress is not None:
                self.progress((number + 1) * self.setup.frames, expected)
        return found

    def _selected(self, number: int, path: Path, expected: int) -> Selected:
        def report(done: int, _: int) -> None:
            if self.progress is not None:
                own = self.setup.frames
                self.progress(number * own + min(done, own), expected)

        theta_v = self.plan.thetas[self.plan.slices[number].pair[1]]
        return select_frames(path, self.setup, *targets(self.plan, number), theta_v, report)

    # -- directions ------------------------------------------------------------------------------

    @cached_property
    def lens(self) -> tuple[Camera, float]:
        """The camera without its place, and the error of its calibration in pixels."""
        return calibrated(self.selected, self.setup)

    @cached_property
    def frames(self) -> list[list[Frame]]:
        """The frames of every slice with their directions, ascending by the camera's azimuth."""
        made = [
            placed(s, self.plan, k, self.lens[0], self.setup, path.name, self.notes)
            for k, (s, path) in enumerate(zip(self.selected, self.videos, strict=True))
        ]
        for own, path in zip(made, self.videos, strict=True):
            if len(own) < FEWEST:
                raise SimrigError(
                    f"'{path.name}' has {len(own)} frames that can be used, {FEWEST} are needed: "
                    "film this slice again; the others are kept"
                )
        return made

    # -- exposure and colour ---------------------------------------------------------------------

    @cached_property
    def lit(self) -> list[list[Frame]]:
        """The frames with what exposure and light are."""
        return [self._lit(number, own) for number, own in enumerate(self.frames)]

    def _lit(self, number: int, frames: list[Frame]) -> list[Frame]:
        chosen, path, lost = self.selected[number], self.videos[number], 0
        read: list[tuple[Frame, np.ndarray, Light]] = []
        for one in frames:
            grey = linear(chosen.frames[one.index]).mean(axis=-1)
            try:
                light = Light.read(grey, chosen.corner, one.camera, self.setup, one.light_mm)
            except SimrigError:
                lost += 1
                continue
            read.append((one, grey, light))
        if lost:
            self.notes.append(f"{path.name}: the black material cannot be read in {lost} frames")
        if len(read) < FEWEST:
            raise SimrigError(
                f"'{path.name}' shows the black material in {len(read)} frames, {FEWEST} are "
                "needed: film this slice again, darker; the others are kept"
            )
        told = [light.room for _, _, light in read if np.isfinite(light.room)]
        room = max(float(np.median(told)), 0.0) if len(told) > len(read) / 2 else 0.0
        return [
            replace(
                one,
                light=light.without_room(room, grey, chosen.corner, one.camera, self.setup),
            )
            for one, grey, light in read
        ]

    @cached_property
    def colour(self) -> ColourMatrix | None:
        """From the camera's colours to XYZ; None without a chart."""
        if self.chart is None:
            return None
        path, albedo, side = self.chart
        lens, one = self.lens[0], self.plan.slices[0]
        still = _still(path, self.setup, self.corners, self.plan.thetas[one.pair[1]])
        marks = marks_of(still, 0, lens)
        if marks is None:
            raise SimrigError(f"the border is not found in '{path}'")
        camera = lens.posed(self.corners, marks)
        phi = np.arctan2(camera.centre_mm[1], camera.centre_mm[0])
        towards = to_vector(self.plan.thetas[one.pair[0]], coupled(one, phi))
        place = self.setup.optics.moves.light_mm * np.ravel(towards)
        values = linear(still.frames[0])
        light = Light.read(values.mean(axis=-1), still.corner, camera, self.setup, place)
        room = light.room if np.isfinite(light.room) else 0.0
        grey = values.mean(axis=-1)
        light = light.without_room(max(room, 0.0), grey, still.corner, camera, self.setup)
        area = Area((side, side), (240, 240))
        shown = self._registered(values, still.corner, camera, light, area, Plane(), path.name)
        ends = np.array([[0, 0], [240, 0], [240, 240], [0, 240]], dtype=np.float64) - 0.5
        patches = np.pi * read_patches(shown, ends)
        reference = finite_array(albedo, "the chart's albedos", (2,)) @ TO_XYZ.T
        return colour_matrix(patches, reference, TO_XYZ.sum(axis=1))

    # -- images ----------------------------------------------------------------------------------

    @cached_property
    def area(self) -> Area:
        """What is cut out of the frames: a tile, and what it is joined with."""
        spot = self.setup.optics.spot_mm
        width, height = self.settings.size_mm or (spot, spot)
        if not 0.0 < min(width, height) <= max(width, height) <= self.setup.optics.sample_mm:
            raise SimrigError(
                f"the sample is {self.setup.optics.sample_mm:g} mm large, asked for are "
                f"{width:g} × {height:g} mm"
            )
        columns = self.settings.pixels
        rows = max(8, round(columns * height / width))
        if self.settings.tile:
            columns, rows = (side + side // _OVERLAP for side in (columns, rows))
        return Area((width, height), (columns, rows))

    @cached_property
    def fit(self) -> PlaneFit | None:
        """The plane of the surface; None where the frames do not tell it."""
        frames = [one for own in self.frames for one in own]
        frames = frames[:: max(1, len(frames) // _PLANE_VIEWS)]
        size = min(self.area.size_mm)
        area = Area.of_pitch(size, size / max(self.settings.pixels, 96))
        pictures, cameras = [], []
        for one in frames:
            chosen = self.selected[one.number]
            pictures.append(linear(chosen.frames[one.index]).mean(axis=-1))
            cameras.append(shifted(one.camera, chosen.corner))
        try:
            found = fit_plane(registered_views(pictures, cameras, area), height_mm=_REACH_MM)
        except SimrigError as error:
            self.notes.append(f"the surface is taken to lie in the border's plane: {error}")
            return None
        if not found.u_z_mm < _SURE_MM or found.left_range:
            said = "; ".join(found.doubts)
            self.notes.append(f"the surface is taken to lie in the border's plane ({said})")
            return None
        return found

    @cached_property
    def plane(self) -> Plane:
        """The plane that frames are registered to."""
        if self.settings.plane == "marks" or self.fit is None:
            return Plane()
        return self.fit.plane

    def _registered(
        self,
        values: np.ndarray,
        corner: np.ndarray,
        camera: Camera,
        light: Light,
        area: Area,
        plane: Plane,
        name: str,
    ) -> np.ndarray:
        """Return f_r in the camera's colours, (rows, columns, 3)."""
        pixels, seen = projected(camera, area, plane)
        pixels = pixels - corner
        seen &= inside(pixels, values.shape)
        if not seen.all():
            raise SimrigError(
                f"'{name}' shows {100 * seen.mean():.0f} % of {area.size_mm[0]:g} mm: choose a "
                "smaller --size-mm"
            )
        return light.f_r(Spline(values).at(pixels), *area.points(), plane)

    def images(self) -> tuple[np.ndarray, GantryPlan]:
        """Return f_r of all frames, (n, rows, columns, 3) in 1/sr, and the plan with their places.

        Raises:
            SimrigError: a slice of which hardly anything is not over-exposed.
        """
        matrix = np.eye(3) if self.colour is None else FROM_XYZ @ self.colour.matrix
        made, filmed = [], []
        for number, own in enumerate(self.lit):
            chosen, clipped = self.selected[number], []
            for one in own:
                assert one.light is not None
                values = linear(chosen.frames[one.index])
                name = self.videos[number].name
                shown = self._registered(
                    values, chosen.corner, one.camera, one.light, self.area, self.plane, name
                )
                clipped.append(self._clipped(chosen, one))
                made.append(np.maximum(shown @ matrix.T, 0.0).astype(np.float32))
            self._say_clipped(number, np.array(clipped))
            filmed.append(tuple(one.phi_v for one in own))
        return np.array(made), replace(self.plan, filmed=tuple(filmed))

    def _clipped(self, chosen: Selected, one: Frame) -> float:
        pixels, _ = projected(one.camera, Area(self.area.size_mm, (32, 32)), self.plane)
        column, row = np.rint(pixels - chosen.corner).astype(int).reshape(-1, 2).T
        return float((chosen.frames[one.index][row, column].max(axis=-1) >= _CLIPPED).mean())

    def _say_clipped(self, number: int, clipped: np.ndarray) -> None:
        name = self.videos[number].name
        if np.median(clipped) > _LOST:
            raise SimrigError(
                f"'{name}' is over-exposed in {int((clipped > _LOST).sum())} of {len(clipped)} "
                "frames: film this slice again, darker; the others are kept"
            )
        over = int((clipped > _OVER).sum())
        if over:
            self.notes.append(
                f"{name}: over-exposed in {over} of {len(clipped)} frames, up to "
                f"{100 * clipped.max():.0f} % of the sample"
            )

    def stack(self, name: str = "film") -> tuple[BtfStack, GantryPlan]:
        """Return the images as a BTF of the slices alone, cut so that they repeat, and the plan."""
        values, plan = self.images()
        about: dict[str, Any] = {"filmed": asdict(plan), "settings": asdict(self.settings)}
        size = self.area.size_mm
        if self.settings.tile:
            rows, columns = (side * _OVERLAP // (_OVERLAP + 1) for side in values.shape[1:3])
            spread = np.unique(np.linspace(0, len(values) - 1, 24).astype(int))
            overlap = max(1, min(values.shape[1] - rows, values.shape[2] - columns))
            tiling = find_tiling(values[spread].mean(axis=-1), rows, columns, overlap)
            size = (size[0] * columns / values.shape[2], size[1] * rows / values.shape[1])
            values = np.array([tiling.cut(image) for image in values])
            about["tile"] = {"seam": tiling.seam, "plain_seam": tiling.plain_seam}
        kind = np.float16 if values.max() <= LARGEST_HALF else np.float32
        return BtfStack(values.astype(kind), plan.angles(), size, name, about), plan

    def found(self) -> dict[str, Any]:
        """Return what the stages found, plain values."""
        lens, error = self.lens
        fit = None if self.settings.plane == "marks" else self.fit
        return {
            "frames": [len(own) for own in self.lit],
            "calibration_error_px": error,
            "focal_px": float(lens.matrix[0, 0]),
            "k1": float(lens.distortion[0]),
            "plane": None if fit is None else fit.as_dict(),
            "chart_mean_dE": None if self.colour is None else float(self.colour.errors.mean()),
            "room": [own[0].light.room for own in self.lit if own[0].light is not None],
            "notes": self.notes,
        }


def _still(path: Path, setup: Setup, corners: np.ndarray, theta_v: float) -> Selected:
    """Return a still as if it were the only frame of a slice."""
    picture = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if picture is None:
        raise SimrigError(f"there is no picture '{path}' that can be read")
    marks = located(picture, setup, corners, theta_v)
    if marks is None:
        raise SimrigError(f"'{path}' does not show the border whole, with its dot")
    return Selected(np.zeros(1, int), picture[None, ..., ::-1], np.zeros(2, int), marks[None], 1)

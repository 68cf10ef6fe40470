"""From a recording to a BTF: every stage of ``simrig.imaging`` in its order, pose by pose.

Merge, fill defects, flat field, demosaic, colour, find the frame, register to the surface's true
plane, divide by what light reaches each point: f_r in 1/sr. What is finished is kept image by
image, so an interrupted processing goes on with the same bits; the recording is only read.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from simrig.core.colour import FROM_XYZ, TO_XYZ
from simrig.core.errors import SimrigError
from simrig.core.progress import Progress, tracked
from simrig.files.btf.recording import BtfWriter
from simrig.files.btf.source import ANGLES
from simrig.files.images import write_exr
from simrig.files.recorded import RecordedPictures
from simrig.imaging.alignment import FEWEST_VIEWS, Plane
from simrig.imaging.camera import Camera, from_pose
from simrig.imaging.chart import ColourMatrix, colour_matrix, read_patches
from simrig.imaging.checks import finite_array, finite_number
from simrig.imaging.marks import expected_frame, find_frame, frame_corners
from simrig.imaging.merging import Merged, SensorModel, merge
from simrig.imaging.mosaic import demosaic, fill_defects, find_defects
from simrig.imaging.plane import PlaneFit, fit_plane
from simrig.imaging.registration import Area, register, registered_views

PLANE_VIEWS = 80  # thesis section 4.2.2
_SURE_MM = 0.2  # uncertainty up to which a plane that was found is taken
_ENDLESS = 1e30  # clipping level of frames that were not rounded to whole numbers
_LARGEST_OFFSET = 12.0  # pixels of a mark from where the instrument's pose has it


@dataclass(frozen=True)
class Settings:
    """What of a recording is made.

    Attributes:
        pixels: of the images, a side.
        size_mm: side of the square that they show; the recording's sample unless given.
        plane: ``"fit"`` finds the surface's plane, ``"marks"`` takes that of the frame.
        method: of demosaicing.
    """

    pixels: int = 128
    size_mm: float | None = None
    plane: str = "fit"
    method: str = "malvar"


@dataclass(frozen=True, eq=False)
class Chain:
    """The stages with what the calibration pictures say.

    Attributes:
        recording: what is processed.
        settings: what is made.
    """

    recording: RecordedPictures
    settings: Settings

    @cached_property
    def cfa(self) -> str | None:
        """The colour filter array; None of a monochrome sensor."""
        named = self.recording.sensor.get("cfa")
        return None if named is None else str(named)

    @cached_property
    def model(self) -> SensorModel:
        """The sensor."""
        found = SensorModel.of(self.recording.sensor)
        if "dark-current" not in self.recording.effects and self.recording.effects:
            found = replace(found, dark_e_s=0.0)
        return found

    @cached_property
    def corners(self) -> np.ndarray:
        """Outer corners of the frame on the reference plane, (4, 2) mm, or (0, 2)."""
        given = self.recording.sample.get("marks_mm")
        if not given:
            return np.zeros((0, 2))
        marks = finite_array(given, "marks_mm of the recording", (2,))
        if marks.shape != (4, 3):
            raise SimrigError(f"marks_mm of the recording must be (4, 3), got {marks.shape}")
        return marks[:, :2]

    @cached_property
    def sample_mm(self) -> float:
        """Side of the recording's sample."""
        return finite_number(
            self.recording.sample.get("size_mm"), "size_mm of the recording's sample", above=0.0
        )

    def merged(self, taken: Mapping[str, np.ndarray]) -> Merged:
        """Return the merged frames of a picture."""
        frames, model = taken["frames"], self.model
        if frames.dtype.kind == "f":  # without rounding nothing clips
            model = replace(model, saturation_DN=_ENDLESS)
        return merge(frames, taken["exposures"], model, seconds=taken.get("seconds"))

    @cached_property
    def white(self) -> np.ndarray | None:
        """Response of the pixels: what they show of 1/sr of irradiance, electrons per second."""
        taken = self.recording.calibration("white")
        if taken is None:
            return None
        value = self._whole(taken)
        said = self.recording.calibrated.get("white_albedo", 1.0)
        albedo = finite_number(said, "white_albedo of the recording", above=0.0)
        x, y = self._plane_points(_camera(taken), value.shape)
        light = self.irradiance(x, y, Plane(), taken["light_mm"])
        response = value / (light * albedo / np.pi)
        if not response.min() > 0.0:
            raise SimrigError(
                f"'{self.recording.folder}': the white sheet does not fill its picture"
            )
        return response

    @cached_property
    def bad(self) -> np.ndarray | None:
        """Defective pixels, where a dark and a white picture tell; None where there are none."""
        dark, white = (self.recording.calibration(name) for name in ("dark", "white"))
        if dark is None or white is None:
            return None
        found = find_defects(
            dark["frames"].mean(axis=0, dtype=np.float64), self.merged(white).value, self.cfa
        )
        return found if found.any() else None

    @cached_property
    def colour(self) -> ColourMatrix | None:
        """From the camera's colours to XYZ, by the chart; None without one."""
        taken = self.recording.calibration("chart")
        known = self.recording.calibrated.get("chart_albedo")
        if taken is None or known is None or self.cfa is None:
            return None
        camera = _camera(taken)
        said = self.recording.calibrated.get("chart_mm", self.sample_mm)
        side = finite_number(said, "chart_mm of the recording", above=0.0)
        ends = expected_frame(camera, frame_corners(side, side))
        flat = self.colours(taken)
        x, y = self._plane_points(camera, flat.shape)
        light = self.irradiance(x, y, Plane(), taken["light_mm"])
        try:
            shown = read_patches(np.pi * flat / light[..., None], ends)
        except SimrigError as error:
            raise SimrigError(
                f"the chart of '{self.recording.folder}' is too small to be read: record with "
                "larger --pixels, or move calibration/chart.npz away to do without"
            ) from error
        reference = finite_array(known, "chart_albedo of the recording", (2,)) @ TO_XYZ.T
        return colour_matrix(shown, reference, TO_XYZ.sum(axis=1))

    def _whole(self, taken: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return a merged picture, its defects filled."""
        value = self.merged(taken).value
        return value if self.bad is None else fill_defects(value, self.bad, self.cfa)

    def colours(self, taken: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return a picture's linear colours over the response of the pixels, (h, w, 3)."""
        value, response = self._whole(taken), self.white
        if response is None:
            rate = self.recording.sensor.get("electrons_per_second", 1.0)
            response = np.asarray(finite_number(rate, "the sensor's electrons_per_second", above=0))
        if response.ndim and response.shape != value.shape:
            raise SimrigError(
                f"'{self.recording.folder}': the white picture is {response.shape}, a pose "
                f"{value.shape}"
            )
        value = value / response
        if self.cfa is None:
            return np.repeat(value[..., None], 3, axis=2)
        return demosaic(value, self.cfa, self.settings.method)

    def irradiance(
        self, x: np.ndarray, y: np.ndarray, plane: Plane, light_mm: np.ndarray
    ) -> np.ndarray:
        """Return what light reaches points of a plane over that which the centre faces."""
        to_light = light_mm - np.stack([x, y, plane.height(x, y)], axis=-1)
        square = np.sum(to_light**2, axis=-1)
        cosine = to_light @ plane.normal / np.sqrt(square)
        whole = self.recording.effects
        if not whole or "fall-off" in whole:
            cosine = cosine * float(np.sum(light_mm**2)) / square
        return np.asarray(cosine)

    def _plane_points(
        self, camera: Camera, shape: tuple[int, ...]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return where pixels look on the reference plane, mm, each (height, width)."""
        column, row = np.meshgrid(np.arange(shape[1]), np.arange(shape[0]))
        flat = np.stack([column.ravel(), row.ravel()], axis=1).astype(np.float64)
        straight = camera.straight(flat)
        m, turn = camera.matrix, camera.world_to_camera[:3, :3]
        rays = np.linalg.solve(m, np.concatenate([straight, np.ones((len(flat), 1))], 1).T).T @ turn
        at = camera.centre_mm - rays * (camera.centre_mm[2] / rays[:, 2])[:, None]
        return at[:, 0].reshape(shape[:2]), at[:, 1].reshape(shape[:2])

    def camera(self, taken: Mapping[str, np.ndarray], grey: np.ndarray) -> tuple[Camera, bool]:
        """Return the camera where its picture shows the frame, and whether it does."""
        nominal = _camera(taken)
        if not len(self.corners):
            return nominal, False
        expected = expected_frame(nominal, self.corners)
        try:
            found = find_frame(grey, expected, nominal).pixels
        except SimrigError:
            return nominal, False  # edge-on, or in the dark: the instrument's own pose is left
        if not np.abs(found - expected).max() < _LARGEST_OFFSET:
            return nominal, False
        return nominal.posed(self.corners, found), True

    @cached_property
    def area(self) -> Area:
        """The square that images show."""
        size = self.sample_mm if self.settings.size_mm is None else self.settings.size_mm
        if size > self.sample_mm * (1.0 + 1e-9):
            raise SimrigError(
                f"the sample is {self.sample_mm:g} mm large, asked for are {size:g} mm: lower "
                "--size-mm"
            )
        return Area((size, size), (self.settings.pixels, self.settings.pixels))

    def image(self, number: int, plane: Plane) -> tuple[np.ndarray, bool]:
        """Return f_r of one pose, (pixels, pixels, 3) in 1/sr, and whether its marks were found."""
        taken = self.recording.pose(number)
        colours = self.colours(taken)
        camera, marked = self.camera(taken, colours.mean(axis=-1))
        shown, seen = register(colours, camera, self.area, plane)
        if not seen.all():
            raise SimrigError(
                f"'{self.recording.poses[number]}' shows {100.0 * seen.mean():.0f} % of the "
                f"{self.area.size_mm[0]:g} mm that are asked for: choose a smaller --size-mm"
            )
        x, y = self.area.points()
        light = self.irradiance(x, y, plane, taken["light_mm"])
        lit = np.where(light > 1e-6, light, np.inf)[..., None]
        found = shown / lit
        if self.colour is not None:
            found = found @ (FROM_XYZ @ self.colour.matrix).T
        return found, marked

    def angles(self) -> np.ndarray:
        """Return theta_i, theta_v, phi_i, phi_v of every pose, radians."""
        return np.array(
            [self.recording.pose(n)["angles"] for n in range(len(self.recording.poses))]
        )

    def plane(self, angles: np.ndarray) -> PlaneFit:
        """Return the surface's plane, by one picture of each of up to 80 views.

        Raises:
            SimrigError: there are too few views, or nothing that could be aligned.
        """
        order = np.lexsort((angles[:, 0],))
        views: dict[tuple[float, ...], int] = {}
        for number in order:
            key = tuple(np.round(angles[number, [1, 3]], 6) % (2.0 * np.pi))
            key = (0.0, 0.0) if angles[number, 1] < 1e-6 else key
            views.setdefault(key, int(number))
        chosen = sorted(views.values())[:: max(1, len(views) // PLANE_VIEWS)]
        pictures, cameras = [], []
        for number in chosen:
            taken = self.recording.pose(number)
            grey = self.colours(taken).mean(axis=-1)
            camera, marked = self.camera(taken, grey)
            if marked and np.degrees(taken["angles"][1]) < 76.0:
                pictures.append(grey)
                cameras.append(camera)
        if len(pictures) < FEWEST_VIEWS:
            raise SimrigError(f"{len(pictures)} views show the frame, {FEWEST_VIEWS} are needed")
        size = self.area.size_mm[0]
        area = Area.of_pitch(size, size / max(self.settings.pixels, 64))
        return fit_plane(registered_views(pictures, cameras, area))


def process_recording(
    folder: str | Path,
    output: str | Path,
    settings: Settings | None = None,
    pictures: str | Path | None = None,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Make a BTF of a recording; an interrupted one continues with the same bits.

    Args:
        folder: of the recording.
        output: the HDF5 file.
        settings: what is made.
        pictures: folder for the registered images as OpenEXR too: linear sRGB, CIE XYZ, the pose.
        progress: called with poses done and in total.

    Returns:
        What was found: the plane, how many poses were registered by their marks, the share of
        values that noise had made negative (they are 0), ΔE of the chart.

    Raises:
        SimrigError: no recording, a damaged picture, numbers that cannot be, no room.
    """
    chosen = settings or Settings()
    if chosen.plane not in ("fit", "marks"):
        raise SimrigError(f"the plane is to be 'fit' or that of the 'marks', got '{chosen.plane}'")
    recording = RecordedPictures(folder)
    recording.check_whole()
    chain = Chain(recording, chosen)
    angles = chain.angles()
    surface, about = _surface(chain, angles)
    provenance = {
        "recording": {key: recording.about.get(key) for key in ("material", "plan", "seed")},
        "settings": dict(vars(chosen)),
        "plane": about,
    }
    side = chosen.pixels
    with BtfWriter(
        output,
        angles,
        (side, side),
        chain.area.size_mm,
        name=str(recording.about.get("material", "recording")),
        provenance=provenance,
    ) as writer:
        for number in _todo(writer.missing, len(angles), progress):
            image, found = chain.image(int(number), surface)
            notes = {
                "marks": (np.array([float(found)]), "1 where the frame was found"),
                "negative": (np.array([float((image < 0.0).mean())]), "share set to 0"),
            }
            if pictures is not None:
                _write_picture(Path(pictures), int(number), image, angles[number], chain, surface)
            writer.write(int(number), np.maximum(image, 0.0)[None].astype(np.float32), notes)
        marked, negative = (writer.notes[key] for key in ("marks", "negative"))
    errors = None if chain.colour is None else float(chain.colour.errors.mean())
    return {
        "poses": len(angles),
        "plane": about,
        "marks_found": int(np.nansum(marked)),
        "negative_share": float(np.nanmean(negative)),
        "chart_mean_dE": errors,
        "defects": 0 if chain.bad is None else int(chain.bad.sum()),
    }


def _todo(missing: np.ndarray, total: int, progress: Progress | None) -> Iterator[int]:
    done = total - len(missing)
    report = None if progress is None else lambda now, _, *name: progress(done + now, total, *name)
    yield from tracked(missing.tolist(), report)


def _surface(chain: Chain, angles: np.ndarray) -> tuple[Plane, dict[str, Any]]:
    """Return the plane that images are registered to, and what is known of it.

    Numbers are rounded far below what they are known to, so that a resumed run has the same.
    """
    if chain.settings.plane == "marks":
        return Plane(), {"taken": "the plane of the marks"}
    try:
        fit = chain.plane(angles)
    except SimrigError as error:
        return Plane(), {"taken": f"the plane of the marks: no other is found ({error})"}
    if not fit.u_z_mm < _SURE_MM or fit.left_range:
        said = "; ".join(fit.doubts)
        return Plane(), {"taken": f"the plane of the marks: another is not certain ({said})"}
    plane = Plane(*(round(float(number), 7) for number in fit.plane.numbers))
    about = {k: v for k, v in fit.as_dict().items() if k not in ("seconds", "evaluations")}
    about = {k: round(v, 5) if isinstance(v, float) else v for k, v in about.items()}
    return plane, about | {"numbers": plane.numbers.tolist(), "taken": "found by alignment"}


def _camera(taken: Mapping[str, np.ndarray]) -> Camera:
    return from_pose(taken["intrinsics"], taken["distortion"], taken["camera_to_world"])


def _write_picture(
    folder: Path, number: int, image: np.ndarray, angles: np.ndarray, chain: Chain, plane: Plane
) -> None:
    """Write one registered image: R, G, B linear sRGB and xyz.X, xyz.Y, xyz.Z, with its pose."""
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise SimrigError(f"cannot write '{folder}': {error.strerror}") from error
    about = {
        "unit": "f_r in 1/sr",
        "width_mm": chain.area.size_mm[0],
        "plane_mm": json.dumps(plane.numbers.tolist()),
        **dict(zip(ANGLES, np.degrees(angles), strict=True)),
    }
    xyz = dict(zip(("xyz.X", "xyz.Y", "xyz.Z"), np.moveaxis(image @ TO_XYZ.T, -1, 0), strict=True))
    write_exr(folder / f"{number:06d}.exr", image, about, xyz)

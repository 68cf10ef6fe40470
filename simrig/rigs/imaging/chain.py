"""The stages of ``simrig.imaging`` on one recording, in their order.

Merge, fill defects, flat field, demosaic, colour, find the frame, register to the surface's true
plane, divide by what light reaches each point: f_r in 1/sr. Of every picture only the pixels that
the images need are processed, and pictures that are taken one after the other from one place share
a camera.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from simrig.core.colour import FROM_XYZ, TO_XYZ
from simrig.core.errors import SimrigError
from simrig.files.recorded import RecordedPictures
from simrig.imaging.alignment import FEWEST_VIEWS, Plane
from simrig.imaging.camera import Camera, from_pose
from simrig.imaging.chart import ColourMatrix, colour_matrix, read_patches
from simrig.imaging.checks import finite_array, finite_number
from simrig.imaging.marks import expected_frame, find_frame, frame_corners
from simrig.imaging.merging import Merged, SensorModel, merge
from simrig.imaging.mosaic import demosaic, fill_defects, find_defects
from simrig.imaging.plane import HEIGHT_MM, PlaneFit, fit_plane
from simrig.imaging.registration import Area, projected, registered_views
from simrig.imaging.resampling import Spline, inside

PLANE_VIEWS = 80  # thesis section 4.2.2
_ENDLESS = 1e30  # clipping level of frames that were not rounded to whole numbers
_LARGEST_OFFSET = 12.0  # pixels of a mark from where the instrument's pose has it
_STEADY = 0.25  # pixels that the marks of pictures from one place differ at most
_REACH = 0.05  # of the sample's side, how far off its plane is looked for
_NEARLY, _MOST_PARTS = 0.25, 8  # of a pixel; of a texel's side
_AROUND = 16  # pixels around what images need: what filters see there is below 1e-9
_EVERYWHERE = (slice(None), slice(None))


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
class _Sight:
    """Where pictures from one place show an area.

    Attributes:
        pixels: (rows, columns, 2) of the area's points, from the window's corner on.
        window: rows and columns of the pictures that are needed.
        marked: the frame said so, not the instrument's pose.
    """

    pixels: np.ndarray
    window: tuple[slice, slice]
    marked: bool


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

    def _has(self, effect: str) -> bool:
        """Return whether pictures have an effect; photographs, which say of none, have all."""
        return not self.recording.about.get("effects") or effect in self.recording.effects

    @cached_property
    def model(self) -> SensorModel:
        """The sensor."""
        found = SensorModel.of(self.recording.sensor)
        if not self._has("dark-current"):
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

    def merged(
        self, taken: Mapping[str, np.ndarray], window: tuple[slice, slice] = _EVERYWHERE
    ) -> Merged:
        """Return the merged frames of a picture, or of a part of it."""
        frames, model = taken["frames"][:, *window], self.model
        if frames.dtype.kind == "f":  # without rounding nothing clips
            model = replace(model, saturation_DN=_ENDLESS)
        return merge(frames, taken["exposures"], model, seconds=taken.get("seconds"))

    @property
    def without(self) -> list[str]:
        """What is left undone for want of a calibration picture, in a line each."""
        undone = {
            "white": "neither vignetting nor the response of each pixel is taken out",
            "dark": "defective pixels are not looked for",
            "chart": "colours stay the camera's own",
        }
        if self.cfa is None:
            del undone["chart"]
        return [
            f"no calibration/{name}.npz: {what}"
            for name, what in undone.items()
            if self.recording.calibration(name) is None
        ]

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

    def _whole(
        self, taken: Mapping[str, np.ndarray], window: tuple[slice, slice] = _EVERYWHERE
    ) -> np.ndarray:
        """Return a merged picture, or a part, its defects filled."""
        value = self.merged(taken, window).value
        return value if self.bad is None else fill_defects(value, self.bad[window], self.cfa)

    def colours(
        self, taken: Mapping[str, np.ndarray], window: tuple[slice, slice] = _EVERYWHERE
    ) -> np.ndarray:
        """Return a picture's linear colours over the response of the pixels, (h, w, 3).

        Raises:
            SimrigError: a picture of another size than those of the calibration.
        """
        shape, response = taken["frames"].shape[1:], self.white
        for name, known in (("white", response), ("dark", self.bad)):
            if known is not None and known.shape != shape:
                raise SimrigError(
                    f"'{self.recording.folder}': the {name} picture is {known.shape}, a pose "
                    f"{shape}"
                )
        value = self._whole(taken, window)
        if response is None:
            rate = self.recording.sensor.get("electrons_per_second", 1.0)
            value = value / finite_number(rate, "the sensor's electrons_per_second", above=0)
        else:
            value = value / response[window]
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
        if self._has("fall-off"):
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

    def marks(self, taken: Mapping[str, np.ndarray]) -> np.ndarray | None:
        """Return where a picture shows the frame's corners, (4, 2) pixels; None where it does not.

        Edge-on, or in the dark, the instrument's own pose is left.
        """
        if not len(self.corners):
            return None
        nominal = _camera(taken)
        expected = expected_frame(nominal, self.corners)
        try:
            found = find_frame(self.colours(taken).mean(axis=-1), expected, nominal).pixels
        except SimrigError:
            return None
        return found if np.abs(found - expected).max() < _LARGEST_OFFSET else None

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

    def images(
        self, numbers: Sequence[int], seen_in: Sequence[int], plane: Plane
    ) -> Iterator[tuple[int, np.ndarray, bool]]:
        """Yield number, f_r (pixels, pixels, 3) in 1/sr and whether marks were found, by pose.

        Args:
            numbers: of pictures that were taken one after the other from one place.
            seen_in: those of them in which to look for the frame. Where they disagree, something
                moved, and every picture is registered by its own.
            plane: of the surface.
        """
        shared = self._sight(seen_in, plane)
        for number in numbers:
            sight = shared or self._sight([number], plane)
            assert sight is not None
            yield number, self._image(number, sight, plane), sight.marked

    def _sight(self, numbers: Sequence[int], plane: Plane) -> _Sight | None:
        """Return what pictures from one place show where; None where their marks disagree."""
        found = []
        for number in numbers:
            taken = self.recording.pose(number)
            marks = self.marks(taken)
            if marks is not None:
                found.append(marks)
        camera = _camera(taken)
        if found:
            if np.ptp(found, axis=0).max() > _STEADY:
                return None
            camera = camera.posed(self.corners, np.mean(found, axis=0))
        pixels, seen = projected(camera, self.area, plane)
        parts = _parts(pixels)
        if parts > 1:
            # pixels at the sample's border show the frame as well
            margin_mm = self.area.size_mm[0] / self.area.pixels[0] / parts
            pixels, seen = projected(camera, self.area.divided(parts, margin_mm), plane)
        shape = taken["frames"].shape[1:]
        seen &= inside(pixels, shape)
        if not seen.all():
            raise SimrigError(
                f"'{self.recording.poses[number]}' shows {100.0 * seen.mean():.0f} % of the "
                f"{self.area.size_mm[0]:g} mm that are asked for: choose a smaller --size-mm, or "
                "record more --pixels"
            )
        # an even corner keeps the colours of the filter array
        low = np.maximum(pixels.min(axis=(0, 1)).astype(int) - _AROUND, 0) // 2 * 2
        high = pixels.max(axis=(0, 1)).astype(int) + _AROUND + 2
        window = (slice(low[1], high[1]), slice(low[0], high[0]))
        return _Sight(pixels - low, window, bool(found))

    def _image(self, number: int, sight: _Sight, plane: Plane) -> np.ndarray:
        taken = self.recording.pose(number)
        read = Spline(self.colours(taken, sight.window)).at(sight.pixels)
        x, y = self.area.points()
        # the mean over each texel, as a texel of a BTF is defined, and not its middle
        shown = read.reshape(len(x), len(read) // len(x), x.shape[1], -1, 3).mean(axis=(1, 3))
        light = self.irradiance(x, y, plane, taken["light_mm"])
        found = shown / np.where(light > 1e-6, light, np.inf)[..., None]
        return found if self.colour is None else found @ (FROM_XYZ @ self.colour.matrix).T

    def stated(self) -> tuple[np.ndarray, np.ndarray]:
        """Return theta_i, theta_v, phi_i, phi_v of every pose, radians, and camera_to_world."""
        names = ("angles", "camera_to_world")
        said = [self.recording.pose(n, names) for n in range(len(self.recording.poses))]
        angles, cameras = (np.array([pose[name] for pose in said]) for name in names)
        return angles, cameras

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
            marks = self.marks(taken) if np.degrees(taken["angles"][1]) < 76.0 else None
            if marks is not None:
                pictures.append(self.colours(taken).mean(axis=-1))
                cameras.append(_camera(taken).posed(self.corners, marks))
        if len(pictures) < FEWEST_VIEWS:
            raise SimrigError(f"{len(pictures)} views show the frame, {FEWEST_VIEWS} are needed")
        size = self.area.size_mm[0]
        area = Area.of_pitch(size, size / max(self.settings.pixels, 64))
        reach = min(HEIGHT_MM, _REACH * size)  # a small sample leaves its pictures before
        return fit_plane(registered_views(pictures, cameras, area), height_mm=reach)


def _parts(pixels: np.ndarray) -> int:
    """Return into how many parts a side of a texel is cut, so that none spans more than a pixel."""
    steps = [np.linalg.norm(np.diff(pixels, axis=axis), axis=-1) for axis in (0, 1)]
    widest = max((float(np.median(step)) for step in steps if step.size), default=1.0)
    return int(np.clip(np.ceil(widest - _NEARLY), 1, _MOST_PARTS))


def _camera(taken: Mapping[str, np.ndarray]) -> Camera:
    return from_pose(taken["intrinsics"], taken["distortion"], taken["camera_to_world"])

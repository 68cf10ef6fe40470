"""The plan of a large flat sample: every picture holds many pairs of directions.

The sample is not small beside its distance to light and camera, so its points see them in different
directions. A picture is taken for each pair of 81 × 81 directions and for 24 × 81 with the light at
85°; its values are read on a grid of points.

Source: thesis section 4.3.1.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

from simrig.core.errors import SimrigError
from simrig.core.kept import kept
from simrig.core.options import Option
from simrig.directions import to_vector
from simrig.plans.listed import named_scheme
from simrig.plans.protocol import Batches, Plan

if TYPE_CHECKING:
    from simrig.brdf.protocol import Brdf

THETA_MAX_DEG = 87.0  # of a point's directions: the bin of 86° ends there
_MOST_SAMPLES = 50_000_000
_POSES_AT_ONCE = 256
_PICTURES, _POINTS = 8505, 1225  # of the thesis


@dataclass(frozen=True)
class LargeSamplePlan(Plan):
    """Pictures of a large flat sample, read on a grid of points.

    Attributes:
        centres: scheme of directions of light and camera to the sample's centre, all ordered pairs.
        oblique_deg, oblique_azimuths: further directions of light, at one polar angle.
        radius_mm: of the circle in which values are read.
        spacing_mm: of the grid of points.
        light_mm, camera_mm: distances of light and camera from the centre.
        largest_theta_deg: points that see light or camera lower are not read.

    Raises:
        SimrigError: sizes that cannot be, or too many samples to hold.
    """

    name: ClassVar[str] = "large-sample"
    about: ClassVar[str] = "pictures of a large flat sample, many directions in each (4.3)"
    options: ClassVar[tuple[Option, ...]] = (
        Option("samples", int, "At most so many, in the place of the others.", least=1, short="-n"),
        Option(
            "centres", str, "Directions to the centre: 1 to 30, 81x81, 151x151 or a name.", "81x81"
        ),
        Option("spacing_mm", float, "Of the points at which a picture is read.", 14.0, least=0.1),
        Option("radius_mm", float, "Of the circle that holds these points.", 277.0, least=0.1),
        Option("oblique_azimuths", int, "Further lights at 85°.", 24, least=0, most=3600),
        Option("light_mm", float, "Distance of the light.", 1300.0, least=1.0),
        Option("camera_mm", float, "Distance of the camera.", 2000.0, least=1.0),
    )

    centres: str = "81x81"
    oblique_deg: float = 85.0
    oblique_azimuths: int = 24
    radius_mm: float = 277.0
    spacing_mm: float = 14.0
    light_mm: float = 1300.0
    camera_mm: float = 2000.0
    largest_theta_deg: float = THETA_MAX_DEG

    def __post_init__(self) -> None:
        sizes = (self.radius_mm, self.spacing_mm, self.light_mm, self.camera_mm)
        if not all(0.0 < size < np.inf for size in sizes):
            raise SimrigError(f"radius, spacing and distances must be above 0 mm, got {sizes}")
        if self.radius_mm >= 0.5 * min(self.light_mm, self.camera_mm):
            raise SimrigError(
                f"a sample of radius {self.radius_mm:g} mm is too large beside light and camera at "
                f"{self.light_mm:g} and {self.camera_mm:g} mm: at most half of the smaller"
            )
        count = len(self.points) * len(self.poses)
        if count > _MOST_SAMPLES:
            raise SimrigError(
                f"the plan reads {count:,} samples, at most {_MOST_SAMPLES:,} fit: raise --spacing"
            )

    @classmethod
    def for_material(
        cls, material: Brdf | None = None, *, samples: int | None = None, **options: Any
    ) -> Self:
        """Return the plan that options give; where the data end early it reads less.

        Args:
            samples: at most so many: fewer pictures and fewer points, in equal parts.
            options: fields of the plan.

        Raises:
            SimrigError: too few samples, or samples beside options that decide their number.
        """
        end = 90.0 if material is None else float(np.degrees(material.theta_max))
        if samples is not None:
            both = {"centres", "spacing_mm", "oblique_azimuths"} & set(options)
            if both:
                raise SimrigError(
                    f"--samples and --{min(both).removesuffix('_mm').replace('_', '-')} contradict "
                    "each other: give only one of them"
                )
            options |= _of_so_many(samples, options.get("radius_mm", cls.radius_mm))
        return cls(**options, largest_theta_deg=min(THETA_MAX_DEG, end))

    @property
    def points(self) -> np.ndarray:
        """Points of the grid within the circle, (n, 2) in mm; the centre is one of them."""
        return _grid(self.radius_mm, self.spacing_mm)

    @property
    def poses(self) -> np.ndarray:
        """Directions to the centre, (pictures, 4) theta_i, theta_v, phi_i, phi_v in radians."""
        named = named_scheme(self.centres)
        own = np.stack([named.theta, named.phi], axis=1)
        step = 2.0 * np.pi / max(self.oblique_azimuths, 1)
        oblique = np.stack(
            [
                np.full(self.oblique_azimuths, np.radians(self.oblique_deg)),
                step * np.arange(self.oblique_azimuths),
            ],
            axis=1,
        )
        lights = np.concatenate([own, oblique])
        light, view = np.repeat(lights, len(own), axis=0), np.tile(own, (len(lights), 1))
        return np.stack([light[:, 0], view[:, 0], light[:, 1], view[:, 1]], axis=1)

    @property
    def pictures_taken(self) -> int:
        """How many pictures the plan takes."""
        return len(self.poses)

    @property
    def theta_max(self) -> float:
        """The largest polar angle in radians."""
        return self._read[1]

    @property
    def samples(self) -> int:
        """How many samples the plan reads: those below the largest angle of both directions."""
        return int(self._read[0].sum())

    def check_instrument(self, instrument: Any) -> None:
        """Raise SimrigError for a smaller sample, or other distances than the plan reckons with."""
        if 2.0 * self.radius_mm > instrument.sample_diameter:
            raise SimrigError(
                f"plan '{self.name}' reads a circle of {2.0 * self.radius_mm:g} mm, the sample of "
                f"'{instrument.name}' has {instrument.sample_diameter:g} mm: choose --rig "
                "utia-large, or a smaller --radius"
            )
        asked = (self.light_mm, self.camera_mm)
        found = (instrument.light_distance, instrument.sensor_distance)
        if asked != found:
            raise SimrigError(
                f"plan '{self.name}' reckons with light and camera at {asked} mm, those of "
                f"'{instrument.name}' stand at {found}: give --light and --camera"
            )

    def shots(self, samples: int) -> int:
        """Return how many pictures the first so many samples take."""
        return int(np.searchsorted(np.cumsum(self._read[0]), samples)) + 1 if samples else 0

    @property
    def _read(self) -> tuple[np.ndarray, float]:
        """How many samples each picture gives, (pictures,), and the largest polar angle."""

        def counted() -> tuple[np.ndarray, float]:
            counts, largest = [], 0.0
            for seen, read in map(self._seen, self._pose_blocks()):
                counts.append(read.sum(axis=1))
                largest = max(largest, float(seen[read][:, :2].max(initial=0.0)))
            return np.concatenate(counts), largest

        made: tuple[np.ndarray, float] = kept(self, "read", counted)
        return made

    def _pose_blocks(self) -> list[np.ndarray]:
        poses = self.poses
        return [poses[k : k + _POSES_AT_ONCE] for k in range(0, len(poses), _POSES_AT_ONCE)]

    def _seen(self, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return directions at all points, (poses, points, 4), and which of them are read."""
        points = np.concatenate([self.points, np.zeros((len(self.points), 1))], axis=1)
        angles = np.empty((len(poses), len(points), 4))
        for column, distance in ((0, self.light_mm), (1, self.camera_mm)):
            place = distance * to_vector(poses[:, column], poses[:, column + 2])
            x, y, z = np.moveaxis(place[:, None, :] - points, -1, 0)
            angles[..., column] = np.arctan2(np.hypot(x, y), z)
            angles[..., column + 2] = np.mod(np.arctan2(y, x), 2.0 * np.pi)
        return angles, np.all(angles[..., :2] <= np.radians(self.largest_theta_deg), axis=-1)

    def batches(self) -> Batches:
        """Yield the directions of one block of pictures after the other."""
        for poses in self._pose_blocks():
            seen, read = self._seen(poses)
            if np.any(read):
                yield seen[read]
        return {}

    def places(self) -> np.ndarray:
        """Return at which of the points each sample is read, (samples,), in the plan's order."""
        read = [self._seen(poses)[1] for poses in self._pose_blocks()]
        return np.concatenate([np.nonzero(each)[1] for each in read])

    def describe(self) -> str:
        """Return the plan in words."""
        return (
            f"{self.pictures_taken:,} pictures of a sample of {2.0 * self.radius_mm:g} mm, read "
            f"every {self.spacing_mm:g} mm: {len(self.points):,} points in each"
        )

    def probe(self, most: int) -> Plan:
        """Return directions of the plan, about ``most`` of them."""
        from simrig.plans.listed import Directions

        each = max(most // len(self.points), 1)
        poses = self.poses[:: max(len(self.poses) // each, 1)]
        seen, read = self._seen(poses)
        return Directions(seen[read][:most])


def _of_so_many(samples: int, radius_mm: float) -> dict[str, Any]:
    """Return the fields of a plan of at most so many samples."""
    # 24 oblique lights belong to 81 directions, as in the thesis; to the fewest, none
    schemes = ["81x81", *map(str, range(30, 0, -1))]
    sizes = [(name, len(named_scheme(name))) for name in schemes]
    layouts = [(name, n, round(24 / 81 * n)) for name, n in sizes] + [(*sizes[-1], 0)]
    wished = _PICTURES * min(np.sqrt(samples / (_PICTURES * _POINTS)), 1.0)
    fitting = [one for one in layouts if one[1] * (one[1] + one[2]) <= max(wished, 1.0)]
    centres, directions, oblique = fitting[0] if fitting else layouts[-1]
    pictures = directions * (directions + oblique)
    points = samples // pictures
    if points == 0:
        raise SimrigError(
            f"{samples} samples are too few for a large sample, it takes at least {pictures}"
        )
    spacing = radius_mm * np.sqrt(np.pi / points)
    while len(_grid(radius_mm, spacing)) > points:
        spacing *= 1.01
    return {"centres": centres, "oblique_azimuths": oblique, "spacing_mm": float(spacing)}


def _grid(radius_mm: float, spacing_mm: float) -> np.ndarray:
    """Return the points of a square grid within a circle, (n, 2); its centre is one of them."""
    steps = int(radius_mm / spacing_mm)
    line = spacing_mm * np.arange(-steps, steps + 1)
    grid = np.stack(np.meshgrid(line, line, indexing="ij"), axis=-1).reshape(-1, 2)
    return np.asarray(grid[np.hypot(*grid.T) <= radius_mm])

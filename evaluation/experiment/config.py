"""What an experiment is: its settings, read from TOML and checked before anything is computed.

Every section of the file is a frozen dataclass. ``docs/experiments.md`` documents the keys.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any, ClassVar

import tomli_w

from simrig.brdf import KURT_MATERIALS, RESCALED_MATERIALS
from simrig.core.backend import VARIANTS
from simrig.core.effects import parse_tolerance
from simrig.core.errors import SimrigError, unknown_name
from simrig.evaluation.experiment.rendering import USUAL_SPP, RenderingSettings
from simrig.evaluation.experiment.schema import (
    Check,
    Section,
    choice,
    flag,
    integer,
    number,
    optional,
    sample_counts,
    setting,
    text,
)
from simrig.files.atomic import existing_file
from simrig.files.text import read_toml
from simrig.plans.slices import SLICE_TYPES
from simrig.reconstruction.slices.along_slices import INTERPOLATIONS
from simrig.rendering.environment import BUILTIN
from simrig.scenes import SCENES

NO_EFFECTS = "none"  # an ideal rig
BOTH_SLICE_TYPES = "both"  # measure with each of them, to compare
SMALLEST_PICTURE = 11  # pixels; the window of SSIM


def _tolerance(where: str, value: Any) -> str:
    if text(where, value) != NO_EFFECTS:
        parse_tolerance(value)
    return value


@dataclass(frozen=True)
class MeasurementSettings(Section):
    """How the material is measured.

    Attributes:
        samples: one measurement is made for each of these numbers of samples, ascending.
        theta_step_deg, azimuth_step_deg: e_s and a_s of the slices, in degrees; both or
            neither. Without them thesis Table 5.1 chooses.
        theta_max_deg: largest polar angle in degrees; by default 80, or that of the data, rounded
            down to whole degrees, where it ends earlier.
        slice_types: ``"all"``, ``"axial-diagonal"``, or ``"both"`` for a measurement with each.
        k, p_1, p_2: parameters of thesis algorithm 5.1.
        automatic: also measure by the automatic plan, with at most as many samples.
        baseline: also measure a regular grid with about as many samples, for comparison.
        rig: the name of a rig, or an instrument file (TOML).
        tolerance: chooses the effects of the rig that are simulated (``"dE=0.5"``); ``"none"`` is
            an ideal rig.
    """

    section: ClassVar[str] = "measurement"

    samples: tuple[int, ...] = setting(sample_counts, (3230, 8911, 18721))
    theta_step_deg: float | None = setting(optional(number(0.5, 89.0)), None)
    azimuth_step_deg: float | None = setting(optional(number(1.0, 180.0)), None)
    theta_max_deg: float | None = setting(optional(number(1.0, 89.0), "auto"), None)
    slice_types: str = setting(choice((*SLICE_TYPES, BOTH_SLICE_TYPES)), "all")
    k: float = setting(number(0.0, 1.0), 0.9)
    p_1: int = setting(integer(0, 1000), 5)
    p_2: int = setting(integer(0, 1000), 5)
    automatic: bool = setting(flag, False)
    baseline: bool = setting(flag, True)
    rig: str = setting(text, "gonioreflectometer")
    tolerance: str = setting(_tolerance, NO_EFFECTS)

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.theta_step_deg is None) != (self.azimuth_step_deg is None):
            raise SimrigError(
                "give both 'theta_step_deg' and 'azimuth_step_deg' in [measurement], or "
                "neither to have them chosen"
            )
        if self.p_1 + self.p_2 < 1:
            raise SimrigError("'p_1' + 'p_2' in [measurement] must be at least 1")


@dataclass(frozen=True)
class ReconstructionSettings(Section):
    """How the BRDF is reconstructed: ``interpolation`` along slices, cubic, pchip or linear."""

    section: ClassVar[str] = "reconstruction"

    interpolation: str = setting(choice(INTERPOLATIONS), "cubic")


@dataclass(frozen=True)
class ComparisonSettings(Section):
    """How BRDFs are compared.

    Attributes:
        exact: also compare on every direction pair of the grid.
        estimate_samples: random direction pairs of the MRE estimate.
        step_deg: step of the grid in degrees; divides 360.
    """

    section: ClassVar[str] = "comparison"

    exact: bool = setting(flag, True)
    estimate_samples: int = setting(integer(1), 100_000)
    step_deg: float = setting(number(0.5, 45.0), 2.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if abs(360.0 / self.step_deg - round(360.0 / self.step_deg)) > 1e-6:
            raise SimrigError(
                f"'step_deg' in [comparison] must divide 360 degrees, got {self.step_deg:g}"
            )


@dataclass(frozen=True)
class SceneSettings:
    """One scene: its registered name and options.

    Every scene also takes ``spp`` in place of that of [rendering]. ``environment_sphere`` takes
    ``environment``, an EXR or HDR file (``"builtin"`` without one), beside ``lights``, the number
    of directional lights into which it is cut.
    """

    name: str
    options: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if text("'name' in [[scenes]]", self.name) not in SCENES:
            raise unknown_name("scene", self.name, SCENES)
        defaults = dict(SCENES[self.name].options)
        defaults["spp"] = USUAL_SPP
        if "lights" in defaults:
            defaults["environment"] = BUILTIN
        checked = {}
        for key, value in self.options.items():
            if key not in defaults:
                raise unknown_name(f"option of scene '{self.name}'", key, defaults)
            checked[key] = _option_check(key, defaults[key])(
                f"'{key}' of scene '{self.name}'", value
            )
        object.__setattr__(self, "options", checked)

    @classmethod
    def from_table(cls, table: Any) -> SceneSettings:
        """Return the scene from a TOML table or its bare name."""
        if isinstance(table, str):
            return cls(table)
        if not isinstance(table, Mapping) or "name" not in table:
            raise SimrigError("every [[scenes]] needs a 'name': one of " + ", ".join(SCENES))
        return cls(table["name"], {key: value for key, value in table.items() if key != "name"})

    @property
    def key(self) -> str:
        """A name for files: the scene's, with the side of the light where it has one."""
        parts = [self.name, str(self.options.get("light", ""))]
        if "environment" in self.options and self.options["environment"] != BUILTIN:
            parts.append(Path(self.options["environment"]).stem)
        if "lights" in self.options:
            parts.append(str(self.options["lights"]))
        return "-".join(part for part in parts if part)


def _option_check(key: str, default: Any) -> Check:
    if key == "resolution":
        return integer(SMALLEST_PICTURE, 16384)
    if isinstance(default, bool):
        return flag
    if isinstance(default, int):
        return integer(1)
    return number(-1e6, 1e6) if isinstance(default, float) else text


DEMO_SCENES = (
    SceneSettings("sphere", {"resolution": 256}),
    SceneSettings("four_spheres", {"columns": 2, "resolution": 384}),
    SceneSettings("cylinder", {"light": "top", "resolution": 128}),
    SceneSettings("environment_sphere", {"lights": 256, "resolution": 256}),
)


@dataclass(frozen=True)
class Experiment(Section):
    """Everything that decides a result.

    Attributes:
        material: name of a built-in material, or a file.
        title: heading of the report; by default the material's name.
        measurement, reconstruction, rendering, comparison: see their classes.
    """

    material: str = setting(text)
    title: str | None = setting(optional(text), None)
    variant: str = setting(choice(("auto", *VARIANTS)), "auto")
    seed: int = setting(integer(0), 0)
    measurement: MeasurementSettings = MeasurementSettings()
    reconstruction: ReconstructionSettings = ReconstructionSettings()
    rendering: RenderingSettings = field(default_factory=RenderingSettings)
    comparison: ComparisonSettings = ComparisonSettings()
    scenes: tuple[SceneSettings, ...] = DEMO_SCENES

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.scenes:
            raise SimrigError("an experiment needs at least one scene")
        if len(set(map(repr, self.scenes))) < len(self.scenes):
            raise SimrigError("two [[scenes]] are the same: leave one out")

    @property
    def keyed_scenes(self) -> dict[str, SceneSettings]:
        """The scenes under names for files, with a number where two would be the same."""
        keyed: dict[str, SceneSettings] = {}
        for scene in self.scenes:
            alike = sum(other.key == scene.key for other in keyed.values())
            keyed[f"{scene.key}-{alike + 1}" if alike else scene.key] = scene
        return keyed

    @classmethod
    def from_toml(cls, path: str | Path) -> Experiment:
        """Read an experiment; files named in it are looked for beside it.

        Raises:
            SimrigError: no such file, no TOML, an unknown key, a value of the wrong type or out
                of range, a material or scene that does not exist.
        """
        table = read_toml(path, "an experiment")
        try:
            return cls.from_table(table)._found_beside(Path(path).absolute().parent)
        except SimrigError as error:
            raise SimrigError(f"'{path}': {error}") from error

    @classmethod
    def from_table(cls, table: Mapping[str, Any]) -> Experiment:
        """Return the experiment of a parsed TOML document.

        Raises:
            SimrigError: see ``from_toml``.
        """
        known = [item.name for item in fields(cls)]
        for key in table:
            if key not in known:
                raise unknown_name("key", key, known)
        if "material" not in table:
            raise SimrigError("'material' is missing: a built-in name or a file")
        values = dict(table)
        for section in _SECTIONS:
            if section.section in values:
                values[section.section] = section.from_table(values[section.section])
        if "scenes" in values:
            if not isinstance(values["scenes"], list):
                raise SimrigError("'scenes' must be a list, written as [[scenes]] tables")
            values["scenes"] = tuple(SceneSettings.from_table(t) for t in values["scenes"])
        return cls(**values)

    def _found_beside(self, folder: Path) -> Experiment:
        """Return the experiment with files as absolute paths.

        Raises:
            SimrigError: the material is neither a built-in name nor a file.
        """
        material = self.material
        if material not in (*KURT_MATERIALS, *RESCALED_MATERIALS):
            if not Path(material).suffix and not (folder / material).is_file():
                known = (*KURT_MATERIALS, *RESCALED_MATERIALS)
                raise unknown_name("material (and no file of this name)", material, known)
            material = str(existing_file(folder / material).resolve())
        scenes = []
        for scene in self.scenes:
            source = scene.options.get("environment", BUILTIN)
            if source != BUILTIN:
                found = str(existing_file(folder / source).resolve())
                scene = replace(scene, options={**scene.options, "environment": found})
            scenes.append(scene)
        measurement = self.measurement
        if measurement.rig.endswith(".toml"):
            rig = str(existing_file(folder / measurement.rig).resolve())
            measurement = replace(measurement, rig=rig)
        return replace(self, material=material, measurement=measurement, scenes=tuple(scenes))

    def as_dict(self) -> dict[str, Any]:
        """Return the settings as plain values, as they would stand in a TOML file."""
        values = asdict(self)
        values["measurement"]["samples"] = list(self.measurement.samples)
        for key in ("enable", "disable"):
            values["rendering"][key] = list(values["rendering"][key])
        values["scenes"] = [{"name": scene.name, **scene.options} for scene in self.scenes]
        return values

    def to_toml(self) -> str:
        """Return the experiment as TOML; reading it gives an equal experiment."""
        return tomli_w.dumps(_given(self.as_dict()))


_SECTIONS: tuple[type[Section], ...] = (
    MeasurementSettings,
    ReconstructionSettings,
    RenderingSettings,
    ComparisonSettings,
)


def _given(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return values and tables of them without what is None, which TOML cannot say."""
    return {
        key: _given(value) if isinstance(value, Mapping) else value
        for key, value in values.items()
        if value is not None
    }


def demo_experiment(material: str | None = None) -> Experiment:
    """Return the experiment of ``simrig demo``: automatic plan, the thesis's slices, regular grid.

    Args:
        material: name of a built-in material, or a file; by default one whose anisotropic
            highlights are a fair test.

    Raises:
        SimrigError: neither a known material nor a file.
    """
    measurement = MeasurementSettings(samples=DEMO_SAMPLES, automatic=True)
    experiment = Experiment(
        material=material or DEMO_MATERIAL,
        measurement=measurement,
        rendering=RenderingSettings(tolerance=DEMO_TOLERANCE),
    )
    return experiment._found_beside(Path.cwd())


DEMO_MATERIAL = "fabric112"
DEMO_SAMPLES = (1060, 3230, 8911)
DEMO_TOLERANCE = "dE=1"  # a dozen pictures of each scene: a fourth of the samples of the default

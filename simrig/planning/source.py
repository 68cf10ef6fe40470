"""Where a scene comes from: a dictionary, a file, a function that builds it, or a loaded scene.

A plan may ask for another variant than the one in which the scene is looked at, so a scene that
can be built again is kept as what builds it. What its description says, and a loaded scene no
longer knows, is read here: spectra, and a camera that looks through pixel centres only.
"""

from __future__ import annotations

import os
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from simrig.core import backend
from simrig.core.errors import SimrigError
from simrig.plugins.make import building

# what carries a spectrum that RGB cannot say; a plain number or rgb is none
_SPECTRAL_TYPES = {
    "spectrum",
    "blackbody",
    "regular",
    "irregular",
    "measured",
    "measured_polarized",
    "sunsky",
    "timed_sunsky",
    "hair",
    "specfilm",
}
_METALS = {"conductor", "roughconductor"}  # by name ("Au") their eta and k are tabulated spectra


@dataclass(frozen=True)
class SceneSource:
    """A scene that can be loaded in the current variant.

    Attributes:
        build: returns a dictionary or loaded scene for the current variant.
        reconstructs: whether ``build`` works in another variant than the one it was made in.
        spectral: what in the description is spectral; empty when all of it is RGB, None when
            that is not known.
        pixel_centres: whether the camera looks through pixel centres only, so that more samples
            per pixel change nothing.
    """

    build: Callable[[], Any]
    reconstructs: bool
    spectral: tuple[str, ...] | None
    pixel_centres: bool


def scene_source_in(scene: Any, variant: str) -> SceneSource:
    """Select a variant and return where the scene comes from.

    A scene made of Mitsuba objects stays in the variant that is set.
    """
    import mitsuba as mi

    if mi.variant() is None or not hasattr(scene, "sensors"):
        current = mi.variant()
        if current is None or variant != "auto":
            backend.select(variant)
    return scene_source(scene)


def scene_source(scene: Any) -> SceneSource:
    """Return where a scene comes from.

    Args:
        scene: a Mitsuba dictionary, a loaded scene, the path of an XML file, or a function
            without arguments that returns one of the first two for the current variant.

    Raises:
        SimrigError: a file that is missing or is no Mitsuba scene, or none of these.
    """
    if isinstance(scene, str | os.PathLike):
        return _from_file(Path(scene))
    if isinstance(scene, Mapping):
        return _from_dictionary(
            lambda: dict(scene), dict(scene), reconstructs=not _has_objects(scene)
        )
    if callable(scene):
        made = scene()
        return _from_dictionary(_made_once(scene, made), made, reconstructs=True)
    if hasattr(scene, "sensors"):
        return SceneSource(lambda: scene, False, None, False)
    kind = type(scene).__name__
    raise SimrigError(f"a scene is a Mitsuba dictionary, a scene or an XML file, got {kind}")


def _made_once(scene: Callable[[], Any], made: Any) -> Callable[[], Any]:
    """Return a function that builds a scene, except in the variant in which it is made already."""
    import mitsuba as mi

    variant = mi.variant()
    return lambda: made if mi.variant() == variant else scene()


def _from_dictionary(build: Callable[[], Any], made: Any, reconstructs: bool) -> SceneSource:
    if not isinstance(made, Mapping):
        return SceneSource(build, reconstructs, None, False)
    sampler = made.get("sensor", {}).get("sampler", {}) if _is_mapping(made.get("sensor")) else {}
    centres = sampler.get("jitter") is False and sampler.get("sample_count") == 1
    return SceneSource(build, reconstructs, tuple(sorted(set(_spectral_entries(made)))), centres)


def _from_file(path: Path) -> SceneSource:
    if not path.is_file():
        raise SimrigError(f"there is no scene file '{path}'")
    try:
        root = ElementTree.parse(path).getroot()
    except ElementTree.ParseError as error:
        raise SimrigError(f"'{path}' is no XML file: {error}") from None
    if root.tag != "scene":
        raise SimrigError(f"'{path}' is no Mitsuba scene: its root is <{root.tag}>, not <scene>")

    def build() -> Any:
        import mitsuba as mi

        with building(f"the scene '{path}'"):
            return mi.load_file(str(path))

    includes = root.iter("include")
    spectral = None if any(True for _ in includes) else tuple(sorted(set(_spectral_tags(root))))
    return SceneSource(build, True, spectral, False)


def _spectral_tags(root: ElementTree.Element) -> Iterator[str]:
    for element in root.iter():
        value = element.get("value", element.get("filename", ""))
        if element.tag == "spectrum" and _is_spectrum(value or ""):
            yield "spectrum"
        if element.get("type") in _SPECTRAL_TYPES:
            yield str(element.get("type"))
        if element.get("type") in _METALS and any(
            child.tag == "string"
            and child.get("name") == "material"
            and child.get("value") != "none"
            for child in element
        ):
            yield str(element.get("type"))


def _is_spectrum(text: str) -> bool:
    """Return whether the value of a <spectrum> varies with wavelength."""
    try:
        float(text)
    except ValueError:
        return True
    return False


def _spectral_entries(entry: Mapping[str, Any]) -> Iterator[str]:
    kind = entry.get("type")
    if kind in _SPECTRAL_TYPES and not (
        kind == "spectrum" and isinstance(entry.get("value"), float)
    ):
        yield str(kind)
    if kind in _METALS and entry.get("material", "none") != "none":
        yield str(kind)
    for value in entry.values():
        if _is_mapping(value):
            yield from _spectral_entries(value)


def _has_objects(entry: Mapping[str, Any]) -> bool:
    """Return whether a dictionary holds Mitsuba objects that belong to one variant.

    Bitmaps belong to none.
    """
    return any(
        _has_objects(value)
        if _is_mapping(value)
        else hasattr(value, "variant_name") and type(value).__name__ != "Bitmap"
        for value in entry.values()
    )


def _is_mapping(value: Any) -> bool:
    return isinstance(value, Mapping)

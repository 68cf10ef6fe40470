"""Where a scene comes from: a dictionary, a file, a function that builds it, or a loaded scene.

A plan may ask for another variant than the one in which the scene is looked at, so a scene that
can be built again is kept as what builds it. What its description says, and a loaded scene no
longer knows, is read here: spectra, and a camera that looks through pixel centres only.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import mitsuba as mi

from simrig.core import backend
from simrig.core.errors import SimrigError
from simrig.planning.spectral_content import spectral_content
from simrig.rendering.scene_file import Description, SceneFile, load_described, parsed

_NO_DESCRIPTION = "a loaded scene"


@dataclass(frozen=True)
class SceneSource:
    """A scene that can be loaded in the current variant.

    Attributes:
        build: returns a loaded scene for the current variant.
        reconstructs: whether ``build`` works in another variant than the one it was made in.
        spectral: what in the description is spectral.
        unknown: of what it is not known whether it is; both are empty where all of it is RGB.
        pixel_centres: whether the camera looks through pixel centres only, so that more samples
            per pixel change nothing.
        sensor: which of the scene's sensors looks.
    """

    build: Callable[[], Any]
    reconstructs: bool
    spectral: tuple[str, ...]
    unknown: tuple[str, ...]
    pixel_centres: bool = False
    sensor: int = 0


def scene_source_in(scene: Any, variant: str, sensor: int = 0) -> SceneSource:
    """Select a variant and return where the scene comes from.

    A loaded scene stays in the variant in which it was loaded, whichever is set.
    """
    if hasattr(scene, "sensors"):
        if mi.variant() != scene.variant_name():
            mi.set_variant(scene.variant_name())
        backend.equip()
    elif mi.variant() is None or variant != "auto":
        backend.select(variant)
    else:
        backend.equip()
    return scene_source(scene, sensor)


def scene_source(scene: Any, sensor: int = 0) -> SceneSource:
    """Return where a scene comes from.

    Args:
        scene: a Mitsuba dictionary, a loaded scene, the path of an XML file or a ``SceneFile``,
            or a function without arguments that returns one of the first two for the current
            variant.
        sensor: which of the scene's sensors looks.

    Raises:
        SimrigError: a file that is missing or is no Mitsuba scene, or none of these.
    """
    return replace(_source(scene), sensor=sensor)


def _source(scene: Any) -> SceneSource:
    if isinstance(scene, str | os.PathLike):
        return _described(SceneFile(Path(scene)))
    if isinstance(scene, SceneFile):
        return _described(scene)
    if isinstance(scene, Mapping):
        return _described(scene, reconstructs=not _has_objects(scene))
    if hasattr(scene, "sensors"):
        return SceneSource(lambda: scene, False, (), (_NO_DESCRIPTION,))
    if callable(scene):
        made = scene()
        if hasattr(made, "sensors"):
            return SceneSource(_made_once(scene, made), True, (), (_NO_DESCRIPTION,))
        described = _described(made)
        return replace(described, build=_loaded(_made_once(scene, made)), reconstructs=True)
    kind = type(scene).__name__
    raise SimrigError(f"a scene is a Mitsuba dictionary, a scene or an XML file, got {kind}")


def _made_once(scene: Callable[[], Any], made: Any) -> Callable[[], Any]:
    """Return a function that builds a scene, except in the variant in which it is made already."""
    variant = mi.variant()
    return lambda: made if mi.variant() == variant else scene()


def _loaded(make: Callable[[], Any]) -> Callable[[], Any]:
    return lambda: load_described(make())


def _described(scene: Description, reconstructs: bool = True) -> SceneSource:
    with parsed(scene) as state:
        nodes = list(state.nodes)
        spectral, unknown = spectral_content(nodes)
    return SceneSource(
        lambda: load_described(scene),
        reconstructs,
        spectral,
        unknown,
        _looks_through_centres(nodes),
    )


def _looks_through_centres(nodes: Iterable[Any]) -> bool:
    samplers = [node.props for node in nodes if node.type == mi.ObjectType.Sampler]
    return bool(samplers) and all(
        one.get("jitter", True) is False and one.get("sample_count", 4) == 1 for one in samplers
    )


def _has_objects(entry: Mapping[str, Any]) -> bool:
    """Return whether a dictionary holds Mitsuba objects that belong to one variant.

    Bitmaps belong to none.
    """
    return any(
        _has_objects(value)
        if isinstance(value, Mapping)
        else hasattr(value, "variant_name") and type(value).__name__ != "Bitmap"
        for value in entry.values()
    )

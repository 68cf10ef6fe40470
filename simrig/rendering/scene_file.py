"""Mitsuba scene files and dictionaries, parsed: what they say before anything is loaded.

Mitsuba's own parser reads fragments, fills in parameters and resolves references, so that what is
asked of a description is asked of the whole of it.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import mitsuba as mi

from simrig.core.errors import SimrigError
from simrig.plugins.make import building

# shapes that stay apart: Mitsuba merges those of equal BSDFs into one mesh without a bounding box
MOST_SHAPES_APART = 64
# properties of a film, and what Mitsuba takes where they are not given
_SIZES = {
    "width": 768,
    "height": 576,
    "crop_width": None,
    "crop_height": None,
    "crop_offset_x": None,
    "crop_offset_y": None,
}


@dataclass(frozen=True)
class SceneFile:
    """A scene file with what it is filled in with.

    Attributes:
        parameters: values of its ``$names``.
        scale: of the pictures' width and height.
    """

    path: Path
    parameters: Mapping[str, str] = field(default_factory=dict)
    scale: float = 1.0

    def __post_init__(self) -> None:
        if not 0.0 < self.scale < math.inf:
            raise SimrigError(f"the scale of a picture is a number above 0, got {self.scale:g}")


Description = SceneFile | Mapping[str, Any]


@contextmanager
def parsed(scene: Description) -> Iterator[Any]:
    """Parse a scene in the current variant; its relative paths are known while the context lasts.

    Args:
        scene: a file, or a dictionary.

    Yields:
        The state of Mitsuba's parser, references resolved.

    Raises:
        SimrigError: no such file, or one that is no scene; a parameter that is not given, or that
            the file does not have.
    """
    before = mi.file_resolver()  # type: ignore[operator]  # the stub says object
    resolver = mi.FileResolver(before)
    mi.set_file_resolver(resolver)  # type: ignore[operator]  # likewise
    try:
        if isinstance(scene, SceneFile):
            resolver.prepend(str(scene.path.absolute().parent))
        with building(_named(scene)):
            state = _parse(scene)
        yield state
    finally:
        mi.set_file_resolver(before)  # type: ignore[operator]  # likewise


def load_described(scene: Description) -> Any:
    """Return the loaded scene of a file or dictionary, in the current variant.

    Raises:
        SimrigError: Mitsuba cannot build it, in one line.
    """
    with parsed(scene) as state, building(_named(scene)):
        made = mi.parser.instantiate(_configuration(state), state)
        return made[0] if isinstance(made, list) else made


def _named(scene: Description) -> str:
    return f"the scene '{scene.path}'" if isinstance(scene, SceneFile) else "the scene"


def _configuration(state: Any = None) -> Any:
    config = mi.parser.ParserConfig(str(mi.variant()))
    if state is not None:
        shapes = sum(node.type == mi.ObjectType.Shape for node in state.nodes)
        config.merge_meshes = shapes > MOST_SHAPES_APART
    return config


def _parse(scene: Description) -> Any:
    config = _configuration()
    name = "the dictionary"
    if isinstance(scene, SceneFile):
        name = f"'{scene.path}'"
        if not scene.path.is_file():
            raise SimrigError(f"there is no scene file {name}")
        try:
            state = mi.parser.parse_file(config, str(scene.path), **scene.parameters)
        except RuntimeError as error:
            _explain(scene.path, str(error))
            raise
        _scale_films(state, scene.scale)
    else:
        state = mi.parser.parse_dict(config, dict(scene))
    root = state.nodes[0].props.plugin_name() if len(state.nodes) else "nothing"
    if root != "scene":
        raise SimrigError(f"{name} is no Mitsuba scene: it describes a '{root}'")
    mi.parser.transform_all(_configuration(state), state)
    return state


def _scale_films(state: Any, scale: float) -> None:
    """Change the sizes of all films; a crop keeps its place."""
    if scale == 1.0:
        return
    for node in state.nodes:
        if node.type != mi.ObjectType.Film:
            continue
        for name, usual in _SIZES.items():
            if name in node.props or usual is not None:
                size = int(node.props.get(name, usual))
                least = 0 if "offset" in name else 1
                node.props[name] = max(round(size * scale), least)


def _explain(scene: Path, report: str) -> None:
    """Raise SimrigError for what is no scene, or where a parameter is the cause."""
    if "Parsing of XML file" in report:
        reason = report.rsplit("failed:", 1)[-1].strip()
        raise SimrigError(f"'{scene}' is no XML file: {reason}") from None
    root = re.search(r"root element <(\w+)>", report)
    if root and root.group(1) != "scene":
        raise SimrigError(
            f"'{scene}' is no Mitsuba scene: its root is <{root.group(1)}>, not <scene>"
        ) from None
    missing = re.search(r"undefined parameter: \$?(\w+)", report)
    if missing:
        name = missing.group(1)
        raise SimrigError(
            f"the scene '{scene}' leaves ${name} open: say what it is with -D {name}=VALUE"
        ) from None
    stray = re.findall(r"- \$(\w+)=", report)
    if stray and "unused parameters" in report:
        raise SimrigError(
            f"the scene '{scene}' has no parameter ${stray[0]}: leave out -D {stray[0]}=..."
        ) from None

"""Mitsuba's samplers: which numbers of samples each can draw, and a scene with another one."""

from __future__ import annotations

import os
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from simrig.core.errors import SimrigError, unknown_name

SAMPLERS = ("independent", "stratified", "multijitter", "orthogonal", "ldsampler")
_PRIMES = (2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37, 41, 43, 47, 53, 59, 61)


def samples_for(sampler: str, wanted: int) -> int:
    """Return a number of samples per pixel near ``wanted`` that a sampler draws without rounding.

    ``orthogonal`` takes squares of primes only (Jarosz et al. 2019), ``ldsampler`` at least 4;
    otherwise all take every power of four, to which ``stratified`` and ``ldsampler`` round.

    Raises:
        SimrigError: an unknown sampler, or a number that is no power of four (4096 at most).
    """
    if sampler not in SAMPLERS:
        raise unknown_name("sampler", sampler, SAMPLERS)
    if wanted not in (1, 4, 16, 64, 256, 1024, 4096):
        raise SimrigError(f"samplers are compared at powers of 4 up to 4096, got {wanted}")
    if sampler == "orthogonal":
        return min((prime**2 for prime in _PRIMES), key=lambda count: abs(count - wanted))
    return max(wanted, 4) if sampler == "ldsampler" else wanted


def with_sampler(scene: Any, sampler: str) -> Any:
    """Return a scene whose camera draws its samples by another sampler.

    Args:
        scene: a Mitsuba dictionary with one sensor, or the path of an XML file.
        sampler: one of ``SAMPLERS``.

    Raises:
        SimrigError: an unknown sampler, or a scene that has no sensor of its own to change.
    """
    if sampler not in SAMPLERS:
        raise unknown_name("sampler", sampler, SAMPLERS)
    if isinstance(scene, Mapping):
        return _dictionary_with(scene, sampler)
    if isinstance(scene, str | os.PathLike):
        return _file_with(Path(scene), sampler)
    raise SimrigError("the sampler of a loaded scene cannot be changed: give what it is made from")


def _dictionary_with(scene: Mapping[str, Any], sampler: str) -> dict[str, Any]:
    cameras = [name for name, entry in scene.items() if _is_camera(entry)]
    if len(cameras) != 1:
        raise SimrigError(f"expected a scene with one sensor that has a film, got {len(cameras)}")
    camera = {key: value for key, value in scene[cameras[0]].items() if not _is_sampler(value)}
    # 4 samples suit every sampler; a render states its own number
    camera["sampler"] = {"type": sampler, "sample_count": 4}
    return {**scene, cameras[0]: camera}


def _is_camera(entry: Any) -> bool:
    return isinstance(entry, Mapping) and any(
        isinstance(value, Mapping) and str(value.get("type")).endswith("film")
        for value in entry.values()
    )


def _is_sampler(entry: Any) -> bool:
    return isinstance(entry, Mapping) and entry.get("type") in SAMPLERS


def _file_with(path: Path, sampler: str) -> Any:
    """Load a scene file with its first sensor's sampler replaced."""
    import mitsuba as mi

    from simrig.plugins.make import building

    try:
        root = ElementTree.parse(path).getroot()
    except (OSError, ElementTree.ParseError) as error:
        raise SimrigError(f"'{path}' is no Mitsuba scene file: {error}") from None
    camera = root.find("sensor")
    if camera is None:
        raise SimrigError(f"'{path}' has no <sensor> of its own to change the sampler of")
    for old in camera.findall("sampler"):
        camera.remove(old)
    element = ElementTree.SubElement(camera, "sampler", type=sampler)
    ElementTree.SubElement(element, "integer", name="sample_count", value="4")
    resolver = mi.file_resolver()  # type: ignore[operator]  # the stub says object
    folder = str(path.absolute().parent)
    if folder not in [str(known) for known in resolver]:
        resolver.append(folder)  # where the file's own references are looked up
    with building(f"the scene '{path}'"):
        return mi.load_string(ElementTree.tostring(root, encoding="unicode"))

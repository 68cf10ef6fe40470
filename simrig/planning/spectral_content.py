"""What in the description of a scene holds spectra that red, green and blue cannot say.

Asked of the parsed description, with includes read and parameters filled in. A plugin's name
decides only where the name is what states the data (a metal named "Au", a temperature); files are
asked for their fields. What a plugin that is not Mitsuba's or ours holds is not known.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np

from simrig.core.errors import SimrigError
from simrig.files.rgl.tensor_file import read_tensors

# Whose own data are spectra: the model of the sky has one set of data for RGB and another for
# wavelengths, hair absorbs by wavelength, the film has a channel per band.
_ALWAYS = {"blackbody", "sunsky", "timed_sunsky", "hair", "specfilm"}
_METALS = {"conductor", "roughconductor"}
_FILES = {"measured"}  # that hold RGB or spectra
_TABULATED = {"regular", "irregular"}
_NUMBERS = (int, float)


def spectral_content(nodes: Iterable[Any]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return what holds spectra, and what of which that is not known, by names of plugins.

    Args:
        nodes: of a parsed scene (``mitsuba.parser``), references resolved.
    """
    spectral: set[str] = set()
    unknown: set[str] = set()
    for node in nodes:
        name = node.props.plugin_name()
        if any(_varies(value) for value in _values(node.props)):
            spectral.add("spectrum")
        if name in _ALWAYS or (name in _METALS and _names_a_metal(node.props)):
            spectral.add(name)
        elif name in _TABULATED:
            spectral.update({name} if _table_varies(node.props) else ())
        elif name in _FILES:
            held = _file_is_spectral(node.props)
            spectral.update({name} if held else ())
            unknown.update({name} if held is None else ())
        elif name == "measured_polarized" and "wavelength" not in node.props:
            spectral.add(name)
        elif name and not _is_known(name):
            unknown.add(name)
        unknown.update(
            name
            for kind, name in map(_foreign_object, _values(node.props))
            if kind and not _is_known(name)
        )
    return tuple(sorted(spectral)), tuple(sorted(unknown))


def _values(properties: Any) -> list[Any]:
    kinds: Any = mi.Properties.Type
    kept = (kinds.Spectrum, kinds.Object)
    return [value for key, value in properties.items() if properties.type(key) in kept]


def _varies(value: Any) -> bool:
    """Return whether a value is a spectrum that is not the same at all wavelengths."""
    if not hasattr(value, "is_uniform"):
        return False
    return not value.is_uniform() and len(set(value.values)) > 1


def _names_a_metal(properties: Any) -> bool:
    return "material" in properties and str(properties["material"]) != "none"


def _table_varies(properties: Any) -> bool:
    """Return whether the values of a tabulated spectrum vary; True where they cannot be read."""
    if "values" not in properties or not isinstance(properties["values"], str):
        return True
    return len(set(properties["values"].replace(",", " ").split())) > 1


def _file_is_spectral(properties: Any) -> bool | None:
    """Return whether a file of the RGL database holds spectra, None where nothing says so."""
    if "filename" not in properties:
        return None
    path = Path(str(mi.file_resolver().resolve(str(properties["filename"]))))  # type: ignore[operator]
    try:
        fields = read_tensors(path)
    except SimrigError:
        return None
    if "spectra" in fields:
        return bool(np.size(fields["spectra"]))
    return False if "rgb" in fields else None


def _foreign_object(value: Any) -> tuple[bool, str]:
    """Return whether a value is an object of a plugin, and the plugin's name."""
    if not isinstance(value, mi.Object):
        return False, ""
    kind = type(value)
    return True, "simrig_" if kind.__module__.startswith("simrig.") else kind.__name__


@cache
def _is_known(plugin: str) -> bool:
    """Return whether a plugin is Mitsuba's or ours; none of these but the above holds spectra."""
    if plugin.startswith("simrig_") or plugin in ("scene", "ref", "rgb", "spectrum", "bitmap"):
        return True
    if (Path(mi.__file__).parent / "plugins" / f"{plugin}.so").is_file():
        return True
    # the base class of an object of Mitsuba's own, or one of its integrators in Python
    return hasattr(mi, plugin) or hasattr(mi.ad.integrators, plugin)

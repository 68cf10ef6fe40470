"""The plugins that scenes call by name: each builds its BRDF from Mitsuba properties.

The docstrings are the manual; ``simrig.plugins.manual`` makes docs/plugins.md from them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from simrig.brdf.analytic import Kurt, KurtLobe, Ward
from simrig.brdf.kurt_materials import kurt_material
from simrig.brdf.multiaxial import Mode, Multiaxial
from simrig.brdf.protocol import Brdf
from simrig.core.errors import SimrigError

_MODE_NUMBERS = {
    "axis": 0.0,
    "width": 40.0,
    "length": 35.0,
    "strength": 0.1,
    "alpha": 0.0,
    "grazing": 0.0,
}
_LOBE_NUMBERS = ("f_0", "m_x", "m_y", "alpha")


def simrig_kurt(props: Any) -> Brdf:
    """The anisotropic microfacet model of Kurt et al. 2010.

    Either ``material`` or the parameters, not both.

    | parameter | type | default | differentiable | meaning |
    | --- | --- | --- | --- | --- |
    | material | string | – | – | one of the ten built-in materials, or its `_rescaled` form |
    | k_d | rgb or float | 0.1 | `k_d` | diffuse coefficient |
    | k_s | rgb or float | 0.2 | `lobe_1_k_s` | specular coefficient |
    | f_0 | float | 1 | `lobe_1_f_0` | BRDF at normal incidence, in [0, 1] |
    | m_x, m_y | float | 0.2 | `lobe_1_m_x`, `lobe_1_m_y` | roughness, in [0.005, 3] |
    | alpha | float | 0 | `lobe_1_alpha` | exponent of the cosines, in [0, 1] |
    | k_s_2, f_0_2, m_x_2, m_y_2, alpha_2 | as above | – | `lobe_2_…` | second lobe |
    | rotation | float | 0 | `rotation` | degrees about the normal |

    ```python
    {"type": "simrig_kurt", "material": "yellow_satin", "rotation": 30.0}
    ```
    """
    if "material" in props:
        clash = [name for name in ("k_d", "k_s", "k_s_2", *_LOBE_NUMBERS) if name in props]
        if clash:
            raise SimrigError(f"simrig_kurt: give 'material' or '{clash[0]}', not both")
        return _built_in(props["material"])
    lobes = [_kurt_lobe(props, "")]
    if "k_s_2" in props:
        lobes.append(_kurt_lobe(props, "_2"))
    stray = [f"{name}_2" for name in _LOBE_NUMBERS if len(lobes) == 1 and f"{name}_2" in props]
    if stray:
        raise SimrigError(f"'{stray[0]}' belongs to a second lobe, which needs 'k_s_2'")
    return Kurt(k_d=_colour(props, "k_d", 0.1), lobes=tuple(lobes), name="simrig_kurt")


def simrig_ward(props: Any) -> Brdf:
    """Ward's anisotropic model.

    | parameter | type | default | differentiable | meaning |
    | --- | --- | --- | --- | --- |
    | k_d | rgb or float | 0.1 | `k_d` | diffuse BRDF |
    | k_s | rgb or float | 0.2 | `k_s` | specular BRDF |
    | m_x, m_y | float | 0.2 | `m_x`, `m_y` | roughness, in [0.005, 3] |
    | variant | string | bounded | – | `bounded` (2010), `duer` (2006) or `ward` (1992) |
    | rotation | float | 0 | `rotation` | degrees about the normal |

    ```python
    {"type": "simrig_ward", "k_s": {"type": "rgb", "value": [0.3, 0.2, 0.1]}, "m_x": 0.05}
    ```
    """
    return Ward(
        k_d=_colour(props, "k_d", 0.1),
        k_s=_colour(props, "k_s", 0.2),
        m_x=number(props, "m_x", 0.2),
        m_y=number(props, "m_y", 0.2),
        variant=props.get("variant", "bounded"),
        name="simrig_ward",
    )


def simrig_multiaxial(props: Any) -> Brdf:
    """Modes of anisotropy, each with its own axis, width, length, strength and colour.

    The first mode has no number, others `_2`, `_3`, … up to 16, each of which needs its `strength`.

    | parameter | type | default | differentiable | meaning |
    | --- | --- | --- | --- | --- |
    | k_d | rgb or float | 0.1 | `k_d` | diffuse coefficient |
    | axis | float | 0 | `mode_1_axis` | degrees, azimuth along which the highlight extends |
    | width | float | 40 | `mode_1_m_across` | degrees of azimuth at half height, θ_h = 25° |
    | length | float | 35 | `mode_1_m_along` | degrees θ_h at which it has fallen to half |
    | strength | float | 0.1 | `mode_1_colour` | its f_r at the normal, 1/sr |
    | tint | rgb or float | 1 | `mode_1_colour` | multiplies the strength |
    | alpha | float | 0 | `mode_1_alpha` | exponent of 1 / (cos θ_i cos θ_v), in [0, 1] |
    | grazing | float | 0 | `mode_1_grazing` | growth towards grazing angles, in [0, 100] |
    | rotation | float | 0 | `rotation` | degrees about the normal |

    ```python
    {"type": "simrig_multiaxial", "axis": 20.0, "width": 15.0, "axis_2": 110.0, "strength_2": 0.05}
    ```
    """
    modes = [_mode(props, "")]
    while f"strength_{len(modes) + 1}" in props:
        modes.append(_mode(props, f"_{len(modes) + 1}"))
    stray = [
        f"{name}_{number}"
        for number in range(len(modes) + 1, 18)
        for name in _MODE_NUMBERS
        if f"{name}_{number}" in props
    ]
    if stray:
        missing = f"strength_{len(modes) + 1}"
        raise SimrigError(f"'{stray[0]}' needs '{missing}': every mode has a strength, 2, 3, …")
    return Multiaxial(_colour(props, "k_d", 0.1), tuple(modes), name="simrig_multiaxial")


def simrig_slices(props: Any) -> Brdf:
    """A BRDF reconstructed from one-dimensional slices, as stored by simrig (HDF5).

    | parameter | type | default | differentiable | meaning |
    | --- | --- | --- | --- | --- |
    | filename | string | required | the slices' tables | file that `simrig reconstruct` wrote |
    | rotation | float | 0 | `rotation` | degrees about the normal |

    ```python
    {"type": "simrig_slices", "filename": "slices.h5"}
    ```
    """
    brdf = _load("simrig_slices", props)
    kind = getattr(brdf, "kind", type(brdf).__name__)
    if kind != "slices":
        raise SimrigError(
            f"simrig_slices: '{props['filename']}' holds {kind}, not slices: use simrig_table"
        )
    return brdf


def simrig_table(props: Any) -> Brdf:
    """A BRDF from a file of any format that simrig reads.

    What the file says about its values is used; what it cannot say, the options of
    `simrig convert` do, under the same names (see docs/formats.md).

    | parameter | type | default | differentiable | meaning |
    | --- | --- | --- | --- | --- |
    | filename | string | required | the table's values | measured or reconstructed material |
    | rotation | float | 0 | `rotation` | degrees about the normal |
    | factor | float | 1 | – | makes the file's values f_r in 1/sr |
    | clamp_negative | boolean | false | – | negative values count as 0 |
    | layout | string | `6x48` | – | UTIA: polar angles x azimuths |
    | theta_step | float | – | – | UTIA: degrees; 90 over the count of polar angles |
    | encoding | string | linear | – | UTIA: `linear` or `srgb` |
    | colour | string | rgb | – | UTIA: `rgb` or `xyz` |
    | axes, variable | string | – | – | arrays: what the axes are, which array |
    | wavelength | float | – | – | nm of the one that becomes grey |
    | wavelengths | string | – | – | RGL: first:last in nm |
    | side | string | – | – | WINDOW: `front` or `back` |
    | gamut | string | clip | – | colours outside sRGB: `clip` negative channels to 0, or `keep` |

    ```python
    {"type": "simrig_table", "filename": "table.h5"}
    ```
    """
    from simrig.files.load import ReadOptions

    given = {f.name: props[f.name] for f in fields(ReadOptions) if f.name in props}
    return _load("simrig_table", props, given)


PLUGINS: dict[str, Callable[[Any], Brdf]] = {
    "simrig_slices": simrig_slices,
    "simrig_table": simrig_table,
    "simrig_kurt": simrig_kurt,
    "simrig_ward": simrig_ward,
    "simrig_multiaxial": simrig_multiaxial,
}


def resolved(plugin: str, props: Any) -> Path:
    """Return the path that ``filename`` names, relative to the scene where Mitsuba finds it.

    Raises:
        SimrigError: the property is missing, or there is no such file.
    """
    import mitsuba

    if "filename" not in props:
        raise SimrigError(f"{plugin}: the parameter 'filename' is missing")
    mi: Any = mitsuba  # the stubs know file_resolver as an object
    path = Path(str(mi.file_resolver().resolve(props["filename"])))
    if not path.is_file():
        raise SimrigError(f"{plugin}: there is no file '{props['filename']}'")
    return path


def _load(plugin: str, props: Any, options: Mapping[str, Any] | None = None) -> Brdf:
    """Load the material in the file that ``filename`` names."""
    from simrig.files.load import load_material

    return load_material(resolved(plugin, props), **(options or {}))


@cache
def _built_in(name: str) -> Kurt:
    """Return a built-in material, once: its device copies and its sampling stay with it."""
    return kurt_material(name)


def _kurt_lobe(props: Any, suffix: str) -> KurtLobe:
    defaults = {"f_0": 1.0, "m_x": 0.2, "m_y": 0.2, "alpha": 0.0}
    numbers = {name: number(props, name + suffix, defaults[name]) for name in _LOBE_NUMBERS}
    return KurtLobe(k_s=_colour(props, "k_s" + suffix, 0.2), **numbers)


def _mode(props: Any, suffix: str) -> Mode:
    axis, width, length, strength, alpha, grazing = (
        number(props, name + suffix, default) for name, default in _MODE_NUMBERS.items()
    )
    tint = _colour(props, "tint" + suffix, 1.0)
    return Mode.of(axis, width, length, strength, tint, alpha=alpha, grazing=grazing)


def number(props: Any, name: str, default: float) -> float:
    """Return a property that is one finite number.

    Raises:
        SimrigError: it is something else.
    """
    value = props.get(name, default)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise SimrigError(f"'{name}' must be a number, got {value!r}")
    if not np.isfinite(value):
        raise SimrigError(f"{name} must be finite, got {value}")
    return float(value)


def _colour(props: Any, name: str, default: float) -> tuple[float, float, float]:
    """Return a linear RGB property: an rgb, a vector or one number for grey."""
    value = props.get(name, default)
    if isinstance(value, str):
        raise SimrigError(f"'{name}' must be an rgb or a number, got the string '{value}'")
    try:
        red, green, blue = np.broadcast_to(np.asarray(value, dtype=np.float64), 3).tolist()
    except (TypeError, ValueError):
        raise SimrigError(
            f"'{name}' must be an rgb or a number, got {type(value).__name__}"
        ) from None
    return red, green, blue

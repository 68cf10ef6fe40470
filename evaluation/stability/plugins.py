"""Plugins in the stability table: Mitsuba's eval, pdf and sample beside float64 and better.

What a plugin computes is compared at the very directions that it was given (float32), with the
BRDF times the cosine, with the density of the sampling mixture, and for drawn samples with
the ratio of both at the direction that was drawn.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from simrig.brdf import Brdf
from simrig.brdf.tables.packed import RELATIVE_ERROR
from simrig.core import backend
from simrig.core.arrays import map_arrays
from simrig.evaluation.stability.hard_cases import HardCase
from simrig.evaluation.stability.judgement import direction_rows
from simrig.evaluation.stability.rows import StabilityRow
from simrig.evaluation.stability.subjects import FAINT, conditioning_of
from simrig.plugins.lobes import mixture_pdf

_BELOW = (0.0, 0.0, -1.0)  # stands for a draw that fell below the horizon


@dataclass(frozen=True, eq=False)
class _PluginSubject:
    """One function of a BSDF; ``wi`` is the illumination (Mitsuba's ``wo``)."""

    name: str
    bsdf: Any

    @property
    def reads_angles(self) -> bool:
        return any(np.ndim(array) > 1 for array in self.bsdf.brdf.data().values())

    @property
    def conditioning(self) -> str:
        if not self.reads_angles:
            return conditioning_of(self.bsdf.brdf)
        return f"values packed in 21 bits (2^-13); {conditioning_of(self.bsdf.brdf)}"

    def scale(self, reference: np.ndarray) -> np.ndarray:
        return np.maximum(np.abs(reference), FAINT)

    def negative(self, values: np.ndarray) -> np.ndarray:
        return np.any(values < 0.0, axis=-1)

    def with_rounded_data(
        self, wi: np.ndarray, wv: np.ndarray, rng: np.random.Generator
    ) -> np.ndarray | None:
        if not self.reads_angles:
            return None
        brdf = self.bsdf.brdf

        def rounded(table: np.ndarray) -> np.ndarray:
            return table * (1.0 + RELATIVE_ERROR * rng.choice([-1.0, 1.0], table.shape))

        packed = map_arrays(rounded, brdf.tables(np.ndarray))
        return self._value(wi, wv, packed) / self._unit(wi, wv)

    def _unit(self, wi: np.ndarray, wv: np.ndarray) -> Any:
        """Return what the value is divided by in the result."""
        return 1.0

    def _value(self, wi: np.ndarray, wv: np.ndarray, tables: Any = None) -> np.ndarray:
        return self.bsdf.brdf.eval(wi, wv, tables) * wi[..., 2:]

    def _density(self, wi: np.ndarray, wv: np.ndarray) -> np.ndarray:
        above = (wi[..., 2] > 0.0) & (wv[..., 2] > 0.0)
        wi, wv = (np.where(above[..., None], w, [0.0, 0.0, 1.0]).astype(w.dtype) for w in (wi, wv))
        return np.where(above, mixture_pdf(self.bsdf.mixture_host, wv, wi), 0.0)[..., None]


class _Value(_PluginSubject):
    """``eval``: f_r times the cosine of the illumination."""

    def reference(self, wi: np.ndarray, wv: np.ndarray) -> np.ndarray:
        return self._value(wi, wv)

    def compute(self, wi: np.ndarray, wv: np.ndarray, float_type: type | None) -> np.ndarray:
        context, interaction = _interaction(wv)
        value = self.bsdf.eval(context, interaction, _vector(wi))
        return np.array(value, dtype=np.float64).T


class _Density(_PluginSubject):
    """``pdf``: the density of sampling the illumination, 1/sr."""

    @property
    def reads_angles(self) -> bool:
        return False

    @property
    def conditioning(self) -> str:
        return "the slope of the sampled lobe"

    def reference(self, wi: np.ndarray, wv: np.ndarray) -> np.ndarray:
        return self._density(wi, wv)

    def compute(self, wi: np.ndarray, wv: np.ndarray, float_type: type | None) -> np.ndarray:
        context, interaction = _interaction(wv)
        pdf = self.bsdf.pdf(context, interaction, _vector(wi))
        return np.array(pdf, dtype=np.float64)[:, None]


@dataclass(frozen=True, eq=False)
class _Weight(_PluginSubject):
    """``sample``: the weight, at the directions that were drawn.

    Attributes:
        weights: (n, 3) what ``sample`` returned, in the order of the directions.
    """

    weights: np.ndarray

    def reference(self, wi: np.ndarray, wv: np.ndarray) -> np.ndarray:
        return self._value(wi, wv) / self._unit(wi, wv)

    def _unit(self, wi: np.ndarray, wv: np.ndarray) -> Any:
        density = self._density(wi, wv)
        return np.where(density > 0.0, density, 1.0)  # the value is 0 there

    def compute(self, wi: np.ndarray, wv: np.ndarray, float_type: type | None) -> np.ndarray:
        return self.weights


def plugin_jobs(
    brdfs: Sequence[Brdf], cases: Sequence[HardCase], variant: str
) -> list[Callable[[], list[StabilityRow]]]:
    """Return one job per plugin: every BRDF in the adapter, and the named plugins.

    Args:
        brdfs: what the adapter wraps.
        variant: Mitsuba variant in single precision, already resolved.
    """
    jobs = [partial(_rows_of_adapter, brdf, cases, variant) for brdf in brdfs]
    named = [partial(_rows_of_named, *item, cases, variant) for item in _NAMED.items()]
    return [*jobs, *named]


def plugin_rows(
    name: str, bsdf: Any, cases: Sequence[HardCase], variant: str
) -> list[StabilityRow]:
    """Return the rows of a BSDF of ours: value, density and weight.

    Args:
        bsdf: a Mitsuba BSDF made by ``simrig.plugins`` in the current variant.
    """
    drawn, weights = _draw(bsdf, cases)
    parts: list[tuple[_Value | _Density | _Weight, Sequence[HardCase]]] = [
        (_Value(f"plugin {name}: value", bsdf), cases),
        (_Density(f"plugin {name}: pdf", bsdf), cases),
        (_Weight(f"plugin {name}: weight", bsdf, weights), drawn),
    ]
    return [row for subject, own in parts for row in direction_rows(subject, own, [variant])]


def _rows_of_adapter(brdf: Brdf, cases: Sequence[HardCase], variant: str) -> list[StabilityRow]:
    from simrig.plugins import make_bsdf

    backend.select(variant)
    return plugin_rows(brdf.name, make_bsdf(brdf), cases, variant)


_NAMED: dict[str, dict[str, Any]] = {
    "simrig_kurt": {"material": "brushed_aluminium"},
    "simrig_ward": {"m_x": 0.005, "m_y": 3.0},
    "simrig_slices": {},
    "simrig_table": {},
}


def _rows_of_named(
    plugin: str, properties: dict[str, Any], cases: Sequence[HardCase], variant: str
) -> list[StabilityRow]:
    """Load a plugin by its name, from a file where it wants one."""
    import mitsuba as mi

    backend.select(variant)
    with tempfile.TemporaryDirectory() as folder:
        if not properties:
            properties = {"filename": str(_material_file(plugin, Path(folder)))}
        bsdf = mi.load_dict({"type": plugin, **properties})
        return plugin_rows(plugin, bsdf, cases, variant)


def _material_file(plugin: str, folder: Path) -> Path:
    """Write the kind of material that a plugin reads."""
    from simrig.evaluation.stability.subjects import small_slices, small_table
    from simrig.files.load import save_material

    path = folder / "material.h5"
    save_material(path, small_slices() if plugin == "simrig_slices" else small_table(), None)
    return path


def _vector(w: np.ndarray) -> Any:
    import mitsuba as mi

    return mi.Vector3f(*w.astype(np.float32).T.copy())


def _interaction(wv: np.ndarray) -> tuple[Any, Any]:
    import drjit as dr
    import mitsuba as mi

    interaction = dr.zeros(mi.SurfaceInteraction3f, len(wv))
    interaction.wi = _vector(wv)
    return mi.BSDFContext(), interaction


def _draw(bsdf: Any, cases: Sequence[HardCase]) -> tuple[list[HardCase], np.ndarray]:
    """Return the directions that ``sample`` draws for the cases' views, and its weights.

    The variates hold the ends of their range as well.
    """
    import mitsuba as mi

    wv = np.concatenate([case.wv for case in cases])
    variates = np.random.default_rng(0).random((3, len(wv)), dtype=np.float32)
    largest = np.nextafter(np.float32(1.0), np.float32(0.0))
    variates[0, ::7], variates[1, ::5], variates[2, ::3] = 0.0, largest, 0.0
    variates[0, 3::7], variates[1, 2::5], variates[2, 1::3] = largest, 0.0, largest
    context, interaction = _interaction(wv)
    first, second = mi.Float(variates[0]), mi.Point2f(variates[1], variates[2])
    sample, weight = bsdf.sample(context, interaction, first, second)
    weights = np.array(weight, dtype=np.float64).T
    wi = np.array(sample.wo, dtype=np.float64).T
    lost = ~(np.array(sample.pdf) > 0.0) & np.all(weights == 0.0, axis=-1)
    wi[lost] = _BELOW
    ends = np.cumsum([len(case.wv) for case in cases])[:-1]
    parts = zip(cases, np.split(wi, ends), np.split(wv, ends), strict=True)
    return [HardCase(c.name, c.description, i, v) for c, i, v in parts], weights

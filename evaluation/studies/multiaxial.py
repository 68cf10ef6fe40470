"""The multi-axial model beside fits of Ward's and Kurt's, from the same samples (Fig. 3.8).

Materials with one, two and three modes, turned by 25°; samples at random pairs of directions up to
80°. Ward's and Kurt's models (one and two lobes, about an axis of their own) are fitted by
non-linear least squares of cube roots of all values at once, from the widths that a first search
over roughness finds. The multi-axial one is fitted mode by mode (``simrig.reconstruction.
multiaxial``). Errors are of a sphere under 16 directional lights, and of f_r at other directions.

Source: thesis section 3.2, Figure 3.8.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from simrig.brdf import Brdf, Kurt, KurtLobe, Ward, kurt_material
from simrig.brdf.multiaxial import Multiaxial
from simrig.core.arrays import Array
from simrig.core.cost import stopwatch
from simrig.core.tables import text_table
from simrig.directions.spherical import to_vector, turned
from simrig.evaluation.metrics.comparison import compare_images
from simrig.evaluation.metrics.sphere_picture import SpherePicture
from simrig.evaluation.studies.engine.base import Cell, Config, Row, one_per
from simrig.evaluation.studies.engine.rows import distinct, means, where
from simrig.reconstruction.multiaxial import fit_multiaxial
from simrig.viewing.plots import dot_style, drawn_panel

MODELS = ("multi-axial", "Ward", "Kurt, 1 lobe", "Kurt, 2 lobes")
_TURN = np.radians(25.0)
_PICTURE = ("delta_e", "rmse", "psnr", "ssim")
_KEYS = (*_PICTURE, "relative_error", "fit_seconds")

PRESETS: dict[str, dict[str, Any]] = {
    "quick": {"materials": ["yellow_satin", "weave3"], "samples": 1500, "pixels": 32},
    "full": {
        "materials": [
            "purple_satin", "yellow_satin", "brushed_aluminium", "fabric041", "fabric139",
            "fabric112", "fabric135_rescaled", "weave2", "weave3",
        ],
        "samples": 8000,
        "pixels": 96,
    },
}  # fmt: skip


@dataclass(eq=False)
class Turned(Brdf):
    """BRDFs turned about the normal and added up: ``parts`` are (BRDF, radians, share)."""

    parts: tuple[tuple[Brdf, float, float], ...]
    name: str = "turned"

    def data(self) -> Mapping[str, np.ndarray]:
        return {
            f"part_{k}_{name}": value
            for k, (brdf, _, _) in enumerate(self.parts)
            for name, value in brdf.data().items()
        }

    def prepare(self, data: Mapping[str, Array], differentiable: bool = True) -> Any:
        return tuple(
            brdf.prepare({n: data[f"part_{k}_{n}"] for n in brdf.data()}, differentiable)
            for k, (brdf, _, _) in enumerate(self.parts)
        )

    def look_up(self, wi: Array, wv: Array, tables: Any) -> Array:
        total: Array = 0.0
        for (brdf, angle, share), own in zip(self.parts, tables, strict=True):
            value = brdf.look_up(turned(wi, -angle), turned(wv, -angle), own)
            total = total + value * share
        return total


def material(name: str) -> Turned:
    """Return a material by name: of Table D.1, or threads of two or three directions."""
    if name.startswith("weave"):
        threads = [("yellow_satin", 0.0), ("purple_satin", 60.0), ("fabric041", 120.0)]
        count = int(name.removeprefix("weave"))
        parts = [(kurt_material(m), np.radians(a) + _TURN, 1.0 / count) for m, a in threads[:count]]
    else:
        parts = [(kurt_material(name), _TURN, 1.0)]
    return Turned(tuple((b, float(a), s) for b, a, s in parts), name)


cells = one_per(material="materials")


def run_cell(config: Config, cell: Cell) -> list[dict[str, Any]]:
    """Fit all models to one material, and compare each with the truth."""
    truth = material(cell["material"])
    angles, other = (_directions(config["samples"], seed) for seed in (1, 2))
    values, expected = _values(truth, angles), _values(truth, other)
    stage = SpherePicture(truth, config["pixels"])
    rows = []
    for model in MODELS:
        elapsed = stopwatch()
        fitted = _FITS[model](angles, values)
        seconds = elapsed()
        compared = compare_images(stage.image, stage.rendered(fitted), exposure=stage.exposure)
        error = float(np.mean(np.abs(_values(fitted, other) - expected)) / expected.mean())
        row = {
            "model": model,
            "modes": len(fitted.modes) if isinstance(fitted, Multiaxial) else None,
            **{key: getattr(compared, key) for key in _PICTURE},
            "relative_error": error,
            "fit_seconds": seconds,
        }
        rows.append({**row, "psnr": min(compared.psnr, 99.0)})
    return rows


def _directions(count: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    thetas = np.radians(80.0 * np.sqrt(rng.random((count, 2))))
    return np.concatenate([thetas, 2.0 * np.pi * rng.random((count, 2))], axis=1)


def _values(brdf: Brdf, angles: np.ndarray) -> np.ndarray:
    light, view = to_vector(angles[:, 0], angles[:, 2]), to_vector(angles[:, 1], angles[:, 3])
    return np.asarray(brdf.eval(light, view))


def _ward(p: np.ndarray) -> Brdf:
    m_x, m_y = np.clip(np.exp(p[1:3]), 0.005, 3.0)
    brdf = Ward(np.exp(p[3:6]).tolist(), np.exp(p[6:9]).tolist(), float(m_x), float(m_y))
    return Turned(((brdf, float(p[0]), 1.0),), "Ward")


def _kurt(p: np.ndarray) -> Brdf:
    lobes = []
    for k in range((len(p) - 4) // 7):
        q = p[4 + 7 * k : 11 + 7 * k]
        m_x, m_y = (float(m) for m in np.clip(np.exp(q[:2]), 0.005, 3.0))
        f_0, alpha = (float(v) for v in 1.0 / (1.0 + np.exp(-np.clip(q[2:4], -30.0, 30.0))))
        red, green, blue = np.exp(q[4:7]).tolist()
        lobes.append(KurtLobe((red, green, blue), f_0, m_x, m_y, alpha))
    red, green, blue = np.exp(p[1:4]).tolist()
    return Turned(((Kurt((red, green, blue), tuple(lobes)), float(p[0]), 1.0),), "Kurt")


def _start_ward(axis: float, m: tuple[float, float], values: np.ndarray) -> np.ndarray:
    low = np.log(np.pi * np.quantile(values, 0.05, axis=0) + 1e-4)
    return np.r_[axis, np.log(m), low, low]


def _start_kurt(axis: float, m: tuple[float, float], values: np.ndarray) -> np.ndarray:
    low = np.log(np.pi * np.quantile(values, 0.05, axis=0) + 1e-4)
    return np.r_[axis, low, np.log(m), 0.0, -1.0, low]


def _start_two(axis: float, m: tuple[float, float], values: np.ndarray) -> np.ndarray:
    first = _start_kurt(axis, m, values)
    return np.r_[first, first[4:6][::-1], first[6:8], first[8:11] - 1.0]


def _non_linear(
    make: Callable[[np.ndarray], Brdf],
    start: Callable[[float, tuple[float, float], np.ndarray], np.ndarray],
) -> Callable[[np.ndarray, np.ndarray], Brdf]:
    """Return a fit of all parameters at once, from the best of some widths and azimuths."""

    def fit(angles: np.ndarray, values: np.ndarray) -> Brdf:
        root = np.cbrt(values)

        def left(p: np.ndarray) -> np.ndarray:
            own = np.cbrt(_values(make(np.clip(p, -40.0, 20.0)), angles))
            return np.asarray(own - root).ravel()

        starts = [
            start(axis, m, values)
            for axis in np.radians([0.0, 45.0, 90.0, 135.0])
            for m in ((0.3, 0.1), (1.2, 0.3), (0.5, 0.5))
        ]
        few = sorted(starts, key=lambda p: float(np.sum(left(p) ** 2)))[:3]
        found = [least_squares(left, p, max_nfev=60, method="trf") for p in few]
        best = min(found, key=lambda f: float(f.cost))
        return make(np.clip(best.x, -40.0, 20.0))

    return fit


_FITS: dict[str, Callable[[np.ndarray, np.ndarray], Brdf]] = {
    "multi-axial": fit_multiaxial,
    "Ward": _non_linear(_ward, _start_ward),
    "Kurt, 1 lobe": _non_linear(_kurt, _start_kurt),
    "Kurt, 2 lobes": _non_linear(_kurt, _start_two),
}


def summarise(config: Config, rows: Sequence[Row]) -> dict[str, Any]:
    """Return each model's means, and all rows."""
    models = {model: means(where(rows, model=model), _KEYS) for model in MODELS}
    ours = models["multi-axial"]
    best = [
        min(where(rows, material=name), key=lambda row: row["delta_e"])["model"]
        for name in distinct(rows, "material")
    ]
    return {
        **ours,
        "best_of_materials": {model: best.count(model) for model in MODELS},
        "models": models,
        "rows": [dict(row) for row in rows],
    }


def table(summary: Mapping[str, Any]) -> Any:
    """Return the summary as a table for the terminal."""
    columns = ("material", "model", "modes", "ΔE", "RMSE", "PSNR", "SSIM", "f_r error", "fit / s")

    def line(name: str, model: str, modes: Any, row: Mapping[str, float]) -> tuple[str, ...]:
        numbers = (f"{row[key]:.4g}" for key in _KEYS)
        return (name, model, "" if modes is None else str(modes), *numbers)

    lines = [line(r["material"], r["model"], r["modes"], r) for r in summary["rows"]]
    below = [line("mean", model, None, row) for model, row in summary["models"].items()]
    return text_table("Models fitted to the same samples", columns, lines, below=below)


def plots(summary: Mapping[str, Any], rows: Sequence[Row], folder: Path) -> list[Path]:
    """Draw error over time of fitting."""
    path = folder / "multiaxial.png"
    with drawn_panel(path, 5.6, 4.4, xlabel="fit [s]", ylabel="ΔE of a sphere") as panel:
        for number, model in enumerate(MODELS):
            own = where(rows, model=model)
            x, y = ([max(row[key], 1e-3) for row in own] for key in ("fit_seconds", "delta_e"))
            panel.loglog(x, y, label=model, **dot_style(number))
    return [path]

"""The pictures that a report draws itself, as URIs that stand in the HTML."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib.image
import numpy as np

from simrig.brdf.protocol import Brdf
from simrig.core.cost import Cost
from simrig.core.errors import SimrigError
from simrig.evaluation.metrics.images import difference_image
from simrig.files.images import to_srgb8
from simrig.reconstruction.slices.tables import full_slices
from simrig.rigs.measurements.measurement import Measurement
from simrig.viewing.brdf.figure import brdf_figure
from simrig.viewing.brdf.picture import THETAS_DEG, brdf_exposure, brdf_picture
from simrig.viewing.plots import CostPoint, accuracy_versus_cost
from simrig.viewing.reflector import draw_sheet, material_sheet, true_profile

_AZIMUTH_STEP_DEG = 4.0  # of the BRDF pictures: tiles of 90 × 90 pixels
_ERRORS = (
    ("delta_e", "mean ΔE 1976", "Colour difference of the pictures, mean over the scenes"),
    ("log_error_percent", "log error [%]", "Logarithmic error over all pairs of directions"),
)


def data_uri(png: bytes) -> str:
    """Return a PNG as a URI that stands in the HTML itself."""
    return "data:image/png;base64," + base64.b64encode(png).decode("ascii")


def _encoded(image: np.ndarray) -> str:
    """Return an sRGB-encoded uint8 image as a URI."""
    buffer = io.BytesIO()
    matplotlib.image.imsave(buffer, image, format="png")
    return data_uri(buffer.getvalue())


def slices_picture(truth: Brdf, measurement: Measurement) -> dict[str, Any]:
    """Return the BRDF picture with the slices and samples of a measurement on it."""
    placement, slice_types = full_slices(measurement)
    return {
        "picture": data_uri(brdf_figure(truth, measurement=measurement, title="")),
        "samples": len(measurement.values),
        "plan": placement.describe(),
        "slice_types": slice_types,
    }


def directions_picture(measurement: Measurement) -> dict[str, Any]:
    """Return where light and view stood, from above, with the colours seen there."""
    picture = measurement.exhibit().picture
    assert picture is not None
    return {"picture": _encoded(picture), "samples": len(measurement.values)}


def anisotropy_sheet(truth: Brdf) -> dict[str, Any] | None:
    """Return what one picture under the reflector shows (Fig. 3.3), None of an isotropic one."""
    try:
        found = material_sheet(truth)
    except SimrigError:  # black
        return None
    modes = found.anisotropy.modes.found
    if not modes:
        return None
    return {
        "picture": data_uri(draw_sheet(found, None, [true_profile(truth)])),
        "axes": [float(np.degrees(mode.axis)) for mode in modes],
        "widths": [float(np.degrees(mode.width)) for mode in modes],
    }


def brdf_pictures(
    truth: Brdf, others: Mapping[str, Brdf], theta_max_deg: float, difference_scale: float
) -> dict[str, Any]:
    """Return the BRDF pictures of the truth and of others by their keys, with differences.

    All share the exposure of the truth's; ``white`` is the f_r that is shown as white, in 1/sr.
    """
    thetas = [degrees for degrees in THETAS_DEG if degrees <= theta_max_deg]
    reference = brdf_picture(truth, thetas, _AZIMUTH_STEP_DEG)
    exposure = brdf_exposure(reference)
    rows = {}
    for key, brdf in others.items():
        picture = brdf_picture(brdf, thetas, _AZIMUTH_STEP_DEG)
        difference = difference_image(reference, picture, difference_scale, exposure)
        rows[key] = {
            "picture": _encoded(to_srgb8(picture, exposure)),
            "difference": _encoded(difference),
        }
    return {
        "thetas": thetas,
        "white": 1.0 / exposure,
        "truth": _encoded(to_srgb8(reference, exposure)),
        "others": rows,
    }


def cost_plots(
    rows: Sequence[Mapping[str, Any]], methods: Mapping[str, str]
) -> list[dict[str, str]]:
    """Return the accuracy-versus-cost plots, one per kind of error that is not zero throughout."""
    plots = []
    for key, label, about in _ERRORS:
        points = [CostPoint(methods[row["method"]], _cost(row), row[key]) for row in rows]
        if any(point.error > 0.0 for point in points):
            plots.append({"about": about, "picture": data_uri(accuracy_versus_cost(points, label))})
    return plots


def _cost(row: Mapping[str, Any]) -> Cost:
    return Cost(
        samples=row["samples"],
        hardware_seconds=3600.0 * row["hardware_hours"],
        compute_seconds=row["compute_seconds"],
    )

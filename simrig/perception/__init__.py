"""Visibility of structure: image features, contrast sensitivity, and critical viewing distances.

Arrays in, numbers out: nothing here renders or reads files. Images are grey as a display shows
them, values in [0, 1], shape (height, width); physical scale is given as mm per pixel or as pixels
per degree of visual angle. Thesis section 3.3; docs/perception.md.
"""

from simrig.perception.features import (
    contrast,
    luminance,
    perceptual_difference,
    structural_difference,
)
from simrig.perception.fitting import DistanceFit, fit_distances
from simrig.perception.prediction import PUBLISHED_MODELS, DistanceModel, predict_distance
from simrig.perception.saliency import (
    luminance_contrast,
    saliency,
    saliency_maps,
    texture_contrast,
)
from simrig.perception.sensitivity import contrast_sensitivity, cycles_per_degree, pixels_per_degree
from simrig.perception.structure import structure_size

__all__ = [
    "PUBLISHED_MODELS",
    "DistanceFit",
    "DistanceModel",
    "contrast",
    "contrast_sensitivity",
    "cycles_per_degree",
    "fit_distances",
    "luminance",
    "luminance_contrast",
    "perceptual_difference",
    "pixels_per_degree",
    "predict_distance",
    "saliency",
    "saliency_maps",
    "structural_difference",
    "structure_size",
    "texture_contrast",
]

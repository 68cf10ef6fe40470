"""Recover one slice of a reconstruction from pictures, by gradient descent.

Of a reconstruction from slices, the axial slice that the pictures show best is replaced by its
mean and found again from pictures of a sphere under four lights. Where the pictures do not show
it, nothing can be found; the error counts what they show.

Run: python docs/examples/recover_slice.py
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np

from simrig.brdf.kurt_materials import kurt_material
from simrig.core import backend
from simrig.plans.along_slices import SlicePlan
from simrig.plans.placement import SlicePlacement
from simrig.plugins import make_bsdf
from simrig.reconstruction.slices.tables import reconstruct
from simrig.rigs.direct.gonioreflectometer import Gonioreflectometer

LIGHTS = ((2.0, -4.0, 2.0), (-3.0, -4.0, 0.0), (0.0, -4.0, -3.0), (0.5, -5.0, 0.5))


def sphere_scene(bsdf: object, light: tuple[float, float, float]) -> object:
    """Return a sphere under one point light, seen by a 48×48 camera."""
    view = mi.ScalarTransform4f().look_at([0, -5, 0], [0, 0, 0], [0, 0, 1])
    film = {"type": "hdrfilm", "width": 48, "height": 48, "rfilter": {"type": "box"}}
    return mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "direct"},
            "light": {"type": "point", "position": light, "intensity": 40.0},
            "ball": {"type": "sphere", "material": bsdf},
            "sensor": {"type": "perspective", "fov": 25.0, "to_world": view, "film": film},
        }
    )


def recover(steps: int = 60) -> tuple[float, float]:
    """Return the relative error of the slice where it is in view, before and after."""
    plan = SlicePlan(SlicePlacement.from_degrees(20.0, 45.0), 2000)
    material = kurt_material("yellow_satin")
    slices = reconstruct(Gonioreflectometer().measure(material, plan))
    bsdf = make_bsdf(slices)
    params = mi.traverse(bsdf)  # all scenes share the BSDF
    scenes = [sphere_scene(bsdf, light) for light in LIGHTS]
    targets = [mi.render(scene, spp=256) for scene in scenes]

    # for which slice does it matter most that it is not its mean?
    dr.enable_grad(params["axial"])
    params.update()
    pictures = [mi.render(scene, params, spp=16) for scene in scenes]
    dr.backward(sum(dr.mean(picture, axis=None) for picture in pictures))
    axial = slices.data()["axial"]  # (pairs, rows, azimuths, 3)
    every = axial.reshape(-1, axial[0, 0].size)
    influence = np.abs(dr.grad(params["axial"]).numpy().reshape(every.shape))
    difference = np.abs(every - every.mean(axis=1, keepdims=True))
    number = int((influence * difference).sum(axis=1).argmax())
    truth = every[number]
    seen = influence[number] > 0.05 * influence[number].max()
    place = mi.UInt32(np.arange(truth.size) + number * truth.size)

    known = mi.Float(dr.detach(params["axial"]))
    optimiser = mi.ad.Adam(lr=0.02 * float(truth.max()))
    optimiser["slice"] = mi.Float(np.full(truth.size, truth.mean()))
    for step in range(steps):
        whole = mi.Float(known)
        dr.scatter(whole, optimiser["slice"], place)
        params["axial"] = whole
        params.update()
        loss = mi.Float(0.0)
        for index, (scene, target) in enumerate(zip(scenes, targets, strict=True)):
            seed = len(scenes) * step + index + 1
            picture = mi.render(scene, params, spp=8, seed=seed)
            loss += dr.mean(dr.square((picture - target) / (target + 0.005)), axis=None)
        dr.backward(loss)  # once: it frees the graph from the slice to all pictures
        optimiser.step()
        optimiser["slice"] = dr.maximum(optimiser["slice"], 0.0)

    def error(values: np.ndarray) -> float:
        return float(np.abs(values - truth)[seen].sum() / truth[seen].sum())

    found = dr.detach(optimiser["slice"]).numpy()
    return error(np.full(truth.size, truth.mean())), error(found)


if __name__ == "__main__":
    backend.select("llvm_ad_rgb")
    print("relative error of the slice: {:.3f} before, {:.3f} after".format(*recover()))

"""Recover two parameters of a material from one picture of it, by gradient descent.

Run: python docs/examples/recover_kurt.py
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

from simrig.core import backend


def sphere_scene(material: dict) -> object:
    """Return a sphere under a point light, seen by a 48×48 camera."""
    view = mi.ScalarTransform4f().look_at([0, -5, 0], [0, 0, 0], [0, 0, 1])
    film = {"type": "hdrfilm", "width": 48, "height": 48, "rfilter": {"type": "box"}}
    return mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "direct"},
            "light": {"type": "point", "position": [2.0, -4.0, 2.0], "intensity": 40.0},
            "ball": {"type": "sphere", "material": material},
            "sensor": {"type": "perspective", "fov": 25.0, "to_world": view, "film": film},
        }
    )


def recover(steps: int = 120) -> dict[str, float]:
    """Return the recovered green k_s and the roughness m_x."""
    truth = {"type": "simrig_ward", "k_d": 0.1, "k_s": [0.1, 0.3, 0.2], "m_x": 0.25, "m_y": 0.4}
    target = mi.render(sphere_scene(truth), spp=16, seed=0)

    guess = {**truth, "k_s": [0.2, 0.2, 0.2], "m_x": 0.5}
    scene = sphere_scene(guess)
    params = mi.traverse(scene)
    wanted = [key for key, _ in params if key.endswith((".k_s", ".m_x"))]
    optimiser = mi.ad.Adam(lr=0.02)
    for key in wanted:
        optimiser[key] = params[key]
    for step in range(steps):
        params.update(optimiser)
        picture = mi.render(scene, params, spp=4, seed=step + 1)
        # relative error, so that the highlight does not outweigh everything else
        loss = dr.mean(dr.square((picture - target) / (target + 0.05)), axis=None)
        dr.backward(loss)
        optimiser.step()
        for key in wanted:  # keep what physics allows
            optimiser[key] = dr.maximum(optimiser[key], 0.005)
    params.update(optimiser)
    k_s, m_x = (params[key] for key in sorted(wanted))
    return {"k_s": float(k_s[1][0]), "m_x": float(m_x[0])}


if __name__ == "__main__":
    backend.select("llvm_ad_rgb")
    print("wanted:    {'k_s': 0.3, 'm_x': 0.25}")
    print("recovered:", recover())

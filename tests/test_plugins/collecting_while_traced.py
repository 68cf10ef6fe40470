"""Renders while Python's collector runs inside the trace; prints what is left afterwards.

Arguments: a BSDF that wraps ours or "plain", and "unguarded" to see what would happen. A process of
its own, for it may die.
"""

import gc
import sys
import weakref

import mitsuba as mi

from simrig.brdf import Ward
from simrig.core import backend

backend.select("llvm_ad_rgb")

from simrig.plugins import lifetime  # noqa: E402
from simrig.plugins.make import make_bsdf  # noqa: E402

wrapper, guarded = sys.argv[1], "unguarded" not in sys.argv
armed, collections, alive = False, [], []


class Collecting(Ward):
    """Collects garbage while it is traced, as any allocation may."""

    def look_up(self, wi, wv, tables):
        if armed:
            collections.append(gc.collect())
        return super().look_up(wi, wv, tables)


def scene():
    material = make_bsdf(Collecting())
    alive.append(weakref.ref(material))
    return mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "direct"},
            "light": {"type": "constant"},
            "sensor": {"type": "perspective", "film": {"type": "hdrfilm", "width": 4, "height": 4}},
            "ball": {
                "type": "sphere",
                "center": [0, 0, 5],
                "bsdf": material if wrapper == "plain" else {"type": wrapper, "b": material},
            },
        }
    )


if not guarded:
    gc.callbacks.remove(lifetime._collection)
gc.freeze()  # as a host application may
frozen = gc.get_freeze_count()
for number in range(2):
    gc.disable()
    for _ in range(2):
        cycle = [scene()]
        cycle.append(cycle)
    cycle = None
    whole = scene()
    gc.enable()
    armed = True
    mi.render(whole, spp=1, seed=number).numpy()
    armed = False
    assert gc.isenabled() and gc.get_freeze_count() == frozen, "the host's objects stay frozen"
    gc.collect()
assert len(collections) > 4
print("alive", sum(one() is not None for one in alive))

"""Instructions and gathers of a look-up, counted in Dr.Jit's intermediate code.

Counted in the callable that Mitsuba's integrators call; the counts do not depend on how busy the
machine is. Literals and the copying of one number to all lanes are not counted, nor is what LLVM
does later (it does not contract a product and a sum, but shares what Dr.Jit left double). The
pointer of the object's own data is one of the gathers. Kernels are those of the LLVM backend.
"""

from __future__ import annotations

import re
from typing import Any

from simrig.core.errors import SimrigError

_LANES = 4096
_CALLABLE = re.compile(r"^define [^\n]*@func_.*?^}", re.M | re.S)
_FREE = ("insertelement", "shufflevector", "extractvalue")  # literals, copies, names of results


def count(bsdf: Any, sampled: bool) -> dict[str, int]:
    """Return the ``instructions`` and ``gathers`` of one look-up of a BSDF.

    Args:
        sampled: whether a direction is drawn as well, as path tracing does.

    Raises:
        SimrigError: a variant of another backend than LLVM.
    """
    import drjit as dr
    import mitsuba

    mi: Any = mitsuba  # its stubs describe one variant
    if not (mi.variant() or "").startswith("llvm"):
        raise SimrigError("look-ups are counted in the code of LLVM: set a variant 'llvm_...'")
    random = mi.PCG32(_LANES)
    numbers = [random.next_float32() for _ in range(7)]
    si = dr.zeros(mi.SurfaceInteraction3f, _LANES)
    si.wi = mi.warp.square_to_uniform_hemisphere(mi.Point2f(*numbers[:2]))
    si.t = 1.0 + numbers[6]
    wo = mi.warp.square_to_uniform_hemisphere(mi.Point2f(*numbers[2:4]))
    which, context = mi.UInt32(0), mi.BSDFContext()
    dr.make_opaque(si, wo, numbers, which)

    def look_up(si: Any, wo: Any, first: Any, second: Any) -> Any:
        if sampled:
            return bsdf.eval_pdf_sample(context, si, wo, first, second)
        return bsdf.eval_pdf(context, si, wo)

    def nothing(si: Any, wo: Any, first: Any, second: Any) -> Any:
        value = mi.Spectrum(0.0), mi.Float(0.0)
        return (*value, dr.zeros(mi.BSDFSample3f), mi.Spectrum(0.0)) if sampled else value

    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history_clear()
        # not by a pointer: that would trace all BSDFs of the process
        second = mi.Point2f(*numbers[5:])
        dr.eval(dr.switch(which, [look_up, nothing], si, wo, numbers[4], second))
        history = dr.kernel_history([dr.KernelType.JIT])
    code = "".join(kernel["ir"].getvalue() for kernel in history)
    lines = [line for body in _CALLABLE.findall(code) for line in body.splitlines()]
    made = [line for line in lines if " = " in line]
    return {
        "instructions": sum(not any(free in line for free in _FREE) for line in made),
        "gathers": sum("gather" in line for line in made if "call " in line),
    }

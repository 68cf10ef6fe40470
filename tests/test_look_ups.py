"""Counts of instructions and gathers, and what eval_pdf and sample share."""

from __future__ import annotations

import drjit as dr
import numpy as np
import pytest

from simrig.brdf import Lambert, kurt_material
from simrig.brdf.tables.resample import resample_dense
from simrig.evaluation.instructions import count
from simrig.plugins import make_bsdf


@pytest.fixture
def table(variant_llvm):
    return make_bsdf(resample_dense(kurt_material("fabric112"), np.radians(30.0), 12))


def test_a_table_reads_sixteen_colours(table) -> None:
    one, path = count(table, False), count(table, True)
    assert one["gathers"] >= 17  # the corners, and the object's own data
    assert path["gathers"] - one["gathers"] == 16
    plain = count(make_bsdf(Lambert()), False)
    assert plain["gathers"] < 16 and plain["instructions"] < one["instructions"]


def test_a_path_makes_the_views_part_once(table, monkeypatch) -> None:
    shared = count(table, True)["instructions"]
    monkeypatch.setattr(table, "_keep", lambda si, fixed: None)
    assert shared < count(table, True)["instructions"] - 40


def _interaction(wi):
    import mitsuba as mi

    si = dr.zeros(mi.SurfaceInteraction3f, dr.width(wi))
    si.wi = wi
    return si


def test_what_is_kept_belongs_to_one_direction(table, variant_llvm) -> None:
    """Other directions, and the same one after a branch, are looked at anew."""
    import mitsuba as mi

    context = mi.BSDFContext()
    wi, other, wo = (
        mi.warp.square_to_cosine_hemisphere(mi.Point2f(u, 0.3))
        for u in (dr.linspace(mi.Float, 0.1, 0.9, 64) * s for s in (1.0, 0.7, 0.4))
    )
    dr.eval(wi, other, wo)
    numbers = mi.Float(0.5), mi.Point2f(0.3, 0.6)
    expected = table.sample(context, _interaction(other), *numbers)[1]

    def after_another(first, second):
        table.eval_pdf(context, _interaction(first), wo)
        return table.sample(context, _interaction(second), *numbers)[1]

    def in_a_branch(second):
        def inside(w):
            table.eval_pdf(context, _interaction(second), wo)
            return mi.Color3f(1.0)

        dr.if_stmt((wo,), second.x > 0.0, inside, lambda w: mi.Color3f(0.0))
        return table.sample(context, _interaction(second), *numbers)[1]

    with dr.scoped_set_flag(dr.JitFlag.SymbolicScope, True):
        found = [after_another(wi, other), after_another(other, other), in_a_branch(other)]
    for weight in found:
        assert np.allclose(weight.numpy(), expected.numpy(), rtol=1e-6)

"""The sampler of planned pictures against the plugin whose numbers it draws."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from simrig.core import backend
from simrig.rendering.multijitter import is_grid, multijitter

RUNS = 7


def _numbers(sampler: mi.Sampler) -> np.ndarray:
    """Return what a path of three dimensions draws, the last two in a symbolic loop."""
    first, second = sampler.next_1d(), sampler.next_2d()
    drawn = [first, second.x, second.y]

    def step(turn: mi.UInt32, sampler: mi.Sampler, total: mi.Float) -> tuple:
        place = sampler.next_2d(turn < 2)
        return turn + 1, sampler, total + place.x * 3.0 + place.y

    start = (mi.UInt32(0), sampler, mi.Float(0.0))
    _, _, total = dr.while_loop(start, lambda turn, *_: turn < 2, step)
    return np.array([*drawn, total])


@pytest.mark.parametrize("spp", [1, 2, 3, 4, 6, 12, 16, 42, 100, 1024])
def test_numbers_are_those_of_the_plugin(spp: int) -> None:
    backend.select()
    plugin = mi.load_dict({"type": "multijitter", "sample_count": spp})
    plugin.set_samples_per_wavefront(spp)
    plugin.seed(11, RUNS * spp)
    np.testing.assert_array_equal(_numbers(multijitter(spp, 11, RUNS * spp)), _numbers(plugin))


def test_every_number_of_samples_has_the_same_kernels() -> None:
    backend.select()
    kernels = []
    for spp in (6, 42):
        with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
            dr.kernel_history_clear()
            place = multijitter(spp, 1, RUNS * spp).next_2d()
            dr.eval(place)
            kernels.append({kernel["hash"] for kernel in dr.kernel_history() if "hash" in kernel})
    assert kernels[0] == kernels[1] != set()


def test_grids_are_numbers_that_the_plugin_does_not_round() -> None:
    backend.select()
    for spp in range(1, 80):
        plugin = mi.load_dict({"type": "multijitter", "sample_count": spp})
        assert is_grid(spp) == (plugin.sample_count() == spp)

"""Mitsuba's ``multijitter`` with one kernel for every number of samples.

The plugin writes its number of samples into the program, so that each is compiled anew: 0.4 s,
where the picture itself may take a tenth of that. Here the number is data. The random numbers are
the same to the last bit, at the same speed.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import drjit as dr
import mitsuba as mi

NAME = "multijitter"


def multijitter(spp: int, seed: int, count: int) -> Any:
    """Return a sampler of ``count`` sequences, stratified in runs of ``spp``, seeded.

    Args:
        spp: a number r · c with r = ⌊√spp⌋, see ``is_grid``.
        seed: of the random numbers.
        count: of sequences, a multiple of ``spp``.
    """
    return _sampler_of(str(mi.variant()))(spp, seed, count)


def is_grid(count: int) -> bool:
    """Return whether ``multijitter`` draws a number of samples without rounding it."""
    return count > 0 and nearest_grid(count) == count


def nearest_grid(count: float) -> int:
    """Return the largest number of at most ``count``, 1 at least, that ``multijitter`` draws."""
    whole = max(int(count), 1)
    root = math.isqrt(whole)
    return root * (whole // root)


class _Cells:
    """A number of cells, as data: what is divided by it, and permutations of their indices."""

    def __init__(self, number: int) -> None:
        self.number = dr.opaque(mi.UInt32, number)
        self.inverse = dr.opaque(mi.Float, 1.0 / number)
        self._mask = dr.opaque(mi.UInt32, (1 << (number - 1).bit_length()) - 1)
        self._reciprocal = dr.opaque(mi.UInt32, min((1 << 32) // number, (1 << 32) - 1))

    def divided(self, dividend: Any) -> tuple[Any, Any]:
        """Return quotient and remainder; processors divide vectors of whole numbers one by one."""
        quotient: Any = dr.mul_hi(dividend, self._reciprocal)  # too small by one at most
        rest = dividend - quotient * self.number
        over = rest >= self.number
        return quotient + dr.select(over, 1, 0), dr.select(over, rest - self.number, rest)

    def permuted(self, index: Any, seed: Any, active: Any) -> Any:
        """Return where a cell goes (Kensler 2013, "Correlated multi-jittered sampling")."""

        def walk(index: Any, outside: Any) -> tuple[Any, Any]:
            index = _hashed(index, seed, self._mask)
            return index, outside & (index >= self.number)

        start = (mi.UInt32(index), mi.Bool(active))
        index, _ = dr.while_loop(start, lambda _, outside: outside, walk)
        return self.divided(index + seed)[1]


def _hashed(index: Any, seed: Any, mask: Any) -> Any:
    index = (index ^ seed) * 0xE170893D
    index ^= seed >> 16
    index ^= (index & mask) >> 4
    index = (index ^ (seed >> 8)) * 0x0929EB3F
    index ^= seed >> 23
    index ^= (index & mask) >> 1
    index = index * (1 | (seed >> 27)) * 0x6935FA69
    index = (index ^ ((index & mask) >> 11)) * 0x74DCB303
    index = (index ^ ((index & mask) >> 2)) * 0x9E501CC3
    index = (index ^ ((index & mask) >> 2)) * 0xC860A3DF
    index &= mask
    return index ^ (index >> 5)


@cache
def _sampler_of(variant: str) -> Any:
    """Return the class for a variant, which is set."""

    class Multijitter(mi.Sampler):
        def __init__(self, spp: int, seed: int, count: int) -> None:
            super().__init__(mi.Properties())
            rows = math.isqrt(spp)
            self.cells, self.columns, self.rows = _Cells(spp), _Cells(spp // rows), _Cells(rows)
            whole: Any = mi.UInt64  # the stubs do not tell these types
            scrambled: Any = mi.sample_tea_32
            generator: Any = mi.PCG32
            number, start = dr.arange(mi.UInt32, count), dr.opaque(mi.UInt32, seed)
            self.random = generator(count)
            self.random.seed(*map(whole, scrambled(start, number)))
            _, self.index = self.cells.divided(number)
            of_run = number - self.index + start
            self.permutation, _ = scrambled(dr.opaque(mi.UInt32, 0), of_run)
            self.dimension = dr.opaque(mi.UInt32, 0)

        def next_1d(self, active: Any = True) -> Any:
            seed = self._next_seed()
            cell = self.cells.permuted(self.index, seed * 0x45FBE943, active)
            return (mi.Float(cell) + self.random.next_float32(active)) * self.cells.inverse

        def next_2d(self, active: Any = True) -> Any:
            seed, columns, rows = self._next_seed(), self.columns, self.rows
            cell = self.cells.permuted(self.index, seed * 0x51633E2D, active)
            y, x = columns.divided(cell)
            across = columns.permuted(x, seed * 0x68BC21EB, active)
            along = rows.permuted(y, seed * 0x02E5BE93, active)
            first, second = (self.random.next_float32(active) for _ in range(2))
            return mi.Point2f(
                (x + (along + first) * rows.inverse) * columns.inverse,
                (y + (across + second) * columns.inverse) * rows.inverse,
            )

        def _next_seed(self) -> Any:
            self.dimension += 1
            return self.permutation + self.dimension - 1

    return Multijitter

"""Floating-point operations of the kernel, counted by running its own source with lanes that count.

The kernel's source is executed as plain Python: its compiler is replaced by nothing, and its lanes by arrays of eight
numbers that add one to a counter per addition, subtraction, multiplication, division or root, and two per fused
multiply-add. Comparisons, roundings, sign changes, loads and the few operations on single lanes count nothing. So the
count follows every change of the kernel, and is exact for the model and the frequencies it is given.
"""

from __future__ import annotations

import inspect
import types
from collections.abc import Callable
from typing import Any

import numpy as np

from mcstudy.fit import kernel, lanes
from mcstudy.fit.lm import Plan, _pack
from mcstudy.fit.problem import Problem

WIDTH = lanes.WIDTH
COMPILERS = {
    "from numba import njit": "njit = lambda *a, **k: a[0] if a else (lambda f: f)",
    "from mcstudy.stance.compiled import compiled": "compiled = lambda f: f",
}
"""Lines of the kernel's source that bring in its compiler, and what leaves it plain Python."""


class Counter:
    """Operations so far, per lane."""

    flops = 0


class Counted:
    """Eight numbers that count what is done to them."""

    __slots__ = ("v",)

    def __init__(self, v: np.ndarray) -> None:
        self.v = v

    def _do(self, other: Counted, operation: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> Counted:
        Counter.flops += 1
        return Counted(operation(self.v, other.v))

    def __add__(self, other: Counted) -> Counted:
        return self._do(other, np.add)

    def __sub__(self, other: Counted) -> Counted:
        return self._do(other, np.subtract)

    def __mul__(self, other: Counted) -> Counted:
        return self._do(other, np.multiply)

    def __truediv__(self, other: Counted) -> Counted:
        return self._do(other, np.divide)


def _load(array: np.ndarray, slot: int) -> Counted:
    return Counted(array[WIDTH * slot : WIDTH * slot + WIDTH].copy())


def _store(array: np.ndarray, slot: int, value: Counted) -> None:
    array[WIDTH * slot : WIDTH * slot + WIDTH] = value.v


def _fma(x: Counted, y: Counted, z: Counted) -> Counted:
    Counter.flops += 2
    return Counted(x.v * y.v + z.v)


def _fnma(x: Counted, y: Counted, z: Counted) -> Counted:
    Counter.flops += 2
    return Counted(z.v - x.v * y.v)


def _root(x: Counted) -> Counted:
    Counter.flops += 1
    return Counted(np.sqrt(x.v))


_LANES: dict[str, Any] = {
    "load": _load,
    "store": _store,
    "splat": lambda value: Counted(np.full(WIDTH, value)),
    "fma": _fma,
    "fnma": _fnma,
    "negative": lambda x: Counted(-x.v),
    "nearest": lambda x: Counted(np.rint(x.v)),
    "root": _root,
    "where_less": lambda x, y, a, b: Counted(np.where(x.v < y.v, a.v, b.v)),
}


def counting_kernel() -> types.SimpleNamespace:
    """The kernel's functions as plain Python on counting lanes."""
    space: dict[str, Any] = {"__name__": "counting_kernel"}
    source = inspect.getsource(kernel)
    for line, plain in COMPILERS.items():
        if line not in source:
            raise RuntimeError(f"the kernel's source has changed: expected the line {line!r}")
        source = source.replace(line, plain)
    exec(compile(source, kernel.__file__, "exec"), space)
    space.update({name: value for name, value in _LANES.items() if name in space})
    return types.SimpleNamespace(**{k: v for k, v in space.items() if k in ("evaluate", "levenberg_marquardt")})


def evaluation(problem: Problem, theta: np.ndarray) -> tuple[int, np.ndarray]:
    """Operations of one evaluation of cost, gradient and Gram matrix a fit, and what the kernel computed."""
    plan = Plan.of(problem.model, problem.f)
    w, (at_x, _, at_gram, *_, at_data, at_scratch) = plan.workspace()
    slots, packed, P = w.reshape(-1, WIDTH), _pack(problem), theta.size
    slots[at_data : at_data + packed.size] = packed[:, None]
    slots[at_x : at_x + P] = theta[:, None]
    Counter.flops = 0
    counting_kernel().evaluate(w, at_x, at_gram, at_data, at_scratch, P, *plan.tables())
    return Counter.flops, slots[at_gram : at_gram + (P + 1) * (P + 2) // 2, 0]


def whole(problem: Problem, starts: np.ndarray, tolerance: float, most: int) -> tuple[int, int]:
    """Operations per lane of fits from ``starts`` (multiples of eight keep the lanes busy), and passes of the lanes."""
    plan = Plan.of(problem.model, problem.f)
    w, layout = plan.workspace()
    space, passes = counting_kernel(), [0]
    evaluate = space.levenberg_marquardt.__globals__["evaluate"]

    def counted(*arguments: Any) -> None:
        passes[0] += 1
        evaluate(*arguments)

    space.levenberg_marquardt.__globals__["evaluate"] = counted
    S, P = starts.shape
    Counter.flops = 0
    with np.errstate(all="ignore"):
        space.levenberg_marquardt(
            w,
            layout,
            _pack(problem)[None],
            starts,
            np.zeros(S, dtype=np.int64),
            problem.model.lower,
            problem.model.upper,
            tolerance,
            most,
            np.empty((S, P)),
            np.empty(S),
            np.empty(S, dtype=np.int64),
            np.empty(S, dtype=np.int64),
            *plan.tables(),
        )
    return Counter.flops, passes[0]

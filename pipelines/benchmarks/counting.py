"""Floating-point operations of the kernel, counted by running its own source with lanes that count.

The kernel's source is executed as plain Python, without its compiler. Its lanes are arrays of eight numbers that add
one to a counter per addition, subtraction, multiplication, division or root, and two per fused multiply-add.
Comparisons, roundings, sign changes, loads and the few operations on single lanes are not counted. So the count follows
every change of the kernel and is exact for the given model and frequencies.
"""

from __future__ import annotations

import inspect
import types
from collections.abc import Callable
from typing import Any

import numpy as np

from mcstudy.fitting import kernel, lanes
from mcstudy.fitting.arguments import Bounds, LaneStates, Outcomes, Queue, StopRules
from mcstudy.fitting.plans import plan, workspace
from mcstudy.fitting.problem import Problem

WIDTH = lanes.WIDTH
COMPILERS = {
    "from mcstudy.compiling.decorators import compiled, inner": (
        "compiled = lambda f=None, **_: f or compiled\ninner = lambda f=None, **_: f or inner"
    ),
    "from mcstudy.compiling.addresses import call, calling": (
        "calling = lambda *_, **__: lambda f: f\ncall = lambda f, *arguments: f(*arguments)"
    ),
}
"""Lines of the kernel's source that import its compiler, and their replacements in plain Python."""


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


def _load(array: np.ndarray | list[Counted], slot: int) -> Counted:
    return array[slot] if isinstance(array, list) else Counted(array[WIDTH * slot : WIDTH * slot + WIDTH].copy())


def _store(array: np.ndarray | list[Counted], slot: int, value: Counted) -> None:
    if isinstance(array, list):
        array[slot] = value
    else:
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
    "registers": lambda: [Counted(np.full(WIDTH, np.nan))] * lanes.REGISTERS,
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
    table, packed, P = plan(problem.model, problem.f), problem.packed, theta.size
    work = workspace(table)
    slots = work.w.reshape(-1, WIDTH)
    slots[work.data : work.data + packed.size] = packed[:, None]
    slots[work.trial : work.trial + P] = theta[:, None]
    Counter.flops = 0
    counting_kernel().evaluate(table, work)
    return Counter.flops, slots[work.gram_trial : work.gram_trial + (P + 1) * (P + 2) // 2, 0]


def whole(problem: Problem, starts: np.ndarray, tolerance: float, most: int) -> tuple[int, int]:
    """Operations per lane of fits from ``starts`` (multiples of eight keep the lanes busy), and passes of the lanes."""
    model, table = problem.model, plan(problem.model, problem.f)
    queue = Queue(problem.packed[None], np.zeros(len(starts), dtype=np.int64), starts)
    bounds, rules, out = Bounds(model.lower, model.upper), StopRules(tolerance, most), Outcomes.empty(*starts.shape)
    space, passes = counting_kernel(), [0]

    def counted(*arguments: Any) -> None:
        passes[0] += 1
        space.evaluate(*arguments)

    Counter.flops = 0
    with np.errstate(all="ignore"):
        space.levenberg_marquardt(counted, table, workspace(table), LaneStates.idle(WIDTH), queue, bounds, rules, out)
    return Counter.flops, passes[0]

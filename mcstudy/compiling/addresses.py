"""Compiled functions that call another one where it is, without a copy of its code.

numba puts a copy of every function that a compiled function calls into the code of the caller, and optimises it once
more. For a large function that several others call, this is most of what their compilation takes, and they have to
wait for its own. Here the caller gets the address of the other function as its first argument. Both are compiled apart,
at the same time if there are processes for it. Without the private parts of numba that give an address, the caller
holds a copy like any other; the numbers are the same.
"""

from __future__ import annotations

import contextlib
import threading
import types
from collections.abc import Callable, Iterator
from typing import Any

from numba import njit

from mcstudy.compiling.decorators import INTERNALS, compiled

_state = threading.local()


class _Compiled(Exception):
    """The caller is compiled, and is not to be run."""


class Caller:
    """A compiled function ``function(address, plan, work, ...)`` that does ``call(address, plan, work)``.

    It is called without the address, which is that of ``callee`` for these types. ``callee`` must raise nothing and
    return nothing: its result is not looked at. ``seconds``: see `mcstudy.compiling.decorators.compiled`.
    """

    def __init__(self, function: Callable[..., Any], callee: Any, seconds: float | None = None) -> None:
        if INTERNALS is None:
            function = _with_copy(function, callee)
        self.dispatcher, self.callee = compiled(function, seconds=seconds), callee
        self._addresses: dict[bytes, int] = {}

    def __call__(self, plan: Any, work: Any, *others: Any) -> Any:
        """The function's own result."""
        if getattr(_state, "apart", False):
            self.dispatcher.compile(tuple(map(self.dispatcher.typeof_pyval, (0, plan, work, *others))))
            raise _Compiled
        if INTERNALS is None:
            return self.dispatcher(0, plan, work, *others)
        key = INTERNALS.types_of((plan, work))
        if key not in self._addresses:
            self._addresses[key] = INTERNALS.address(self.callee, (plan, work))
        return self.dispatcher(self._addresses[key], plan, work, *others)


def _with_copy(function: Callable[..., Any], callee: Any) -> Callable[..., Any]:
    """The function with a `call` that calls ``callee``, whatever the address."""

    @njit(error_model="numpy")
    def call(_address: Any, plan: Any, work: Any) -> None:
        callee(plan, work)

    copy = types.FunctionType(function.__code__, {**function.__globals__, "call": call}, function.__name__)
    copy.__module__, copy.__qualname__ = function.__module__, function.__qualname__
    return copy


def calling(callee: Any, *, seconds: float | None = None) -> Callable[[Callable[..., Any]], Caller]:
    """Decorator: compile a function, as `compiled` does, that calls ``callee`` through `call`; see `Caller`."""

    def decorate(function: Callable[..., Any]) -> Caller:
        return Caller(function, callee, seconds)

    return decorate


@contextlib.contextmanager
def apart() -> Iterator[None]:
    """In this thread, the first `Caller` that is called is compiled, without what it calls; then the block ends."""
    _state.apart = True
    try:
        with contextlib.suppress(_Compiled):
            yield
    finally:
        _state.apart = False


call: Any = None if INTERNALS is None else INTERNALS.call
"""``call(address, plan, work)`` in compiled code: run the function at an address, whose arguments have these types."""

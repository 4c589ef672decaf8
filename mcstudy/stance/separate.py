"""Compiled functions that call another one where it is, without a copy of its code.

numba puts a copy of every function that a compiled function calls into the code of the caller, and optimises it once
more. For a large function that several others call, this is most of what their compilation takes, and they have to
wait for its own. Here the caller gets the address of the other function as its first argument. Both are compiled apart,
at the same time if there are processes for it.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterator
from typing import Any

from numba import types
from numba._dispatcher import compute_fingerprint
from numba.extending import intrinsic

from mcstudy.stance.compiled import compiled

_state = threading.local()


class _Compiled(Exception):
    """The caller is compiled, and is not to be run."""


class Caller:
    """A compiled function ``function(address, plan, work, ...)`` that does ``call(address, plan, work)``.

    It is called without the address, which is that of ``callee`` for these types. ``callee`` must raise nothing and
    return nothing: its result is not looked at.
    """

    def __init__(self, function: Callable[..., Any], callee: Any) -> None:
        self.dispatcher, self.callee = compiled(function), callee
        self._addresses: dict[bytes, int] = {}

    def __call__(self, plan: Any, work: Any, *others: Any) -> Any:
        """The function's own result."""
        if getattr(_state, "apart", False):
            self.dispatcher.compile(tuple(map(self.dispatcher.typeof_pyval, (0, plan, work, *others))))
            raise _Compiled
        key = compute_fingerprint((plan, work))  # of their types
        if key not in self._addresses:
            self._addresses[key] = self._address(plan, work)
        return self.dispatcher(self._addresses[key], plan, work, *others)

    def _address(self, *arguments: Any) -> int:
        signature = tuple(map(self.callee.typeof_pyval, arguments))
        self.callee.compile(signature)
        code = self.callee.overloads[signature]
        return int(code.library.get_pointer_to_function(code.fndesc.llvm_func_name))


def calling(callee: Any) -> Callable[[Callable[..., Any]], Caller]:
    """Decorator: compile a function, as `compiled` does, that calls ``callee`` through `call`; see `Caller`."""

    def decorate(function: Callable[..., Any]) -> Caller:
        return Caller(function, callee)

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


def _call(_context: Any, address: Any, plan: Any, work: Any) -> Any:
    """Run the compiled function that begins at an address, whose arguments have just these types."""

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        taken = signature.args[1:]
        kind = context.call_conv.get_function_type(types.none, taken)
        function = builder.inttoptr(args[0], kind.as_pointer())
        context.call_conv.call_function(builder, function, types.none, taken, args[1:])
        return context.get_dummy_value()

    return types.void(address, plan, work), code


call: Any = intrinsic(_call)
"""``call(address, plan, work)`` in compiled code; see `_call`."""

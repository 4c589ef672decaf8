"""Decorators of functions that numba compiles and keeps on disk, because to compile all kernels takes half a minute.

How much of numba's private parts is used for that is decided here, once a process: all of `numba_internals`, or, with a
numba that this package does not know, none. Then ``njit(cache=True)`` does the work and a line says so: numbers are the
same, but each process compiles for itself, one function after the other, and nothing of an installed wheel is used.
"""

from __future__ import annotations

import contextlib
import sys
import threading
from collections.abc import Callable, Iterator
from functools import cache, partial
from pathlib import Path
from types import ModuleType
from typing import Any

from numba import njit

from mcstudy.compiling import shipped

SLOW_NOTICE = "compiling {} (first run only, about {} s) ..."

PLAIN_NOTICE = "mcstudy: {}; kernels are compiled by numba's documented functions, which takes about a minute longer"

KEPT: list[Any] = []
"""Every function of `compiled`."""


class NotCompiledError(Exception):
    """A function is not compiled yet, inside `only_compiled`."""


_state = threading.local()


def _known_internals() -> ModuleType | None:
    """`numba_internals`; None, and a line says why, where they are not as they were."""
    try:
        from mcstudy.compiling import numba_internals
    except (ImportError, AttributeError) as error:  # a module or a class that is gone
        why = f"{type(error).__name__} in numba: {error}"
    else:
        why = numba_internals.fault()
        if not why:
            return numba_internals
    _say(PLAIN_NOTICE.format(why))
    return None


def _say(line: str) -> None:
    if sys.stderr is not None:
        with contextlib.suppress(OSError, ValueError):  # closed: nobody to tell
            print(line, file=sys.stderr, flush=True)


INTERNALS = _known_internals()
"""The private parts of numba, or None."""


@contextlib.contextmanager
def only_compiled() -> Iterator[None]:
    """In this thread, functions that are compiled are loaded; any other raises `NotCompiledError`.

    Without `INTERNALS` they are compiled: numba does not tell whether it has kept a function.
    """
    _state.only = True
    try:
        yield
    finally:
        _state.only = False


def folder_of(dispatcher: Any) -> Path | None:
    """Folder in which the code of a function is kept for other processes.

    None when no folder can be written to, and without `INTERNALS`.
    """
    return None if INTERNALS is None else dispatcher._cache.folder


def compiled(
    function: Callable[..., Any] | None = None, *, allocates: bool = True, seconds: float | None = None
) -> Any:
    """Compile without the interpreter's lock and with NumPy's division by zero; keep the result on disk.

    ``allocates``: False for a function that makes no arrays. It then does not count references to those it is handed,
    which costs the kernel, with its twenty arrays, some percent; and numba does not look for array expressions.
    ``seconds``: of a function that takes several seconds to compile, with what becomes part of it: whoever waits for it
    is told.
    """
    if function is None:
        return partial(compiled, allocates=allocates, seconds=seconds)
    options: dict[str, Any] = {"nogil": True, "error_model": "numpy"}
    if INTERNALS is None:
        dispatcher: Any = _plain(function, options)
    else:
        dispatcher = njit(**options, **INTERNALS.options(allocates=allocates))(function)
        dispatcher._cache = INTERNALS.Cache(function, partial(_missed, seconds))
    KEPT.append(dispatcher)
    return dispatcher


def _plain(function: Callable[..., Any], options: dict[str, Any]) -> Any:
    try:
        return njit(cache=True, **options)(function)
    except RuntimeError:  # no folder can be written to, or the function is in no file
        return njit(**options)(function)


def inner(function: Callable[..., Any] | None = None, *, forceinline: bool = False) -> Any:
    """Decorator of a function that only compiled functions call, and that makes no arrays.

    No code of its own is made or kept, only what becomes part of its callers. Python cannot call it.
    """
    if function is None:
        return partial(inner, forceinline=forceinline)
    more = {} if INTERNALS is None else INTERNALS.inner_options(forceinline=forceinline)
    return njit(error_model="numpy", **more)(function)


def ship(folder: Path) -> None:
    """Write what this process has compiled to a new folder, as `mcstudy.compiling.shipped` reads it.

    Raises ``RuntimeError`` without `INTERNALS`: what numba keeps by itself does not say what it was made from.
    """
    if INTERNALS is None:
        raise RuntimeError("no compiled code can be shipped with a numba whose private parts are not known")
    shipped.write(folder, [code for function in KEPT for code in INTERNALS.codes(function)])


def _missed(seconds: float | None, function: Callable[..., Any]) -> None:
    """A function is about to be compiled."""
    if getattr(_state, "only", False):
        raise NotCompiledError(function.__name__)
    if seconds is not None:
        _notice(function.__name__, seconds)


@cache
def _notice(name: str, seconds: float) -> None:
    """Say once that compiling a function takes its time."""
    _say(SLOW_NOTICE.format(name, f"{seconds:g}"))

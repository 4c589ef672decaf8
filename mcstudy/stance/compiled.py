"""The decorator of every compiled function that is kept on disk: a change of any source it is compiled from is seen.

Numba keeps compiled code beside the source, since compiling the kernels takes most of a minute. What it keeps is
stamped with the file that holds the function alone, so that a function compiled from two files (`inline` or called)
would go on running the old code of the other one. Here the stamp is over the file and every file of the same package
that it imports, and those import in turn.
"""

from __future__ import annotations

import hashlib
import re
import sys
from collections.abc import Callable, Iterator
from functools import cache, partial
from importlib.util import find_spec
from typing import Any

from numba import njit
from numba.core.caching import CompileResultCacheImpl, FunctionCache

FROM = re.compile(r"^[ \t]*from[ \t]+([\w.]+)[ \t]+import[ \t]+(\([^)]*\)|[^\n]*)", re.MULTILINE)
IMPORT = re.compile(r"^[ \t]*import[ \t]+([^\n]*)", re.MULTILINE)


def compiled(function: Callable[..., Any]) -> Any:
    """Compile without the interpreter's lock and with NumPy's division by zero; keep the result on disk."""
    dispatcher: Any = njit(nogil=True, error_model="numpy")(function)
    dispatcher._cache = _Cache(function)  # what `cache=True` does, with another stamp
    return dispatcher


def sources(module: str) -> dict[str, str]:
    """Source of a module and of every module of the same package that it imports, directly or not, by name."""
    found: dict[str, str] = {}
    waiting = [module]
    while waiting:
        name = waiting.pop()
        if name not in found:
            found[name], imported = _source(name)
            waiting += [other for other in imported if other.partition(".")[0] == module.partition(".")[0]]
    return found


@cache
def stamp(module: str) -> str:
    """SHA-256 of `sources`."""
    digest = hashlib.sha256()
    for name, text in sorted(sources(module).items()):
        digest.update(f"{name}\0{len(text)}\0{text}".encode())
    return digest.hexdigest()


@cache
def _source(name: str) -> tuple[str, tuple[str, ...]]:
    """Source of a module, and the modules it imports (absolute imports, as everywhere in this package)."""
    spec = find_spec(name)
    loader: Any = spec and spec.loader
    text = loader.get_source(name) if hasattr(loader, "get_source") else None
    if text is None:
        raise ImportError(f"{name}: expected a module with Python source, which compiled code is compared with")
    return str(text), tuple(_imports(str(text)))


def _imports(text: str) -> Iterator[str]:
    # A syntax tree of every kernel would take a fifth of a second at each start.
    for module, names in FROM.findall(text):
        yield module
        yield from (f"{module}.{name}" for name in re.findall(r"\w+", names) if _is_module(module, name))
    for names in IMPORT.findall(text):
        yield from re.findall(r"[\w.]+", names)


def _is_module(package: str, name: str) -> bool:
    """Whether what is imported from a package that is loaded is one of its modules."""
    loaded = sys.modules.get(package)
    return hasattr(loaded, "__path__") and find_spec(f"{package}.{name}") is not None


class _Impl(CompileResultCacheImpl):
    """Numba's, wherever it keeps the code of a function, with the stamp of this module."""

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        locator: Any = self.locator
        locator.get_source_stamp = partial(stamp, function.__module__)


class _Cache(FunctionCache):
    _impl_class = _Impl

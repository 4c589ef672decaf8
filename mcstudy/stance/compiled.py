"""The decorator of every compiled function that is kept on disk: a change of any source it is compiled from is seen.

Numba keeps compiled code beside the source, since compiling the kernels takes most of a minute. What it keeps is
stamped with the file that holds the function alone, so that a function compiled from two files (`inline` or called)
would go on running the old code of the other one. Here the stamp is over the file and every file of the same package
that it imports, and those import in turn.
"""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Callable, Iterator
from functools import cache, partial
from importlib.util import find_spec
from typing import Any

from numba import njit
from numba.core.caching import CompileResultCacheImpl, FunctionCache


def compiled(function: Callable[..., Any]) -> Any:
    """Compile without the interpreter's lock and with NumPy's division by zero; keep the result on disk."""
    dispatcher: Any = njit(nogil=True, error_model="numpy")(function)
    dispatcher._cache = _Cache(function)  # what `cache=True` does, with another stamp
    return dispatcher


@cache
def sources(module: str) -> dict[str, str]:
    """Source of a module and of every module of the same package that it imports, directly or not, by name."""
    found: dict[str, str] = {}
    waiting = [module]
    while waiting:
        name = waiting.pop()
        if name not in found:
            found[name] = _source(name)
            waiting += _imports(found[name], module.partition(".")[0])
    return found


def stamp(module: str) -> str:
    """SHA-256 of `sources`."""
    digest = hashlib.sha256()
    for name, text in sorted(sources(module).items()):
        digest.update(f"{name}\0{len(text)}\0{text}".encode())
    return digest.hexdigest()


def _source(name: str) -> str:
    spec = find_spec(name)
    loader: Any = spec and spec.loader
    text = loader.get_source(name) if hasattr(loader, "get_source") else None
    if text is None:
        raise ImportError(f"{name}: expected a module with Python source, which compiled code is compared with")
    return str(text)


def _imports(text: str, package: str) -> Iterator[str]:
    """Modules of ``package`` that a source imports (absolute imports)."""
    for node in ast.walk(ast.parse(text)):
        names: list[str] = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names = [node.module]
            if node.module.partition(".")[0] == package:
                inside = (f"{node.module}.{alias.name}" for alias in node.names)
                names += [name for name in inside if _is_module(name)]
        yield from (name for name in names if name.partition(".")[0] == package)


def _is_module(name: str) -> bool:
    parent = find_spec(name.rpartition(".")[0])
    return parent is not None and parent.submodule_search_locations is not None and find_spec(name) is not None


class _Impl(CompileResultCacheImpl):
    """Numba's, wherever it keeps the code of a function, with the stamp of this module."""

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        locator: Any = self.locator
        locator.get_source_stamp = partial(stamp, function.__module__)


class _Cache(FunctionCache):
    _impl_class = _Impl

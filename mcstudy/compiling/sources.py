"""Sources that a compiled function is made from: of its module, and of all it imports from its package and this one."""

from __future__ import annotations

import hashlib
import re
import sys
from collections.abc import Iterator
from functools import cache
from importlib.util import find_spec
from typing import Any

FROM = re.compile(r"^[ \t]*from[ \t]+([\w.]+)[ \t]+import[ \t]+(\([^)]*\)|[^\n]*)", re.MULTILINE)
IMPORT = re.compile(r"^[ \t]*import[ \t]+([^\n]*)", re.MULTILINE)


def sources(module: str) -> dict[str, str]:
    """Source of a module and of all that it imports, directly or not, from its package and from this one, by name."""
    packages = {__name__.partition(".")[0], module.partition(".")[0]}
    texts: dict[str, str] = {}
    waiting = [module]
    while waiting:
        name = waiting.pop()
        if name not in texts:
            texts[name], imported = _source(name)
            waiting += [other for other in imported if other.partition(".")[0] in packages]
    return texts


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

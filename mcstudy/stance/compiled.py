"""Decorator for compiled functions that are cached on disk; it detects changes in all source files they depend on.

Numba caches compiled code next to the source, because compiling all kernels takes half a minute. By default it
checks only the file that contains the function, so a function that calls or inlines code of another file would continue
to use the old code of that file. Here the check covers the file and, recursively, all files of the same package that it
imports.

An installed wheel brings compiled code with it (`mcstudy.stance.shipped`). It is looked for after numba's own, which
was made for this very processor.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import pickle
import re
import sys
import threading
from collections.abc import Callable, Iterator
from functools import cache, partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm
from numba import njit
from numba.core.caching import CompileResultCacheImpl, FunctionCache, InTreeCacheLocator
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.runtime import rtsys
from numba.core.serialize import dumps

from mcstudy.stance import shipped

FROM = re.compile(r"^[ \t]*from[ \t]+([\w.]+)[ \t]+import[ \t]+(\([^)]*\)|[^\n]*)", re.MULTILINE)
IMPORT = re.compile(r"^[ \t]*import[ \t]+([^\n]*)", re.MULTILINE)

SLOW = {
    "rightmost": 4,
    "evaluate": 8,
    "evaluate_cost": 3,
    "interior_point": 14,
    "penalised_fits": 6,
    "outermost": 9,
}
"""Functions that take several seconds to compile, with what becomes part of them: whoever waits for one is told."""

SAVING = "mcstudy-saving.lock"
"""File whose lock is held while code is written to its folder."""

NOTICE = "compiling {}, once for this installation: about {} s ..."

KEPT: list[Any] = []
"""Every function of `compiled`."""


class NotCompiledError(Exception):
    """A function is not compiled yet, inside `only_compiled`."""


_state = threading.local()


@contextlib.contextmanager
def only_compiled() -> Iterator[None]:
    """In this thread, functions that are compiled are loaded; any other raises `NotCompiledError`."""
    _state.only = True
    try:
        yield
    finally:
        _state.only = False


def folder_of(dispatcher: Any) -> Path | None:
    """Folder in which the code of a function is kept for other processes; None when none can be written to."""
    locator = dispatcher._cache.impl.locator
    if isinstance(locator, _ReadOnly):
        return None
    locator.ensure_cache_path()
    return Path(locator.get_cache_path())


def compiled(function: Callable[..., Any], *, allocates: bool = True) -> Any:
    """Compile without the interpreter's lock and with NumPy's division by zero; keep the result on disk.

    ``allocates``: False for a function that makes no arrays. It then does not count references to those it is handed,
    which costs the kernel, with its twenty arrays, some percent; and numba does not look for array expressions.
    """
    options: dict[str, Any] = {"nogil": True, "error_model": "numpy", "_nrt": allocates, "no_rewrites": not allocates}
    dispatcher: Any = njit(**options)(function)
    dispatcher._cache = _Cache(function)  # as with `cache=True`, but with another check
    KEPT.append(dispatcher)
    return dispatcher


def inner(function: Callable[..., Any] | None = None, *, forceinline: bool = False) -> Any:
    """Decorator of a function that only compiled functions call, and that makes no arrays.

    No code of its own is made or kept, only what becomes part of its callers. Python cannot call it.
    """
    if function is None:
        return partial(inner, forceinline=forceinline)
    options: dict[str, Any] = {
        "error_model": "numpy",
        "forceinline": forceinline,
        "no_cpython_wrapper": True,
        "no_cfunc_wrapper": True,
        "no_rewrites": True,
        "pipeline_class": _Inner,
        "_nrt": False,
    }
    return njit(**options)(function)


class _InnerCodegen:
    """In the place of numba's, which would look for what is not in memory."""

    def set_env(self, name: str, environment: Any) -> None:
        """The callers have their own."""


class _InnerLibrary(JITCodeLibrary):
    """LLVM's code of a function and of those it calls, neither optimised as a whole nor turned into machine code."""

    def finalize(self) -> None:
        """As numba's, as far as others need it to link to."""
        own: Any = self
        own._raise_if_finalized()
        for library in dict.fromkeys(own._linking_libraries):
            own._reload_init.update(library._reload_init)
            own._final_module.link_in(library._get_module_for_linking(), preserve=True)
        own._final_module.verify()
        own._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """None: it is not in memory."""
        del name
        own: Any = self
        own._ensure_finalized()
        return 0

    @property
    def codegen(self) -> Any:
        """See `_InnerCodegen`."""
        return _InnerCodegen()


class _Inner(Compiler):
    """Numba's compiler with another library."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.state.library = _InnerLibrary(self.state.targetctx.codegen(), "inner")


def ship(folder: Path, package: str = "mcstudy") -> None:
    """Write what this process has compiled of a package to a new folder, as `mcstudy.stance.shipped` reads it."""
    codes, codegen = [], None
    for dispatcher in KEPT:
        if dispatcher.py_func.__module__.partition(".")[0] != package:
            continue
        for arguments, result in dispatcher.overloads.items():
            codegen, own = result.codegen, dispatcher._cache
            codes.append((own.function, own.stamp, arguments, dumps(own.impl.reduce(result))))
    shipped.write(folder, codes, codegen)


@cache
def _notice(name: str) -> None:
    """Say once that compiling a function takes its time."""
    if sys.stderr is not None:
        with contextlib.suppress(OSError, ValueError):  # closed: nobody to tell
            print(NOTICE.format(name, SLOW[name]), file=sys.stderr, flush=True)


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


class _ReadOnly(InTreeCacheLocator):
    """Beside the source, where no folder can be written to: nothing is kept, and that is no reason to stop."""

    @classmethod
    def from_function(cls, py_func: Callable[..., Any], py_file: str) -> _ReadOnly | None:
        """For any function of a file."""
        return cls(py_func, py_file) if Path(py_file).exists() else None


class _Impl(CompileResultCacheImpl):
    """Numba's, wherever it keeps the code of a function, with the stamp of this module."""

    _locator_classes = [*CompileResultCacheImpl._locator_classes, _ReadOnly]  # noqa: RUF012  # as in numba

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        locator: Any = self.locator
        locator.get_source_stamp = partial(stamp, function.__module__)

    def rebuild(self, target_context: Any, payload: Any) -> Any:
        """What `reduce` has kept, ready to be called.

        Numba also reads LLVM's code of the function and of all it calls, from which others that call it are compiled.
        That takes half of the time, and a process that compiles nothing has no use for it: it is read when it is asked
        for.
        """
        (name, kind, (machine_code, code)), described, *rest = payload
        names = (described.llvm_func_name, described.llvm_cpython_wrapper_name, described.llvm_cfunc_wrapper_name)
        empty = "\n".join(f'define void @"{own}"() {{ ret void }}' for own in dict.fromkeys(names))
        stub = llvm.parse_assembly(empty).as_bitcode()
        result = super().rebuild(target_context, ((name, kind, (machine_code, stub)), described, *rest))
        result.library._get_module_for_linking = cache(lambda: llvm.parse_bitcode(code))
        return result


class _Cache(FunctionCache):
    """Numba's, then what came with the package, then a line that says why the caller waits."""

    _impl_class = _Impl

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        own: Any = self
        self.function, self.impl, self.stamp = function, own._impl, stamp(function.__module__)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Code for a signature; None: to be compiled."""
        rtsys.initialize(target_context)  # what compiled code calls to allocate
        own: Any = self
        # As in numba, but for `target_context.refresh`: to read code that is there takes no knowledge of all that can
        # be compiled, which takes a third of a second to load (and SciPy's linear algebra). Compiling does it anyway.
        found = None
        with own._guard_against_spurious_io_errors():
            found = _of(sig, own._load_overload(sig, target_context))
        if found is None:
            found = self._shipped(sig, target_context)
        if found is None and getattr(_state, "only", False):
            raise NotCompiledError(self.function.__name__)
        if found is None and self.function.__name__ in SLOW:
            _notice(self.function.__name__)
        return found

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep what was compiled, where there is room for it.

        Numba reads the index of a function, chooses a free file name, and writes both. Two processes that compile one
        function for different types would choose the same name, and the index would lead one to the other's code.
        """
        with contextlib.suppress(OSError):
            locator: Any = self.impl.locator
            locator.ensure_cache_path()
            with (Path(locator.get_cache_path()) / SAVING).open("wb") as file:
                with contextlib.suppress(OSError):  # some shared file systems have no locks
                    fcntl.flock(file, fcntl.LOCK_EX)
                super().save_overload(sig, data)

    def _shipped(self, sig: Any, target_context: Any) -> Any:
        # Whatever is wrong with a file that came with the package, compiling is the remedy: there is nothing to tell.
        with contextlib.suppress(Exception):
            code = shipped.find(self.function, self.stamp, sig, target_context.codegen())
            if code is not None:
                return _of(sig, self.impl.rebuild(target_context, pickle.loads(code)))
        return None


def _of(sig: Any, result: Any) -> Any:
    """Code that was found for a signature; None when it is for another one: an index and its files do not agree."""
    return result if result is not None and tuple(result.signature.args) == tuple(sig) else None

"""The private parts of numba that this package uses, all of them; `fault` says whether they are as they were.

What they give beyond numba's own keeping on disk: an edit of any source that a function is compiled from is seen
(numba looks at the file of the function only; since 0.68 by its content); processes that compile one function for
different types keep both; a damaged file of compiled code is compiled again; code that came with an installed package
is used; a process that compiles nothing does not load what only compiling needs; functions that are only part of others
cost no code of their own; large functions are called at their address instead of being copied into each caller.

NUMBA_CACHE_LOCATOR_CLASSES, which numba documents since 0.62 for its cache's places and stamps, would hold for every
library of the process, and must be set before numba is imported: that is the user's, so it is left alone.
"""

from __future__ import annotations

import contextlib
import fcntl
import inspect
import os
import pickle
from collections.abc import Callable, Iterator
from functools import cache, partial
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm
import numba
from numba import _dispatcher, types
from numba.core import caching, codegen, compiler, config
from numba.core.runtime import rtsys
from numba.core.serialize import dumps
from numba.extending import intrinsic

from mcstudy.compiling import shipped
from mcstudy.compiling.sources import stamp

KNOWN = ((0, 63), (0, 68))
"""First and last version of numba whose private parts are known (`tests/compiling` passes with both)."""

PLAIN = "MCSTUDY_PLAIN_NUMBA"
"""Variable that has numba used as it is documented, without any of its private parts."""

SAVING = "mcstudy-saving.lock"
"""File whose lock is held while code is written to its folder."""

USED: tuple[tuple[Any, str, tuple[str, ...] | None], ...] = (
    (caching.CompileResultCacheImpl, "_locator_classes", None),
    (caching.CompileResultCacheImpl, "__init__", ("self", "py_func")),
    (caching.CompileResultCacheImpl, "locator", None),
    (caching.CompileResultCacheImpl, "reduce", ("self", "cres")),
    (caching.CompileResultCacheImpl, "rebuild", ("self", "target_context", "payload")),
    (caching.FunctionCache, "_impl_class", None),
    (caching.FunctionCache, "_load_overload", ("self", "sig", "target_context")),
    (caching.FunctionCache, "load_overload", ("self", "sig", "target_context")),
    (caching.FunctionCache, "save_overload", ("self", "sig", "data")),
    (caching.FunctionCache, "flush", ("self",)),
    (caching.InTreeCacheLocator, "ensure_cache_path", ("self",)),
    (caching.InTreeCacheLocator, "get_cache_path", ("self",)),
    (caching.InTreeCacheLocator, "get_source_stamp", ("self",)),
    (caching.InTreeCacheLocator, "from_function", ("py_func", "py_file")),
    (codegen.JITCodeLibrary, "finalize", ("self",)),
    (codegen.JITCodeLibrary, "_raise_if_finalized", ("self",)),
    (codegen.JITCodeLibrary, "_ensure_finalized", ("self",)),
    (codegen.JITCodeLibrary, "_get_module_for_linking", ("self",)),
    (codegen.JITCodeLibrary, "get_pointer_to_function", ("self", "name")),
    (codegen.JITCPUCodegen, "magic_tuple", ("self",)),
    (compiler.Compiler, "__init__", None),
    (_dispatcher, "compute_fingerprint", None),
    (rtsys, "initialize", ("ctx",)),
)
"""Owner, attribute, and the arguments it must have."""


def fault() -> str:
    """Why numba's private parts cannot be used, in words; empty when they can."""
    if os.environ.get(PLAIN, "") not in ("", "0"):
        return f"{PLAIN} is set"
    first, last = KNOWN
    version = tuple(int(part) for part in numba.__version__.split(".")[:2])
    if not first <= version <= last:
        known = " to ".join(f"{major}.{minor}" for major, minor in KNOWN)
        return f"numba {numba.__version__} is not one of those known ({known})"
    for owner, name, arguments in USED:
        if not hasattr(owner, name):
            return f"numba {numba.__version__} has no {owner.__name__}.{name}"
        if arguments is not None and tuple(inspect.signature(getattr(owner, name)).parameters) != arguments:
            return f"{owner.__name__}.{name} of numba {numba.__version__} takes other arguments"
    return ""


def options(*, allocates: bool) -> dict[str, Any]:
    """Options of `numba.njit` for a function that makes no arrays: references to what it is handed are not counted."""
    return {"_nrt": allocates, "no_rewrites": not allocates}


def inner_options(*, forceinline: bool) -> dict[str, Any]:
    """Options of `numba.njit` for a function that only compiled functions call, and that makes no arrays."""
    return {
        "forceinline": forceinline,
        "no_cpython_wrapper": True,
        "no_cfunc_wrapper": True,
        "no_rewrites": True,
        "pipeline_class": _Inner,
        "_nrt": False,
    }


class _InnerCodegen:
    """In the place of numba's, which would look for what is not in memory."""

    def set_env(self, name: str, environment: Any) -> None:
        """The callers have their own."""


class _InnerLibrary(codegen.JITCodeLibrary):
    """LLVM's code of a function and of those it calls, neither optimised as a whole nor turned into machine code."""

    def finalize(self) -> None:
        """As numba's, as far as others need it to link to."""
        library: Any = self
        library._raise_if_finalized()
        for called in dict.fromkeys(library._linking_libraries):
            library._reload_init.update(called._reload_init)
            library._final_module.link_in(called._get_module_for_linking(), preserve=True)
        library._final_module.verify()
        library._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """None: it is not in memory."""
        del name
        library: Any = self
        library._ensure_finalized()
        return 0

    @property
    def codegen(self) -> Any:
        """See `_InnerCodegen`."""
        return _InnerCodegen()


class _Inner(compiler.Compiler):
    """Numba's compiler with another library."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.state.library = _InnerLibrary(self.state.targetctx.codegen(), "inner")


class _ReadOnly(caching.InTreeCacheLocator):
    """Beside the source, where no folder can be written to: nothing is kept, and that is no reason to stop."""

    @classmethod
    def from_function(cls, py_func: Callable[..., Any], py_file: str) -> _ReadOnly | None:
        """For any function of a file."""
        return cls(py_func, py_file) if Path(py_file).exists() else None


class _Impl(caching.CompileResultCacheImpl):
    """Numba's, wherever it keeps the code of a function, with the stamp of this package's sources."""

    _locator_classes = [*caching.CompileResultCacheImpl._locator_classes, _ReadOnly]  # noqa: RUF012  # as in numba

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
        empty = "\n".join(f'define void @"{symbol}"() {{ ret void }}' for symbol in dict.fromkeys(names))
        stub = llvm.parse_assembly(empty).as_bitcode()
        result = super().rebuild(target_context, ((name, kind, (machine_code, stub)), described, *rest))
        result.library._get_module_for_linking = cache(lambda: llvm.parse_bitcode(code))
        return result


class Cache(caching.FunctionCache):
    """Code of a function on disk: numba's own, then what came with the package.

    ``missed(function)`` is called when there is none, before it is compiled; it may raise.
    """

    _impl_class = _Impl

    def __init__(self, function: Callable[..., Any], missed: Callable[[Callable[..., Any]], None]) -> None:
        super().__init__(function)
        numbas: Any = self
        self.function, self.impl, self.stamp = function, numbas._impl, stamp(function.__module__)
        self._missed = missed

    @property
    def folder(self) -> Path | None:
        """Where the code is kept for other processes; None when no folder can be written to."""
        locator: Any = self.impl.locator
        if isinstance(locator, _ReadOnly):
            return None
        locator.ensure_cache_path()
        return Path(locator.get_cache_path())

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Code for a signature; None: to be compiled."""
        rtsys.initialize(target_context)  # what compiled code calls to allocate
        # As in numba, but for `target_context.refresh`: to read code that is there takes no knowledge of all that can
        # be compiled, which takes a third of a second to load (and SciPy's linear algebra). Compiling does it anyway.
        for read in (self._kept, self._shipped):
            if (result := read(sig, target_context)) is not None:
                return result
        self._missed(self.function)
        return None

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

    def _kept(self, sig: Any, target_context: Any) -> Any:
        """From numba's folder; damaged files, whose remedy is to compile again, are forgotten."""
        numbas: Any = self
        try:
            return _of(sig, numbas._load_overload(sig, target_context))
        except Exception:  # of a pickle that ends early or holds something else, anything
            with contextlib.suppress(OSError):
                self.flush()
        return None

    def _shipped(self, sig: Any, target_context: Any) -> Any:
        # Whatever is wrong with a file that came with the package, compiling is the remedy: there is nothing to tell.
        with contextlib.suppress(Exception):
            code = shipped.find(self.function, self.stamp, sig, machine(target_context.codegen()))
            if code is not None:
                return _of(sig, self.impl.rebuild(target_context, pickle.loads(code)))
        return None


def _of(sig: Any, result: Any) -> Any:
    """Code that was found for a signature; None when it is for another one: an index and its files do not agree."""
    return result if result is not None and tuple(result.signature.args) == tuple(sig) else None


def machine(target: Any) -> shipped.Machine:
    """What numba compiles for: of this processor, or what numba's variables allow."""
    triple, _, features = target.magic_tuple()
    return shipped.Machine(
        triple=triple,
        features=frozenset(name[1:] for name in features.split(",") if name.startswith("+")),
        # Intel's elementary functions round otherwise than the C library's.
        svml=bool(getattr(config, "USING_SVML", False)),
    )


def codes(dispatcher: Any) -> Iterator[tuple[shipped.Code, shipped.Machine]]:
    """Everything that this process has compiled of a function."""
    kept = dispatcher._cache
    for arguments, result in dispatcher.overloads.items():
        code = shipped.Code(kept.function, kept.stamp, tuple(arguments), dumps(kept.impl.reduce(result)))
        yield code, machine(result.codegen)


def types_of(arguments: tuple[Any, ...]) -> bytes:
    """Stands for the types of arguments."""
    return bytes(_dispatcher.compute_fingerprint(arguments))


def address(dispatcher: Any, arguments: tuple[Any, ...]) -> int:
    """Where a function's code for the types of these arguments begins; compiles it if need be."""
    signature = tuple(map(dispatcher.typeof_pyval, arguments))
    dispatcher.compile(signature)
    code = dispatcher.overloads[signature]
    return int(code.library.get_pointer_to_function(code.fndesc.llvm_func_name))


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

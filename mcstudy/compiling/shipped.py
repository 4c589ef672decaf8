"""Compiled code that came with an installed package: used when all it depends on is the same, ignored otherwise.

A wheel holds folders of compiled functions (``hatch_build.py`` makes them), one for each kind of processor, with an
index in each. The one that asks most of the processor is looked at first. A function is found there by its name, the
types of its arguments, the stamp of its sources and its bytecode. The index also says what the code was made with: the
versions of Python, numba and llvmlite must be equal, and the CPU must be able to do all that the code uses. Nothing is
ever written into the folders, and no file of them is read as code whose SHA-256 is not the one in the index.
"""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

FOLDER = Path(__file__).parents[1] / "_compiled"
INDEX = "index.json"


class Machine(NamedTuple):
    """What code is compiled for.

    Attributes
    ----------
    triple: LLVM's name of processor and system. features: instruction sets that code may use.
    svml: whether elementary functions are Intel's, which round otherwise than the C library's.
    """

    triple: str
    features: frozenset[str]
    svml: bool


class Code(NamedTuple):
    """A compiled function: the function, the stamp of its sources, the types of its arguments, its code."""

    function: Callable[..., Any]
    stamp: str
    arguments: tuple[Any, ...]
    content: bytes


def made_with(machine: Machine) -> dict[str, Any]:
    """What compiled code must have been made with to be used by this process, the processor left out."""
    import llvmlite
    import numba

    return {
        "python": f"{sys.implementation.cache_tag}{sys.abiflags}",
        "numba": numba.__version__,
        "llvmlite": llvmlite.__version__,
        "svml": machine.svml,
    }


def name_of(function: Any) -> str:
    """Of a function, as the index has it."""
    return f"{function.__module__}.{function.__qualname__}"


def signature_of(arguments: Iterable[Any]) -> str:
    """The types of a call, as the index has them."""
    return ", ".join(map(str, arguments))


def bytecode_of(function: Any) -> str:
    """SHA-256 of a function's bytecode."""
    return hashlib.sha256(function.__code__.co_code).hexdigest()


def find(function: Any, stamp: str, arguments: Iterable[Any], machine: Machine) -> bytes | None:
    """The code of ``function`` for these types, as `write` has written it; None if there is none.

    ``stamp``: of the sources that the function is compiled from. May raise anything when the index is damaged.
    """
    if function.__closure__ is not None:
        return None
    made = made_with(machine)
    wanted = {"signature": signature_of(arguments), "stamp": stamp, "bytecode": bytecode_of(function)}
    for folder, index in _indices(FOLDER):
        if index["made_with"] != made or index["triple"] != machine.triple:
            continue
        if not machine.features.issuperset(index["features"]):
            continue
        for entry in index["functions"].get(name_of(function), ()):
            if wanted.items() <= entry.items():
                code = (folder / Path(entry["file"]).name).read_bytes()
                if hashlib.sha256(code).hexdigest() == entry["sha256"]:
                    return code
    return None


def write(folder: Path, codes: Iterable[tuple[Code, Machine]]) -> None:
    """Make the folder, from everything that was compiled (for one machine)."""
    folder.mkdir(parents=True)
    compiled = list(codes)
    functions: dict[str, list[dict[str, str]]] = {}
    for code, _ in compiled:
        entries = functions.setdefault(name_of(code.function), [])
        file = f"{name_of(code.function)}-{len(entries) + 1}.code"
        (folder / file).write_bytes(code.content)
        entries.append(
            {
                "signature": signature_of(code.arguments),
                "stamp": code.stamp,
                "bytecode": bytecode_of(code.function),
                "file": file,
                "sha256": hashlib.sha256(code.content).hexdigest(),
            }
        )
    machine = compiled[0][1]
    index = {
        "made_with": made_with(machine),
        "triple": machine.triple,
        "features": sorted(machine.features),
        "functions": functions,
    }
    (folder / INDEX).write_text(json.dumps(index, indent=1, sort_keys=True) + "\n", encoding="utf-8")


@cache
def _indices(folder: Path) -> list[tuple[Path, dict[str, Any]]]:
    """Every folder of code with its index, the one for the most able processor first."""
    indices = [(file.parent, json.loads(file.read_text(encoding="utf-8"))) for file in folder.glob(f"*/{INDEX}")]
    return sorted(indices, key=lambda index: (-len(index[1]["features"]), index[0].name))

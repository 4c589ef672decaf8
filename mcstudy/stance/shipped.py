"""Compiled code that came with an installed package: used when all it depends on is the same, ignored otherwise.

A wheel holds folders of compiled functions beside its modules (``hatch_build.py`` makes them), one for each kind of
processor, with an index in each. The one that asks most of the processor is looked at first. A function is found there
by its name, the types of its arguments, the stamp of its sources and its bytecode. The index also says what the code
was made with: the versions of Python, numba and llvmlite must be equal, and the CPU must be able to do all that the
code uses. Nothing is ever written into the folders, and no file of them is read as code whose SHA-256 is not the one in
the index.
"""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

FOLDER = "_compiled"
INDEX = "index.json"


def made_with() -> dict[str, Any]:
    """What compiled code must have been made with to be used by this process, the processor left out."""
    import llvmlite
    import numba
    from numba.core import config

    return {
        "python": f"{sys.implementation.cache_tag}{sys.abiflags}",
        "numba": numba.__version__,
        "llvmlite": llvmlite.__version__,
        # Intel's elementary functions round otherwise than the C library's.
        "svml": bool(getattr(config, "USING_SVML", False)),
    }


def features(codegen: Any) -> set[str]:
    """What code may use that ``codegen`` makes: of this processor, or what numba's variables allow."""
    return {name[1:] for name in codegen.magic_tuple()[2].split(",") if name.startswith("+")}


def name_of(function: Any) -> str:
    """Of a function, as the index has it."""
    return f"{function.__module__}.{function.__qualname__}"


def signature_of(arguments: Iterable[Any]) -> str:
    """The types of a call, as the index has them."""
    return ", ".join(map(str, arguments))


def bytecode_of(function: Any) -> str:
    """SHA-256 of a function's bytecode."""
    return hashlib.sha256(function.__code__.co_code).hexdigest()


def find(function: Any, stamp: str, arguments: Iterable[Any], codegen: Any) -> bytes | None:
    """The code of ``function`` for these types, as `mcstudy.stance.compiled.ship` wrote it; None if there is none.

    ``stamp``: of the sources that the function is compiled from. May raise anything when the index is damaged.
    """
    package = sys.modules[function.__module__.partition(".")[0]]
    if function.__closure__ is not None or not package.__file__:
        return None
    made, triple, can = made_with(), codegen.magic_tuple()[0], features(codegen)
    wanted = {"signature": signature_of(arguments), "stamp": stamp, "bytecode": bytecode_of(function)}
    for folder, index in _indices(Path(package.__file__).parent / FOLDER):
        if index["made_with"] != made or index["triple"] != triple or not can.issuperset(index["features"]):
            continue
        for entry in index["functions"].get(name_of(function), ()):
            if wanted.items() <= entry.items():
                code = (folder / Path(entry["file"]).name).read_bytes()
                if hashlib.sha256(code).hexdigest() == entry["sha256"]:
                    return code
    return None


def write(folder: Path, codes: Iterable[tuple[Any, str, Iterable[Any], bytes]], codegen: Any) -> None:
    """Make the folder: function, stamp, types and code of each."""
    folder.mkdir(parents=True)
    functions: dict[str, list[dict[str, str]]] = {}
    for function, stamp, arguments, code in codes:
        entries = functions.setdefault(name_of(function), [])
        file = f"{name_of(function)}-{len(entries) + 1}.code"
        (folder / file).write_bytes(code)
        entries.append(
            {
                "signature": signature_of(arguments),
                "stamp": stamp,
                "bytecode": bytecode_of(function),
                "file": file,
                "sha256": hashlib.sha256(code).hexdigest(),
            }
        )
    index = {
        "made_with": made_with(),
        "triple": codegen.magic_tuple()[0],
        "features": sorted(features(codegen)),
        "functions": functions,
    }
    (folder / INDEX).write_text(json.dumps(index, indent=1, sort_keys=True) + "\n", encoding="utf-8")


@cache
def _indices(folder: Path) -> list[tuple[Path, dict[str, Any]]]:
    """Every folder of code with its index, the one for the most able processor first."""
    found = [(file.parent, json.loads(file.read_text(encoding="utf-8"))) for file in folder.glob(f"*/{INDEX}")]
    return sorted(found, key=lambda one: (-len(one[1]["features"]), one[0].name))

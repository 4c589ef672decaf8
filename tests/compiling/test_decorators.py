"""Compiled code on disk is that of the sources there are, also where a function is compiled from several files."""

from __future__ import annotations

import ast
import fcntl
import importlib
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from numba.core.caching import FunctionCache

import mcstudy
from mcstudy.compiling.decorators import compiled
from mcstudy.compiling.numba_internals import SAVING
from mcstudy.compiling.sources import sources

PACKAGE = Path(mcstudy.__file__).parent

CALLED = """
from numba import njit

@njit
def inner(x):
    return {value} * x
"""

OTHER = """
from mcstudy.compiling.decorators import compiled
from two_files import called

inner = called.inner

@compiled
def kept(x):
    return inner(x)
"""

CALLER = """
import two_files.other as other
from mcstudy.compiling.decorators import compiled

kept = other.kept

@compiled
def outer(x):
    return 1 + kept(x)
"""

RUN = "from two_files.caller import outer; print(outer(1), sum(outer.stats.cache_hits.values()))"


def test_an_edit_of_a_file_whose_functions_are_called_is_seen(tmp_path: Path) -> None:
    folder = tmp_path / "two_files"
    folder.mkdir()
    (folder / "__init__.py").touch()
    (folder / "other.py").write_text(OTHER)
    (folder / "caller.py").write_text(CALLER)
    # Of one length, and with bytecode that is never kept: only the text differs.
    variables = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"} | {
        "PYTHONPATH": str(tmp_path),
        "PYTHONDONTWRITEBYTECODE": "1",
    }

    def run(value: int) -> list[str]:
        (folder / "called.py").write_text(CALLED.format(value=value))
        done = subprocess.run([sys.executable, "-c", RUN], capture_output=True, text=True, check=True, env=variables)
        return done.stdout.split()

    assert run(2) == ["3", "0"]
    assert run(2) == ["3", "1"]  # kept
    assert run(3) == ["4", "0"]  # and not kept too long


COUNTED = """
import llvmlite.binding as llvm
from two_files.{module} import {function} as called

read, parse = [], llvm.parse_bitcode
llvm.parse_bitcode = lambda code: read.append(len(code)) or parse(code)
print(called(1), sum(called.stats.cache_hits.values()), len(read))
"""


def test_what_is_loaded_is_read_for_the_compiler_only_when_something_is_compiled_from_it(tmp_path: Path) -> None:
    folder = tmp_path / "two_files"
    folder.mkdir()
    (folder / "__init__.py").touch()
    (folder / "called.py").write_text(CALLED.format(value=2))
    (folder / "other.py").write_text(OTHER)
    (folder / "caller.py").write_text(CALLER)
    variables = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"} | {"PYTHONPATH": str(tmp_path)}

    def run(module: str, function: str) -> list[str]:
        command = [sys.executable, "-c", COUNTED.format(module=module, function=function)]
        return subprocess.run(command, capture_output=True, text=True, check=True, env=variables).stdout.split()

    run("other", "kept")  # compiles it
    # Whatever is loaded, numba reads what stands for its code; the code itself is a second reading.
    assert run("other", "kept") == ["2", "1", "1"]
    assert run("caller", "outer") == ["3", "0", "2"]  # compiled from what is loaded
    assert run("caller", "outer") == ["3", "1", "1"]


TWICE = """
from mcstudy.compiling.decorators import compiled

@compiled
def twice(x):
    return 2 * x

def called():
    return [twice(3), twice(0.5)]
"""


def test_code_of_other_types_under_a_functions_name_is_not_run(tmp_path: Path) -> None:
    """As two processes would leave it that keep a function for different types at once."""
    (tmp_path / "two_types.py").write_text(TWICE)
    variables = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"} | {"PYTHONPATH": str(tmp_path)}

    def called() -> str:
        command = [sys.executable, "-c", "from two_types import called; print(called())"]
        return subprocess.run(command, capture_output=True, text=True, check=True, env=variables).stdout.strip()

    assert called() == "[6, 1.0]"
    first, second = (tmp_path / "__pycache__").glob("*.nbc")
    texts = first.read_bytes(), second.read_bytes()
    first.write_bytes(texts[1])
    second.write_bytes(texts[0])
    assert called() == "[6, 1.0]"


def test_one_process_at_a_time_keeps_code_in_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "two_types.py"
    file.write_text(TWICE)
    monkeypatch.syspath_prepend(tmp_path)
    module, saved = importlib.import_module("two_types"), list[str]()

    def save(_: object, sig: object, __: object) -> None:
        with (tmp_path / "__pycache__" / SAVING).open("wb") as lock, pytest.raises(BlockingIOError):
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        saved.append(str(sig))

    monkeypatch.setattr(FunctionCache, "save_overload", save)
    assert module.called() == [6, 1.0]
    assert saved == ["(int64,)", "(float64,)"]


def test_the_kernels_that_call_other_files_are_stamped_with_all_they_import() -> None:
    assert {"mcstudy.fitting.kernel", "mcstudy.fitting.lanes"} <= set(sources("mcstudy.fitting.penalised_kernel"))
    assert "mcstudy.fitting.penalised_kernel" not in sources("mcstudy.fitting.kernel")  # which calls nothing of it
    for name in ("mcstudy.fitting.penalised_kernel", "mcstudy.fitting.kernel", "mcstudy.fitting.equation_error"):
        for module, text in sources(name).items():
            tree = ast.walk(ast.parse(text))
            imported = {n.module for n in tree if isinstance(n, ast.ImportFrom) and n.module}
            assert {i for i in imported if i.startswith("mcstudy.")} <= set(sources(name)), module


def test_nothing_is_kept_on_disk_by_any_other_decorator() -> None:
    keeps = re.compile(r"\bcache=True\b")
    code = {file: re.sub(r"#.*", "", file.read_text()) for file in PACKAGE.rglob("*.py")}
    assert [file.name for file, text in code.items() if keeps.search(text)] == ["decorators.py"]
    named = {file for file, text in code.items() if re.search(r"^@compiled\b", text, re.MULTILINE)}
    assert {file.stem for file in named} >= {"kernel", "penalised_kernel", "equation_error", "stability_kernel"}
    for file in named:
        name = ".".join(file.relative_to(PACKAGE.parent).with_suffix("").parts)
        assert importlib.import_module(name).__dict__["compiled"] is compiled


READ = """
import sys
from mcstudy.fitting import warm

warm.compile_here()
print("numba.np.linalg" in sys.modules)
"""


def test_reading_compiled_code_loads_nothing_that_only_compiling_needs() -> None:
    """Numba's linear algebra imports SciPy's; no kernel calls it, and no entry of the cache may name its modules."""
    said = []
    for _ in range(2):  # what is not compiled yet is compiled by the first
        done = subprocess.run([sys.executable, "-c", READ], capture_output=True, text=True, check=True)
        said.append(done.stdout.split()[-1])
    assert said[1] == "False"

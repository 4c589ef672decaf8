"""Compiled code that came with a package is used when all it depends on is the same, and else is not there."""

from __future__ import annotations

import importlib
import json
import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from numba import config

from mcstudy.compiling import decorators, numba_internals, shipped
from mcstudy.compiling.decorators import KEPT, NotCompiledError, compiled, only_compiled, ship

SOURCE = """
def inner(x):
    return 3 * x

def evaluate(x):
    return 2 * x
"""

Call = Callable[..., tuple[Any, int]]


@pytest.fixture
def call(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Call]:
    """Calls `tiny_shipped.kernel.inner` as a new process with an empty home would: its result, and what it compiled."""
    package, before = tmp_path / "tiny_shipped", KEPT[:]
    del KEPT[:]
    monkeypatch.setattr(shipped, "FOLDER", package / "_compiled")
    package.mkdir()
    (package / "__init__.py").touch()
    (package / "kernel.py").write_text(SOURCE)
    monkeypatch.syspath_prepend(str(tmp_path))
    homes = iter(range(1000))

    def once(x: Any, name: str = "inner", seconds: float | None = None) -> tuple[Any, int]:
        monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path / f"home{next(homes)}"))
        shipped._indices.cache_clear()
        dispatcher = compiled(getattr(importlib.import_module("tiny_shipped.kernel"), name), seconds=seconds)
        return dispatcher(x), sum(dispatcher.stats.cache_misses.values())

    yield once
    KEPT[:] = before
    for name in [n for n in sys.modules if n.startswith("tiny_shipped")]:
        del sys.modules[name]


@pytest.fixture
def folder(call: Call) -> Path:
    """The compiled code of the package, in it."""
    assert call(7) == (21, 1)
    folder = shipped.FOLDER / "this"
    ship(folder)
    return folder


def test_what_came_with_the_package_is_not_compiled_again_nor_changed(folder: Path, call: Call) -> None:
    held = {file: file.read_bytes() for file in folder.iterdir()}
    assert len(held) == 2
    assert call(7) == (21, 0)
    assert call(7.0) == (21.0, 1)  # other types
    assert {file: file.read_bytes() for file in folder.iterdir()} == held


@pytest.mark.parametrize("version", ["python", "numba", "llvmlite", "svml"])
def test_it_is_compiled_when_a_version_differs(folder: Path, call: Call, version: str) -> None:
    _edit(folder, lambda index: index["made_with"].update({version: "another"}))
    assert call(7) == (21, 1)


@pytest.mark.parametrize("field", ["stamp", "bytecode", "signature", "sha256"])
def test_it_is_compiled_when_the_source_or_the_code_differs(folder: Path, call: Call, field: str) -> None:
    def change(index: Any) -> None:
        ((entry,),) = index["functions"].values()
        entry[field] = "another"

    _edit(folder, change)
    assert call(7) == (21, 1)


def test_it_is_compiled_on_another_processor_or_system(folder: Path, call: Call) -> None:
    _edit(folder, lambda index: index["features"].append("instructions-of-the-future"))
    assert call(7) == (21, 1)
    _edit(folder, lambda index: index["features"].pop())
    assert call(7) == (21, 0)
    _edit(folder, lambda index: index.update(triple="riscv64-unknown-linux-gnu"))
    assert call(7) == (21, 1)


def test_the_code_for_the_most_able_processor_is_taken_that_this_one_is(folder: Path, call: Call) -> None:
    less = folder.with_name("less")
    shutil.copytree(folder, less)
    _edit(less, lambda index: index.update(features=[]))
    (damaged,) = less.glob("*.code")
    damaged.write_bytes(b"")
    assert call(7) == (21, 0)
    _edit(folder, lambda index: index["features"].append("instructions-of-the-future"))
    assert call(7) == (21, 1)
    shutil.copy(next(folder.glob("*.code")), damaged)
    assert call(7) == (21, 0)


def test_damage_is_silent_and_only_code_with_the_noted_checksum_is_read(
    folder: Path, call: Call, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (code,) = folder.glob("*.code")
    sound, index = code.read_bytes(), (folder / shipped.INDEX).read_bytes()
    with monkeypatch.context() as patched:
        patched.setattr(numba_internals.pickle, "loads", _never)
        code.write_bytes(sound[:-1] + bytes([sound[-1] ^ 1]))
        assert call(7) == (21, 1)
        code.write_bytes(b"")
        assert call(7) == (21, 1)
        code.unlink()
        assert call(7) == (21, 1)
    code.write_bytes(sound)
    for damaged in (b"", index[: len(index) // 2], b"[]", b"{}", b"\xff"):
        (folder / shipped.INDEX).write_bytes(damaged)
        assert call(7) == (21, 1)
    (folder / shipped.INDEX).write_bytes(index)
    assert call(7) == (21, 0)
    assert capsys.readouterr() == ("", "")


def test_where_nothing_can_be_kept_everything_is_compiled(call: Call, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(numba_internals._Impl, "_locator_classes", [numba_internals._ReadOnly])
    monkeypatch.setattr(numba_internals._ReadOnly, "ensure_cache_path", _full)
    assert call(7) == (21, 1)


def test_who_waits_for_a_slow_function_is_told_once(call: Call, capsys: pytest.CaptureFixture[str]) -> None:
    decorators._notice.cache_clear()
    for x in (7, 7.0):
        call(x, "inner")
    assert capsys.readouterr().err == ""
    for x in (7, 7.0):
        assert call(x, "evaluate", 8.0)[1] == 1
    assert capsys.readouterr().err == "compiling evaluate (first run only, about 8 s) ...\n"


def test_what_is_not_compiled_can_be_asked_for_without_compiling_it(call: Call) -> None:
    with only_compiled(), pytest.raises(NotCompiledError):
        call(7)
    assert call(7) == (21, 1)


def _edit(folder: Path, change: Callable[[Any], Any]) -> None:
    file = folder / shipped.INDEX
    index = json.loads(file.read_text())
    change(index)
    file.write_text(json.dumps(index))


def _never(code: bytes) -> Any:
    raise AssertionError(f"{len(code)} bytes were read as code")


def _full(_: object) -> None:
    raise OSError("no space left")

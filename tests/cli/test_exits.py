"""Exit codes: one list, which the help and the page of the commands repeat, and which every verb returns from."""

from __future__ import annotations

import ast
import errno
import re
import subprocess
import sys
from pathlib import Path

import pytest

import mcstudy.cli
import mcstudy.cli.verbs.run
import mcstudy.cli.verbs.show
from mcstudy.exits import Exit, exit_codes

ROOT = Path(__file__).parents[2]


def test_help_of_the_command_and_of_a_verb_lists_them_all() -> None:
    for words in ([], ["run"]):
        call = [sys.executable, "-m", "mcstudy", *words, "--help"]
        done = subprocess.run(call, capture_output=True, text=True, check=True)
        assert f"exit codes: {exit_codes()}" in " ".join(done.stdout.split())


def test_the_page_of_the_commands_says_the_same() -> None:
    (line,) = re.findall(
        r"^Exit codes: .*?\.$", (ROOT / "pipelines/docs/command_line.md").read_text(), re.DOTALL | re.MULTILINE
    )
    assert " ".join(line.split()) == f"Exit codes: {exit_codes()}."


def test_no_verb_returns_a_bare_number() -> None:
    for file in Path(mcstudy.cli.__file__).parent.rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.Return) and isinstance(node.value, ast.Constant):
                assert not isinstance(node.value.value, int) or isinstance(node.value.value, bool), (file, node.lineno)


def test_the_documented_codes_keep_their_meaning() -> None:
    documented = {"DONE": 0, "BAD_INPUT": 2, "INTERRUPTED": 3, "FITS_FAILED": 4, "MISSED": 5, "UNREACHABLE": 8}
    assert {name: Exit[name].value for name in documented} == documented
    assert len(Exit) == len({code.sentence for code in Exit}) == 9


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (MemoryError("Unable to allocate 3 GiB"), "expected more memory"),
        (RuntimeError("can't start new thread"), "expected to start another thread"),
        (OSError("cannot load liba.so"), "expected more memory"),
        (OSError(errno.ENOSPC, "No space left on device"), "output: cannot be written: No space left on device"),
    ],
)
def test_a_limit_of_the_machine_is_one_line(
    error: Exception, said: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    if str(error).startswith("cannot load"):
        error.__cause__ = ImportError("liba.so: failed to map segment from shared object")

    def fails(*_: object) -> None:
        raise error

    for verb, code in (("show", Exit.BAD_INPUT), ("run", Exit.INTERRUPTED)):
        monkeypatch.setattr(f"mcstudy.cli.verbs.{verb}.main", fails)
        assert mcstudy.cli.main([verb, "x", "-o", "y"] if verb == "run" else [verb, "x"]) == code
        (line,) = capsys.readouterr().err.splitlines()
        assert line.startswith(f"mcstudy: {said}")
        assert line.endswith("mcstudy run x -o y") == (verb == "run")


def test_a_fault_of_the_program_is_not_taken_for_a_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object) -> None:
        raise OSError("cannot load liba.so")

    monkeypatch.setattr("mcstudy.cli.verbs.show.main", fails)
    with pytest.raises(OSError, match="cannot load"):
        mcstudy.cli.main(["show", "x"])

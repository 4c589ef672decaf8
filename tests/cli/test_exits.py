"""Exit codes: one list, which the help and the README repeat, and which every verb returns from."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from pathlib import Path

import mcstudy.cli
from mcstudy.exits import Exit, exit_codes

ROOT = Path(__file__).parents[2]


def test_help_of_the_command_and_of_a_verb_lists_them_all() -> None:
    for words in ([], ["run"]):
        call = [sys.executable, "-m", "mcstudy", *words, "--help"]
        done = subprocess.run(call, capture_output=True, text=True, check=True)
        assert f"exit codes: {exit_codes()}" in " ".join(done.stdout.split())


def test_the_readme_says_the_same() -> None:
    (line,) = re.findall(r"^Exit codes: .*?\.$", (ROOT / "README.md").read_text(), re.DOTALL | re.MULTILINE)
    assert " ".join(line.split()) == f"Exit codes: {exit_codes()}."


def test_no_verb_returns_a_bare_number() -> None:
    for file in Path(mcstudy.cli.__file__).parent.glob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.Return) and isinstance(node.value, ast.Constant):
                assert not isinstance(node.value.value, int) or isinstance(node.value.value, bool), (file, node.lineno)


def test_the_documented_codes_keep_their_meaning() -> None:
    documented = {"DONE": 0, "BAD_INPUT": 2, "INTERRUPTED": 3, "FITS_FAILED": 4, "MISSED": 5, "UNREACHABLE": 8}
    assert {name: Exit[name].value for name in documented} == documented
    assert len(Exit) == len({code.sentence for code in Exit}) == 9

"""The code blocks of the documentation, and how they are run."""

from __future__ import annotations

import os
import re
import runpy
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from mcstudy.cli import main

ROOT = Path(__file__).parents[2]
PLACES = (
    "README.md",
    "results_schema/README.md",
    "pipelines/**/*.md",
    "mcstudy/**/*.md",
    "CONTRIBUTING.md",
)
PAGES = sorted({page.relative_to(ROOT).as_posix() for place in PLACES for page in ROOT.glob(place)})
FENCE = re.compile(r"^```(\w*|\{[\w-]+\})\n(.*?)^```$", re.MULTILINE | re.DOTALL)
NOT_RUN = re.compile(r"^<!-- Not run by the tests: \S.{5,}\. -->$")
PROSE = ("", "text")
"""Blocks that hold no code: what a program printed, a formula."""
SECONDS = 900
"""After which a block counts as hung, on the slowest machine."""
SHELL = re.compile(r"[|&;<>()$`*?~{}\[\]]")
"""Characters that mean something to a shell."""
SCRIPT = re.compile(r"[$&]|<<|^(umask|export|cd|for|while|if) ", re.MULTILINE)
"""What makes the lines of a block depend on each other."""
MOST = {"realizations": 4, "starts": 4}
GROUPS = 4
"""Of a study, the first ones."""
WHOLE = ("paper_solver.toml",)
"""Studies whose every group an example asks for."""


@dataclass(frozen=True)
class Block:
    """A fenced block: its language, its text, the line it starts on, and whether it is run."""

    language: str
    text: str
    line: int
    run: bool


def blocks(page: str) -> list[Block]:
    text = (ROOT / page).read_text(encoding="utf-8")
    found = []
    for match in FENCE.finditer(text):
        above = text[: match.start()].rstrip("\n").rsplit("\n", 1)[-1]
        line = text.count("\n", 0, match.start()) + 1
        found.append(Block(match.group(1), match.group(2), line, run=not NOT_RUN.match(above)))
    return found


def cut_down(study: Path) -> None:
    """The same study with fewer groups, realizations and starts."""
    head, *tables = re.split(r"^(?=\[)", study.read_text(encoding="utf-8"), flags=re.M)
    groups = list(dict.fromkeys(re.findall(r"^\[group\.(\w+)", "".join(tables), re.M)))
    left_out = () if study.name in WHOLE else tuple(f"[group.{name}{end}" for name in groups[GROUPS:] for end in "].")
    text = head + "".join(table for table in tables if not table.startswith(left_out))
    for key, most in MOST.items():
        text = re.sub(rf"^{key} = (\d+)", lambda m, k=key, n=most: f"{k} = {min(int(m[1]), n)}", text, flags=re.M)
    study.write_text(text, encoding="utf-8")


def pieces(block: Block) -> list[str]:
    """What of a ``bash`` block runs one after the other: its lines, or all of it where one line needs another."""
    lines = block.text.replace("\\\n", " ").splitlines()
    return [block.text] if SCRIPT.search(block.text) else [line for line in lines if line.strip()]


def run_piece(text: str, block: Block, where: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In this process where it is but ``mcstudy ...`` or ``python FILE ...``, else in a shell."""
    words = shlex.split(text, comments=True)
    if words[:1] in (["mcstudy"], ["python"]) and not SHELL.search(" ".join(words)) and "\n" not in text.strip():
        run_here(words, monkeypatch)
    else:
        run_bash(text, block, where)


def run_here(words: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """As the command line does it."""
    code: object = None
    if words[0] == "mcstudy":
        code = main(words[1:])
    else:
        with monkeypatch.context() as patch:
            patch.setattr(sys, "argv", words[1:])
            patch.syspath_prepend(str(Path(words[1]).parent.resolve()))
            try:
                runpy.run_path(words[1], run_name="__main__")
            except SystemExit as end:
                code = end.code
    assert not code, words


def run_bash(text: str, block: Block, where: Path) -> None:
    environment = {**os.environ, "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}
    done = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", text],
        cwd=where,
        env=environment,
        capture_output=True,
        text=True,
        timeout=SECONDS,
        check=False,
    )
    assert done.returncode == 0, f"line {block.line}: status {done.returncode}\n{done.stdout}\n{done.stderr}"


def run_page(
    page: str, where: Path, monkeypatch: pytest.MonkeyPatch, wanted: Callable[[Block, str], bool] = lambda *_: True
) -> None:
    """Run the blocks of a page in a folder, in order.

    ``wanted``: of a block and what of it runs at once (`pieces`), whether it does.
    """
    shutil.copytree(ROOT / "pipelines", where / "pipelines", ignore=shutil.ignore_patterns("__pycache__"))
    for study in (where / "pipelines").glob("*.toml"):
        cut_down(study)
    monkeypatch.chdir(where)
    namespace: dict[str, Any] = {"__name__": "__main__"}
    for block in blocks(page):
        if not block.run or block.language in PROSE or block.language.startswith("{"):  # {toctree}: for the site
            continue
        if block.language == "bash":
            for text in pieces(block):
                if wanted(block, text):
                    run_piece(text, block, where, monkeypatch)
        elif block.language == "python":
            if wanted(block, block.text):
                exec(compile("\n" * block.line + block.text, str(ROOT / page), "exec"), namespace)
            if plt := sys.modules.get("matplotlib.pyplot"):
                plt.close("all")  # as a notebook does after a cell; more than 20 open ones give a warning
        else:
            name = re.match(r"# (\w+\.toml)\n", block.text)
            assert block.language == "toml", f"line {block.line}: a block of no known language {block.language!r}"
            assert name, f"line {block.line}: expected '# NAME.toml' on the first line"
            (where / name.group(1)).write_text(block.text, encoding="utf-8")

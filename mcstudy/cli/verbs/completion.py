"""``mcstudy completion``: a script that makes the shell complete verbs, options and files."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mcstudy.exits import Exit

if TYPE_CHECKING:
    from mcstudy.cli.parser import Parser

SHELLS = ("bash", "zsh", "fish")

SHIPPED = {
    "mcstudy run study": "study",
    "mcstudy plan study": "study",
    "mcstudy solve study": "study",
    "mcstudy design file": "design",
}
"""Verb and argument that takes a file or the name of a shipped one, and the kind of the latter."""


def add_arguments(parser: Parser) -> None:
    """Arguments of the verb."""
    parser.add_argument("shell", choices=SHELLS, help='bash: add eval "$(mcstudy completion bash)" to ~/.bashrc')


def main(args: argparse.Namespace) -> Exit:
    """Print the script; returns the exit code."""
    from mcstudy.cli.parser import main_parser
    from mcstudy.cli.verbs import added
    from mcstudy.errors import InputError

    try:
        import shtab
    except ModuleNotFoundError:
        raise InputError("completion: shtab is not installed; pip install shtab") from None
    parser = main_parser(whole=True)
    words = _words()
    files = SHIPPED | {
        f"mcstudy {name} {argument}": kind
        for name, command in added().items()
        for argument, kind in getattr(command, "SHIPPED", {}).items()
    }
    for name, action in parser.whole():
        if name in files:
            action.complete = _names_or_files(files[name])  # type: ignore[attr-defined]
        elif action.type is Path:
            action.complete = shtab.FILE  # type: ignore[attr-defined]
        elif name in words:
            action.choices = words[name]
    print(shtab.complete(parser, shell=args.shell))
    return Exit.DONE


def _words() -> dict[str, list[str]]:
    """Verb and argument that takes one of some words, which its parser leaves to the verb."""
    from mcstudy.cli.verbs import verbs
    from mcstudy.cli.verbs.help import TOPICS
    from mcstudy.effect_library.library import LIBRARY
    from mcstudy.study.catalogue import shipped

    return {
        "mcstudy studies name": sorted(shipped()),
        "mcstudy help topic": sorted({*TOPICS, *verbs()}),
        "mcstudy simulate effect": sorted(LIBRARY),
    }


def _names_or_files(kind: str) -> dict[str, Any]:
    """What shtab needs to complete files and the names of shipped ones."""
    from mcstudy.study.catalogue import shipped

    names, function = " ".join(shipped(kind)), f"_mcstudy_{kind}_files"
    return {
        "bash": function,
        "zsh": function,
        "fish": f"(string split ' ' '{names}'; __fish_complete_path (commandline -ct))",
        "preamble": {
            "bash": f'{function}() {{\n  compgen -W "{names}" -- "$1"\n  compgen -f -- "$1"\n}}\n',
            "zsh": f"{function}() {{\n  _alternative 'names:shipped {kind}:({names})' 'files:file:_files'\n}}\n",
        },
    }

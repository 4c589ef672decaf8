"""``mcstudy completion``: a script that makes the shell complete verbs, options and files."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

from mcstudy.exits import Exit

SHELLS = ("bash", "zsh", "fish")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument("shell", choices=SHELLS, help='bash: add eval "$(mcstudy completion bash)" to ~/.bashrc')


def main(args: argparse.Namespace) -> Exit:
    """Print the script; returns the exit code."""
    from mcstudy.cli import whole_parser
    from mcstudy.errors import InputError

    try:
        import shtab
    except ModuleNotFoundError:
        raise InputError("completion: shtab is not installed; install mcstudy with the extra [completion]") from None
    parser = whole_parser()
    for action in _actions(parser):
        if action.type is Path:
            action.complete = shtab.FILE  # type: ignore[attr-defined]
    print(shtab.complete(parser, shell=args.shell))
    return Exit.DONE


def _actions(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    """All arguments of a parser and of its sub-verbs."""
    for action in parser._actions:  # what shtab itself reads
        yield action
        if isinstance(action, argparse._SubParsersAction):
            for sub in action.choices.values():
                yield from _actions(sub)

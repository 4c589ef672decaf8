"""Parsers that know their arguments and the verbs below them: help, completion and the shown command follow from them.

`argparse` documents no way to ask a parser for its arguments, so they are noted when they are declared.
"""

from __future__ import annotations

import argparse
from collections.abc import Collection, Iterator
from typing import Any

from mcstudy.cli.verbs import VERBS, listed, module, verbs
from mcstudy.exits import exit_codes


class Group:
    """A group of arguments of a `Parser`; made by its methods."""

    def __init__(self, group: Any, arguments: list[argparse.Action]) -> None:
        self._group, self._arguments = group, arguments

    def add_argument(self, *names: str, **options: Any) -> argparse.Action:
        """As `argparse.ArgumentParser.add_argument`."""
        action: argparse.Action = self._group.add_argument(*names, **options)
        self._arguments.append(action)
        return action

    def add_alternatives(self) -> Group:
        """Arguments of which one may be given."""
        return Group(self._group.add_mutually_exclusive_group(), self._arguments)


class Parser(argparse.ArgumentParser):
    """Parser of a verb, or of a verb below it.

    Attributes
    ----------
    arguments
        Everything that was declared, in its order.
    verbs
        The argument that names a verb below it; None where there is none.
    """

    def __init__(self, **options: Any) -> None:
        self.arguments: list[argparse.Action] = []
        self.verbs: Any = None
        super().__init__(**options)

    @property
    def below(self) -> dict[str, Parser]:
        """Parsers of the verbs below it, by name."""
        return {} if self.verbs is None else dict(self.verbs.choices)

    def add_argument(self, *names: str, **options: Any) -> argparse.Action:  # strings only
        """As `argparse.ArgumentParser`."""
        action = super().add_argument(*names, **options)
        self.arguments.append(action)
        return action

    def add_group(self, title: str, description: str | None = None) -> Group:
        """A titled group of arguments."""
        return Group(self.add_argument_group(title, description), self.arguments)

    def add_alternatives(self) -> Group:
        """Arguments of which one may be given."""
        return Group(self.add_mutually_exclusive_group(), self.arguments)

    def add_subparsers(self, **options: Any) -> Any:
        """As `argparse.ArgumentParser`."""
        self.verbs = super().add_subparsers(**options)
        return self.verbs

    def add_verbs(self, dest: str, named: dict[str, str], *, required: bool = True, **options: Any) -> list[Parser]:
        """Parsers of verbs below, from the one-line help of each; ``dest`` will be the name of the one that is used."""
        verbs = self.add_subparsers(dest=dest, metavar="VERB", required=required)
        return [verbs.add_parser(name, help=text, description=text, **options) for name, text in named.items()]

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """As `argparse.ArgumentParser`, but no word may be left: a verb shows its own usage beside such a word."""
        known, left = super().parse_known_args(args, namespace)
        if left:
            self.error(f"unrecognized arguments: {' '.join(left)}")
        return known, left

    def whole(self) -> Iterator[tuple[str, argparse.Action]]:
        """All arguments, also of the verbs below, with the words that lead to them."""
        for action in self.arguments:
            yield f"{self.prog} {action.dest}", action
        for parser in self.below.values():
            yield from parser.whole()

    def command(self, args: argparse.Namespace, without: Collection[str] = ()) -> list[str]:
        """Words of the command that gives ``args``: what differs from its default, except arguments ``without``."""
        if self.verbs is not None:
            return self.below[getattr(args, self.verbs.dest)].command(args, without)
        positional, options = [], []
        for action in self.arguments:
            value = getattr(args, action.dest, action.default)
            if action.dest in without or value == action.default:
                continue
            values = [str(v) for v in value] if isinstance(value, list) else [str(value)]
            if not action.option_strings:
                positional += values
            elif action.nargs == 0:
                options += [_option(action)] * (value == action.const)
            elif action.nargs is None:
                options += [word for v in values for word in (_option(action), v)]
            else:
                options += [_option(action), *values]
        return [*self.prog.split(), *positional, *options]


def _option(action: argparse.Action) -> str:
    """The first name in full, and ``-o``."""
    names = action.option_strings
    return names[0] if names[0] == "-o" else next((name for name in names if name.startswith("--")), names[0])


def main_parser(whole: bool = False) -> Parser:
    """The parser of the command; ``whole``: with the arguments of every verb."""
    parser = Parser(
        prog="mcstudy",
        description="Monte Carlo studies of parameter identification in human balance.",
        epilog=f"exit codes: {exit_codes()}",
    )
    parser.add_argument("--version", action="store_true", help="print the version and exit")
    named = verbs() if whole else listed()
    for verb, below in zip(named, parser.add_verbs("verb", named, required=False, add_help=whole), strict=True):
        if whole:
            module(verb).add_arguments(below)
    return parser


def parser_of(verb: str) -> Parser:
    """The parser of one verb with all its arguments; the reference of the command line is made from it."""
    text = VERBS.get(verb) or verbs()[verb]
    parser = Parser(prog=f"mcstudy {verb}", description=text, epilog=f"exit codes: {exit_codes()}")
    module(verb).add_arguments(parser)
    return parser

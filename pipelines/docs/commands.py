"""The directive ``{command-line}``: every verb of `mcstudy` with its arguments, from the program's own parsers."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from functools import partial

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from mcstudy.cli.parser import Parser, parser_of
from mcstudy.cli.verbs import verbs


class CommandLine(SphinxDirective):
    """One section per verb: what it does, its usage, and each argument."""

    def run(self) -> list[nodes.Node]:
        """The sections."""
        text = "\n".join(line for verb, does in verbs().items() for line in _section(parser_of(verb), does))
        return self.parse_text_to_nodes(text, allow_section_headings=True)


def _section(parser: Parser, does: str) -> Iterator[str]:
    """Markdown of one verb, then of the verbs below it."""
    parser.formatter_class = partial(argparse.HelpFormatter, width=78)
    yield f"## {parser.prog}\n\n{does[0].upper()}{does[1:]}.\n"
    yield f"```text\n{parser.format_usage().removeprefix('usage: ').rstrip()}\n```\n"
    for action in parser.arguments:
        if action.dest != "help":
            yield f"{_names(action)}\n: {_help(parser, action)}\n"
    for below in parser.below.values():
        yield from _section(below, below.description or "")


def _names(action: argparse.Action) -> str:
    """An argument as it is typed, with what stands for its value."""
    value = action.metavar or (None if action.nargs == 0 else (action.dest.upper()))
    if not action.option_strings:
        return f"`{action.metavar or action.dest}`"
    return ", ".join(f"`{name} {value}`" if value else f"`{name}`" for name in action.option_strings)


def _help(parser: Parser, action: argparse.Action) -> str:
    """Its help as the terminal shows it, and its choices."""
    text = (action.help or "") % {**vars(action), "prog": parser.prog}
    choices = f"one of {', '.join(map(str, action.choices))}" if action.choices else ""
    return "; ".join(part for part in (text, choices) if part).replace("<", r"\<").replace("*", r"\*")


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directive with Sphinx."""
    app.add_directive("command-line", CommandLine)
    return {"parallel_read_safe": True}

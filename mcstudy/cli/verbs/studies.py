"""``mcstudy studies``: list the study files that come with mcstudy, or print one of them."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from mcstudy.exits import Exit

if TYPE_CHECKING:
    from mcstudy.cli.parser import Parser


def add_arguments(parser: Parser) -> None:
    """Arguments of the verb."""
    parser.add_argument(
        "name", nargs="?", help="print this study file, e.g. to change it: mcstudy studies quick > my.toml"
    )


def main(args: argparse.Namespace) -> Exit:
    """Print; returns the exit code."""
    from mcstudy.study.catalogue import located, question, shipped
    from mcstudy.text_tables import table

    if args.name is not None:
        print(located(args.name).read_text(encoding="utf-8"), end="")
        return Exit.DONE
    rows = [(name, question(file)) for name, file in shipped().items()]
    print(table(["study", "what it answers"], rows, of_text=True))
    print("\nRun one: mcstudy run NAME. Print its file: mcstudy studies NAME.")
    return Exit.DONE

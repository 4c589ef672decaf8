"""``mcstudy show``: print the tables of a results cube."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from mcstudy.cli.terminal import print_json
from mcstudy.exits import Exit

if TYPE_CHECKING:
    from mcstudy.cli.parser import Parser

TOPIC = "statistics"


def add_arguments(parser: Parser) -> None:
    """Arguments of the verb."""
    parser.add_argument("out", type=Path, help="results cube")
    parser.add_argument(
        "--compare", type=Path, metavar="OTHER", help="another cube; prints OUT minus OTHER, group by group"
    )
    parser.add_argument("--json", action="store_true", help="print JSON (described in results_schema)")


def main(args: argparse.Namespace) -> Exit:
    """Print; returns the exit code."""
    from mcstudy.analysis.show.tables import show
    from mcstudy.scheduler.activity import activity

    with activity(f"{args.out}: computing the statistics"):
        report = show(args.out, args.compare)
    if args.json:
        print_json(report.json())
    else:
        print(report.text())
    return Exit.DONE

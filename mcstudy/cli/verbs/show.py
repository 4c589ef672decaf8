"""``mcstudy show``: print the tables of a results cube."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from mcstudy.cli.options import add_cube_argument, add_json_argument
from mcstudy.cli.terminal import print_json
from mcstudy.exits import Exit

if TYPE_CHECKING:
    from mcstudy.cli.parser import Parser

TOPIC = "statistics"


def add_arguments(parser: Parser) -> None:
    """Arguments of the verb."""
    add_cube_argument(parser)
    parser.add_argument(
        "--compare", type=Path, metavar="OTHER", help="another cube; prints OUT minus OTHER, group by group"
    )
    parser.add_argument(
        "--csv",
        type=Path,
        metavar="FILE",
        help="write every parameter of every cell as a row: population, average, SD, ...",
    )
    add_json_argument(parser)


def main(args: argparse.Namespace) -> Exit:
    """Print; returns the exit code."""
    from mcstudy.analysis.show.tables import show
    from mcstudy.scheduler.activity import activity

    with activity(f"{args.out}: computing the statistics"):
        report = show(args.out, args.compare)
    if args.csv is not None:
        from mcstudy.analysis.show.sweeps import csv_rows
        from mcstudy.files.csv_text import csv_text
        from mcstudy.files.json_files import write_text

        write_text(args.csv, csv_text(*csv_rows(report.data)))
    if args.json:
        print_json(report.json())
    else:
        print(report.text())
    return Exit.DONE

"""``mcstudy show``: what a results cube says, on one screen or in full."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from mcstudy.cli.options import add_cube_argument, add_json_argument, names, numbers
from mcstudy.cli.terminal import print_json
from mcstudy.exits import Exit

if TYPE_CHECKING:
    from mcstudy.analysis.show.tables import Report
    from mcstudy.cli.parser import Parser

TOPIC = "statistics"


def add_arguments(parser: Parser) -> None:
    """Arguments of the verb."""
    add_cube_argument(parser)
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--all", action="store_true", help="all tables, not only the first screen")
    what.add_argument("--starts", action="store_true", help="how many starts a fit needs, in each condition")
    what.add_argument("--paper", action="store_true", help="the comparison with a publication, by statement")
    parser.add_argument("--group", type=names, default=(), metavar="G,...", help="tables of these groups")
    parser.add_argument("--fmax", type=numbers, default=(), metavar="HZ,...", help="tables at these Fmax")
    parser.add_argument("--amplitude", type=numbers, default=(), metavar="A,...", help="tables at these amplitudes")
    parser.add_argument("--parameter", type=names, default=(), metavar="P,...", help="tables of these parameters")
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
    from mcstudy.analysis.show.selection import Selection
    from mcstudy.analysis.show.tables import show
    from mcstudy.scheduler.activity import activity

    wanted = Selection(groups=args.group, fmax=args.fmax, amplitude=args.amplitude, parameters=args.parameter)
    with activity(f"{args.out}: computing the statistics"):
        report = show(args.out, args.compare).selected(wanted)
    if args.csv is not None:
        from mcstudy.analysis.show.sweeps import csv_rows
        from mcstudy.files.csv_text import csv_text
        from mcstudy.files.json_files import write_text

        write_text(args.csv, csv_text(*csv_rows(report.data)))
    if args.json:
        print_json(report.json())
    else:
        print(_text(report, args, bool(wanted)))
    return Exit.DONE


def _text(report: Report, args: argparse.Namespace, narrowed: bool) -> str:
    if args.paper:
        return report.publication()
    if args.starts:
        return report.starts()
    return report.details() if args.all else report.groups() if narrowed else report.text()

"""``mcstudy extend``: add realizations, starts, Fmax values or amplitudes to a results cube; only new cells are run."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from mcstudy.cli.first_look import prepare
from mcstudy.cli.options import add_cluster_arguments, cluster_options, named_as_options, tell
from mcstudy.exits import Exit

if TYPE_CHECKING:
    from mcstudy.cli.parser import Parser

TOPIC = "studies"


def add_arguments(parser: Parser) -> None:
    """Arguments of the verb."""
    parser.add_argument("out", type=Path, help="results cube")
    parser.add_argument("--realizations", type=int, help="new total number of realizations")
    parser.add_argument(
        "--starts",
        type=int,
        help="new total number of starts per fit; the new maximum where starts are drawn until certain",
    )
    parser.add_argument("--fmax", type=float, nargs="+", default=[], metavar="HZ", help="Fmax values to add")
    parser.add_argument("--amplitude", type=float, nargs="+", default=[], help="stimulus amplitudes to add")
    parser.add_argument("--group", action="append", default=[], help="group to extend; may be repeated; default all")
    add_cluster_arguments(parser)


def main(args: argparse.Namespace) -> Exit:
    """Extend the study and run the new cells; returns the exit code."""
    from mcstudy.study.extend import Growth, extend

    growth = Growth(args.realizations, args.starts, tuple(args.fmax), tuple(args.amplitude), tuple(args.group))
    with named_as_options(group="group"):
        outcome = extend(args.out, growth, cluster_options(args), args.block)
    code = tell(outcome, args.out)
    prepare(outcome, args.out)
    return code

"""``mcstudy extend``: grow a results cube; only the new cells are run."""

from __future__ import annotations

import argparse
from pathlib import Path

from mcstudy.cli.options import add_cluster_arguments, cluster_options, tell
from mcstudy.exits import Exit


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument("out", type=Path, help="results cube")
    parser.add_argument("--realizations", type=int, help="realizations there are to be in all")
    parser.add_argument("--starts", type=int, help="starts a fit problem is to have in all")
    parser.add_argument("--fmax", type=float, nargs="+", default=[], metavar="HZ", help="Fmax values to add")
    parser.add_argument("--amplitude", type=float, nargs="+", default=[], help="stimulus amplitudes to add")
    parser.add_argument("--group", action="append", default=[], help="group that grows; may be repeated; default all")
    add_cluster_arguments(parser)


def main(args: argparse.Namespace) -> Exit:
    """Grow and run; returns the exit code."""
    from mcstudy.study.extend import Growth, extend

    growth = Growth(args.realizations, args.starts, tuple(args.fmax), tuple(args.amplitude), tuple(args.group))
    return tell(extend(args.out, growth, cluster_options(args), args.block), args.out)

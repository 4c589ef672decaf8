"""``mcstudy extend``: add realizations, starts, Fmax, amplitudes or values of a sweep; only new cells are run."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from mcstudy.cli.options import add_cluster_arguments, add_cube_argument, cluster_options, named_as_options
from mcstudy.cli.outcome import prepare, tell
from mcstudy.exits import Exit

if TYPE_CHECKING:
    from mcstudy.cli.parser import Parser
    from mcstudy.study.group import Label

TOPIC = "studies"


def add_arguments(parser: Parser) -> None:
    """Arguments of the verb."""
    add_cube_argument(parser)
    parser.add_argument("--realizations", type=int, help="new total number of realizations")
    parser.add_argument(
        "--starts",
        type=int,
        help="new total number of starts per fit; the new maximum where starts are drawn until certain",
    )
    parser.add_argument("--fmax", type=float, nargs="+", default=[], metavar="HZ", help="Fmax values to add")
    parser.add_argument("--amplitude", type=float, nargs="+", default=[], help="stimulus amplitudes to add")
    parser.add_argument("--group", action="append", default=[], help="group to extend; may be repeated; default all")
    parser.add_argument(
        "--sweep",
        type=further_labels,
        action="append",
        default=[],
        metavar="AXIS=VALUE,...",
        help="values to add to an axis of a sweep; may be repeated",
    )
    add_cluster_arguments(parser)


def further_labels(text: str) -> tuple[str, tuple[Label, ...]]:
    """``size=0.03,high`` as an axis and its further labels."""
    axis, equals, labels = text.partition("=")
    if not (axis and equals and labels):
        raise argparse.ArgumentTypeError(f"expected AXIS=VALUE,VALUE, got {text!r}")
    return axis, tuple(map(_label, labels.split(",")))


def _label(text: str) -> Label:
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text


def main(args: argparse.Namespace) -> Exit:
    """Extend the study and run the new cells; returns the exit code."""
    from mcstudy.study.extend import Growth, extend

    growth = Growth(
        args.realizations, args.starts, tuple(args.fmax), tuple(args.amplitude), tuple(args.group), tuple(args.sweep)
    )
    with named_as_options(group="group"):
        outcome = extend(args.out, growth, cluster_options(args), args.block)
    code = tell(outcome, args.out)
    prepare(outcome, args.out)
    return code

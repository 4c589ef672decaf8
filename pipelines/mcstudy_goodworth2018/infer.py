"""``mcstudy infer``: what the paper's printed numbers tell about its lost Table I."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from mcstudy.cli.options import add_scheduler_arguments, cluster_options
from mcstudy.exits import Exit

if TYPE_CHECKING:
    from mcstudy.cli.parser import Parser

HELP = "infer the paper's lost true values from its printed numbers"
RESUMABLE = ("",)
SHIPPED = {"file": "inference"}


def add_arguments(parser: Parser) -> None:
    """Arguments of the verb."""
    parser.add_argument("file", type=Path, help="inference file (.toml), or the name of a shipped one (table_one)")
    parser.add_argument(
        "-o", "--out", "--output", dest="out", type=Path, required=True, metavar="DIR", help="folder for all results"
    )
    parser.add_argument("--figure", type=Path, metavar="SVG", help="also draw the marginals of the posterior")
    parser.add_argument("--trade-offs", type=Path, metavar="SVG", help="also draw which numbers contradict each other")
    add_scheduler_arguments(parser)


def main(args: argparse.Namespace) -> Exit:
    """Infer what is missing and print the tables; returns the exit code."""
    from mcstudy.cli.figure_file import check_figure, write_figure
    from mcstudy.scheduler.compiling import compile_kernels
    from mcstudy.text_tables import folded
    from mcstudy_goodworth2018.lost_table.design import read_inference
    from mcstudy_goodworth2018.lost_table.result import RESULT, result
    from mcstudy_goodworth2018.lost_table.words import text

    check_figure(args.figure)
    check_figure(args.trade_offs)
    file, options = read_inference(args.file), cluster_options(args)
    if options.here and not (args.out / RESULT).exists():
        compile_kernels(("lm", "linearised", "stability"))
    found = result(file, args.out, options)
    print(folded(text(found)))
    if args.figure is not None:
        from mcstudy_goodworth2018.lost_table.marginals import marginals_svg

        write_figure(marginals_svg(found), args.figure)
    if args.trade_offs is not None:
        from mcstudy_goodworth2018.lost_table.trade_off import trade_offs_svg

        write_figure(trade_offs_svg(found), args.trade_offs)
    return Exit.DONE

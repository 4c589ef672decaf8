"""``mcstudy infer``: what the paper's printed numbers tell about its lost Table I."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

from mcstudy.cli.options import add_figure_argument, add_out_argument, add_scheduler_arguments
from mcstudy.cli.options import where as where_of
from mcstudy.exits import Exit

if TYPE_CHECKING:
    import xarray as xr

    from mcstudy.api.where import Where
    from mcstudy.cli.parser import Parser

HELP = "infer the paper's lost true values from its printed numbers"
RESUMABLE = ("",)
SHIPPED = {"file": "inference"}


def add_arguments(parser: Parser) -> None:
    """Arguments of the verb."""
    parser.add_argument("file", type=Path, help="inference file (.toml), or the name of a shipped one (table_one)")
    add_out_argument(parser, "DIR", "folder for all results", required=True)
    add_figure_argument(parser, "the marginals of the posterior")
    add_figure_argument(parser, "which numbers contradict each other", "--trade-offs")
    add_scheduler_arguments(parser)


def infer(file: str | Path, out: str | Path, **where: Unpack[Where]) -> xr.Dataset:
    """Infer the paper's lost true values from its printed numbers.

    Parameters
    ----------
    file
        Path of an inference file, or the name of a shipped one (``"table_one"``).
    out
        Folder for all results; a finished one is read, a stopped one resumed.
    where
        Where to run, as `mcstudy.run`.

    Returns
    -------
    xarray.Dataset
        The posterior of the true values, and how well it reproduces every printed number.

    Raises
    ------
    DesignError
        The file has a mistake.
    StudyChangedError
        The folder belongs to another inference file, or another program has begun it.
    Interrupted
        Stopped; the same call resumes.
    """
    from mcstudy.api.where import cluster_options
    from mcstudy.scheduler.compiling import compile_kernels
    from mcstudy_goodworth2018.lost_table.design import read_inference
    from mcstudy_goodworth2018.lost_table.result import RESULT, result

    inference, options, out = read_inference(file), cluster_options(where), Path(out)
    if options.here and not (out / RESULT).exists():
        compile_kernels(("lm", "linearised", "stability"))
    return result(inference, out, options)


def main(args: argparse.Namespace) -> Exit:
    """Infer what is missing and print the tables; returns the exit code."""
    from mcstudy.cli.figure_file import check_figure, write_figure
    from mcstudy.text_tables import folded
    from mcstudy_goodworth2018.lost_table.words import text

    check_figure(args.figure)
    check_figure(args.trade_offs)
    found = infer(args.file, args.out, **where_of(args))
    print(folded(text(found)))
    if args.figure is not None:
        from mcstudy_goodworth2018.lost_table.marginals import marginals_picture

        write_figure(marginals_picture(found), args.figure)
    if args.trade_offs is not None:
        from mcstudy_goodworth2018.lost_table.trade_off import trade_offs_picture

        write_figure(trade_offs_picture(found), args.trade_offs)
    return Exit.DONE

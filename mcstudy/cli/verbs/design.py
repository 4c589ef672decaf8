"""``mcstudy design``: the stimulus that identifies the controllers best, verified by Monte Carlo."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from mcstudy.cli.options import (
    add_figure_argument,
    add_other_model_argument,
    add_out_argument,
    add_page_argument,
    add_scheduler_arguments,
    cluster_options,
    shown_command,
)
from mcstudy.exits import Exit

if TYPE_CHECKING:
    from mcstudy.cli.parser import Parser


def add_arguments(parser: Parser) -> None:
    """Arguments of the verb."""
    parser.add_argument("file", type=Path, help="design file (.toml), or the name of a shipped one (design)")
    add_other_model_argument(parser, "the design file")
    add_out_argument(parser, "DIR", "folder for all results", required=True)
    parser.add_argument(
        "--no-verify", action="store_true", help="only predict: leave out the Monte Carlo study of design and sequence"
    )
    add_figure_argument(parser, "spectra and errors before and after")
    add_page_argument(parser)
    add_scheduler_arguments(parser)


def main(args: argparse.Namespace) -> Exit:
    """Design, verify and print the tables; returns the exit code."""
    from mcstudy.cli.figure_file import check_figure, write_figure
    from mcstudy.errors import DesignError
    from mcstudy.stimulus_design.design_file import read_design

    check_figure(args.figure, args.html)
    file, options = read_design(args.file, args.model), cluster_options(args)
    from mcstudy.results.stimulus_design import StimulusDesign
    from mcstudy.stimulus_design.run import design_stimulus  # Dask is slow to import; report a bad file first
    from mcstudy.text_tables import folded

    try:
        design = StimulusDesign.of(design_stimulus(file, args.out, options, verify=not args.no_verify))
    except DesignError as error:
        raise DesignError(f"{args.file}: {error}") from None
    if args.figure is not None:
        from mcstudy.report.design_page import design_picture

        write_figure(design_picture(design), args.figure)
    if args.html is not None:
        from mcstudy.report.design_page import design_page
        from mcstudy.report.document import write_page

        write_page(args.html, lambda: design_page(design, shown_command(args)))
    print(folded(design.text()))
    return Exit.DONE

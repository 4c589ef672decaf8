"""``mcstudy report``: write a results cube as one self-contained page."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from mcstudy.exits import Exit

if TYPE_CHECKING:
    from mcstudy.cli.parser import Parser

TOPIC = "pages"


def add_arguments(parser: Parser) -> None:
    """Arguments of the verb."""
    parser.add_argument("out", type=Path, help="results cube")
    parser.add_argument(
        "--beside",
        nargs="+",
        type=Path,
        default=[],
        metavar="FILE",
        help="further results to include on the page: cubes, or files from "
        "pipelines/examples/{two_stimuli,population}.py",
    )
    parser.add_argument(
        "-o", "--out", "--output", dest="output", type=Path, metavar="PAGE", help="page to write; default OUT.html"
    )


def main(args: argparse.Namespace) -> Exit:
    """Write the page; returns the exit code."""
    from mcstudy.report.document import page_of
    from mcstudy.report.page import page  # imports what it needs to draw

    return write_and_tell(args.output or page_of(args.out), lambda: page(args.out, args.beside))


def write_and_tell(file: Path, text: Callable[[], str]) -> Exit:
    """Write a page, and print how large it is."""
    from mcstudy.report.document import write_page
    from mcstudy.scheduler.activity import activity

    with activity(f"{file}: computing statistics and drawing figures"):
        written = write_page(file, text)
    print(f"{file}: {written.stat().st_size / 1e6:.2f} MB")
    return Exit.DONE

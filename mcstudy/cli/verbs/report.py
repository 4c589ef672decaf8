"""``mcstudy report``: write a results cube as one self-contained page."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from mcstudy.cli.options import add_cube_argument, add_out_argument
from mcstudy.exits import Exit

if TYPE_CHECKING:
    from mcstudy.cli.parser import Parser

TOPIC = "pages"


def add_arguments(parser: Parser) -> None:
    """Arguments of the verb."""
    add_cube_argument(parser)
    parser.add_argument(
        "--beside",
        nargs="+",
        type=Path,
        default=[],
        metavar="FILE",
        help="further results to include on the page: cubes, or files from "
        "pipelines/examples/{two_stimuli,population}.py",
    )
    add_out_argument(parser, "PAGE", "page to write; default OUT.html", dest="output")
    parser.add_argument("--open", action="store_true", help="open the page in the web browser")


def main(args: argparse.Namespace) -> Exit:
    """Write the page; returns the exit code."""
    from mcstudy.report.document import page_of
    from mcstudy.report.page import page  # imports what it needs to draw

    file = args.output or page_of(args.out)
    code = write_and_tell(file, lambda: page(args.out, args.beside))
    if args.open:
        import webbrowser

        webbrowser.open(file.absolute().as_uri())
    return code


def write_and_tell(file: Path, text: Callable[[], str]) -> Exit:
    """Write a page, and print its address and how large it is."""
    from mcstudy.report.document import write_page
    from mcstudy.scheduler.activity import activity

    with activity(f"{file}: computing statistics and drawing figures"):
        written = write_page(file, text)
    print(f"{written.absolute().as_uri()} ({written.stat().st_size / 1e6:.2f} MB)")
    return Exit.DONE

"""``mcstudy report``: write a results cube as one self-contained page."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

from mcstudy.exits import Exit


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument("out", type=Path, help="results cube")
    parser.add_argument(
        "--beside",
        nargs="+",
        type=Path,
        default=[],
        metavar="FILE",
        help="alternatives to show too: cubes, or files from pipelines/examples/{two_stimuli,population}.py",
    )
    parser.add_argument(
        "-o", "--out", "--output", dest="output", type=Path, metavar="PAGE", help="page to write; default OUT.html"
    )


def main(args: argparse.Namespace) -> Exit:
    """Write the page; returns the exit code."""
    from mcstudy.report.page import default_page, write_report  # imports what it needs to draw

    page = args.output or default_page(args.out)
    return write_and_tell(page, lambda: write_report(args.out, page, beside=args.beside))


def write_and_tell(page: Path, write: Callable[[], Path]) -> Exit:
    """Write a page, and print how large it is."""
    from mcstudy.scheduler.activity import activity

    with activity(f"{page}: computing statistics and drawing figures"):
        written = write()
    print(f"{page}: {written.stat().st_size / 1e6:.2f} MB")
    return Exit.DONE

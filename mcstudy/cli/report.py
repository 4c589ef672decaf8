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
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="PAGE", help="the page to write (.html)")


def main(args: argparse.Namespace) -> Exit:
    """Write the page; returns the exit code."""
    from mcstudy.report.style import require_matplotlib

    require_matplotlib()
    from mcstudy.report.page import page

    return write_and_tell(args.output, lambda: page(args.out, args.beside))


def write_and_tell(file: Path, text: Callable[[], str]) -> Exit:
    """Write a page, and print how large it is."""
    from mcstudy.report.document import write_page

    written = write_page(file, text)
    print(f"{file}: {written.stat().st_size / 1e6:.2f} MB")
    return Exit.DONE

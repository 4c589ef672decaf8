"""``mcstudy report``: a results cube as one self-contained page."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument("out", type=Path, help="results cube")
    parser.add_argument(
        "--beside",
        nargs="+",
        type=Path,
        default=[],
        metavar="FILE",
        help="alternatives to show on the page: cubes, or files of pipelines/examples/{two_stimuli,population}.py",
    )
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="PAGE", help="the page to write (.html)")


def main(args: argparse.Namespace) -> int:
    """Write the page; returns the exit code."""
    from mcstudy.report.style import require_matplotlib

    require_matplotlib()
    from mcstudy.report.page import page

    return write_page(args.output, lambda: page(args.out, args.beside))


def write_page(file: Path, text: Callable[[], str]) -> int:
    """Write what ``text`` returns; the file is opened first: nobody should wait for a page that cannot be kept."""
    from mcstudy.cli import DONE
    from mcstudy.errors import InputError

    try:
        opened = file.open("a", encoding="utf-8")
    except OSError as error:
        raise InputError(f"{file}: expected a file that can be written, got {error.strerror}") from None
    with opened:
        content = text()
        opened.truncate(0)
        opened.write(content)
    print(f"{file}: {len(content.encode()) / 1e6:.2f} MB")
    return DONE

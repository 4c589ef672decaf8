"""``mcstudy report``: a results cube as one self-contained page."""

from __future__ import annotations

import argparse
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument("out", type=Path, help="results cube")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="PAGE", help="the page to write (.html)")


def main(args: argparse.Namespace) -> int:
    """Write the page; returns the exit code."""
    from mcstudy.report.style import require_matplotlib

    require_matplotlib()
    from mcstudy.cli import DONE
    from mcstudy.errors import InputError
    from mcstudy.report.page import page

    try:
        # Opened first: nobody should wait for a page that cannot be kept.
        file = args.output.open("a", encoding="utf-8")
    except OSError as error:
        raise InputError(f"{args.output}: expected a file that can be written, got {error.strerror}") from None
    with file:
        text = page(args.out)
        file.truncate(0)
        file.write(text)
    print(f"{args.output}: {len(text.encode()) / 1e6:.2f} MB")
    return DONE

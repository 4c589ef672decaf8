"""``mcstudy report``: a results cube as one self-contained page."""

from __future__ import annotations

import argparse
import contextlib
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
        help="alternatives to show on the page: cubes, or files of pipelines/examples/{two_stimuli,population}.py",
    )
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="PAGE", help="the page to write (.html)")


def main(args: argparse.Namespace) -> Exit:
    """Write the page; returns the exit code."""
    from mcstudy.report.style import require_matplotlib

    require_matplotlib()
    from mcstudy.report.page import page

    return write_page(args.output, lambda: page(args.out, args.beside))


def write_page(file: Path, text: Callable[[], str]) -> Exit:
    """Write what ``text`` returns; the file is begun first: nobody should wait for a page that cannot be kept."""
    from mcstudy.errors import InputError
    from mcstudy.study.durable import replacing

    place = file.resolve()  # a link stays one
    with contextlib.ExitStack() as stack:
        try:
            if place.exists():
                place.open("ab").close()
            opened = stack.enter_context(replacing(place))
        except OSError as error:
            raise InputError(f"{file}: expected a file that can be written, got {error.strerror}") from None
        content = text().encode()
        opened.write(content)
    print(f"{file}: {len(content) / 1e6:.2f} MB")
    return Exit.DONE

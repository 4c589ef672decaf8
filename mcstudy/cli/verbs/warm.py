"""``mcstudy warm``: compile the kernels ahead of the first run."""

from __future__ import annotations

import argparse
import time
from typing import TYPE_CHECKING

from mcstudy.exits import Exit

if TYPE_CHECKING:
    from mcstudy.cli.parser import Parser


def add_arguments(parser: Parser) -> None:
    """Arguments of the verb: none."""
    del parser


def main(args: argparse.Namespace) -> Exit:
    """Compile what is not; returns the exit code."""
    del args
    begun = time.monotonic()
    from mcstudy.fitting.compilers import warm
    from mcstudy.scheduler.activity import activity, doing

    with activity("loading the kernels"):
        compiled = warm(show=lambda compilation: doing(compilation.line()))
    print(f"{compiled} functions compiled in {time.monotonic() - begun:.1f} s; all kernels are ready")
    return Exit.DONE

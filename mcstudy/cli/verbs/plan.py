"""``mcstudy plan``: predict run time, size and precision of a study before running it."""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import TYPE_CHECKING

from mcstudy.cli.options import add_unstable_argument, positive, stable_study
from mcstudy.exits import Exit

if TYPE_CHECKING:
    from mcstudy.cli.parser import Parser

TOPIC = "studies"


def add_arguments(parser: Parser) -> None:
    """Arguments of the verb."""
    parser.add_argument("study", type=Path, help="study file (.toml), or the name of a shipped study (mcstudy studies)")
    add_unstable_argument(parser)
    parser.add_argument("--workers", type=positive, help="number of threads assumed; default one per core")


def main(args: argparse.Namespace) -> Exit:
    """Print the plan; returns the exit code."""
    study = stable_study(args)
    import mcstudy.study.run  # noqa: F401 - the imports of a run are part of its time
    from mcstudy.scheduler.activity import activity
    from mcstudy.scheduler.compiling import compile_kernels
    from mcstudy.study.kernels import parts_of
    from mcstudy.study.plan import plan_study
    from mcstudy.text_tables import folded

    compile_kernels(parts_of(study.groups.values()))
    with activity("loading the solvers"):
        found = plan_study(study, imports=time.process_time(), workers=args.workers, allow_unstable=args.allow_unstable)
    print(folded(str(found)))
    return Exit.DONE

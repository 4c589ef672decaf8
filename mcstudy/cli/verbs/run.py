"""``mcstudy run``: run a study file into a results cube, or resume it."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from mcstudy.cli.first_look import prepare
from mcstudy.cli.options import (
    add_cluster_arguments,
    add_unstable_argument,
    cluster_options,
    named_as_options,
    stable_study,
    tell,
    where,
)
from mcstudy.exits import Exit

if TYPE_CHECKING:
    from mcstudy.cli.parser import Parser
    from mcstudy.study.design import Study

TOPIC = "studies"


def add_arguments(parser: Parser) -> None:
    """Arguments of the verb."""
    parser.add_argument("study", type=Path, help="study file (.toml), or the name of a shipped study (mcstudy studies)")
    parser.add_argument("-o", "--out", type=Path, help="results cube; default results/NAME.zarr")
    parser.add_argument(
        "--quarantine",
        action="store_true",
        help="move files in OUT that do not belong to the cube to OUT.aside; nothing is deleted",
    )
    parser.add_argument(
        "--until-mcse",
        metavar="STATISTIC=PERCENT%",
        help="add realizations or starts until the largest Monte Carlo standard error of STATISTIC (bias or mean_bias) "
        "is below PERCENT, e.g. bias=1%%; needs --budget-fits",
    )
    parser.add_argument("--budget-fits", type=int, metavar="N", help="upper limit on the total number of fits")
    add_unstable_argument(parser)
    add_cluster_arguments(parser)


def main(args: argparse.Namespace) -> Exit:
    """Run; returns the exit code."""
    study = stable_study(args)
    # Dask is slow to import; report a bad study file first.
    from mcstudy.study.run import default_out, run_study

    out = args.out or default_out(study)
    if args.until_mcse is not None or args.budget_fits is not None:
        return _until(args, study, out)
    outcome = run_study(
        study, out, cluster_options(args), args.block, args.quarantine, allow_unstable=args.allow_unstable
    )
    code = tell(outcome, out)
    prepare(outcome, out)
    return code


def _until(args: argparse.Namespace, study: Study, out: Path) -> Exit:
    """Run, and extend until the target is reached; returns the exit code."""
    import sys

    from mcstudy.api.cubes import run_until
    from mcstudy.errors import InputError

    if args.until_mcse is None or args.budget_fits is None:
        raise InputError("--until-mcse and --budget-fits: expected both or neither")

    def say(line: str) -> None:
        print(f"extending: {line}", file=sys.stderr, flush=True)

    with named_as_options(target="until-mcse", budget_fits="budget-fits"):
        until = run_until(
            study,
            out,
            args.until_mcse,
            args.budget_fits,
            quarantine=args.quarantine,
            allow_unstable=args.allow_unstable,
            say=say,
            **where(args),
        )
    code = tell(until.outcome, out)
    for line in until.steps:
        print(f"extended: {line}")
    print(until.statement)
    prepare(until.outcome, out)
    return code if code != Exit.DONE or until.reached else Exit.NOT_REACHED

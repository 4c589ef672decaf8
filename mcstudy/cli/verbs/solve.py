"""``mcstudy solve``: the cheapest design of an experiment that reaches a target."""

from __future__ import annotations

import argparse
import os
import sys
from typing import TYPE_CHECKING

from mcstudy.cli.options import (
    add_figure_argument,
    add_json_argument,
    add_other_model_argument,
    add_out_argument,
    add_page_argument,
    add_study_argument,
    positive,
    shown_command,
    stable_study,
)
from mcstudy.cli.terminal import print_json
from mcstudy.exits import Exit

if TYPE_CHECKING:
    from mcstudy.cli.parser import Parser
    from mcstudy.planning.solution import SolutionRecord

PRECISION, BUDGET = 10.0, 200_000


def add_arguments(parser: Parser) -> None:
    """Arguments of the verb."""
    add_study_argument(parser)
    add_other_model_argument(parser, "STUDY")
    parser.add_argument(
        "--target",
        action="append",
        required=True,
        metavar="TEXT",
        help="what shall be reached: 'cv(Td1) <= 10%%', 'sd(K11 + Kpas1) <= 40 N m/rad', 'mcse(bias(B11)) <= 1%%'; "
        "measures cv, sd, bias, rmse and mcse of them; may be repeated",
    )
    parser.add_argument(
        "--over",
        required=True,
        metavar="AXES",
        help="axes to search, with ranges where wanted: cycles=2:40,amplitude=2:8,fmax=0.41/1.2/8,realizations",
    )
    parser.add_argument("--group", help="group of the study file; needed if it has several")
    parser.add_argument(
        "--cost",
        metavar="FORMULA",
        help="what is minimised: a formula of time (recording time, s), cycles, amplitude and fmax; default the "
        "recording time, then the amplitude",
    )
    parser.add_argument(
        "--precision",
        type=float,
        default=PRECISION,
        metavar="PERCENT",
        help="half-width of the 95 %% interval of the answer, or of the measure there, at which the search ends; "
        "default 10",
    )
    parser.add_argument(
        "--budget-fits",
        type=positive,
        default=BUDGET,
        metavar="N",
        help="largest number of fits, those of the prediction too",
    )
    parser.add_argument("--workers", type=positive, help="threads; default one per core")
    add_out_argument(parser, "FILE", "write the study (.toml)")
    add_json_argument(parser)
    add_figure_argument(parser, "the measures against the design")
    add_page_argument(parser)
    parser.set_defaults(allow_unstable=False)


def main(args: argparse.Namespace) -> Exit:
    """Search, print and write; returns the exit code."""
    from mcstudy.cli.figure_file import check_figure, write_figure

    check_figure(args.figure, args.html)
    study = stable_study(args)
    from mcstudy.planning.solve import solve_study
    from mcstudy.results.solution import Solution
    from mcstudy.scheduler.activity import activity, doing
    from mcstudy.scheduler.compiling import compile_kernels
    from mcstudy.study.kernels import parts_of
    from mcstudy.text_tables import folded

    compile_kernels([*parts_of(study.groups.values()), "linearised"])
    with activity("preparing"):
        record = solve_study(
            study,
            args.target,
            args.over.split(","),
            group=args.group,
            cost=args.cost,
            precision=args.precision / 100,
            budget=args.budget_fits,
            threads=args.workers or os.cpu_count() or 1,
            say=doing,
        )
    found = Solution.of(record)
    if args.figure is not None:
        from mcstudy.report.solution_page import solution_picture

        write_figure(solution_picture(found), args.figure)
    if args.html is not None:
        from mcstudy.report.document import write_page
        from mcstudy.report.solution_page import solution_page

        write_page(args.html, lambda: solution_page(found, shown_command(args)))
    if args.out is not None:
        if found.answer is None:
            print(f"{args.out}: not written, because no allowed design reaches the targets", file=sys.stderr)
        else:
            found.write_study(args.out)
    if args.json:
        from mcstudy.files.json_files import json_text

        print_json(json_text(found.to_dict(), "solution", "solution"))
    else:
        print(folded(found.text()))
    return _exit(found)


def _exit(found: SolutionRecord) -> Exit:
    """A script must not record a design that does not reach its target, nor take a rough answer for a precise one."""
    if not found.decided:
        return Exit.NOT_REACHED
    return Exit.DONE if found.answer is not None else Exit.UNREACHABLE

"""``mcstudy verify``: check every chunk of a results cube and recompute a sample of fits."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from mcstudy.cli.options import relative
from mcstudy.exits import Exit

if TYPE_CHECKING:
    from mcstudy.cli.parser import Parser

TOPIC = "faults"


def add_arguments(parser: Parser) -> None:
    """Arguments of the verb."""
    parser.add_argument("out", type=Path, help="results cube")
    parser.add_argument(
        "--cells", type=int, default=20, help="number of fits to recompute and compare bit for bit; default 20"
    )
    parser.add_argument("--seed", type=int, default=0, help="random seed for the choice of these fits; default 0")
    parser.add_argument(
        "--tolerance",
        type=relative,
        metavar="RELATIVE",
        help="difference of data and costs that is no fault where they were computed in another environment (program, "
        "library, processor), in which last digits differ; default 1e-6",
    )
    parser.add_argument("--json", action="store_true", help="print JSON (schema verification)")


def main(args: argparse.Namespace) -> Exit:
    """Check a cube; returns `Exit.DIFFERS` when anything is damaged or differs by more than rounding explains."""
    from mcstudy.files.json_files import json_text
    from mcstudy.scheduler.activity import activity
    from mcstudy.study.cube.rounding import TOLERANCE
    from mcstudy.study.verify import verify
    from mcstudy.text_tables import folded

    with activity(f"{args.out}: reading"):
        findings = verify(args.out, args.cells, args.seed, args.tolerance or TOLERANCE)
    if args.json:
        print(json_text(findings.to_dict(), "verification", "verification"))
    else:
        print(folded(findings.text(args.out)))
        print(f"sha256 of tree: {findings.digest}")
    return Exit.DIFFERS if findings.damage or findings.beyond else Exit.DONE

"""``mcstudy replay``: repeat one stored fit, print every iteration, and compare the result with the stored one."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from mcstudy.cli.options import named_as_options
from mcstudy.exits import Exit

if TYPE_CHECKING:
    from mcstudy.cli.parser import Parser

TOPIC = "cube"


CELL = ("group", "amplitude", "fmax", "realization", "start")
"""Options that choose the fit, named as the arguments of `mcstudy.replay`."""


def add_arguments(parser: Parser) -> None:
    """Arguments of the verb."""
    parser.add_argument("out", type=Path, help="results cube")
    parser.add_argument("--group", help="group of the fit; not needed when the cube has only one")
    parser.add_argument("--realization", type=int, required=True, metavar="INDEX", help="realization, from 0")
    parser.add_argument("--start", type=int, required=True, metavar="INDEX", help="start, from 0")
    parser.add_argument("--fmax", type=float, metavar="HZ", help="highest frequency; not needed when there is one")
    parser.add_argument("--amplitude", type=float, help="stimulus amplitude; not needed when there is one")


def main(args: argparse.Namespace) -> Exit:
    """Print the path of the fit; returns `Exit.DIFFERS` if it differs by more than rounding elsewhere explains."""
    import numpy as np

    from mcstudy.scheduler.activity import activity
    from mcstudy.study.replay import replay
    from mcstudy.text_tables import fill, folded, table

    cell = {name: getattr(args, name) for name in CELL}
    with activity(f"{args.out}: repeating the fit"), named_as_options(**dict(zip(CELL, CELL, strict=True))):
        r = replay(args.out, **cell)
    width = r.model.upper - r.model.lower
    header = ["iteration", "cost", "step", *(f"{p.name}/({p.unit})" for p in r.model.parameters)]
    rows = [
        [str(p.iteration), f"{p.cost:.16g}", f"{np.abs(p.step / width).max():.1e}", *(f"{x:.10g}" for x in p.theta)]
        for p in r.path
    ]
    print(table(header, rows))
    print(fill("step: largest change of a parameter, divided by the width of its bounds; 0: the step was rejected"))
    print(fill(f"ended: {r.status.text}"))
    if not r.differ:
        print(f"{args.out}: equal to the stored fit, bit for bit")
        return Exit.DONE
    print(f"{args.out}: differs from the stored fit ({', '.join(r.differ)}); stored: {r.stored_status.text}")
    if r.elsewhere is not None:
        why = "as rounding explains" if r.elsewhere.within else "by more than rounding explains"
        print(folded(f"computed in another environment, and differs {why}: {r.elsewhere.text()}"))
        print(folded(f"environment: {'; '.join(r.environment)}"))
    return Exit.DONE if r.reproduced else Exit.DIFFERS

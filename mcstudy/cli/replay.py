"""``mcstudy replay``: run one stored fit again, iteration by iteration, and compare it with what is stored."""

from __future__ import annotations

import argparse
from pathlib import Path

from mcstudy.exits import Exit


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument("out", type=Path, help="results cube")
    parser.add_argument("--group", help="group of the cell; not needed when there is only one")
    parser.add_argument("--realization", type=int, required=True)
    parser.add_argument("--start", type=int, required=True)
    parser.add_argument("--fmax", type=float, required=True, metavar="HZ")
    parser.add_argument("--amplitude", type=float, required=True)


def main(args: argparse.Namespace) -> Exit:
    """Print the path of the fit; `Exit.DIFFERS` unless it ends where it is stored to have ended."""
    import numpy as np

    from mcstudy.study.replay import replay

    r = replay(args.out, args.group, args.amplitude, args.fmax, args.realization, args.start)
    width = r.model.upper - r.model.lower
    units = " ".join(f"{p.name}/({p.unit})" for p in r.model.parameters)
    print(f"{'iteration':>9}  {'cost':>22}  {'step':>8}  {units}")
    for point in r.path:
        values = " ".join(f"{x:.10g}" for x in point.theta)
        step = np.abs(point.step / width).max()
        print(f"{point.iteration:>9}  {point.cost:>22.16g}  {step:>8.1e}  {values}")
    print("step: largest change of a parameter, in widths of its bounds; 0 is a step that was tried and not taken")
    print(f"ended: {r.status.text}")
    if r.differ:
        print(f"{args.out}: differs from what is stored ({', '.join(r.differ)}); stored: {r.stored_status.text}")
        return Exit.DIFFERS
    print(f"{args.out}: equal to what is stored, bit for bit")
    return Exit.DONE

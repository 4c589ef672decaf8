"""``mcstudy verify``: check every chunk of a results cube and recompute a sample of fits."""

from __future__ import annotations

import argparse
from pathlib import Path

from mcstudy.exits import Exit


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument("out", type=Path, help="results cube")
    parser.add_argument(
        "--cells", type=int, default=20, help="number of fits to recompute and compare bit for bit; default 20"
    )
    parser.add_argument("--seed", type=int, default=0, help="random seed for the choice of these fits; default 0")


def main(args: argparse.Namespace) -> Exit:
    """Check a cube; returns `Exit.DIFFERS` when anything is damaged or differs."""
    from mcstudy.scheduler.activity import activity
    from mcstudy.study.verify import verify
    from mcstudy.text_tables import folded

    with activity(f"{args.out}: reading"):
        findings = verify(args.out, args.cells, args.seed)
    for note in findings.notes:
        print(folded(f"note: {note}"))
    for line in findings.damage:
        print(folded(f"damage: {line}"))
    print(
        f"{args.out}: {len(findings.damage)} damaged; {findings.chunks} chunks read, "
        f"{findings.recomputed} fits recomputed, {findings.pending} not run yet"
    )
    print(f"sha256 of tree: {findings.digest}")
    return Exit.DIFFERS if findings.damage else Exit.DONE

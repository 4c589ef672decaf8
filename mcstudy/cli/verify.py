"""``mcstudy verify``: check every chunk of a results cube, and recompute a sample."""

from __future__ import annotations

import argparse
from pathlib import Path

from mcstudy.exits import Exit


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument("out", type=Path, help="results cube")
    parser.add_argument("--cells", type=int, default=20, help="cells to recompute bit for bit; default 20")
    parser.add_argument("--seed", type=int, default=0, help="chooses the cells; default 0")


def main(args: argparse.Namespace) -> Exit:
    """Check; returns `Exit.DIFFERS` when anything is wrong."""
    from mcstudy.study.durable import tree_digest
    from mcstudy.study.verify import verify

    verdict = verify(args.out, args.cells, args.seed)
    for note in verdict.notes:
        print(f"note: {note}")
    for line in verdict.damage:
        print(f"damage: {line}")
    print(
        f"{args.out}: {len(verdict.damage)} damaged; {verdict.chunks} chunks read, "
        f"{verdict.recomputed} fits recomputed, {verdict.pending} not run yet"
    )
    print(f"sha256 of the tree: {tree_digest(args.out)}")
    return Exit.DIFFERS if verdict.damage else Exit.DONE

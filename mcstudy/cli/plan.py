"""``mcstudy plan``: what a study will cost and how precise it will be, before running it."""

from __future__ import annotations

import argparse
import time
from pathlib import Path

from mcstudy.cli.options import add_unstable_argument, positive, stable_study
from mcstudy.exits import Exit


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument("study", type=Path, help="study file (TOML)")
    add_unstable_argument(parser)
    parser.add_argument("--workers", type=positive, help="threads assumed; default one a core")


def main(args: argparse.Namespace) -> Exit:
    """Print the plan; returns the exit code."""
    study = stable_study(args)
    import mcstudy.study.run  # noqa: F401 - what a run imports is part of its time
    from mcstudy.study.cluster import ClusterOptions
    from mcstudy.study.plan import plan
    from mcstudy.study.progress import duration
    from mcstudy.study.unstable import warnings_of

    planned = plan(study, imports=time.process_time(), allow_unstable=args.allow_unstable)
    groups = planned.groups
    threads = ClusterOptions(workers=args.workers).threads
    width = max(len(g.name) for g in groups)
    print(f"study {study.study.name}, seed {study.study.seed}")
    for line in warnings_of(study):
        print(f"warning: {line}")
    print(f"{'group':<{width}}  {'fits':>10}  {'chunks':>7}  {'MB':>8}  {'CPU':>12}")
    for g in groups:
        print(f"{g.name:<{width}}  {g.fits:>10}  {g.chunks:>7}  {g.bytes / 1e6:>8.1f}  {duration(g.seconds):>12}")
    busy = f", {planned.slowdown:.1f} times as long as when it is idle" if planned.slowdown > 1.1 else ""
    print(
        f"in all {study.fits} fits, {planned.bytes / 1e6:.1f} MB, {duration(planned.cpu)} of CPU; about "
        f"{duration(planned.wall(threads))} on {threads} threads of this machine as it is now{busy}"
    )
    print("expected Monte Carlo standard error of a bias, % of the true value:")
    for g in groups:
        if not g.precision:
            print(f"{g.name:<{width}}  none: no noise")
        for p in g.precision:
            print(
                f"{g.name:<{width}}  amplitude {p.amplitude:g}, fmax {p.fmax:g} Hz: "
                f"{p.mean:.2g} on average, {p.largest:.2g} for {p.parameter}"
            )
    return Exit.DONE

"""``mcstudy status``: how far a results cube is."""

from __future__ import annotations

import argparse
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument("out", type=Path, help="results cube")
    parser.add_argument("--json", action="store_true", help="machine-readable")


def main(args: argparse.Namespace) -> int:
    """Print a table of fits by status; returns the exit code."""
    import json

    from mcstudy.cli import DONE, FITS_FAILED
    from mcstudy.fit.status import Status
    from mcstudy.study.failures import counts, failed_fits
    from mcstudy.study.store import Cube

    cube = Cube.open(args.out)
    by_group = {name: counts(store) for name, store in cube.groups.items()}
    failed = list(failed_fits(cube))
    if args.json:
        groups = {name: {s.name.lower(): c[s] for s in Status} for name, c in by_group.items()}
        print(json.dumps({"study": cube.study.study.name, "fingerprint": cube.study.fingerprint, "groups": groups}))
        return FITS_FAILED if failed else DONE
    print(f"{args.out}: study {cube.study.study.name}, seed {cube.study.study.seed}")
    print(f"fingerprint {cube.study.fingerprint}")
    shown = [s for s in Status if s is Status.PENDING or any(c[s] for c in by_group.values())]
    width = max(len(name) for name in by_group)
    print(" " * width + "".join(f"  {s.name.lower():>16}" for s in shown))
    for name, c in by_group.items():
        print(f"{name:<{width}}" + "".join(f"  {c[s]:>16}" for s in shown))
    for line in failed:
        print(f"failed fit: {line}")
    if any(c[Status.PENDING] for c in by_group.values()):
        print("not complete: run the study file again to resume")
    return FITS_FAILED if failed else DONE

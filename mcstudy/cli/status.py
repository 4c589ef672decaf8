"""``mcstudy status``: show the progress of a results cube, once or continuously."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from mcstudy.cli.options import seconds
from mcstudy.cli.terminal import print_json
from mcstudy.exits import Exit

if TYPE_CHECKING:
    from collections import Counter

    from mcstudy.fitting.status import Status
    from mcstudy.study.cube.store import Cube


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument("out", type=Path, help="results cube")
    how = parser.add_mutually_exclusive_group()
    how.add_argument("--json", action="store_true", help="print JSON (described in results_schema)")
    how.add_argument("--watch", action="store_true", help="follow a run from another terminal until it is complete")
    parser.add_argument(
        "--every", type=seconds, default=2.0, metavar="SECONDS", help="update interval of --watch (default 2)"
    )


def main(args: argparse.Namespace) -> Exit:
    """Print a table of fits by status; returns the exit code."""
    return _watch(args.out, max(args.every, 0.1)) if args.watch else _once(args.out, args.json)


def _once(path: Path, as_json: bool) -> Exit:
    from mcstudy.files.json_files import json_text
    from mcstudy.files.schema import identifier
    from mcstudy.fitting.status import Status
    from mcstudy.study.cube.replacement import settled
    from mcstudy.study.cube.store import Cube
    from mcstudy.study.failures import account
    from mcstudy.text_tables import table

    def looked_at() -> tuple[Cube, dict[str, Counter[Status]], list[str]]:
        cube = Cube.open(path)
        return cube, *account(cube)

    cube, by_group, failed = settled([path], looked_at)
    if as_json:
        groups = {name: {s.name.lower(): c[s] for s in Status} for name, c in by_group.items()}
        study, fingerprint = cube.study.study.name, cube.study.fingerprint
        document = {"schema": identifier("status"), "study": study, "fingerprint": fingerprint, "groups": groups}
        print_json(json_text(document, "status", "status"))
        return Exit.FITS_FAILED if failed else Exit.DONE
    print(f"{cube.path}: study {cube.study.study.name}, seed {cube.study.study.seed}")
    print(f"fingerprint {cube.study.fingerprint}")
    shown = [s for s in Status if s is Status.PENDING or any(c[s] for c in by_group.values())]
    header = ["", *(s.name.lower().replace("_", " ") for s in shown)]
    print(table(header, [[name, *(str(c[s]) for s in shown)] for name, c in by_group.items()]))
    for line in failed:
        print(f"failed fit: {line}")
    if any(c[Status.PENDING] for c in by_group.values()):
        print("not complete: repeat the run command to resume")
    return Exit.FITS_FAILED if failed else Exit.DONE


def _watch(path: Path, every: float) -> Exit:
    import sys

    from mcstudy.scheduler.display import Display
    from mcstudy.scheduler.progress import Speed, counts_line
    from mcstudy.scheduler.stopping import stop_requests
    from mcstudy.study.cube.replacement import settled, stamp
    from mcstudy.study.cube.store import Cube
    from mcstudy.study.watch import Watch

    watch, display, speed = Watch(Cube.open(path)), Display(sys.stdout), Speed()
    opened = stamp(path)
    with stop_requests() as stop:
        while not stop.is_set():
            watch.look()
            if opened != (opened := stamp(path)):  # a larger cube has taken its place
                watch, speed = Watch(settled([path], lambda: Cube.open(path))), Speed()
                continue
            cube, done = watch.cube, watch.done
            total = cube.study.fits
            speed.note(done)
            line = f"{watch.chunks_done}/{watch.chunks} chunks  {counts_line(done, total, watch.failed, speed.rate())}"
            lines = [f"{cube.path}: study {cube.study.study.name}", line, *watch.headlines()]
            if watch.unreadable:
                lines.append(f"{watch.unreadable} chunks are damaged or incomplete; list them with mcstudy verify")
            display.show(lines)
            if done >= total:
                return Exit.FITS_FAILED if watch.failed else Exit.DONE
            stop.wait(every)
    return Exit.DONE  # the run itself goes on

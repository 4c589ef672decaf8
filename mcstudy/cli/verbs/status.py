"""``mcstudy status``: show the progress of a results cube, once or continuously."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from mcstudy.cli.options import seconds
from mcstudy.cli.terminal import print_json
from mcstudy.exits import Exit

if TYPE_CHECKING:
    from mcstudy.cli.parser import Parser

TOPIC = "faults"


def add_arguments(parser: Parser) -> None:
    """Arguments of the verb."""
    parser.add_argument("out", type=Path, help="results cube")
    how = parser.add_alternatives()
    how.add_argument("--json", action="store_true", help="print JSON (described in results_schema)")
    how.add_argument("--watch", action="store_true", help="follow a run from another terminal until it is complete")
    parser.add_argument(
        "--every", type=seconds, default=2.0, metavar="SECONDS", help="update interval of --watch (default 2)"
    )


def main(args: argparse.Namespace) -> Exit:
    """Print a table of fits by status; returns the exit code."""
    return _watch(args.out, max(args.every, 0.1)) if args.watch else _once(args.out, args.json)


def _once(path: Path, as_json: bool) -> Exit:
    from mcstudy.api.cube_status import status
    from mcstudy.files.json_files import json_text
    from mcstudy.fitting.status import Status
    from mcstudy.text_tables import table

    now = status(path)
    if as_json:
        print_json(json_text(now.to_dict(), "status", "status"))
        return Exit.FITS_FAILED if now.failed else Exit.DONE
    print(f"{now.path}: study {now.study}, seed {now.seed}")
    print(f"fingerprint {now.fingerprint}")
    names = [s.name.lower() for s in Status]
    shown = [s for s in names if s == "pending" or any(counts[s] for counts in now.groups.values())]
    header = ["", *(s.replace("_", " ") for s in shown)]
    print(table(header, [[name, *(str(counts[s]) for s in shown)] for name, counts in now.groups.items()]))
    for line in now.failed:
        print(f"failed fit: {line}")
    if now.pending:
        print("not complete: repeat the run command to resume")
    return Exit.FITS_FAILED if now.failed else Exit.DONE


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

"""``mcstudy status``: show the progress of a results cube, once or continuously."""

from __future__ import annotations

import argparse
from pathlib import Path

from mcstudy.cli.options import seconds
from mcstudy.cli.terminal import print_json
from mcstudy.exits import Exit


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
    from mcstudy.api.cubes import status
    from mcstudy.files.json_files import json_text
    from mcstudy.text_tables import table

    found = status(path)
    if as_json:
        print_json(json_text(found.to_dict(), "status", "status"))
        return Exit.FITS_FAILED if found.failed else Exit.DONE
    print(f"{found.path}: study {found.study}, seed {found.seed}")
    print(f"fingerprint {found.fingerprint}")
    kinds = dict.fromkeys(kind for counts in found.groups.values() for kind in counts)
    shown = [k for k in kinds if k == "pending" or any(counts[k] for counts in found.groups.values())]
    rows = [[name, *(str(counts[k]) for k in shown)] for name, counts in found.groups.items()]
    print(table(["", *(k.replace("_", " ") for k in shown)], rows))
    for line in found.failed:
        print(f"failed fit: {line}")
    if not found.complete:
        print("not complete: repeat the run command to resume")
    return Exit.FITS_FAILED if found.failed else Exit.DONE


def _watch(path: Path, every: float) -> Exit:
    import sys

    from mcstudy.scheduler.display import Display
    from mcstudy.scheduler.progress import Speed, counts_line
    from mcstudy.scheduler.stopping import stop_requests
    from mcstudy.study.settled import settled, stamp
    from mcstudy.study.store import Cube
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

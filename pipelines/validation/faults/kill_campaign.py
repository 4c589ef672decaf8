"""Break runs at random moments, again and again, and count what is lost or wrong.

    python pipelines/validation/faults/kill_campaign.py --kills 100

A kill is SIGKILL to a real process: at a random moment, or before a random line of the code that writes files. After
each fault the cube on disk is compared with one that was never interrupted:

lost: a chunk that the log reports as complete and that is not, or a finished fit that was on disk at the look before;
wrong: whatever `verify` calls damage, a number that differs, or a completed cube with another SHA-256 of its tree.

Processes are forked from this one, with everything compiled, so that a hundred kills take minutes.
"""

from __future__ import annotations

import argparse
import asyncio
import itertools
import logging
import random
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import forked
import numpy as np
from distributed import Scheduler, Worker
from forked import DONE, MEMORY, REFUSED, STOPPED, DieAtLine, answer, ended, fork, kill

from mcstudy.files import durable
from mcstudy.files.durable import log_folder, tree_digest
from mcstudy.fitting.solvers import solvers
from mcstudy.fitting.status import Status
from mcstudy.scheduler.cluster import ClusterOptions
from mcstudy.study import extend, run, verify
from mcstudy.study.cube import layout, run_log, store
from mcstudy.study.cube.store import Cube, GroupStore
from mcstudy.study.execution import submission, tasks
from mcstudy.study.experiment import Experiment
from mcstudy.study.study_file import parse_study

STUDY = """
[study]
name = "campaign"
seed = 11

[group.noisy]
realizations = {realizations}
starts = 4
fmax = [0.41]
amplitude = [3.0, 5.0]
"""

REALIZATIONS = 16
"""Of a study before it is extended by half; the tests take fewer, for the same code runs then."""
ONE = ClusterOptions(workers=1)

WRITERS = {m.__file__ for m in (durable, extend, run, run_log, store, submission, tasks)} | {__file__}
"""Source files between whose lines a process dies: whatever decides what is written when."""

KILLS = "kill -9: "


class Campaign:
    """Counts of one campaign, by fault."""

    def __init__(self, folder: Path, seed: int, realizations: int = REALIZATIONS) -> None:
        self.realizations, more = realizations, realizations * 3 // 2
        self.study, larger = (parse_study(STUDY.format(realizations=n)) for n in (realizations, more))
        self.folder, self.random, self.out = folder, random.Random(seed), folder / "out.zarr"
        self.tried: Counter[str] = Counter()
        self.lost: Counter[str] = Counter()
        self.wrong: Counter[str] = Counter()
        self.seen: dict[str, int] = {}
        group = self.study.groups["noisy"]
        compiled = GroupStore(folder, "noisy", Experiment(group, self.study.study.seed), 1, self.study.fingerprint)
        first = layout.Chunk(0, 0)
        tasks.fill(compiled.experiment, compiled.layout, first, compiled.layout.empty(first))
        self.small, self.large = folder / "small.zarr", folder / "large.zarr"
        for study, path in ((self.study, self.small), (larger, self.large)):
            shutil.rmtree(Cube.create(path, study).path)  # Zarr makes the files of an empty cube once, before any fork
            begun = time.monotonic()
            assert ended(fork(partial(run.run_study, study, path, ONE))) == DONE
            self.seconds = time.monotonic() - begun
        self.small_run = partial(run.run_study, self.study, self.out, ONE)
        self.extension = partial(extend.extend, self.out, extend.Growth(realizations=more), ONE)
        self.lines: dict[Callable[[], object], list[tuple[str, int, int]]] = {}

    def ask(self, work: Callable[[], object]) -> Any:
        """What ``work`` returns, computed in a process of its own."""
        return answer(work, self.folder / "answer.json")

    def look_at_lines(self, *works: Callable[[], object]) -> None:
        """Which lines a run or its extension executes, and how often; before any death at a line."""
        for work in works:
            self.begin()
            if work is self.extension:
                shutil.copytree(self.small, self.out)
            self.lines[work] = self.ask(partial(self.count_lines, work))
        self.begin()

    def count_lines(self, work: Callable[[], object]) -> list[tuple[str, int, int]]:
        with DieAtLine(WRITERS) as counted:
            work()
        return [(*place, n) for place, n in sorted(counted.reached.items())]

    def begin(self) -> None:
        """Throw the cube away."""
        for path in (self.out, log_folder(self.out), *self.folder.glob(".out.zarr.*")):
            shutil.rmtree(path, ignore_errors=True)
        self.seen = {}

    def moment(self) -> float:
        """Seconds into a run."""
        return self.random.uniform(0.0, self.seconds)

    def look(self, fault: str) -> None:
        """Compare an unfinished cube with the whole one, and with what was there before."""
        self.tried[fault] += 1
        lost, wrong, self.seen = self.ask(partial(self.compare, dict(self.seen)))
        self.lost[fault] += lost
        self.wrong[fault] += wrong

    def compare(self, seen: dict[str, int]) -> tuple[int, int, dict[str, int]]:
        """Lost, wrong, and the number of finished fits by chunk."""
        durable.recover(self.out)
        if not self.out.exists():
            return len(seen), 0, {}
        cube, done_now = Cube.open(self.out), {}
        wrong = len(verify.verify(self.out, cells=0).damage)
        (whole,) = Cube.open(self.large).groups.values()
        (mine,) = cube.groups.values()
        reported = run_log.reported(self.out, cube.study.fingerprint)
        lost = 0
        for chunk in mine.layout.chunks:
            data = mine.existing(chunk)
            done = data["status"] != Status.PENDING
            for r, realization in enumerate(mine.layout.realizations(chunk)):
                block, at = divmod(realization, whole.layout.realizations_a_chunk)
                same = whole.existing(layout.Chunk(chunk.amplitude, block))
                cell = f"{chunk.amplitude}/{realization}"
                done_now[cell] = int(done[0, :, r].sum())
                lost += done_now[cell] < seen.get(cell, 0)
                lost += ("noisy", chunk.amplitude, chunk.block) in reported and not done[0, :, r].all()
                if not done_now[cell]:
                    continue
                for name in mine.layout.results:
                    if "fmax" in mine.layout.arrays[name].dims:
                        a, b = data[name][0, :, r][done[0, :, r]], same[name][0, :, at][done[0, :, r]]
                    else:
                        a, b = data[name][0, r], same[name][0, at]
                    wrong += not np.array_equal(a, b, equal_nan=a.dtype.kind in "fc")
        return int(lost), wrong, done_now

    def finish(self, fault: str, work: Callable[[], object], whole: Path) -> None:
        """Let it run to its end and compare the bytes."""
        assert ended(fork(work)) == DONE
        self.wrong[fault] += tree_digest(self.out) != tree_digest(whole)
        self.begin()

    def at_random(self, fault: str, work: Callable[[], object], whole: Path) -> None:
        """Start, kill at a random moment, look; go on from there, or finish and compare."""
        child = fork(work)
        time.sleep(self.moment())
        if kill(child):
            self.look(fault)
        if self.random.random() < 0.3:
            self.finish(fault, work, whole)

    def at_a_line(self, fault: str, work: Callable[[], object], whole: Path) -> None:
        """Die before a random line of what writes; half of the time with a write after every fit.

        Half of the time every line is as likely, half of the time every one of the times it is reached.
        """
        lines = self.lines[work]
        by_visit = self.random.random() < 0.5
        weights = [often if by_visit else 1 for *_, often in lines]
        ((file, line, often),) = self.random.choices(lines, weights)
        at = (file, line, self.random.randint(1, often))
        pauses = self.random.choice((0.0, tasks.CHECKPOINT_S))

        def dying() -> None:
            tasks.CHECKPOINT_S = pauses
            solvers()["lm"] = replace(solvers()["lm"], starts_a_call=1)
            with DieAtLine(WRITERS, at):
                work()

        if ended(fork(dying)) == -signal.SIGKILL:
            self.look(fault)
        if self.random.random() < 0.3:
            self.finish(fault, work, whole)

    def extending(self, kill_it: Callable[[str, Callable[[], object], Path], None], fault: str) -> None:
        """A finished cube that grows."""
        self.begin()
        shutil.copytree(self.small, self.out)
        self.seen = {f"{a}/{r}": 4 for a in range(2) for r in range(self.realizations)}
        kill_it(fault, self.extension, self.large)
        self.begin()

    def interrupted(self) -> None:
        """Ctrl-C or SIGTERM at a random moment: the run ends by itself, resumable."""
        fault = "Ctrl-C or SIGTERM"
        child = fork(self.small_run)
        time.sleep(self.moment())
        if kill(child, self.random.choice((signal.SIGINT, signal.SIGTERM))):
            assert ended(child) in (DONE, STOPPED, -signal.SIGTERM)
        self.look(fault)
        if self.random.random() < 0.3:
            self.finish(fault, self.small_run, self.small)

    def full_disk(self) -> None:
        """No space left from a random write on."""
        count, write = iter(range(self.random.randrange(1, 150))), durable.write

        def full(path: Path, content: bytes | memoryview) -> None:
            if next(count, None) is None:
                raise OSError(28, "No space left on device")
            write(path, content)

        def work() -> None:
            durable.write = full
            self.small_run()

        assert ended(fork(work)) in (DONE, STOPPED, REFUSED)
        self.look("disk full")
        if self.random.random() < 0.3:
            self.finish("disk full", self.small_run, self.small)

    def damaged(self) -> None:
        """A file of a finished cube flipped, cut or deleted: `verify` names it, and `run` repairs it."""
        fault = "file damaged"
        self.begin()
        shutil.copytree(self.small, self.out)
        shutil.copytree(log_folder(self.small), log_folder(self.out))
        file = self.random.choice(sorted(p for p in self.out.rglob("*") if p.is_file()))
        content = bytearray(file.read_bytes())
        how = self.random.choice(("flip", "cut", "delete"))
        if how == "delete":
            file.unlink()
        elif how == "cut":
            file.write_bytes(content[: self.random.randrange(len(content))])
        else:
            content[self.random.randrange(len(content))] ^= 1 << self.random.randrange(8)
            file.write_bytes(content)
        self.tried[fault] += 1
        if file != self.out / "zarr.json":  # without it there is no study to compare with, which `verify` says
            found = self.ask(lambda: verify.verify(self.out, cells=0).damage)
            self.wrong[fault] += not any(str(file) in line for line in found)
        self.finish(fault, self.small_run, self.small)

    def cluster(self, fault: str) -> None:
        """A worker, all workers, or the scheduler of a cluster, killed under a run; workers are replaced."""
        self.begin()
        place = self.folder / "address"
        place.unlink(missing_ok=True)
        scheduler = fork(lambda: asyncio.run(_scheduler(place)))
        while not place.exists() or not place.read_text():
            time.sleep(0.01)
        address = place.read_text()
        workers = [fork(lambda: asyncio.run(_worker(address))) for _ in range(2)]
        child = fork(lambda: run.run_study(self.study, self.out, ClusterOptions(scheduler=address), 1))
        time.sleep(self.random.uniform(0.3, 1.0) * self.seconds)
        victims = {"one worker": workers[:1], "all workers": workers, "the scheduler": [scheduler]}[fault]
        for victim in victims:
            kill(victim)
        if fault == "the scheduler":
            # Killed before the run had reached it, it is a wrong address instead, and refused.
            assert ended(child) in (DONE, STOPPED, forked.BROKEN)
            for worker in workers:
                kill(worker)
            self.look(KILLS + fault)
            self.finish(KILLS + fault, self.small_run, self.small)
        else:
            self.tried[KILLS + fault] += 1
            workers += [fork(lambda: asyncio.run(_worker(address))) for _ in victims]
            assert ended(child) == DONE
            self.wrong[KILLS + fault] += tree_digest(self.out) != tree_digest(self.small)
        for process in (*workers, scheduler):
            kill(process)

    def run(self, kills: int, only: str) -> None:
        """Faults in turn until so many kills have hit."""
        turns: list[tuple[str, Callable[[], object]]] = []
        for where, how in (("any moment", self.at_random), ("between two lines that write", self.at_a_line)):
            turns += 3 * [(f"{KILLS}run, {where}", partial(how, f"{KILLS}run, {where}", self.small_run, self.small))]
            fault = f"{KILLS}extend, {where}"
            turns += [(fault, partial(self.extending, how, fault))]
        turns += [(KILLS + w, partial(self.cluster, w)) for w in ("one worker", "all workers", "the scheduler")]
        others = {"Ctrl-C or SIGTERM": self.interrupted, "disk full": self.full_disk, "file damaged": self.damaged}
        turns += others.items()
        for name, turn in itertools.cycle([t for t in turns if only in t[0]]):
            if sum(n for fault, n in self.tried.items() if fault.startswith(KILLS) or only) >= kills:
                return
            turn()
            print(f"{sum(self.tried.values())} faults: {name}", file=sys.stderr, flush=True)

    def table(self) -> str:
        """``fault | tried | lost | wrong`` as Markdown."""
        rows = ["| fault | tried | lost | wrong |", "|---|---:|---:|---:|"]
        rows += [f"| {f} | {n} | {self.lost[f]} | {self.wrong[f]} |" for f, n in sorted(self.tried.items())]
        total = [sum(c.values()) for c in (self.tried, self.lost, self.wrong)]
        return "\n".join([*rows, "| **all** | {} | {} | {} |".format(*total)])


async def _scheduler(place: Path) -> None:
    async with Scheduler(host="127.0.0.1", port=0, dashboard=False) as scheduler:
        place.write_text(scheduler.address)
        await scheduler.finished()


async def _worker(address: str) -> None:
    async with Worker(address, nthreads=1, dashboard=False, memory_limit=0) as worker:
        await worker.finished()


def main() -> int:
    """Run a campaign; 0 when nothing was lost or wrong."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--realizations", type=int, default=REALIZATIONS, help="of the study; default 16")
    parser.add_argument("--only", default="", help="faults whose name contains this; --kills then counts those")
    args = parser.parse_args()
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    solvers()["lm"] = replace(solvers()["lm"], fits_a_chunk=(8, 8))
    with tempfile.TemporaryDirectory(dir=MEMORY) as folder:
        campaign = Campaign(Path(folder), args.seed, args.realizations)
        try:
            campaign.look_at_lines(campaign.small_run, campaign.extension)
            campaign.run(args.kills, args.only)
        finally:
            forked.kill_all()
            print(campaign.table(), flush=True)
    return int(any(campaign.lost.values()) or any(campaign.wrong.values()))


if __name__ == "__main__":
    sys.exit(main())

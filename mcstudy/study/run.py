"""Running a study: what is pending is submitted block by block, and every block is on disk when it is reported done.

Only a window of blocks is in the scheduler's hands at any time, so a study of any size costs the same memory, and a
stop leaves little to wait for.
"""

from __future__ import annotations

import contextlib
import math
import queue
import signal
import threading
import time
import uuid
from collections import Counter, deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from distributed import Client, Future

from mcstudy.errors import Interrupted, StudyChangedError
from mcstudy.fit.status import Status
from mcstudy.study import environment, study_file
from mcstudy.study.cluster import ClusterOptions, connect, dashboard_url
from mcstudy.study.design import Study
from mcstudy.study.durable import locked, sweep
from mcstudy.study.layout import Chunk, Layout
from mcstudy.study.progress import Progress
from mcstudy.study.runlog import RunLog
from mcstudy.study.store import Cube
from mcstudy.study.tasks import STOP, Report, Task, run_task

ATTEMPTS = 3
"""Times a block is tried before it is reported as failed."""

FITS_A_BLOCK = {"lm": 2000}
"""Fits that make about half a second of work; SciPy's solvers get one chunk a block."""

WINDOW = 3
"""Blocks in the scheduler's hands per thread: one running, and enough waiting that no thread idles."""

COUNT_WORKERS_S = 2.0

DRAIN_S = 1.5
"""How long a stopped run waits for blocks to write what they have."""


@dataclass
class Outcome:
    """What a run did.

    Attributes
    ----------
    path: the cube.
    fits: fits run now; seconds: time they took.
    skipped: fits that earlier runs had done.
    counts: fits run now, by `Status` value.
    failed_blocks: blocks given up, with the reason.
    """

    path: Path
    fits: int = 0
    skipped: int = 0
    seconds: float = 0.0
    counts: Counter[int] = field(default_factory=Counter)
    failed_blocks: list[str] = field(default_factory=list)

    @property
    def failed_fits(self) -> int:
        """Fits run now that ended without a usable result."""
        return sum(n for status, n in self.counts.items() if not Status(status).usable)


@dataclass(frozen=True)
class Block:
    """Pending chunks of one group that make one task."""

    group: str
    chunks: tuple[Chunk, ...]
    fits: int

    def __str__(self) -> str:
        names = ", ".join(f"amplitude {c.amplitude} realizations {c.block}" for c in self.chunks[:3])
        return f"group {self.group}, {names}{' ...' if len(self.chunks) > 3 else ''}"


def default_out(study: Study) -> Path:
    """Where a study's cube goes when nothing is said."""
    return Path("results") / f"{study.study.name}.zarr"


def open_or_create(path: Path, study: Study) -> Cube:
    """The cube at ``path`` for ``study``; raises `StudyChangedError` when it belongs to another one."""
    if not path.exists():
        return Cube.create(path, study)
    cube = Cube.open(path)
    if cube.study.fingerprint != study.fingerprint:
        changed = study_file.changes(cube.study, study)
        more = f"; and {len(changed) - 5} more" if len(changed) > 5 else ""
        raise StudyChangedError(
            f"{path}: belongs to another study file; expected no change, found {'; '.join(changed[:5])}{more}"
        )
    return cube


def run_study(study: Study, out: Path, options: ClusterOptions | None = None, block: int | None = None) -> Outcome:
    """Run everything that is pending of ``study`` in the cube ``out``.

    Parameters
    ----------
    study: a resolved study (`mcstudy.study.study_file.read_study`).
    out: path of the cube; made if it does not exist, resumed if it does.
    options: where to run.
    block: chunks a block; by default enough for about half a second.

    Raises
    ------
    StudyChangedError: the cube belongs to another study.
    StoreError: the cube cannot be used, or another run holds it.
    Interrupted: stopped by Ctrl-C, SIGTERM, or a disk that could not be written; the same call resumes.
    """
    options, out = options or ClusterOptions(), out.resolve()
    run = uuid.uuid4().hex[:12]
    with locked(out):
        if out.exists():
            sweep(out)
        cube = open_or_create(out, study)
        log, here = RunLog(out, run), environment.environment()
        outcome = Outcome(out)
        blocks = list(pending_blocks(cube, options.threads, block))
        total = sum(b.fits for b in blocks)
        outcome.skipped = study.fits - total
        progress = Progress(total)
        log.add("begin", environment=here, pending_fits=total, threads=options.threads)
        for line in environment.differences(cube.attributes["environment"], here) if total else ():
            progress.say(f"warning: the cube was made in another environment: {line}")
        if blocks:
            with _stop_requests(run) as stop, connect(options) as client:
                remote = options.scheduler is not None
                if options.dashboard and not remote:
                    progress.say(f"dashboard: {dashboard_url(client)}")
                _Submission(cube, client, stop, run, log, progress, outcome, remote).run(deque(blocks))
        outcome.seconds = progress.seconds
        log.add("end", fits=outcome.fits, seconds=round(outcome.seconds, 3), failed_blocks=outcome.failed_blocks)
    return outcome


def pending_blocks(cube: Cube, threads: int, per_block: int | None) -> Iterator[Block]:
    """Everything still to run, in the order of the study file."""
    for name, store in cube.groups.items():
        pending = {chunk: n for chunk in store.layout.chunks if (n := store.pending(chunk))}
        chunks = list(pending)
        size = per_block or _chunks_a_block(store.layout, len(chunks), threads)
        for k in range(0, len(chunks), size):
            part = tuple(chunks[k : k + size])
            yield Block(name, part, sum(pending[c] for c in part))


def _chunks_a_block(layout: Layout, chunks: int, threads: int) -> int:
    wanted = FITS_A_BLOCK.get(layout.group.fit.solver, 0) // max(1, layout.fits(Chunk(0, 0)))
    return max(1, min(wanted, chunks // (8 * threads)))  # enough blocks that threads finish together


@contextlib.contextmanager
def _stop_requests(run: str) -> Iterator[threading.Event]:
    """An event that Ctrl-C or SIGTERM sets; a second one ends the process at once."""
    stop = STOP[run] = threading.Event()

    def handle(*_: Any) -> None:
        if stop.is_set():
            raise KeyboardInterrupt
        stop.set()

    in_main = threading.current_thread() is threading.main_thread()
    previous = {s: signal.signal(s, handle) for s in (signal.SIGINT, signal.SIGTERM)} if in_main else {}
    try:
        yield stop
    finally:
        for number, old in previous.items():
            signal.signal(number, old)
        del STOP[run]


class _Submission:
    """The window of blocks of one run."""

    def __init__(
        self,
        cube: Cube,
        client: Client,
        stop: threading.Event,
        run: str,
        log: RunLog,
        progress: Progress,
        outcome: Outcome,
        remote: bool,
    ) -> None:
        self.cube, self.client, self.stop, self.id = cube, client, stop, run
        self.log, self.progress, self.outcome = log, progress, outcome
        self.study = cube.study.to_json()
        self.finished: queue.SimpleQueue[Future] = queue.SimpleQueue()
        self.running: dict[Future, Block] = {}
        self.attempts: Counter[Block] = Counter()
        self.remote = remote
        self.counted, self.threads = -math.inf, 1

    def run(self, waiting: deque[Block]) -> None:
        """Submit and collect until nothing is left; raises `Interrupted` when stopped."""
        while (waiting or self.running) and not self.stop.is_set():
            window = self._window()
            while waiting and len(self.running) < window:
                self._submit(waiting.popleft())
            with contextlib.suppress(queue.Empty):
                self._collect(self.finished.get(timeout=0.2), waiting)
            self.progress.show()
        if self.stop.is_set():
            self._drain()
        self.progress.show(last=True)
        if self.stop.is_set():
            left = self.progress.total - self.progress.done
            self.log.add("interrupted", fits=self.outcome.fits, left=left)
            raise Interrupted(f"{self.cube.path}: stopped with {left} fits left; run the same command again to resume")

    def _window(self) -> int:
        """Blocks to keep in the scheduler's hands; workers come and go, so they are counted again now and then."""
        now = time.monotonic()
        if now > self.counted + COUNT_WORKERS_S:
            self.counted, self.threads = now, max(1, sum(self.client.nthreads().values()))
        return WINDOW * self.threads

    def _submit(self, block: Block) -> None:
        task = Task(self.id, str(self.cube.path), self.study, block.group, self.cube.depths[block.group], block.chunks)
        self.attempts[block] += 1
        first = block.chunks[0]
        key = f"mcstudy-{self.id}-{block.group}-{first.amplitude}.{first.block}-{self.attempts[block]}"
        future = self.client.submit(run_task, task, key=key, pure=False, retries=0)
        self.running[future] = block
        future.add_done_callback(self.finished.put)

    def _collect(self, future: Future, waiting: deque[Block]) -> None:
        block = self.running.pop(future)
        try:
            report: Report = future.result()
        except Exception as error:  # whatever a block raises is an outcome of that block, not of the run
            self._failed(block, error, waiting)
            return
        finally:
            future.release()
        failed = sum(n for status, n in report.counts.items() if not Status(status).usable)
        self.outcome.fits += report.fits
        self.outcome.counts.update(report.counts)
        self.progress.add(report.fits, failed)
        chunks = [[c.amplitude, c.block] for c in block.chunks]
        self.log.add("block", group=block.group, chunks=chunks, fits=report.fits, seconds=round(report.seconds, 3))

    def _failed(self, block: Block, error: Exception, waiting: deque[Block]) -> None:
        reason = " ".join(f"{type(error).__name__}: {error}".split())[:300]
        self.log.add("block_failed", group=block.group, attempt=self.attempts[block], reason=reason)
        if isinstance(error, OSError):
            # The disk, not the block: trying others would only repeat it.
            self.stop.set()
            raise Interrupted(
                f"{self.cube.path}: expected a store that can be written ({error.strerror or error}); "
                "run the same command again to resume"
            )
        if self.attempts[block] < ATTEMPTS:
            waiting.append(block)
        else:
            self.outcome.failed_blocks.append(f"{block}: {reason}")
            self.progress.say(f"block given up after {ATTEMPTS} attempts: {block}: {reason}")

    def _drain(self) -> None:
        """Let running blocks write what they have; those on other machines finish, or do not, without us."""
        self.progress.say("stopping: writing what is finished (Ctrl-C again to leave at once)")
        if self.remote:
            self.client.cancel(list(self.running))
            return
        end = time.monotonic() + DRAIN_S
        nothing: deque[Block] = deque()
        while self.running and (left := end - time.monotonic()) > 0:
            with contextlib.suppress(queue.Empty):
                self._collect(self.finished.get(timeout=left), nothing)

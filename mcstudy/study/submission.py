"""The blocks of one run on a scheduler: a window of them in flight, each with its attempts, its time and its suspects.

- A block that raises is tried `ATTEMPTS` times.
- A block whose worker dies is given to another one. When its workers keep dying it is set aside and run alone at the
  end, so that blocks that were merely nearby finish; one that still kills its workers is given up.
- A block that runs longer than the time limit is taken away, its worker restarted (a local one replaced).
"""

from __future__ import annotations

import contextlib
import math
import queue
import threading
import time
from collections import Counter, deque
from concurrent.futures import CancelledError
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from distributed import Client, Future
from distributed.comm import CommClosedError
from distributed.scheduler import KilledWorker

from mcstudy.errors import Interrupted
from mcstudy.fit.status import Status
from mcstudy.study import environment
from mcstudy.study.attempt import Attempt, Failure, attempt, topic
from mcstudy.study.cluster import Capacity, ClusterOptions, more_threads, restart_worker
from mcstudy.study.layout import Chunk
from mcstudy.study.progress import Progress
from mcstudy.study.runlog import RunLog
from mcstudy.study.store import Cube
from mcstudy.study.tasks import Report, Task

ATTEMPTS = 3
"""Times a block that raises is tried before it is reported as failed."""

STARTS = 3
"""Starts of a block at which it is set aside, or given up when it was alone: its worker died every time before."""

TIMED_OUT = 2
"""Times a block may run out of time: a second chance on another worker, no more, since each costs the whole limit."""

WINDOW = 3
"""Blocks in the scheduler's hands per thread: one running, and enough waiting that no thread idles."""

DRAIN_S = 1.0
"""How long a stopped run waits for blocks to write what they have; with all before and after it, under 2 s."""


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


@dataclass
class _Flight:
    """A block in the scheduler's hands: when it last started, where, and how often."""

    block: Block
    alone: bool
    began: float = math.inf
    worker: str = ""
    starts: int = 0


def how_far(path: Path, progress: Progress, why: str = "stopped") -> str:
    """What a run says that ended before its time."""
    return f"{path}: {why} with {progress.total - progress.done} fits left; run the same command again to resume"


class Submission:
    """Runs blocks of a cube with a client; see the module."""

    def __init__(
        self,
        cube: Cube,
        client: Client,
        options: ClusterOptions,
        stop: threading.Event,
        run: str,
        log: RunLog,
        progress: Progress,
        outcome: Outcome,
    ) -> None:
        self.cube, self.client, self.options, self.stop, self.id = cube, client, options, stop, run
        self.log, self.progress, self.outcome = log, progress, outcome
        self.study = cube.study.to_json()
        self.finished: queue.SimpleQueue[Future] = queue.SimpleQueue()
        self.started: queue.SimpleQueue[dict[str, str]] = queue.SimpleQueue()
        self.running: dict[Future, _Flight] = {}
        self.waiting: deque[Block] = deque()
        self.suspects: deque[Block] = deque()
        self.attempts: Counter[Block] = Counter()
        self.failures: Counter[Block] = Counter()
        self.timeouts: Counter[Block] = Counter()
        self.doubtful: list[Block] = []
        self.given_up: set[Block] = set()
        self.capacity = Capacity(client, progress.say)
        self.warned: set[str] = set()
        client.subscribe_topic(topic(run), lambda event: self.started.put(event[1]))

    def run(self, blocks: deque[Block]) -> list[Block]:
        """Submit and collect until nothing is left; raises `Interrupted` when stopped.

        Returns the blocks that more than one worker had in hands, whose files deserve a second look.
        """
        self.waiting, self.doubtful = blocks, []
        while (self.waiting or self.running or self.suspects) and not self.stop.is_set():
            window = WINDOW * self.capacity.threads()
            while self.waiting and len(self.running) < window:
                self._submit(self.waiting.popleft())
            if self.suspects and not self.running:
                self._submit(self.suspects.popleft(), alone=True)
            with contextlib.suppress(queue.Empty):
                self._collect(self.finished.get(timeout=0.2))
            self._watch()
            self.progress.show()
        if self.stop.is_set():
            self._drain()
        self.progress.show(last=True)
        if self.stop.is_set():
            raise self._interrupted("stopped")
        return [block for block in dict.fromkeys(self.doubtful) if block not in self.given_up]

    def _interrupted(self, why: str) -> Interrupted:
        left = self.progress.total - self.progress.done
        self.log.add("interrupted", why=why, fits=self.outcome.fits, left=left)
        return Interrupted(how_far(self.cube.path, self.progress, why))

    def _submit(self, block: Block, alone: bool = False) -> None:
        task = Task(self.id, str(self.cube.path), self.study, block.group, self.cube.depths[block.group], block.chunks)
        self.attempts[block] += 1
        first = block.chunks[0]
        key = f"mcstudy-{self.id}-{block.group}-{first.amplitude}.{first.block}-{self.attempts[block]}"
        future = self.client.submit(attempt, task, key, key=key, pure=False, retries=0)
        self.running[future] = _Flight(block, alone)
        future.add_done_callback(self.finished.put)

    def _collect(self, future: Future) -> None:
        flight = self.running.pop(future, None)
        if flight is None:
            return  # taken away before
        block = flight.block
        if flight.starts > 1 or self.attempts[block] > 1:
            self.doubtful.append(block)
        try:
            result: Attempt = future.result()
        except (CancelledError, CommClosedError):  # nobody else cancels what is running
            raise self._interrupted("the scheduler was lost") from None
        except KilledWorker as error:
            self._killer(flight, str(error))
            return
        except Exception as error:  # what came back is no `Attempt`: it could not be sent, or not be read
            self._failed(block, Failure(f"{type(error).__name__}: {error}"[:300], None))
            return
        finally:
            future.release()
        if isinstance(result.ended, Failure):
            self._failed(block, result.ended)
        else:
            self._done(block, result.ended, result.environment)

    def _done(self, block: Block, report: Report, place: dict[str, Any]) -> None:
        counts = self._counts(block, report)
        failed = sum(n for status, n in counts.items() if not Status(status).usable)
        self.outcome.fits += counts.total()
        self.outcome.counts.update(counts)
        self.progress.add(counts.total(), failed)
        differ = environment.differences(self.cube.attributes["environment"], place)
        for line in differ:
            if line not in self.warned:
                self.warned.add(line)
                self.progress.say(f"warning: blocks run in another environment than the cube was made in: {line}")
        self.log.add(
            "block",
            group=block.group,
            chunks=[[c.amplitude, c.block] for c in block.chunks],
            fits=report.fits,
            complete=report.complete,
            checksums=True,
            seconds=round(report.seconds, 3),
            **({"other_environment": differ} if differ else {}),
        )

    def _counts(self, block: Block, report: Report) -> Counter[int]:
        """Fits of a block by status, also those whose report was lost with the worker that ran them."""
        if report.complete and report.fits < block.fits:
            store, found = self.cube.groups[block.group], Counter[int]()
            for chunk in block.chunks:
                found.update(store.read("status", chunk).ravel().tolist())
            if found.total() == block.fits:  # else some are of an earlier run, and cannot be told apart
                return found
        return report.counts

    def _failed(self, block: Block, failure: Failure) -> None:
        self.failures[block] += 1
        self.log.add("block_failed", group=block.group, attempt=self.failures[block], reason=failure.reason)
        if failure.disk is not None:
            # The disk, not the block: trying others would only repeat it.
            self.stop.set()
            raise Interrupted(
                f"{self.cube.path}: expected a store that can be written ({failure.disk}); "
                "run the same command again to resume"
            )
        if self.failures[block] < ATTEMPTS:
            self.waiting.append(block)
        else:
            self._give_up(block, f"after {ATTEMPTS} attempts", failure.reason)

    def _give_up(self, block: Block, when: str, reason: str) -> None:
        self.given_up.add(block)
        self.outcome.failed_blocks.append(f"{block}: {reason}")
        self.log.add("block_given_up", group=block.group, reason=reason)
        self.progress.say(f"block given up {when}: {block}: {reason}")

    def _killer(self, flight: _Flight, reason: str) -> None:
        """A block whose workers keep dying: to be run alone, or given up when it was."""
        self.log.add("workers_died", group=flight.block.group, alone=flight.alone, reason=reason[:300])
        if flight.alone:
            self._give_up(flight.block, "since every worker that runs it dies", "its workers died")
        else:
            self.suspects.append(flight.block)

    def _watch(self) -> None:
        """Notice which blocks started, which ran out of time or of workers, and whether the scheduler is there."""
        if self.client.status != "running":
            raise self._interrupted("the scheduler was lost")
        flights = {future.key: (future, flight) for future, flight in self.running.items()}
        with contextlib.suppress(queue.Empty):
            while True:
                event = self.started.get_nowait()
                if event["key"] in flights:
                    _, flight = flights[event["key"]]
                    flight.began, flight.worker = time.monotonic(), event["worker"]
                    flight.starts += 1
        limit = self.options.block_timeout or math.inf
        for future, flight in flights.values():
            if flight.starts >= STARTS:
                self._take_away(future)
                self._killer(flight, f"{flight.starts - 1} workers died")
            elif time.monotonic() > flight.began + limit:
                self._take_away(future)
                self._hung(flight, limit)

    def _take_away(self, future: Future) -> None:
        self.doubtful.append(self.running.pop(future).block)
        future.cancel(force=True)
        future.release()

    def _hung(self, flight: _Flight, limit: float) -> None:
        block, reason = flight.block, f"ran longer than {limit:g} s"
        self.timeouts[block] += 1
        self.log.add("block_timeout", group=block.group, attempt=self.timeouts[block], reason=reason)
        if self.options.scheduler is None:
            more_threads(self.client)
        else:
            restart_worker(self.client, flight.worker)
        if self.timeouts[block] < TIMED_OUT:
            self.suspects.append(block)  # at the end, so that a hang costs the others least
        else:
            self._give_up(block, f"after {TIMED_OUT} attempts", reason)

    def _drain(self) -> None:
        """Let running blocks write what they have; those on other machines finish, or do not, without us."""
        self.progress.say("stopping: writing what is finished (Ctrl-C again to leave at once)")
        if self.options.scheduler is not None:
            self.client.cancel(list(self.running))
            return
        end = time.monotonic() + DRAIN_S
        while self.running and (left := end - time.monotonic()) > 0:
            with contextlib.suppress(queue.Empty):
                self._collect(self.finished.get(timeout=left))

"""Submission of the blocks of one run to a scheduler, with retries and time limits; few blocks are in flight at a time.

- A block that raises an exception is tried `ATTEMPTS` times.
- A block whose worker dies is given to another worker. If its workers keep dying, it is set aside and run alone at the
  end, so that blocks on the same workers can finish. A block that then still kills its workers is given up.
- A worker in another environment than this process computes a sample of fits of each group first. It is refused if the
  bits differ.
- A block that runs longer than the time limit is cancelled and its worker restarted (a local worker is replaced).
"""

from __future__ import annotations

import contextlib
import math
import queue
import threading
import time
from collections import Counter, defaultdict, deque
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from distributed import Client, Future
from distributed.scheduler import KilledWorker

from mcstudy.errors import Interrupted
from mcstudy.files.plain_errors import short
from mcstudy.fitting.status import Status
from mcstudy.scheduler.cluster import ClusterOptions, dismiss_worker, replace_thread, restart_worker
from mcstudy.scheduler.compiling import compile_kernels
from mcstudy.scheduler.progress import Progress
from mcstudy.scheduler.window import Window
from mcstudy.study import environment
from mcstudy.study.cube.layout import Chunk
from mcstudy.study.cube.repair import note_environment
from mcstudy.study.cube.run_log import RunLog
from mcstudy.study.cube.store import Cube
from mcstudy.study.execution import trust
from mcstudy.study.execution.attempt import Attempt, Failure, Trusted, Unlike, attempt, topic
from mcstudy.study.execution.tasks import Task, TaskReport
from mcstudy.study.kernels import parts_of

ATTEMPTS = 3
"""Number of attempts for a block that raises an exception, before it is reported as failed."""

STARTS = 3
"""Number of starts after which a block whose workers died is set aside or, if it ran alone, given up."""

TIMED_OUT = 2
"""Number of attempts for a block that exceeds the time limit: two, because each costs the whole limit."""

REFUSALS = 10
"""Number of refused workers after which a run stops: those that replace them are probably refused too."""

DRAIN_S = 1.0
"""Seconds that a stopped run waits for blocks to write their results; the whole exit takes less than 2 s."""


@dataclass
class Outcome:
    """Summary of a run.

    Attributes
    ----------
    path: the cube.
    fits: number of fits in this run; seconds: time they took.
    skipped: number of fits done by earlier runs, or not needed.
    not_needed: number of starts that this run left out, because those before them sufficed.
    counts: starts of this run by `Status` value.
    failed_blocks: blocks given up, with the reason.
    """

    path: Path
    fits: int = 0
    skipped: int = 0
    not_needed: int = 0
    seconds: float = 0.0
    counts: Counter[int] = field(default_factory=Counter)
    failed_blocks: list[str] = field(default_factory=list)

    @property
    def failed_fits(self) -> int:
        """Fits of this run that ended without a usable result."""
        return sum(n for status, n in self.counts.items() if Status(status).failed)


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
class _History:
    """What has happened to a block: how often it was submitted, failed and ran out of time, and what came of it."""

    attempts: int = 0
    failures: int = 0
    timeouts: int = 0
    doubtful: bool = False
    given_up: bool = False


@dataclass(frozen=True)
class Run:
    """One call of `run_study`: its name, who stops it, and where it tells what happens."""

    id: str
    stop: threading.Event
    log: RunLog
    progress: Progress
    outcome: Outcome


@dataclass
class _Flight:
    """A submitted block: when it last started, on which worker, and how often."""

    block: Block
    alone: bool
    began: float = math.inf
    worker: str = ""
    starts: int = 0


class Submission:
    """Runs blocks of a cube with a Dask client; see the module."""

    def __init__(self, cube: Cube, client: Client, options: ClusterOptions, run: Run) -> None:
        self.cube, self.client, self.options, self.id = cube, client, options, run.id
        self.stop, self.log, self.progress, self.outcome = run.stop, run.log, run.progress, run.outcome
        self.study = cube.study.to_json()
        self.started: queue.SimpleQueue[dict[str, str]] = queue.SimpleQueue()
        self.window = Window[_Flight](client, run.progress.say, self._interrupted)
        self.waiting: deque[Block] = deque()
        self.suspects: deque[Block] = deque()
        self.history: defaultdict[Block, _History] = defaultdict(_History)
        self.lost_threads: Counter[str] = Counter()
        self.warned: set[str] = set()
        self.trusted = Trusted(environment.environment(), environment.label(cube.attributes["environment"]))
        self.refused: set[str] = set()
        client.subscribe_topic(topic(run.id), lambda event: self.started.put(event[1]))

    def run(self, blocks: deque[Block]) -> list[Block]:
        """Submit and collect until all blocks are done; raises `Interrupted` when stopped.

        Returns the blocks that more than one worker may have run; their files must be checked again.
        """
        self.waiting = blocks
        for past in self.history.values():
            past.doubtful = False
        while (self.waiting or self.window.running or self.suspects) and not self.stop.is_set():
            while self.waiting and self.window.has_room():
                self._submit(self.waiting.popleft())
            if self.suspects and not self.window.running:
                self._submit(self.suspects.popleft(), alone=True)
            if ended := self.window.ended():
                self._collect(*ended)
            self._watch()
            self.progress.show()
        if self.stop.is_set():
            self._drain()
        self.progress.show(last=True)
        if self.stop.is_set():
            raise self._interrupted("stopped")
        return [block for block, past in self.history.items() if past.doubtful and not past.given_up]

    def _interrupted(self, why: str) -> Interrupted:
        left = self.progress.total - self.progress.done
        self.log.add("interrupted", why=why, fits=self.outcome.fits, left=left)
        return Interrupted(self.progress.how_far(self.cube.path, why))

    def _submit(self, block: Block, alone: bool = False) -> None:
        depth = self.cube.depths[block.group]
        task = Task(self.id, str(self.cube.path), self.study, block.group, depth, block.chunks)
        self.history[block].attempts += 1
        first, attempts = block.chunks[0], self.history[block].attempts
        key = f"mcstudy-{self.id}-{block.group}-{first.amplitude}.{first.block}-{attempts}"
        self.window.submit(_Flight(block, alone), attempt, task, key, self.trusted, key=key)

    def _collect(self, flight: _Flight, future: Future) -> None:
        block = flight.block
        past = self.history[block]
        past.doubtful |= flight.starts > 1 or past.attempts > 1
        try:
            result = self.window.result(future)
        except Interrupted:
            raise
        except KilledWorker as error:
            self._killer(flight, str(error))
            return
        except Exception as error:  # the result is no `Attempt`: it could not be sent or read
            reason = " ".join(f"{type(error).__name__}: {error}".split())
            self._failed(block, Failure(reason[:300], None))
            return
        match result:
            case Attempt(ended=Failure() as failure):
                self._failed(block, failure)
            case Attempt(ended=Unlike() as unlike):
                self._unlike(flight, result, unlike)
            case Attempt(ended=TaskReport() as report):
                self._done(block, report, result.environment)
            case _:
                self._failed(block, Failure(f"its worker returned no report but {short(result)}", None))

    def _done(self, block: Block, report: TaskReport, place: dict[str, Any]) -> None:
        store = self.cube.groups[block.group]
        if report.complete and not all(store.annotated(chunk) for chunk in block.chunks):
            self.history[block].doubtful = True  # its worker writes elsewhere, or a shared file system shows it later
        counts = self._counts(block, report)
        failed = sum(n for status, n in counts.items() if Status(status).failed)
        self.outcome.fits += counts.total() - counts[Status.NOT_NEEDED]
        self.outcome.not_needed += counts[Status.NOT_NEEDED]
        self.outcome.counts.update(counts)
        self.progress.add(counts.total(), failed, len(block.chunks) if report.complete else 0)
        differ = environment.differences(self.cube.attributes["environment"], place)
        if differ and (said := "; ".join(differ)) not in self.warned:
            self.warned.add(said)
            self.progress.say(f"warning: workers of another environment than the cube's have written to it: {said}")
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

    def _unlike(self, flight: _Flight, result: Attempt, unlike: Unlike) -> None:
        """Trust a worker of another environment whose sample of a group has the same bits; refuse it otherwise."""
        (self.suspects if flight.alone else self.waiting).append(flight.block)
        group = flight.block.group
        who = environment.label(result.environment), group
        if who in self.trusted.agreed or result.worker in self.refused:
            return
        differ = "; ".join(environment.differences(self.trusted.own, result.environment))
        experiment = self.cube.groups[group].experiment
        compile_kernels(parts_of([experiment.group]), self.stop)
        same = unlike.sample == trust.sample(experiment)
        self.log.add("other_environment", differ=differ, group=group, same_sample=same, environment=result.environment)
        if same:
            note_environment(self.cube, result.environment)
            self.trusted = replace(self.trusted, agreed=self.trusted.agreed | {who})
            self.progress.say(
                f"workers of another environment agree in a sample of {trust.fits(experiment.group)} fits of group "
                f"{group} (their chunks name it): {differ}"
            )
            return
        self.refused.add(result.worker)
        why = "their fits have other bits" if unlike.sample else "they run other source code"
        self.progress.say(f"worker {result.worker} refused, because {why}: {differ}")
        if len(self.refused) >= REFUSALS:
            raise self._interrupted(f"stopped after {REFUSALS} workers were refused, because {why} ({differ}),")
        dismiss_worker(self.client, result.worker)

    def _counts(self, block: Block, report: TaskReport) -> Counter[int]:
        """Fits of a block by status, including those whose report was lost with the worker that ran them."""
        if report.complete and report.fits < block.fits:
            store, found = self.cube.groups[block.group], Counter[int]()
            for chunk in block.chunks:
                found.update(store.read("status", chunk).ravel().tolist())
            if found.total() == block.fits:  # otherwise some are of an earlier run and cannot be distinguished
                return found
        return report.counts

    def _failed(self, block: Block, failure: Failure) -> None:
        past = self.history[block]
        past.failures += 1
        self.log.add("block_failed", group=block.group, attempt=past.failures, reason=failure.reason)
        if failure.disk is not None:
            # The disk has failed, not the block: other blocks would fail too.
            self.stop.set()
            raise Interrupted(
                f"{self.cube.path}: expected a store that can be written ({failure.disk}); "
                "run the same command again to resume"
            )
        if past.failures < ATTEMPTS:
            self.waiting.append(block)
        else:
            self._give_up(block, f"after {ATTEMPTS} attempts", failure.reason)

    def _give_up(self, block: Block, when: str, reason: str) -> None:
        self.history[block].given_up = True
        self.outcome.failed_blocks.append(f"{block}: {reason}")
        self.log.add("block_given_up", group=block.group, reason=reason)
        self.progress.say(f"block given up {when}: {block}: {reason}")

    def _killer(self, flight: _Flight, reason: str) -> None:
        """Handle a block whose workers keep dying: run it alone later, or give it up if it ran alone."""
        self.log.add("workers_died", group=flight.block.group, alone=flight.alone, reason=reason[:300])
        if flight.alone:
            self._give_up(flight.block, "because every worker that runs it dies", "its workers died")
        else:
            self.suspects.append(flight.block)

    def _watch(self) -> None:
        """Notice which blocks started, which ran out of time or of workers, and whether the scheduler is there."""
        self.window.check()
        flights = {future.key: (future, flight) for future, flight in self.window.running.items()}
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
        self.history[self.window.take_back(future).block].doubtful = True

    def _hung(self, flight: _Flight, limit: float) -> None:
        block, reason = flight.block, f"ran longer than {limit:g} s"
        past = self.history[block]
        past.timeouts += 1
        self.log.add("block_timeout", group=block.group, attempt=past.timeouts, reason=reason)
        if self.options.here:
            self.lost_threads[flight.worker] += 1
            replace_thread(self.client, flight.worker, self.lost_threads[flight.worker])
        else:
            restart_worker(self.client, flight.worker)
        if past.timeouts < TIMED_OUT:
            self.suspects.append(block)  # at the end, so that a hang delays the other blocks least
        else:
            self._give_up(block, f"after {TIMED_OUT} attempts", reason)

    def _drain(self) -> None:
        """Let running blocks write their results; blocks on other machines end on their own."""
        self.progress.say("stopping: writing finished fits (press Ctrl-C again to quit at once)")
        if not self.options.here:
            self.client.cancel(list(self.window.running))
            return
        end = time.monotonic() + DRAIN_S
        while self.window.running and (left := end - time.monotonic()) > 0:
            if ended := self.window.ended(left):
                self._collect(*ended)

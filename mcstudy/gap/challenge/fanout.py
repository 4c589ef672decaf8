"""One function over many items on the scheduler of the studies: a window at a time, results as they come."""

from __future__ import annotations

import queue
import threading
import uuid
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from typing import Any, TypeVar

import dask.array  # noqa: F401  # xarray imports it on first use, which two threads must not do at once
from distributed import KilledWorker
from distributed.comm import CommClosedError

from mcstudy.errors import Interrupted
from mcstudy.study.cluster import Capacity, ClusterOptions, connect, dashboard_url
from mcstudy.study.progress import Progress
from mcstudy.study.stopping import stop_requests

Item = TypeVar("Item")

WINDOW = 3
"""Items in the scheduler's hands per thread."""

PROCESS = uuid.uuid4().hex
"""Tells an item whether it runs in the process that asked for it."""


class Counting(Progress):
    """Progress in cases."""

    def line(self) -> str:
        """The present state in one line."""
        return super().line().replace(" fits", " cases")


class _Local:
    """Items of one fan-out that the threads of this process are at; none begins once it is closed.

    The scheduler leaves its threads to themselves when it closes. One that is still computing when the interpreter
    goes takes the process down with it: it may be inside compiled code that cannot be left.
    """

    def __init__(self) -> None:
        self._busy, self._closed, self._changed = 0, False, threading.Condition()

    def begin(self) -> bool:
        """Whether one more item may begin."""
        with self._changed:
            self._busy += not self._closed
            return not self._closed

    def end(self) -> None:
        """One item is done."""
        with self._changed:
            self._busy -= 1
            self._changed.notify_all()

    def close(self) -> None:
        """No more items."""
        with self._changed:
            self._closed = True

    def wait(self, seconds: float) -> int:
        """Items that are still busy, after waiting for them for a while."""
        with self._changed:
            self._changed.wait_for(lambda: not self._busy, seconds)
            return self._busy


_LOCAL: dict[str, _Local] = {}


def _one(process: str, fan: str, work: Callable[[Item], Any], item: Item) -> Any:
    """One item; None when it runs in the process that asked for it and that wants no more."""
    if process != PROCESS:
        return work(item)
    local = _LOCAL.get(fan)
    if local is None or not local.begin():
        return None
    try:
        return work(item)
    finally:
        local.end()


def fan_out(
    work: Callable[[Item], Any], items: Sequence[Item], options: ClusterOptions, what: str
) -> Iterator[tuple[Item, Any]]:
    """Yield (item, result) in the order of completion; ``work`` must not raise for what concerns one item only.

    Raises whatever ``work`` raises, once the items that are being worked on in this process have ended, and
    `Interrupted` at once on Ctrl-C, SIGTERM, SIGHUP, a lost scheduler or an item that kills its workers: what was
    yielded is for the caller to keep.
    """
    if not items:
        return
    progress = Counting(len(items))
    finished: queue.SimpleQueue[Any] = queue.SimpleQueue()
    fan, local, left = uuid.uuid4().hex, _Local(), len(items)

    def how_far(why: str = "stopped") -> str:
        return f"{what}: {why} with {left} cases left; run the same command again to resume"

    with stop_requests(how_far) as stop, connect(options) as client:
        if options.dashboard and options.scheduler is None:
            progress.say(f"dashboard: {dashboard_url(client)}")
        running: dict[Any, Item] = {}
        waiting = iter(items)
        capacity = Capacity(client, progress.say)
        _LOCAL[fan] = local
        try:
            while left:
                if stop.is_set():
                    raise Interrupted(how_far())
                if client.status != "running":
                    raise Interrupted(how_far("the scheduler was lost"))
                while len(running) < WINDOW * capacity.threads() and (item := next(waiting, None)) is not None:
                    future = client.submit(_one, PROCESS, fan, work, item, pure=False, retries=0)
                    running[future] = item
                    future.add_done_callback(finished.put)
                progress.show()
                try:
                    future = finished.get(timeout=0.2)
                except queue.Empty:
                    continue
                item = running.pop(future)
                try:
                    result = future.result()
                except (CancelledError, CommClosedError):  # nobody else cancels what is running
                    raise Interrupted(how_far("the scheduler was lost")) from None
                except KilledWorker as error:
                    raise Interrupted(how_far(f"workers kept dying ({error})")) from None
                future.release()
                left -= 1
                progress.add(1, 0)
                yield item, result
            progress.show(last=True)
        except (Interrupted, KeyboardInterrupt):
            raise
        except BaseException as error:
            local.close()
            if busy := local.wait(1.0):
                progress.say(f"waiting for {busy} cases that are being worked on (Ctrl-C stops at once)")
            while local.wait(0.2):
                if stop.is_set() and not isinstance(error, GeneratorExit):
                    raise Interrupted(how_far()) from None
            raise
        finally:
            local.close()
            del _LOCAL[fan]

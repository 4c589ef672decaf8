"""One function over many items on the scheduler of the studies: a window at a time, results as they come."""

from __future__ import annotations

import queue
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from typing import Any, TypeVar

import dask.array  # noqa: F401  # xarray imports it on first use, which two threads must not do at once
from distributed import KilledWorker

from mcstudy.errors import Interrupted
from mcstudy.study.cluster import Capacity, ClusterOptions, connect, dashboard_url
from mcstudy.study.progress import Progress
from mcstudy.study.stopping import stop_requests

Item = TypeVar("Item")

WINDOW = 3
"""Items in the scheduler's hands per thread."""


class Counting(Progress):
    """Progress in cases."""

    def line(self) -> str:
        """The present state in one line."""
        return super().line().replace(" fits", " cases")


def fan_out(
    work: Callable[[Item], Any], items: Sequence[Item], options: ClusterOptions, what: str
) -> Iterator[tuple[Item, Any]]:
    """Yield (item, result) in the order of completion; ``work`` must not raise for what concerns one item only.

    Raises whatever ``work`` raises, and `Interrupted` on Ctrl-C, SIGTERM, SIGHUP, a lost scheduler or an item that
    kills its workers: what was yielded is for the caller to keep.
    """
    if not items:
        return
    progress = Counting(len(items))
    finished: queue.SimpleQueue[Any] = queue.SimpleQueue()
    left = len(items)

    def how_far(why: str = "stopped") -> str:
        return f"{what}: {why} with {left} cases left; run the same command again to resume"

    with stop_requests(how_far) as stop, connect(options) as client:
        if options.dashboard and options.scheduler is None:
            progress.say(f"dashboard: {dashboard_url(client)}")
        running: dict[Any, Item] = {}
        waiting = iter(items)
        capacity = Capacity(client, progress.say)
        while left:
            if stop.is_set():
                raise Interrupted(how_far())
            if client.status != "running":
                raise Interrupted(how_far("the scheduler was lost"))
            while len(running) < WINDOW * capacity.threads() and (item := next(waiting, None)) is not None:
                future = client.submit(work, item, pure=False, retries=0)
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
            except CancelledError:
                raise Interrupted(how_far("the scheduler was lost")) from None  # nobody else cancels what is running
            except KilledWorker as error:
                raise Interrupted(how_far(f"workers kept dying ({error})")) from None
            future.release()
            left -= 1
            progress.add(1, 0)
            yield item, result
        progress.show(last=True)

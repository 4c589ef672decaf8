"""One function over many items on the scheduler of the studies: a window at a time, results as they come."""

from __future__ import annotations

import queue
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeVar

import dask.array  # noqa: F401  # xarray imports it on first use, which two threads must not do at once

from mcstudy.errors import Interrupted
from mcstudy.study.cluster import ClusterOptions, connect
from mcstudy.study.progress import Progress
from mcstudy.study.stopping import stop_requests

Item = TypeVar("Item")

WINDOW = 3
"""Items in the scheduler's hands per thread."""

COUNT_S = 2.0
"""How often the scheduler's threads are counted: workers come and go."""


class Counting(Progress):
    """Progress in cases."""

    def line(self) -> str:
        """The present state in one line."""
        return super().line().replace(" fits", " cases")


def fan_out(
    work: Callable[[Item], Any], items: Sequence[Item], options: ClusterOptions, what: str
) -> Iterator[tuple[Item, Any]]:
    """Yield (item, result) in the order of completion; ``work`` must not raise for what concerns one item only.

    Raises whatever ``work`` raises, and `Interrupted` on Ctrl-C or SIGTERM: what was yielded is for the caller to keep.
    """
    if not items:
        return
    progress = Counting(len(items))
    finished: queue.SimpleQueue[Any] = queue.SimpleQueue()
    with stop_requests() as stop, connect(options) as client:
        running: dict[Any, Item] = {}
        waiting = iter(items)
        left, counted, threads = len(items), -COUNT_S, 1
        while left:
            if stop.is_set():
                raise Interrupted(f"{what}: stopped with {left} cases left; run the same command again to resume")
            if time.monotonic() > counted + COUNT_S:
                counted, threads = time.monotonic(), max(1, sum(client.nthreads().values()))
            while len(running) < WINDOW * threads and (item := next(waiting, None)) is not None:
                future = client.submit(work, item, pure=False, retries=0)
                running[future] = item
                future.add_done_callback(finished.put)
            progress.show()
            try:
                future = finished.get(timeout=0.2)
            except queue.Empty:
                continue
            item = running.pop(future)
            result = future.result()
            future.release()
            left -= 1
            progress.add(1, 0)
            yield item, result
        progress.show(last=True)

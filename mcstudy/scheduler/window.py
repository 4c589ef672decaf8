"""A window of items in a scheduler's hands: as many as keep its threads busy, handed back in the order of completion.

Only a window is out at any time, so work of any length costs the same memory, and a stop leaves little to wait for.
"""

from __future__ import annotations

import queue
from collections.abc import Callable
from concurrent.futures import CancelledError
from typing import Any, Generic, TypeVar

from distributed import Client, Future
from distributed.comm import CommClosedError

from mcstudy.errors import Interrupted
from mcstudy.scheduler.cluster import Capacity

Item = TypeVar("Item")

PER_THREAD = 3
"""Items in the scheduler's hands per thread: one running, and enough waiting that no thread idles."""

LOOK_S = 0.2
"""Longest wait for a result before stop requests and the scheduler are looked at again."""


class Window(Generic[Item]):
    """Items that a client's scheduler is at.

    Parameters
    ----------
    client: where to submit.
    say: told when there are no workers.
    interrupted: what to raise when the scheduler is lost, made of the reason.

    Attributes
    ----------
    running: the item of every future that is out.
    """

    def __init__(self, client: Client, say: Callable[[str], None], interrupted: Callable[[str], Interrupted]) -> None:
        self.running: dict[Future, Item] = {}
        self._client, self._capacity, self._interrupted = client, Capacity(client, say), interrupted
        self._ended: queue.SimpleQueue[Future] = queue.SimpleQueue()

    def has_room(self) -> bool:
        """Whether one more item may go out; counts the scheduler's threads now and then."""
        return len(self.running) < PER_THREAD * self._capacity.threads()

    def submit(self, item: Item, function: Callable[..., Any], *args: Any, key: str | None = None) -> None:
        """Have ``function(*args)`` run for an item, once: what fails is the caller's to try again."""
        future = self._client.submit(function, *args, key=key, pure=False, retries=0)
        self.running[future] = item
        future.add_done_callback(self._ended.put)

    def ended(self, seconds: float = LOOK_S) -> tuple[Item, Future] | None:
        """The next item that ended, with its future for `result`; None when none did within ``seconds``."""
        try:
            future: Future | None = self._ended.get(timeout=seconds)
        except queue.Empty:
            # Without memory for one more thread, Dask forgets to say that a future has ended.
            future = next((future for future in self.running if future.done()), None)
            if future is None:
                return None
        return (self.running.pop(future), future) if future in self.running else None  # else taken back before

    def result(self, future: Future) -> Any:
        """The result of a future that ended, which is released.

        Raises `Interrupted` when it went with the scheduler, `distributed.KilledWorker` when its workers kept dying,
        and whatever the function raised.
        """
        try:
            return future.result()
        except (CancelledError, CommClosedError):  # nobody else cancels what is running
            raise self._lost() from None
        finally:
            future.release()

    def take_back(self, future: Future) -> Item:
        """The item of a future that is out and is waited for no longer."""
        item = self.running.pop(future)
        future.cancel(force=True)
        future.release()
        return item

    def check(self) -> None:
        """Raises `Interrupted` when the scheduler is gone."""
        if self._client.status != "running":
            raise self._lost()

    def _lost(self) -> Interrupted:
        return self._interrupted("lost connection to the scheduler")

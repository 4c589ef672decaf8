"""Apply one function to many items on the scheduler: few items in flight at a time, results in order of completion."""

from __future__ import annotations

import threading
import uuid
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any

import dask.array  # noqa: F401  # xarray imports it on first use, which two threads must not do at once
from distributed import Future, KilledWorker

from mcstudy import program
from mcstudy.errors import InputError, Interrupted, Stopped
from mcstudy.scheduler.cluster import ClusterOptions, connect
from mcstudy.scheduler.progress import Progress
from mcstudy.scheduler.stopping import stop_requests
from mcstudy.scheduler.window import Item, Window

PROCESS = uuid.uuid4().hex
"""Identifies the process that submitted an item."""


class _Local:
    """Items that threads of this process are working on; no item begins after `close`.

    The scheduler does not wait for its threads when it closes. A thread that is still computing when the interpreter
    ends crashes the process, because it may be inside compiled code that cannot be interrupted.
    """

    def __init__(self) -> None:
        self._busy, self._closed, self._changed = 0, False, threading.Condition()

    def begin(self) -> bool:
        """Return whether one more item may begin."""
        with self._changed:
            self._busy += not self._closed
            return not self._closed

    def end(self) -> None:
        """One item is done."""
        with self._changed:
            self._busy -= 1
            self._changed.notify_all()

    def close(self) -> None:
        """Let no further item begin."""
        with self._changed:
            self._closed = True

    def wait(self, seconds: float) -> int:
        """Wait for a while; return the number of items still in progress."""
        with self._changed:
            self._changed.wait_for(lambda: not self._busy, seconds)
            return self._busy


_LOCAL: dict[str, _Local] = {}


def _one(process: str, made_by: dict[str, Any], fan: str, work: Callable[[Item], Any], item: Item) -> Any:
    """Result of one item; None when the process that submitted it runs it and has been told to stop.

    Raises `InputError` in a worker that runs another program than ``made_by``: its results would pass for those of it.
    """
    if process != PROCESS:
        if why := program.other_maker(program.maker(*program.attached(work)), made_by):
            raise InputError(f"worker: expected the program that submits the work; its results would be {why}")
        return work(item)
    local = _LOCAL.get(fan)
    if local is None or not local.begin():
        return None
    try:
        return work(item)
    finally:
        local.end()


def _result(window: Window[Item], future: Future, interrupted: Callable[[str], Interrupted]) -> Any:
    try:
        return window.result(future)
    except KilledWorker as error:
        raise interrupted(f"workers kept dying ({error})") from None


def fan_out(
    work: Callable[[Item], Any],
    items: Sequence[Item],
    options: ClusterOptions,
    what: str,
    *,
    unit: str = "cases",
    resumes: bool = True,
) -> Iterator[tuple[Item, Any]]:
    """Yield (item, result) in the order of completion; ``work`` must return, not raise, failures of a single item.

    ``unit``: what the items are called. ``resumes``: whether the caller stores results, so that the same call resumes.

    Raises `InputError` if a worker runs another program, and whatever ``work`` raises, after the items in progress in
    this process have ended. Raises `Interrupted` at once on Ctrl-C, SIGTERM, SIGHUP, a lost scheduler, or an item that
    kills its workers, `Stopped` if the call does not resume. The caller keeps what was yielded until then.
    """
    if not items:
        return
    progress = Progress(len(items), unit=unit)
    fan, local, made_by = uuid.uuid4().hex, _Local(), program.maker(*program.attached(work))

    def interrupted(why: str) -> Interrupted:
        return (Interrupted if resumes else Stopped)(progress.how_far(what, why, resumes))

    with (
        stop_requests(partial(progress.how_far, what) if resumes else None) as stop,
        connect(options, progress.say) as client,
    ):
        window = Window[Item](client, progress.say, interrupted)
        waiting = iter(items)
        _LOCAL[fan] = local
        try:
            while progress.done < len(items):
                if stop.is_set():
                    raise interrupted("stopped")
                window.check()
                while window.has_room() and (item := next(waiting, None)) is not None:
                    window.submit(item, _one, PROCESS, made_by, fan, work, item)
                progress.show()
                if not (ended := window.ended()):
                    continue
                item, future = ended
                result = _result(window, future, interrupted)
                progress.add(1, 0)
                yield item, result
            progress.show(last=True)
        except (Interrupted, KeyboardInterrupt):
            raise
        except BaseException as error:
            local.close()
            if busy := local.wait(1.0):
                progress.say(f"waiting for {busy} {unit} in progress (press Ctrl-C to quit at once)")
            while local.wait(0.2):
                if stop.is_set() and not isinstance(error, GeneratorExit):
                    raise interrupted("stopped") from None
            raise
        finally:
            local.close()
            del _LOCAL[fan]

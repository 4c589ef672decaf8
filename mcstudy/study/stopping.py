"""Ctrl-C, SIGTERM and SIGHUP as an event that work looks at between its steps.

Inside somebody's program or notebook the signals are ours only while there is such work. The command line owns them
from its first line to its last (`mcstudy.cli.stop`) and sets the same events.
"""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@dataclass(eq=False)
class StopRequest:
    """Work that can be stopped: ``event`` asks it to, ``words`` says how far it is when it did not stop in time."""

    event: threading.Event = field(default_factory=threading.Event)
    words: Callable[[], str] | None = None


_open: list[StopRequest] = []
_owned = threading.Event()


def own_signals() -> None:
    """From now on nobody but the caller, who calls `request_stop`, listens to signals."""
    _owned.set()


def request_stop() -> list[StopRequest]:
    """Ask all work that can be stopped to stop; returns it."""
    asked = list(_open)
    for request in asked:
        request.event.set()
    return asked


def heeded(sign: signal.Signals) -> bool:
    """Whether a signal is not ignored: what ``nohup`` or a shell in the background ignores stays ignored."""
    return signal.getsignal(sign) is not signal.SIG_IGN


@contextlib.contextmanager
def stop_requests(words: Callable[[], str] | None = None) -> Iterator[threading.Event]:
    """An event that Ctrl-C, SIGTERM or SIGHUP sets; a second one does not wait for the work to end."""
    request = StopRequest(words=words)

    def handle(*_: Any) -> None:
        if request.event.is_set():
            raise KeyboardInterrupt
        request.event.set()

    listen = not _owned.is_set() and threading.current_thread() is threading.main_thread()
    previous = {sign: signal.signal(sign, handle) for sign in SIGNALS if heeded(sign)} if listen else {}
    _open.append(request)
    try:
        yield request.event
    finally:
        _open.remove(request)
        for sign, old in previous.items():
            signal.signal(sign, old)

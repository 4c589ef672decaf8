"""Ctrl-C, SIGTERM and SIGHUP set an event that running work checks between its steps.

Inside a user's program or notebook, the signals are handled here only while such work runs. The command line handles
them during its whole run (`mcstudy.cli.stop`) and sets the same events.
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
    """Work that can be stopped: ``event`` asks it to stop; ``words`` gives its message if it does not stop in time."""

    event: threading.Event = field(default_factory=threading.Event)
    words: Callable[[], str] | None = None


_open: list[StopRequest] = []
_owned = threading.Event()


def own_signals() -> None:
    """Leave all signals to the caller from now on; the caller uses `request_stop`."""
    _owned.set()


def request_stop() -> list[StopRequest]:
    """Ask all running work to stop; return that work."""
    asked = list(_open)
    for request in asked:
        request.event.set()
    return asked


def heeded(sign: signal.Signals) -> bool:
    """Whether a signal is handled; signals ignored because of ``nohup`` or a background shell stay ignored."""
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

"""One line on the terminal about what is being done, once that takes more than a moment."""

from __future__ import annotations

import contextlib
import sys
import threading
import time
from collections.abc import Iterator

from mcstudy.scheduler.companion import beside
from mcstudy.scheduler.display import Display
from mcstudy.scheduler.progress import duration

SILENT_S = 2.0
"""Seconds without a line: what is done by then needs none.

CPU seconds of the process so far count among them: it was silent while it loaded its libraries.
"""

SHORTEST_S = 0.2
"""Seconds that any activity takes at least before it shows a line."""

EVERY_S = 0.5

_now: list[str] = []


def doing(what: str) -> None:
    """Say what is done from now on; without effect outside `activity`."""
    if _now:
        _now[-1] = what


def current() -> str | None:
    """What `activity` shows; None outside it."""
    return _now[-1] if _now else None


@contextlib.contextmanager
def activity(what: str) -> Iterator[None]:
    """Show what is being done, and for how long, on stderr if that is a terminal; the line goes away at the end."""
    if sys.stderr is None or not sys.stderr.isatty():
        yield
        return
    display = Display(sys.stderr)
    _now.append(what)

    def show(ended: threading.Event) -> None:
        begun = time.monotonic()
        pause = max(SILENT_S - time.process_time(), SHORTEST_S)
        while not ended.wait(pause):
            display.show([f"{_now[-1]} ... {duration(time.monotonic() - begun)}"])
            pause = EVERY_S
        display.clear()

    try:
        with beside(show, "mcstudy-activity"):
            yield
    finally:
        _now.pop()

"""How far a run is, on stderr: one line that changes on a terminal, now and then a plain line otherwise."""

from __future__ import annotations

import sys
import time
from typing import TextIO

PLAIN_EVERY_S = 10.0
TERMINAL_EVERY_S = 0.2


def duration(seconds: float) -> str:
    """``seconds`` for people: 42 s, 3 min 20 s, 5 h 12 min."""
    s = max(0, round(seconds))
    if s < 60:
        return f"{s} s"
    if s < 3600:
        return f"{s // 60} min {s % 60:02d} s"
    return f"{s // 3600} h {s % 3600 // 60:02d} min"


class Progress:
    """Counts fits and shows them.

    Parameters
    ----------
    total: fits this run is to do.
    stream: where to write.
    """

    def __init__(self, total: int, stream: TextIO | None = None) -> None:
        self.total, self.done, self.failed = total, 0, 0
        self._stream = stream or sys.stderr
        self._terminal = self._stream.isatty()
        self._begun = self._shown = time.monotonic()

    @property
    def seconds(self) -> float:
        """Seconds since the start."""
        return time.monotonic() - self._begun

    def line(self) -> str:
        """The present state in one line."""
        seconds = self.seconds
        rate = self.done / seconds if seconds > 0 else 0.0
        left = duration((self.total - self.done) / rate) if rate > 0 else "unknown"
        share = 100 * self.done / self.total if self.total else 100.0
        return f"{self.done}/{self.total} fits ({share:.0f} %)  {rate:.0f} fits/s  {left} left  {self.failed} failed"

    def add(self, done: int, failed: int) -> None:
        """Count more fits."""
        self.done, self.failed = self.done + done, self.failed + failed

    def show(self, last: bool = False) -> None:
        """Show the line when it is due, or for the last time."""
        now = time.monotonic()
        if not last and now - self._shown < (TERMINAL_EVERY_S if self._terminal else PLAIN_EVERY_S):
            return
        self._shown = now
        if self._terminal:
            print(f"\r\033[K{self.line()}", end="\n" if last else "", file=self._stream, flush=True)
        else:
            print(self.line(), file=self._stream, flush=True)

    def say(self, message: str) -> None:
        """Show a message of its own."""
        print(f"\r\033[K{message}" if self._terminal else message, file=self._stream, flush=True)

"""How far a run is: blocks, fits, speed, time left, failures, and what the results say so far with its error."""

from __future__ import annotations

import time
from typing import TextIO

from mcstudy.study.display import Display
from mcstudy.study.watch import Watch

LOOK_EVERY_S = 2.0
"""How often results are looked at."""

LOOK_SHARE = 0.02
"""Part of the time that may be spent on looking at results."""


def duration(seconds: float) -> str:
    """``seconds`` for people: 42 s, 3 min 20 s, 5 h 12 min."""
    s = max(0, round(seconds))
    if s < 60:
        return f"{s} s"
    if s < 3600:
        return f"{s // 60} min {s % 60:02d} s"
    return f"{s // 3600} h {s % 3600 // 60:02d} min"


def fits_line(done: int, total: int, failed: int, rate: float) -> str:
    """``done/total fits``, share, fits/s, time left, failures."""
    left = duration((total - done) / rate) if rate > 0 else "unknown"
    share = 100 * done / total if total else 100.0
    return f"{done}/{total} fits ({share:.0f} %)  {rate:.0f} fits/s  {left} left  {failed} failed"


class Progress:
    """Counts fits and shows them.

    Parameters
    ----------
    total: fits this run is to do. stream: where to write; by default stderr or the notebook's cell.
    blocks: blocks this run is to do. watch: the cube's results; without them only counts are shown.
    """

    def __init__(
        self, total: int, stream: TextIO | None = None, *, blocks: int = 0, watch: Watch | None = None
    ) -> None:
        self.total, self.done, self.failed = total, 0, 0
        self.blocks, self.blocks_done = blocks, 0
        self._watch, self._display = watch, Display(stream)
        self._begun = self._looked = time.monotonic()

    @property
    def seconds(self) -> float:
        """Seconds since the start."""
        return time.monotonic() - self._begun

    def line(self) -> str:
        """The present state in one line."""
        seconds = self.seconds
        rate = self.done / seconds if seconds > 0 else 0.0
        blocks = f"{self.blocks_done}/{self.blocks} blocks  " if self.blocks else ""
        return blocks + fits_line(self.done, self.total, self.failed, rate)

    def add(self, done: int, failed: int) -> None:
        """Count the fits of one more block."""
        self.done, self.failed = self.done + done, self.failed + failed
        self.blocks_done += 1

    def show(self, last: bool = False) -> None:
        """Show the state when it is due, or for the last time."""
        if last or self._display.due():
            self._display.show([self.line(), *self._headlines()])

    def say(self, message: str) -> None:
        """Show a message of its own."""
        self._display.say(message)

    def _headlines(self) -> list[str]:
        if self._watch is None:
            return []
        now = time.monotonic()
        if now > self._looked + LOOK_EVERY_S:
            self._watch.look(LOOK_SHARE * (now - self._looked))
            self._looked = now
        return self._watch.headlines()

"""Progress of a run: blocks, fits or other units, speed, time left, failures, and the results so far."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TextIO

from mcstudy.scheduler.display import Display

LOOK_EVERY_S = 2.0
"""Seconds between two looks at the results."""

LOOK_SHARE = 0.02
"""Largest fraction of the time spent on looking at the results."""


def duration(seconds: float) -> str:
    """``seconds`` as text: 42 s, 3 min 20 s, 5 h 12 min."""
    s = max(0, round(seconds))
    if s < 60:
        return f"{s} s"
    if s < 3600:
        return f"{s // 60} min {s % 60:02d} s"
    return f"{s // 3600} h {s % 3600 // 60:02d} min"


def counts_line(done: int, total: int, failed: int, rate: float, unit: str = "fits") -> str:
    """``done/total`` of a unit, percentage, speed (units/s), time left, failures."""
    left = f"{duration((total - done) / rate)} left" if rate > 0 else "time left: estimating"
    share = 100 * done / total if total else 100.0
    return f"{done}/{total} {unit} ({share:.0f} %)  {rate:.0f} {unit}/s  {left}  {failed} failed"


class Progress:
    """Counts fits, or other units, and shows them.

    Parameters
    ----------
    total: units this run is to do. stream: where to write; by default stderr or the notebook's cell.
    blocks: blocks this run is to do.
    headlines: lines about the results, which may be read for about the given seconds; without it only counts are shown.
    unit: what is counted, in the plural.
    """

    def __init__(
        self,
        total: int,
        stream: TextIO | None = None,
        *,
        blocks: int = 0,
        headlines: Callable[[float], list[str]] | None = None,
        unit: str = "fits",
    ) -> None:
        self.total, self.done, self.failed, self.unit = total, 0, 0, unit
        self.blocks, self.blocks_done = blocks, 0
        self._headlines, self._latest, self._display = headlines, list[str](), Display(stream)
        self._begun = self._looked = time.monotonic()

    def begin(self) -> None:
        """Count the time from now on, without what had to be done before the first unit."""
        self._begun = self._looked = time.monotonic()

    @property
    def seconds(self) -> float:
        """Seconds since the start, or since `begin`."""
        return time.monotonic() - self._begun

    def line(self) -> str:
        """The current state in one line."""
        seconds = self.seconds
        rate = self.done / seconds if seconds > 0 else 0.0
        blocks = f"{self.blocks_done}/{self.blocks} blocks  " if self.blocks else ""
        return blocks + counts_line(self.done, self.total, self.failed, rate, self.unit)

    def add(self, done: int, failed: int) -> None:
        """Count the units of one more block."""
        self.done, self.failed = self.done + done, self.failed + failed
        self.blocks_done += 1

    def show(self, last: bool = False) -> None:
        """Show the state if an update is due; ``last`` forces it."""
        if last or self._display.due():
            self._display.show([self.line(), *self._look()])

    def how_far(self, what: object, why: str = "stopped") -> str:
        """What work on ``what`` says that ended before its time."""
        return f"{what}: {why} with {self.total - self.done} {self.unit} left; run the same command again to resume"

    def say(self, message: str) -> None:
        """Show one message on a separate line."""
        self._display.say(message)

    def _look(self) -> list[str]:
        now = time.monotonic()
        if self._headlines and now > self._looked + LOOK_EVERY_S:
            self._latest = self._headlines(LOOK_SHARE * (now - self._looked))
            self._looked = now
        return self._latest

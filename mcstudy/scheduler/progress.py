"""Progress of a run: chunks, fits or other units, speed, time left, failures, and the results so far."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from typing import TextIO

from mcstudy.scheduler.display import Display

LOOK_EVERY_S = 2.0
"""Seconds between two looks at the results."""

LOOK_SHARE = 0.02
"""Largest fraction of the time spent on looking at the results."""

LAST_LOOK_S = 5.0
"""Longest last look, at the end of a run."""

WINDOW_S = 30.0
"""Seconds over which the speed is averaged."""

LEAST_STEPS = 4
"""Steps over which the speed is averaged even if they took longer."""

STARTING_S = 10.0
"""Seconds in which the first result, for which every thread had to load its code, would spoil the speed."""


def duration(seconds: float) -> str:
    """``seconds`` as text: 42 s, 3 min 20 s, 5 h 12 min."""
    s = max(0, round(seconds))
    if s < 60:
        return f"{s} s"
    if s < 3600:
        return f"{s // 60} min {s % 60:02d} s"
    return f"{s // 3600} h {s % 3600 // 60:02d} min"


def counts_line(done: int, total: int, failed: int, rate: float, unit: str = "fits") -> str:
    """``done/total`` of a unit, percentage, speed, time left, failures.

    ``rate``: units per second, printed per minute where it is below one; 0 where it is not known yet.
    """
    share = 100 * done / total if total else 100.0
    parts = [f"{done}/{total} {unit} ({share:.0f} %)"]
    if rate > 0:
        parts.append(f"{rate:.0f} {unit}/s" if rate >= 1 else f"{60 * rate:.2g} {unit}/min")
    if done < total:
        parts.append(f"{duration((total - done) / rate)} left" if rate > 0 else "time left: estimating")
    return "  ".join([*parts, f"{failed} failed"])


class Speed:
    """Units per second in the last `WINDOW_S` seconds, or `LEAST_STEPS` steps, whichever is longer.

    In the first `STARTING_S` seconds it is that of the steps after the first one, and known from `LEAST_STEPS` on.
    """

    def __init__(self) -> None:
        self._seen: deque[tuple[float, int]] = deque()
        self._first: tuple[float, int] | None = None
        self._steps = 0

    def begin(self, done: int) -> None:
        """Work begins now, with so many units done before."""
        self._seen.append((time.monotonic(), done))

    def note(self, done: int) -> None:
        """So many units are done now."""
        now = time.monotonic()
        if not self._seen or done > self._seen[-1][1]:
            if self._first is None:
                self._first = now, done
            else:
                self._steps += 1
        self._seen.append((now, done))
        while len(self._seen) > LEAST_STEPS + 1 and self._seen[1][0] < now - WINDOW_S:
            self._seen.popleft()

    def rate(self) -> float:
        """Units per second until now; 0 before anything is known."""
        if not self._seen:
            return 0.0
        now = time.monotonic()
        (begun, before), (_, done) = self._seen[0], self._seen[-1]
        if now < begun + STARTING_S:
            if self._first is None or self._steps < LEAST_STEPS:
                return 0.0
            begun, before = self._first
        return (done - before) / (now - begun) if now > begun else 0.0


class Progress:
    """Counts fits, or other units, and shows them.

    Parameters
    ----------
    total: units this run is to do. stream: where to write; by default stderr or the notebook's cell.
    chunks: chunks this run is to do.
    headlines: lines about the results, which may be read for about the given seconds; without it only counts are shown.
    unit: what is counted, in the plural.
    """

    def __init__(
        self,
        total: int,
        stream: TextIO | None = None,
        *,
        chunks: int = 0,
        headlines: Callable[[float], list[str]] | None = None,
        unit: str = "fits",
    ) -> None:
        self.total, self.done, self.failed, self.unit = total, 0, 0, unit
        self.chunks, self.chunks_done = chunks, 0
        self._headlines, self._latest, self._display = headlines, list[str](), Display(stream)
        self.begin()

    def begin(self, ready: bool = True) -> None:
        """Count the time from now on, without what had to be done before.

        ``ready``: false if workers elsewhere may have to start and compile first, so that the speed is known only
        from the first units on.
        """
        self._begun = self._looked = time.monotonic()
        self._speed = Speed()
        if ready:
            self._speed.begin(self.done)

    @property
    def seconds(self) -> float:
        """Seconds since the start, or since `begin`."""
        return time.monotonic() - self._begun

    def line(self) -> str:
        """The current state in one line."""
        rate = self._speed.rate()
        if self.done >= self.total and self.seconds > 0:
            rate = self.done / self.seconds  # of the whole run, as its summary
        chunks = f"{self.chunks_done}/{self.chunks} chunks  " if self.chunks else ""
        return chunks + counts_line(self.done, self.total, self.failed, rate, self.unit)

    def add(self, done: int, failed: int, chunks: int = 0) -> None:
        """Count the units and chunks of one more block."""
        self.done, self.failed = self.done + done, self.failed + failed
        self.chunks_done += chunks
        self._speed.note(self.done)

    def show(self, last: bool = False) -> None:
        """Show the state if an update is due; ``last`` forces it."""
        if last or self._display.due():
            self._display.show([self.line(), *self._look(whole=last and self.done >= self.total)])

    def how_far(self, what: object, why: str = "stopped", resumes: bool = True) -> str:
        """What work on ``what`` says that ended before its time."""
        left = f"{what}: {why} with {self.total - self.done} {self.unit} left"
        return f"{left}; run the same command again to resume" if resumes else left

    def say(self, message: str) -> None:
        """Show one message on a separate line."""
        self._display.say(message)

    def _look(self, whole: bool) -> list[str]:
        """Lines about the results, of all that is finished if ``whole``."""
        now = time.monotonic()
        if self._headlines and (whole or now > self._looked + LOOK_EVERY_S):
            self._latest = self._headlines(LAST_LOOK_S if whole else LOOK_SHARE * (now - self._looked))
            self._looked = now
        return self._latest

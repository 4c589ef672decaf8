"""Kernels compiled before the work that needs them, with a line on stderr while that takes time."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Iterable

from mcstudy.fitting.compilers import Compilation, begin, warm
from mcstudy.scheduler.activity import current, doing
from mcstudy.scheduler.display import Display

__all__ = ["DIAGNOSIS", "PERSON", "RECORDING", "begin", "compile_kernels"]

DIAGNOSIS = ("lm", "linearised", "diagnosis")
"""Parts that a diagnosis needs."""

PERSON = (*DIAGNOSIS, "intervals")
"""Parts that a fit of a person needs."""

RECORDING = ("stability", "time_domain")
"""Parts that the simulation of a recording needs."""


def compile_kernels(parts: Iterable[str], stop: threading.Event | None = None) -> None:
    """Compile, or load, ``parts`` (`mcstudy.fitting.warm.PARTS`); shows progress, returns early when ``stop`` is set.

    The first call of an installation takes some seconds; every other one only loads.
    """

    def work() -> None:
        with contextlib.suppress(Exception):  # the work itself will meet it too, and report it
            _warm_and_tell(list(parts))

    # Compiling in this process returns to Python only after many seconds; a request to stop cannot wait that long.
    thread = threading.Thread(target=work, name="mcstudy-warm", daemon=True)
    thread.start()
    while thread.is_alive() and not (stop is not None and stop.is_set()):
        thread.join(0.02)


def _warm_and_tell(parts: list[str]) -> None:
    display, shown, before = Display(), list[Compilation](), current()

    def show(compilation: Compilation) -> None:
        if before is not None:
            doing(compilation.line())  # there is a line already
        elif not shown or display.due():
            display.show([compilation.line()])
        shown[:] = [compilation]

    warm(parts, show)
    if before is not None:
        doing(before)
    elif shown and display.live:
        display.clear()
        if shown[0].has(shown[0].parts):
            seconds = time.monotonic() - shown[0].began
            display.say(f"compiled {shown[0].done} functions in {seconds:.0f} s")

"""Ctrl-C, SIGTERM and SIGHUP from the first line of the command to its last.

A signal must end the command wherever it is: in an import or a callback that would swallow an exception, in a compiler
that returns to Python after a minute. So the signals raise nothing. The system's handler writes them into a pipe, a
thread of ours reads it: work that can stop in an orderly way is asked to (`mcstudy.study.stopping`), and when it has
not done so in `GRACE_S`, when there is none, or when a second signal comes, the thread ends the process. That loses
nothing, since what is stored is whole or absent; files that are being written are removed.

`catch` imports nothing that is slow, so that it comes first.
"""

from __future__ import annotations

import os
import select
import signal
import time

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Sequence
    from typing import NoReturn

    from mcstudy.exits import Exit
    from mcstudy.study.stopping import StopRequest

RESUMES = "run the same command again to resume"
"""How a message of what can be resumed ends; the command itself is printed behind it."""

RESUMABLE = (("run",), ("extend",), *(("gap", "challenge", verb) for verb in ("make", "answer", "run")))
"""Verbs that go on from where they were stopped."""

GRACE_S = 1.6
"""From the signal to the end of work that does not stop by itself; with all that comes after it, under 2 s."""

WRITE_S = 0.1
"""How long the last line waits for a reader."""


class Stop:
    """The signals of this process; made by `catch`."""

    def __init__(self, pipe: int) -> None:
        self._pipe = pipe
        self._words: tuple[str, ...] = ()
        self._asked = False

    @property
    def asked(self) -> bool:
        """Whether there was a signal."""
        return self._asked

    def watch(self, words: Sequence[str]) -> None:
        """Act on signals, those since `catch` included; ``words`` are those of the command."""
        # Whatever the thread needs is imported here: later another thread may hold an import for long.
        import shlex  # noqa: F401
        import threading

        from mcstudy.exits import Exit  # noqa: F401
        from mcstudy.study import stopping, unfinished  # noqa: F401

        self._words = tuple(words)
        stopping.own_signals()
        self._last = threading.Lock()
        threading.Thread(target=self._listen, name="mcstudy-signals", daemon=True).start()

    def leave(self, message: str, code: Exit) -> NoReturn:
        """End the process with one line, whatever its threads do: what they would write is whole or absent."""
        from mcstudy.study.unfinished import remove_unfinished

        self._last.acquire()  # and never released: there is one last line
        remove_unfinished()
        line = f"mcstudy: {message}\n".encode()
        try:
            if select.select([], [2], [], WRITE_S)[1]:
                os.write(2, line)
        except (OSError, ValueError):
            pass  # the terminal is gone
        os._exit(code)

    def _listen(self) -> None:
        from mcstudy.study import stopping

        self._wait()
        self._asked = True
        asked = stopping.request_stop()
        if asked and not self._wait(GRACE_S):
            self._last_words(asked)
        self.leave(*stopped(self._words))

    def _wait(self, seconds: float | None = None) -> bool:
        """Wait for one of the signals; whether it came."""
        from mcstudy.study.stopping import SIGNALS

        end = None if seconds is None else time.monotonic() + seconds
        while select.select([self._pipe], [], [], None if end is None else max(0.0, end - time.monotonic()))[0]:
            if os.read(self._pipe, 1)[0] in SIGNALS:
                return True
        return False

    def _last_words(self, asked: list[StopRequest]) -> None:
        """End the process with what work that did not stop says about itself, if it does."""
        from mcstudy.exits import Exit

        for request in asked:
            if request.words is not None:
                self.leave(with_command(request.words(), self._words), Exit.INTERRUPTED)


def catch() -> Stop:
    """Take the signals, before anything else: none is lost from here on. One that is ignored stays so."""
    pipe, written = os.pipe()
    os.set_blocking(written, False)
    for sign in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(sign) is not signal.SIG_IGN:
            signal.signal(sign, _nothing)
    signal.set_wakeup_fd(written, warn_on_full_buffer=False)
    return Stop(pipe)


def with_command(message: str, words: Sequence[str]) -> str:
    """``message``, and the command behind it when it says that the command resumes."""
    import shlex

    return f"{message}: {shlex.join(['mcstudy', *words])}" if message.endswith(RESUMES) else message


def stopped(words: Sequence[str], how: str = "") -> tuple[str, Exit]:
    """What a command says that was stopped, and its exit code."""
    from mcstudy.exits import Exit

    if any(tuple(words[: len(verb)]) == verb for verb in RESUMABLE):
        return with_command(f"stopped{how}; {RESUMES}", words), Exit.INTERRUPTED
    return f"stopped{how}", Exit.STOPPED


def _nothing(*_: object) -> None:
    """What a signal does to the main thread."""

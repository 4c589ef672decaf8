"""Handling of Ctrl-C, SIGTERM and SIGHUP during the whole run of a command.

A signal must end the command wherever it is: in an import or a callback that would swallow an exception, or in a
compiler that returns to Python only after a minute. Therefore signals raise no exception. The system's handler writes
them into a pipe, and a thread of ours reads the pipe. It asks work that can stop in an orderly way to do so
(`mcstudy.scheduler.stopping`). It ends the process when that takes longer than `GRACE_S`, when there is no such work,
or when a second signal arrives. Nothing is lost: a stored chunk is either complete or absent, and unfinished files are
removed.

`catch` imports no slow module, so that it can run first.
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
    from mcstudy.scheduler.stopping import StopRequest

RESUMES = "run the same command again to resume"
"""End of a message about work that can be resumed; the command itself is printed after it."""

_UNMAPPED = "failed to map segment"
"""What the loader of shared libraries says where there is no memory for one."""

INTERRUPTED = 3
"""`mcstudy.exits.Exit.INTERRUPTED`, whose module may not be loaded any more."""

GRACE_S = 1.6
"""Seconds after a signal until work that does not stop by itself is ended; the whole exit takes less than 2 s."""

WRITE_S = 0.1
"""Seconds that the last line waits until the terminal accepts it."""


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
        """Act on signals, including those since `catch`; ``words`` are the command-line arguments."""
        # Everything the thread needs is imported here: later another thread may hold the import lock for long.
        import shlex  # noqa: F401
        import threading

        from mcstudy.exits import Exit  # noqa: F401
        from mcstudy.files import unfinished  # noqa: F401
        from mcstudy.scheduler import stopping

        self._words = tuple(words)
        stopping.own_signals()
        self._last = threading.Lock()
        threading.Thread(target=self._listen, name="mcstudy-signals", daemon=True).start()

    def leave(self, message: str, code: Exit) -> NoReturn:
        """Print one line and end the process, whatever its threads do: their files are complete or absent."""
        from mcstudy.files.unfinished import remove_unfinished

        self._last.acquire()  # never released: only one last line is printed
        remove_unfinished()
        line = f"mcstudy: {message}\n".encode("utf-8", "backslashreplace")
        try:
            if select.select([], [2], [], WRITE_S)[1]:
                os.write(2, line)
        except (OSError, ValueError):
            pass  # the terminal is gone
        os._exit(code)

    def _listen(self) -> None:
        from mcstudy.scheduler import stopping

        self._wait()
        try:
            self._asked = True
            asked = stopping.request_stop()
            if asked and not self._wait(GRACE_S):
                self._last_words(asked)
            self.leave(*stopped(self._words))
        finally:
            os._exit(INTERRUPTED)  # without memory for a last line, too

    def _wait(self, seconds: float | None = None) -> bool:
        """Wait for one of the signals; whether it came."""
        from mcstudy.scheduler.stopping import SIGNALS

        end = None if seconds is None else time.monotonic() + seconds
        while select.select([self._pipe], [], [], None if end is None else max(0.0, end - time.monotonic()))[0]:
            if os.read(self._pipe, 1)[0] in SIGNALS:
                return True
        return False

    def _last_words(self, asked: list[StopRequest]) -> None:
        """End the process with the message of the work that did not stop, if it has one."""
        from mcstudy.exits import Exit

        for request in asked:
            if request.words is not None:
                self.leave(with_command(request.words(), self._words), Exit.INTERRUPTED)


def catch() -> Stop:
    """Catch the signals from here on, before anything else is done. A signal that is ignored stays ignored."""
    pipe, written = os.pipe()
    os.set_blocking(written, False)
    # The pipe comes before the handlers: a signal that is caught while nothing writes it into the pipe would be lost.
    signal.set_wakeup_fd(written, warn_on_full_buffer=False)
    for sign in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(sign) is not signal.SIG_IGN:
            signal.signal(sign, _nothing)
    return Stop(pipe)


def with_command(message: str, words: Sequence[str]) -> str:
    """``message``, followed by the command when it says that the command resumes."""
    import shlex

    return f"{message}: {shlex.join(['mcstudy', *words])}" if message.endswith(RESUMES) else message


def stopped(words: Sequence[str], how: str = "") -> tuple[str, Exit]:
    """Message and exit code of a command that was stopped."""
    from mcstudy.cli.verbs import resumable
    from mcstudy.exits import Exit

    if resumable(tuple(words)):
        return with_command(f"stopped{how}; {RESUMES}", words), Exit.INTERRUPTED
    return f"stopped{how}", Exit.STOPPED


def lacking(error: BaseException) -> str:
    """What the machine lacked, in words: memory, or threads; empty for any other error."""
    if isinstance(error, MemoryError) or (isinstance(error, ImportError | OSError) and _unmapped(error)):
        return "expected more memory: a limit, or the machine, does not give what this needs"
    if isinstance(error, RuntimeError) and "can't start new thread" in str(error):
        return "expected to start another thread: a limit, or the machine, does not allow it"
    return ""


def _unmapped(error: BaseException | None) -> bool:
    """Whether there was no memory for a shared library; packages tell of it by an error of their own."""
    return error is not None and (_UNMAPPED in str(error) or _unmapped(error.__cause__ or error.__context__))


def unusable(error: Exception, words: Sequence[str]) -> tuple[str, Exit] | None:
    """Message and exit code of a command that met a file, a disk or a machine that cannot be used.

    None for any other error: a fault of this program.
    """
    from mcstudy.cli.verbs import resumable
    from mcstudy.exits import Exit
    from mcstudy.files.durable import FULL

    resumes = resumable(tuple(words))
    if what := lacking(error):
        return (with_command(f"{what}; {RESUMES}", words), Exit.INTERRUPTED) if resumes else (what, Exit.BAD_INPUT)
    if not isinstance(error, OSError) or error.errno is None:
        return None
    what = str(error.strerror or error)
    if error.filename:
        what = f"{error.filename}: {what}"
    elif error.errno in FULL:  # writing to what is open already does not name it
        what = f"output: cannot be written: {what}"
    line = " ".join(what.split())
    if error.errno in FULL and resumes:
        return with_command(f"{line}; {RESUMES}", words), Exit.INTERRUPTED
    return line, Exit.BAD_INPUT


def _nothing(*_: object) -> None:
    """Signal handler of the main thread: does nothing."""

"""Processes that compile, one per core, so that a first run waits as short as it can.

One process compiles one function at a time, since the compiler holds a lock, and a run needs two that take long. The
code goes to numba's folder on disk, from which every process loads it. A lock in that folder makes sure that several
runs, or several workers of a cluster, do not compile the same code at the same time.

A compiling process ends with the one that started it, however that ends: its input is closed then. It is in a session
of its own, so Ctrl-C reaches it in that way only.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import selectors
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

from mcstudy.compiling.decorators import folder_of
from mcstudy.files.python_process import start
from mcstudy.fitting.kernel import evaluate
from mcstudy.fitting.warm import PARTS, compile_here, compile_part, missing, with_called

LOCK = "mcstudy-compiling.lock"

START_S = 1.0
"""Seconds until a process is ready to compile."""

LOOK_S = 0.1
"""Seconds between two calls of what shows the progress."""


class Compilation:
    """Parts that are being compiled; the work goes on while nobody waits for it.

    Attributes
    ----------
    parts: of `PARTS`, in its order. total: functions of these parts. began: `time.monotonic`.
    """

    def __init__(self, parts: list[str], folder: Path, cores: int) -> None:
        self.parts, self._cores = parts, min(cores, len(parts))
        self.total, self.began = sum(PARTS[part].functions for part in parts), time.monotonic()
        self._done = dict.fromkeys(parts, 0)
        self._ended = {part: threading.Event() for part in parts}
        self._thread = threading.Thread(target=self._work, args=(folder,), name="mcstudy-compilers", daemon=True)
        self._thread.start()

    @property
    def seconds(self) -> float:
        """About how long it takes on idle cores."""
        chains: dict[str, float] = {}
        for part in self.parts:
            chains[part] = PARTS[part].seconds + max((chains.get(p, 0.0) for p in PARTS[part].after), default=0.0)
        return START_S + max(sum(PARTS[part].seconds for part in self.parts) / self._cores, *chains.values())

    @property
    def done(self) -> int:
        """Functions compiled so far."""
        return sum(self._done.values())

    def has(self, parts: Iterable[str]) -> bool:
        """Whether these parts, as far as they are compiled here, are done."""
        return all(self._ended[part].is_set() for part in with_called(parts) if part in self._ended)

    @property
    def counted(self) -> int:
        """Functions that need not be compiled any more, of ``total``: of a part that is done all, shared ones too."""
        return sum(
            PARTS[part].functions if self._ended[part].is_set() else min(self._done[part], PARTS[part].functions)
            for part in self.parts
        )

    def line(self) -> str:
        """What is going on, in one line."""
        return f"compiling the kernels (once, about {self.seconds:.0f} s): {self.counted} of {self.total} functions"

    def _work(self, folder: Path) -> None:
        try:
            with _alone(folder), contextlib.ExitStack() as stack:
                self._feed([stack.enter_context(_compiler()) for _ in range(self._cores)])
        except OSError:
            pass  # no room for processes: whoever waits compiles what is missing
        finally:
            for event in self._ended.values():
                event.set()

    def _feed(self, compilers: list[subprocess.Popen[bytes]]) -> None:
        """Hand out parts as soon as those they call are done; a dot is a function, a line end is a part."""
        waiting, at = list(self.parts), dict.fromkeys(compilers, "")
        with selectors.DefaultSelector() as selector:
            for compiler in compilers:
                selector.register(compiler.stdout, selectors.EVENT_READ, compiler)  # type: ignore[arg-type]
            while at and (waiting or any(at.values())):
                for compiler in [c for c, part in at.items() if not part]:
                    free = [p for p in waiting if not {*PARTS[p].after} & {*waiting, *at.values()}]
                    if free:
                        at[compiler] = free[0]
                        waiting.remove(free[0])
                        os.write(compiler.stdin.fileno(), f"{free[0]}\n".encode())  # type: ignore[union-attr]
                for key, _ in selector.select():
                    compiler = key.data
                    said = os.read(key.fd, 1000)
                    if part := at[compiler]:
                        self._done[part] += said.count(b".")
                        if b"\n" in said or not said:
                            self._ended[part].set()
                            at[compiler] = ""
                    if not said:  # it is dead; the others go on
                        selector.unregister(key.fileobj)
                        del at[compiler]


_lock = threading.Lock()
_current: Compilation | None = None


def begin(parts: Iterable[str] = ()) -> Compilation | None:
    """Have ``parts`` (all unless some are named) compiled by other processes as far as they are not; returns at once.

    None when nothing is to be compiled, or other processes are of no use: nothing can be kept on disk, or no Python can
    be started (inside another program).
    """
    global _current
    wanted = with_called(parts or PARTS)
    with _lock:
        if _current is not None and not _current.has(_current.parts) and {*wanted} <= {*_current.parts}:
            return _current
        needed = missing(wanted)
        folder = folder_of(evaluate) if needed else None
        if not needed or folder is None or not sys.executable:
            return None
        _current = Compilation(needed, folder, cores())
        return _current


def warm(parts: Iterable[str] = (), show: Callable[[Compilation], None] | None = None) -> int:
    """Compile what is not compiled yet, or load it; all ``parts`` unless some are named.

    ``show`` is called while other processes compile. Returns the number of functions compiled.
    """
    wanted, compiled = list(parts or PARTS), 0
    if (compilation := begin(wanted)) is not None:
        while not compilation.has(wanted):
            if show is not None:
                show(compilation)
            time.sleep(LOOK_S)
        compiled = compilation.done
    return compiled + compile_here(wanted)  # nothing is left, unless a process has failed


def cores() -> int:
    """Number of cores this process may use; all cores where the system does not tell (macOS)."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@contextlib.contextmanager
def _alone(folder: Path) -> Iterator[None]:
    with (folder / LOCK).open("wb") as file:
        with contextlib.suppress(OSError):  # some shared file systems have no locks
            fcntl.flock(file, fcntl.LOCK_EX)
        yield


@contextlib.contextmanager
def _compiler() -> Iterator[subprocess.Popen[bytes]]:
    with start(__name__) as process:  # closes its input at the end, which ends it
        yield process


def _serve() -> None:
    """A compiling process: parts by line on stdin; on stdout a dot per function and a line end per part."""
    import gc
    import queue

    from numba.core import event

    class Dots(event.Listener):
        def on_start(self, event: object) -> None:
            del event

        def on_end(self, event: object) -> None:
            del event
            os.write(1, b".")

    gc.set_threshold(300_000)  # most of what the compiler makes stays; to search it for garbage takes time
    asked: queue.SimpleQueue[str] = queue.SimpleQueue()

    def listen() -> None:
        for line in sys.stdin:
            asked.put(line.strip())
        os._exit(0)  # whoever asked is gone, or needs nothing more

    threading.Thread(target=listen, daemon=True).start()
    event.register("numba:compile", Dots())
    while True:
        compile_part(asked.get())
        os.write(1, b"\n")


if __name__ == "__main__":
    _serve()

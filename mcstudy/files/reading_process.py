"""Files that a compiled library reads are read in another process, which can be ended.

One changed byte can make a library loop for ever while it holds Python's lock, so that no signal ends the process; or
ask for all memory; or end the process. The other process reads one file after another and is started with the first.
While it reads, the system itself ends it: when it has used too much CPU time, when its memory would grow too far, and
when the process that asked is gone (macOS: at the end of that time). Results come as JSON and the bytes of arrays.

The other process is a plain ``python -m``, so that notebooks, scripts without a main guard and workers of a cluster can
start it. It has a session of its own: Ctrl-C reaches only the process that asked, which ends it.
"""

from __future__ import annotations

import atexit
import contextlib
import fcntl
import importlib
import json
import os
import resource
import select
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, Any

import numpy as np

from mcstudy.errors import InputError, RecordingError
from mcstudy.files.python_process import start

LEAST_S = 5.0
"""CPU seconds that reading a file may take, whatever its size; a recording of a megabyte takes 0.03."""

BYTES_PER_S = 2e7
"""Bytes of a file, and of the values in it, for which it may take a second more."""

WAITING = 20.0
"""Times the CPU time that may pass while the process waits, for a disk or for its turn."""

LEAST_BYTES = 1 << 29
"""Memory by which the process may grow while it reads, beside what the sizes of file and values explain."""

LONGEST = 1 << 28
"""Bytes of an answer without arrays."""

Answer = tuple[Any, list[np.ndarray]]
"""What can be written as JSON, and arrays."""


class Unreadable(RuntimeError):
    """What a library said of a file that it could not read."""


def answer(function: str, path: str | Path, *arguments: Any, expected: int = 0) -> Answer:
    """What ``function(path, *arguments)`` returns in the other process.

    Parameters
    ----------
    function
        ``module:name`` of this package; it returns an `Answer`.
    path
        Of the file it reads.
    arguments
        What can be written as JSON.
    expected
        Bytes of the arrays that it returns.

    Raises
    ------
    RecordingError
        What the function raised; or the file took too much time or memory, or ended the process: it is damaged.
    Unreadable
        The function raised another error.
    """
    size = os.stat(path).st_size + expected
    seconds = LEAST_S + size / BYTES_PER_S
    asked = [function, os.fspath(path), arguments, seconds, LEAST_BYTES + 4 * size, _folder()]
    with _lock:
        header, arrays = _exchange(json.dumps(asked).encode() + b"\n", str(path), seconds)
    if "refused" in header:
        raise RecordingError(header["refused"])
    if "error" in header:
        raise Unreadable(header["error"])
    return header["answer"], arrays


def _folder() -> str | None:
    try:
        return os.getcwd()
    except OSError:
        return None  # it was removed


_lock = threading.Lock()
_process: subprocess.Popen[bytes] | None = None


def _exchange(asked: bytes, path: str, seconds: float) -> Answer:
    process = _started(path)
    try:
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            process.stdin.write(asked)
            process.stdin.flush()
            told = process.stdout.readline(LONGEST)
            if told.endswith(b"\n"):
                header = json.loads(told)
                return header, [_array(process.stdout, *form) for form in header.get("arrays", [])]
        except (BrokenPipeError, EOFError):
            pass
        ended = process.wait()
        end()
    except BaseException:  # of a signal, too: what is left of the answer would be taken for the next one
        end()
        raise
    raise RecordingError(f"{path}: {_why(-ended, seconds)}")


def _started(path: str) -> subprocess.Popen[bytes]:
    global _process
    if _process is not None and _process.poll() is None:
        return _process
    end()
    try:
        _process = start(__name__, OPENBLAS_NUM_THREADS="1")  # threads it does not need take memory
    except (OSError, ValueError) as error:
        raise RecordingError(f"{path}: no process can be started that reads it: {error}") from None
    return _process


def _array(source: IO[bytes], kind: str, shape: list[int]) -> np.ndarray:
    values = np.empty(shape, kind)
    left = _bytes(values)
    while left:
        n = source.readinto(left)  # type: ignore[attr-defined]
        if not n:
            raise EOFError
        left = left[n:]
    return values


def _bytes(values: np.ndarray) -> memoryview:
    """The memory of a contiguous array."""
    return values.reshape(-1).view(np.uint8).data


def _why(number: int, seconds: float) -> str:
    if number in (signal.SIGPROF, signal.SIGALRM):
        return f"reading it took more than {seconds:.0f} s of computing: it is damaged"
    if number in (signal.SIGSEGV, signal.SIGABRT, signal.SIGBUS, signal.SIGFPE, signal.SIGILL):
        return f"reading it ended in a fault of the library ({signal.Signals(number).name}): it is damaged"
    if number == signal.SIGKILL:
        return "the process that read it was killed; is there too little memory?"
    return f"the process that read it ended ({-number})"


def end() -> None:
    """End the other process; the next file starts another one."""
    global _process
    process, _process = _process, None
    if process is not None:
        process.kill()
        for pipe in (process.stdin, process.stdout):
            with contextlib.suppress(OSError):
                pipe.close()  # type: ignore[union-attr]
        process.wait()


def _forget() -> None:
    """In a process that was forked: the other process belongs to its parent."""
    global _lock, _process
    process, _process, _lock = _process, None, threading.Lock()
    if process is not None:
        process.returncode = 0
        for pipe in (process.stdin, process.stdout):
            os.close(pipe.fileno())  # type: ignore[union-attr]
            pipe.detach()  # type: ignore[union-attr]


atexit.register(end)
os.register_at_fork(after_in_child=_forget)


def _serve() -> None:
    """The other process: a question by line on stdin, an answer on stdout, which nothing else writes to."""
    out = os.fdopen(os.dup(1), "wb")
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    fatal = {signal.SIGPROF, signal.SIGALRM, signal.SIGIO}
    for number in fatal:
        signal.signal(number, signal.SIG_DFL)  # which ends the process, whatever it does
    signal.pthread_sigmask(signal.SIG_UNBLOCK, fatal)
    fcntl.fcntl(0, fcntl.F_SETOWN, os.getpid())
    most = resource.getrlimit(resource.RLIMIT_AS)[0]
    while line := sys.stdin.buffer.readline():
        header, arrays = _told(json.loads(line), most)
        out.write(json.dumps(header).encode() + b"\n")
        for a in arrays:
            out.write(_bytes(a))
        out.flush()


def _told(asked: list[Any], most: int) -> Answer:
    """The answer to one question, or the error."""
    name, path, arguments, seconds, grow, folder = asked
    try:
        if folder is not None:
            os.chdir(folder)
        module, attribute = name.split(":")
        function: Callable[..., Answer] = getattr(importlib.import_module(module), attribute)
        with _limited(seconds, grow, most):
            value, arrays = function(Path(path), *arguments)
            arrays = [np.asarray(a, order="C") for a in arrays]
        return {"answer": value, "arrays": [[a.dtype.str, a.shape] for a in arrays]}, arrays
    except InputError as error:
        return {"refused": str(error)}, []
    except MemoryError:
        return {"refused": f"{path}: reading it takes too much memory: it is damaged"}, []
    except Exception as error:  # libraries raise different errors for damaged files
        return {"error": (str(error).splitlines() or [type(error).__name__])[0][:300]}, []


@contextlib.contextmanager
def _limited(seconds: float, grow: int, most: int) -> Iterator[None]:
    """Have the system end this process after CPU seconds, beyond memory, or when nobody waits for the answer."""
    with contextlib.suppress(OSError, ValueError):  # not on every system
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        limit = pages * resource.getpagesize() + grow
        soft = limit if most == resource.RLIM_INFINITY else min(limit, most)
        resource.setrlimit(resource.RLIMIT_AS, (soft, resource.getrlimit(resource.RLIMIT_AS)[1]))
    signal.setitimer(signal.ITIMER_PROF, seconds)
    signal.setitimer(signal.ITIMER_REAL, WAITING * seconds)
    flags = fcntl.fcntl(0, fcntl.F_GETFL)
    fcntl.fcntl(0, fcntl.F_SETFL, flags | os.O_ASYNC)
    try:
        if _nobody():
            os._exit(0)
        yield
    finally:
        fcntl.fcntl(0, fcntl.F_SETFL, flags)
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.setitimer(signal.ITIMER_REAL, 0)


def _nobody() -> bool:
    """Whether the process that asked is gone."""
    look = select.poll()
    look.register(0, 0)
    return any(event & select.POLLHUP for _, event in look.poll(0))


if __name__ == "__main__":
    _serve()

"""Processes forked from this one, which has everything compiled and imported already, to be killed at will."""

from __future__ import annotations

import json
import os
import signal
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any

from mcstudy.errors import Interrupted, StoreError

DONE, BROKEN, REFUSED, STOPPED = 0, 1, 2, 3

MEMORY = "/dev/shm" if Path("/dev/shm").is_dir() else None
"""Where cubes are made whose processes are killed: a kill is no power cut, so nothing has to reach a disk."""

_alive: set[int] = set()


def fork(work: Callable[[], object], said: Path | None = None) -> int:
    """A process in its own session that does ``work`` and nothing else; its id. What it prints goes to ``said``."""
    child = os.fork()
    if child:
        _alive.add(child)
        return child
    code = BROKEN
    try:
        os.setsid()
        target = os.open(said or os.devnull, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
        for stream in (1, 2):
            os.dup2(target, stream)
        work()
        code = DONE
    except (Interrupted, KeyboardInterrupt):
        code = STOPPED
    except StoreError:
        code = REFUSED
    except BaseException:
        sys.excepthook(*sys.exc_info())  # type: ignore[arg-type]
    finally:
        sys.stderr.flush()
        os._exit(code)


def ended(child: int, seconds: float = 180.0) -> int:
    """Wait for a process; its exit code, negative for a signal."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        found, status = os.waitpid(child, os.WNOHANG)
        if found:
            _alive.discard(child)
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.003)
    kill(child)
    raise TimeoutError(f"a process took longer than {seconds} s")


def kill(child: int, sign: signal.Signals = signal.SIGKILL) -> bool:
    """Send a signal (and wait for the end after SIGKILL); whether the process was still there."""
    if child not in _alive:
        return False
    found, _ = os.waitpid(child, os.WNOHANG)
    if found:
        _alive.discard(child)
        return False
    os.kill(child, sign)
    if sign == signal.SIGKILL:
        os.waitpid(child, 0)
        _alive.discard(child)
    return True


def kill_all() -> None:
    """End everything that is left."""
    for child in list(_alive):
        kill(child)


def answer(work: Callable[[], Any], place: Path) -> Any:
    """What ``work`` returns (JSON) when another process does it: this one stays without threads, and can be forked."""
    place.unlink(missing_ok=True)
    said = place.with_suffix(".said")
    said.unlink(missing_ok=True)
    code = ended(fork(lambda: place.write_text(json.dumps(work())), said))
    assert code == DONE, said.read_text()
    return json.loads(place.read_text())


class DieAtLine:
    """Counts the lines executed in some source files, in all threads; kills the process before one of them.

    ``at`` is a file, a line of it, and how many times it is reached.
    """

    def __init__(self, files: set[str], at: tuple[str, int, int] | None = None) -> None:
        self.files, self.at, self.lock = files, at, threading.Lock()
        self.reached: Counter[tuple[str, int]] = Counter()

    def __enter__(self) -> DieAtLine:
        threading.settrace(self._call)
        sys.settrace(self._call)
        return self

    def __exit__(self, *_: object) -> None:
        sys.settrace(None)
        threading.settrace(None)  # type: ignore[arg-type]

    def _call(self, frame: FrameType, event: str, _: object) -> Any:
        return self._line if event == "call" and frame.f_code.co_filename in self.files else None

    def _line(self, frame: FrameType, event: str, _: object) -> Any:
        if event == "line":
            place = (frame.f_code.co_filename, frame.f_lineno)
            with self.lock:
                self.reached[place] += 1
                if self.at == (*place, self.reached[place]):
                    os.kill(os.getpid(), signal.SIGKILL)
        return self._line

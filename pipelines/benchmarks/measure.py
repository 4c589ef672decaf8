"""Measurement of time, peak memory and processes.

Wall-clock time on a shared machine has little meaning, so CPU times of this thread are compared, and the methods to be
compared run alternately.
"""

from __future__ import annotations

import importlib.metadata
import os
import platform
import resource
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import psutil

from mcstudy.fitting.compilers import cores

T = TypeVar("T")

PEERS = ("scipy", "numpy", "numba", "pypesto", "fides", "lmfit", "xyzpy", "joblib", "dask", "distributed", "zarr")


def timed(work: Callable[..., T], *arguments: Any) -> tuple[T, float]:
    """What one call returns, and the CPU time of this thread that it took."""
    begun = time.thread_time()
    value = work(*arguments)
    return value, time.thread_time() - begun


@dataclass(frozen=True)
class Usage:
    """What a command took. Seconds are wall and CPU (user + system, children included), memory is resident bytes."""

    wall: float
    cpu: float
    peak: int
    output: str


def run_command(*command: str, longest_s: float | None = None, **variables: str) -> Usage:
    """Run a command to its end, single-threaded libraries, and measure it.

    Bytecode is cached as on any machine, or every process would compile all it imports. ``longest_s``: wall-clock
    seconds after which it is killed. ``variables``: of its environment, besides those of this process.
    Raises `RuntimeError` when it fails, `subprocess.TimeoutExpired` when it is killed.
    """
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"} | variables
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    begun = time.perf_counter()
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=environment
    ) as process:
        peak, done = [0], threading.Event()
        watcher = threading.Thread(target=_watch, args=(process.pid, peak, done))
        watcher.start()
        try:
            output, _ = process.communicate(timeout=longest_s)
        except subprocess.TimeoutExpired:
            process.kill()
            raise
        finally:
            done.set()
            watcher.join()
    wall = time.perf_counter() - begun
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if process.returncode:
        raise RuntimeError(f"{' '.join(command)} ended with {process.returncode}: {output[-1000:]}")
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return Usage(wall, cpu, peak[0], output)


def _watch(pid: int, peak: list[int], done: threading.Event) -> None:
    process = psutil.Process(pid)
    while not done.wait(0.05):
        try:
            peak[0] = max(peak[0], process.memory_info().rss)
        except psutil.Error:
            return


def mcstudy(*arguments: str | Path) -> tuple[str, ...]:
    """The program's command line, in this interpreter."""
    return (sys.executable, "-m", "mcstudy", *map(str, arguments))


def instant(*arguments: str | Path) -> tuple[str, ...]:
    """The same with fits that return at once (`benchmarks.instant`)."""
    return (sys.executable, "-m", "benchmarks.instant", *map(str, arguments))


def machine() -> dict[str, Any]:
    """What the numbers depend on besides the code."""
    versions = {}
    for name in PEERS:
        try:
            versions[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            versions[name] = None
    model = next((x.split(":")[1].strip() for x in _cpuinfo() if x.startswith("model name")), platform.processor())
    return {
        "cpu": model,
        "cores": cores(),
        "load": os.getloadavg(),
        "python": platform.python_version(),
        "versions": versions,
    }


def _cpuinfo() -> list[str]:
    path = Path("/proc/cpuinfo")
    return path.read_text().splitlines() if path.exists() else []

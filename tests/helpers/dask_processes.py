"""A Dask scheduler and workers as processes of their own, to be killed at will."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from distributed import Client
from distributed.security import Security

START_S = 60

# `python -m MODULE WORDS` that ends with the process that started it, however that one ends: then its input is closed.
GOES_WITH_US = """
import os, runpy, sys, threading
def wait():
    sys.stdin.buffer.read()
    os._exit(1)
threading.Thread(target=wait, daemon=True).start()
runpy.run_module(sys.argv.pop(1), run_name="__main__", alter_sys=True)
"""


class Cluster:
    """One scheduler on 127.0.0.1 and its workers, one thread each; ``security`` are command-line words."""

    def __init__(self, folder: Path, protocol: str = "tcp", security: tuple[str, ...] = ()) -> None:
        self.folder, self.security = folder, security
        self.workers: list[subprocess.Popen[bytes]] = []
        file = folder / "scheduler.json"
        self.scheduler = self._process(
            "dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--protocol", protocol,
            "--no-dashboard", "--scheduler-file", str(file),
        )  # fmt: skip
        end = time.monotonic() + START_S
        while not file.exists() or not file.read_text():
            assert self.scheduler.poll() is None, self.said()
            assert time.monotonic() < end, self.said()
            time.sleep(0.05)
        self.address = str(json.loads(file.read_text())["address"])

    def _process(self, module: str, *words: str) -> subprocess.Popen[bytes]:
        with (self.folder / "said.txt").open("ab") as said:
            return subprocess.Popen(
                [sys.executable, "-c", GOES_WITH_US, f"distributed.cli.{module}", *words, *self.security],
                stdin=subprocess.PIPE,
                stdout=said,
                stderr=said,
                start_new_session=True,
            )

    def add_worker(self, *words: str, nanny: bool = False) -> subprocess.Popen[bytes]:
        """Start one worker."""
        process = self._process(
            "dask_worker", self.address, "--nthreads", "1", "--no-dashboard", "--memory-limit", "0",
            "--local-directory", str(self.folder), *words, "--nanny" if nanny else "--no-nanny",
        )  # fmt: skip
        self.workers.append(process)
        return process

    def wait_for(self, workers: int, security: Security | None = None) -> None:
        """Until so many workers have joined."""
        with Client(self.address, security=security, set_as_default=False) as client:
            client.wait_for_workers(workers, timeout=START_S)

    def said(self) -> str:
        """What scheduler and workers printed."""
        return (self.folder / "said.txt").read_text(errors="replace")

    def close(self) -> None:
        """End everything that was started."""
        for process in (*self.workers, self.scheduler):
            if process.poll() is None:
                process.terminate()
        for process in (*self.workers, self.scheduler):
            try:
                process.wait(timeout=10)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
            assert process.stdin is not None
            process.stdin.close()


@contextmanager
def cluster(folder: Path, protocol: str = "tcp", security: tuple[str, ...] = ()) -> Iterator[Cluster]:
    """A `Cluster` that is ended at the end."""
    folder.mkdir(parents=True, exist_ok=True)
    made = Cluster(folder, protocol, security)
    try:
        yield made
    finally:
        made.close()

"""What all tests share: the settings of the process they run in, fixtures of more than one folder.

The tests' own process has the thread settings of the command, which are noted in every cube: without this the first
test that calls ``main`` would set them, and cubes made before and after it would differ.
"""

from __future__ import annotations

import os
import shutil
import signal
from pathlib import Path

import pytest

from mcstudy.cli import ONE_THREAD

pytest_plugins = ["plain_recordings", "tiny_studies", "two_chunks", "schedule"]  # fixtures of more than one file, order

for variable in ONE_THREAD:
    os.environ.setdefault(variable, "1")
os.environ.pop("COLUMNS", None)  # pytest-xdist sets it: tables would be folded

# Cubes are synced to disk file by file, thousands of times in all: in memory that costs nothing, and what a lost sync
# loses is tested with a model of a disk (`study/test_power_cut.py`).
MEMORY, ENOUGH = Path("/dev/shm"), 4 * 2**30
if os.access(MEMORY, os.W_OK) and shutil.disk_usage(MEMORY).free > ENOUGH:
    os.environ.setdefault("PYTEST_DEBUG_TEMPROOT", str(MEMORY))

# A shell that starts the tests in the background has them ignore Ctrl-C, and so would every process they start.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.hookimpl(tryfirst=True)
def pytest_sessionstart(session: pytest.Session) -> None:
    """Compile first, and once: who compiles says so, on a line of its own; and workers would compile the same, each."""
    if not hasattr(session.config, "workerinput"):
        from mcstudy.fitting.compilers import warm

        warm(() if session.config.getoption("numprocesses", None) else ["stability"])

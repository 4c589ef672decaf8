"""What the process that reads files calls in tests: functions that answer, and some that never do."""

from __future__ import annotations

import collections
import ctypes
import itertools
import os
from pathlib import Path
from typing import Any

import numpy as np

from mcstudy.errors import RecordingError
from mcstudy.files.reading_process import Answer


def numbers(path: Path, values: Any, kind: str, shape: list[int]) -> Answer:
    """The values, or one value everywhere, in an array of this type and shape."""
    made = np.full(shape, values, kind) if np.ndim(values) == 0 else np.array(values, kind).reshape(shape)
    return [str(path), f"{path.stat().st_size} bytes"], [made]


def its_number(_: Path) -> Answer:
    return os.getpid(), []


def loops(path: Path) -> Answer:
    """Hold Python's lock for ever, as HDF5 does; no signal is looked at."""
    (path.parent / "reading").touch()
    collections.deque(itertools.repeat(None), maxlen=0)
    return None, []


def crashes(_: Path) -> Answer:
    ctypes.string_at(0)
    return None, []


def aborts(_: Path) -> Answer:
    os.abort()


def leaves(_: Path) -> Answer:
    os._exit(3)


def refuses(path: Path) -> Answer:
    raise RecordingError(f"{path}: wrong")


def fails(_: Path) -> Answer:
    raise ValueError("first line\nsecond line")


def prints(_: Path) -> Answer:
    os.write(1, b"printed by a library\n")
    print("printed by Python")
    return "answered", []

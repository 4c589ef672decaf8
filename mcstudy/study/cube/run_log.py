"""The run log of a cube: times and versions of all runs, and the chunks that each run wrote.

A chunk that is found damaged later is first reported in the log as no longer complete, and then written again.

The log is ``OUT.log/runs.jsonl``, one JSON object per line, next to the cube and not part of it: times differ between
runs, results must not. It holds no host or user names. Only the log tells a chunk that was lost from one that has not
been run, so every line is synced, begins on a line of its own whatever is before it, and names its study.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from mcstudy.errors import StoreError
from mcstudy.files.durable import append_line, log_folder
from mcstudy.files.untrusted import real_bytes

LARGEST = 1 << 30
"""Bytes of a run log that is read at most."""

BEGIN = '{"time": '
"""What every line begins with."""


def file(path: Path) -> Path:
    """The run log of a cube."""
    return log_folder(path) / "runs.jsonl"


class RunLog:
    """Appends events of one run of the study with a ``fingerprint``."""

    def __init__(self, path: Path, run: str, fingerprint: str) -> None:
        self._file, self._run, self._fingerprint = file(path), run, fingerprint

    def add(self, event: str, **values: Any) -> None:
        """Write one line; on return it is on disk. Raises `OSError`."""
        now = datetime.now(UTC).isoformat(timespec="seconds")
        line = {"time": now, "run": self._run, "event": event, "fingerprint": self._fingerprint, **values}
        append_line(self._file, json.dumps(line).encode())


def _lines(path: Path) -> Iterator[dict[str, Any] | None]:
    """All events of a cube's log; None for a line that cannot be read."""
    try:
        content = real_bytes(file(path), LARGEST, follow=True)
    except (OSError, StoreError):
        return
    for line in content.decode(errors="replace").split("\n"):
        if line.strip():
            event = _event(line)
            # An older program wrote the next event to the line that a stop had left half-written.
            if event is None and (begins := line.rfind(BEGIN)) > 0:
                yield None
                event = _event(line[begins:])
            yield event


def _event(line: str) -> dict[str, Any] | None:
    with contextlib.suppress(ValueError, RecursionError):
        event = json.loads(line)
        return event if isinstance(event, dict) else None
    return None


def events(path: Path) -> Iterator[dict[str, Any]]:
    """All readable events of a cube's log."""
    return (event for event in _lines(path) if event is not None)


def unreadable(path: Path) -> int:
    """Number of lines of a cube's log that cannot be read: of a stop in the middle of one, or damaged."""
    return sum(event is None for event in _lines(path))


def last_begin(path: Path) -> dict[str, Any]:
    """The ``begin`` event of the latest run of a cube; empty when none can be read."""
    latest: dict[str, Any] = {}
    for event in events(path):
        if event.get("event") == "begin":
            latest = event
    return latest


def reported(path: Path, fingerprint: str, checksums: bool = False) -> set[tuple[str, int, int]]:
    """Chunks (group, amplitude, block) that runs of the study have reported as complete and not withdrawn since.

    ``checksums``: only chunks whose checksums were stored, which older versions did not do.
    """
    chunks: set[tuple[str, int, int]] = set()
    begun = None
    for event in events(path):
        if event.get("event") == "begin":
            begun = event.get("fingerprint")  # older programs named the study here alone
        ours = event.get("fingerprint", begun) == fingerprint  # an extended study has other chunks
        if event.get("event") == "block" and ours and event.get("complete") is True:
            with contextlib.suppress(KeyError, TypeError, ValueError, OverflowError):
                if not checksums or event.get("checksums") is True:
                    chunks |= {(str(event["group"]), int(a), int(b)) for a, b in event["chunks"]}
        elif event.get("event") == "present" and ours:
            with contextlib.suppress(KeyError, TypeError, ValueError, OverflowError):
                chunks |= {(str(g), int(a), int(b)) for g, a, b in event["chunks"]}
        elif event.get("event") == "taken_back" and ours:
            with contextlib.suppress(KeyError, TypeError, ValueError, OverflowError):
                chunks -= {(str(g), int(a), int(b)) for g, a, b in event["chunks"]}
    return chunks

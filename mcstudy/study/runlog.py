"""The run log of a cube: times and versions of all runs, and the chunks that each run wrote.

A chunk that is found damaged later is first reported in the log as no longer complete, and then written again.

The log is ``OUT.log/runs.jsonl``, one JSON object per line, next to the cube and not part of it: times differ between
runs, results must not. It holds no host or user names.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from mcstudy.files.durable import log_folder


class RunLog:
    """Appends events of one run."""

    def __init__(self, path: Path, run: str) -> None:
        self._file, self._run = log_folder(path) / "runs.jsonl", run

    def add(self, event: str, **values: Any) -> None:
        """Write one line and flush it, so that a killed run leaves its first lines."""
        now = datetime.now(UTC).isoformat(timespec="seconds")
        with self._file.open("a", encoding="utf-8") as file:
            print(json.dumps({"time": now, "run": self._run, "event": event, **values}), file=file)


def events(path: Path) -> Iterator[dict[str, Any]]:
    """All readable events of a cube's log."""
    try:
        with (log_folder(path) / "runs.jsonl").open(encoding="utf-8", errors="replace") as file:
            for line in file:
                try:
                    event = json.loads(line)
                except (ValueError, RecursionError):
                    continue  # the last line of a run that was killed, or damage
                if isinstance(event, dict):
                    yield event
    except OSError:
        return


def last_begin(path: Path) -> dict[str, Any]:
    """The ``begin`` event of the latest run of a cube; empty when none can be read."""
    found: dict[str, Any] = {}
    for event in events(path):
        if event.get("event") == "begin":
            found = event
    return found


def reported(path: Path, fingerprint: str, checksums: bool = False) -> set[tuple[str, int, int]]:
    """Chunks (group, amplitude, block) that runs of the study have reported as complete and not withdrawn since.

    ``checksums``: only chunks whose checksums were stored, which older versions did not do.
    """
    chunks: set[tuple[str, int, int]] = set()
    ours = False
    for event in events(path):
        if event.get("event") == "begin":
            ours = event.get("fingerprint") == fingerprint  # an extended study has other chunks
        elif event.get("event") == "block" and ours and event.get("complete") is True:
            with contextlib.suppress(KeyError, TypeError, ValueError):
                if not checksums or event.get("checksums") is True:
                    chunks |= {(str(event["group"]), int(a), int(b)) for a, b in event["chunks"]}
        elif event.get("event") == "taken_back" and ours:
            with contextlib.suppress(KeyError, TypeError, ValueError):
                chunks -= {(str(g), int(a), int(b)) for g, a, b in event["chunks"]}
    return chunks

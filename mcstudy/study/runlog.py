"""The log of a cube: when it was worked on, by which versions, and which chunks each run wrote.

One JSON object a line in ``OUT.log/runs.jsonl``, beside the cube and never part of it: times differ between runs,
results must not. No host or user names.
"""

from __future__ import annotations

import json
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from mcstudy.study.durable import log_folder


class RunLog:
    """Appends events of one run."""

    def __init__(self, path: Path, run: str) -> None:
        self._file, self._run = log_folder(path) / "runs.jsonl", run

    def add(self, event: str, **values: Any) -> None:
        """One line; flushed at once, so that a killed run leaves its beginning."""
        now = datetime.now(UTC).isoformat(timespec="seconds")
        with self._file.open("a", encoding="utf-8") as file:
            print(json.dumps({"time": now, "run": self._run, "event": event, **values}), file=file)


def last_begin(path: Path) -> dict[str, Any]:
    """The ``begin`` of the latest run of a cube, empty when there is none that can be read."""
    found: dict[str, Any] = {}
    try:
        with (log_folder(path) / "runs.jsonl").open(encoding="utf-8", errors="replace") as file:
            for line in file:
                try:
                    event = json.loads(line)
                except (ValueError, RecursionError):
                    continue  # the last line of a run that was killed, or damage
                if isinstance(event, dict) and event.get("event") == "begin":
                    found = event
    except OSError:
        pass
    return found

"""How far a study on disk is, seen from beside the run that writes it."""

from __future__ import annotations

from pathlib import Path

from mcstudy.files.durable import PARTIAL


def complete_chunks(out: Path, group: str = "noisy") -> int:
    """Chunks of a group whose status is in place; one that is still being written under another name is not."""
    files = (out / group / "status").glob("c.*")
    return sum(1 for file in files if file.suffix not in (PARTIAL, ".checksums"))

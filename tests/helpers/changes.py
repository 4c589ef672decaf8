"""A change of the package made in a copy of it, as somebody who adds something would make it."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
PARTS = ("mcstudy", "results_schema", "pipelines")
LEFT_OUT = ("benchmarks", "docs", "validation")
"""Of `pipelines`: what is never installed."""


class Copy:
    """The package copied into an empty folder; ``touched`` holds the files that the change adds or edits."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.touched: set[str] = set()
        for part in PARTS:
            shutil.copytree(ROOT / part, folder / part, ignore=shutil.ignore_patterns(*LEFT_OUT))

    def add(self, file: str, text: str) -> None:
        """A new file."""
        path = self.folder / file
        assert not path.exists(), f"{file} exists"
        path.write_text(text, encoding="utf-8")
        self.touched.add(file)

    def edit(self, file: str, old: str, new: str) -> None:
        """Replace the one place of a file that reads ``old``."""
        path = self.folder / file
        text = path.read_text(encoding="utf-8")
        assert text.count(old) == 1, f"{file}: expected once, found {text.count(old)} times: {old!r}"
        path.write_text(text.replace(old, new), encoding="utf-8")
        self.touched.add(file)

    def run(self, code: str) -> str:
        """What a program prints that runs with the copy."""
        path = os.pathsep.join(str(p) for p in (self.folder, self.folder / "pipelines"))
        done = subprocess.run(
            [sys.executable, "-c", code],
            cwd=self.folder,
            env=os.environ | {"PYTHONPATH": path},
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

"""A few histories of runs, kills, extensions and damage; `state_machine` says how to try many more."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path


def test_no_history_loses_anything_or_ends_in_other_bytes() -> None:
    """In a process of its own, which can be forked: the one the tests run in has threads."""
    script = Path(__file__).with_name("state_machine.py")
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    tried = {what: int(n) for n, what in re.findall(r"(\d+) ([a-z ]+)", done.stdout.splitlines()[-1])}
    for what in ("kills", "files damaged", "looks by verify", "runs to the end"):
        assert tried.get(what, 0) > 1, tried

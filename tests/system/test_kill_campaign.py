"""A short campaign of random faults, and proof that it would notice; `kill_campaign` says how to run a long one."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path


def test_random_kills_lose_nothing_and_change_nothing() -> None:
    script = Path(__file__).with_name("kill_campaign.py")
    done = subprocess.run(
        [sys.executable, str(script), "--kills", "8", "--seed", "3", "--realizations", "8"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.splitlines()[-1].startswith("| **all** | 8 | 0 | 0 |"), done.stdout


def test_the_campaign_notices_every_sabotage() -> None:
    """Writes that are not atomic, reports before the write, status not last, and more."""
    script = Path(__file__).with_name("sabotage.py")
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.count("noticed after") == 6

"""Short campaigns of random faults and histories, and proof that they would notice.

They run in processes of their own, which can be forked: the one the tests run in has threads.
`pipelines/validation/faults` says how to run long ones.
"""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

FAULTS = Path(__file__).parents[2] / "pipelines" / "validation" / "faults"


def printed(script: str, *words: str) -> str:
    command = [sys.executable, str(FAULTS / script), *words]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_random_kills_lose_nothing_and_change_nothing() -> None:
    said = printed("kill_campaign.py", "--kills", "8", "--seed", "3", "--realizations", "8")
    assert said.splitlines()[-1].startswith("| **all** | 8 | 0 | 0 |"), said


def test_the_campaign_notices_every_sabotage() -> None:
    """Writes that are not atomic, reports before the write, status not last, and more."""
    assert printed("sabotage.py").count("noticed after") == 6


def test_no_history_loses_anything_or_ends_in_other_bytes() -> None:
    last = printed("state_machine.py").splitlines()[-1]
    tried = {what: int(n) for n, what in re.findall(r"(\d+) ([a-z ]+)", last)}
    for what in ("kills", "files damaged", "looks by verify", "runs to the end"):
        assert tried.get(what, 0) > 1, tried

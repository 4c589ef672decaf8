"""A machine that sleeps while a study runs: the run goes on when it wakes."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from mcstudy.study.durable import tree_digest

STUDY = """
[study]
name = "nap"
seed = 7

[group.noisy]
realizations = 60
starts = 50
fmax = [1.2, 8.0]
amplitude = [5.0]
"""

GIVEN_UP_AFTER = "1s"
"""Silence after which a scheduler that is not told otherwise gives a worker up (its default is five minutes)."""

NAP_S = 8
"""Longer than that, and than ten of the worker's heartbeats."""


def test_a_run_goes_on_after_a_sleep(tmp_path: Path) -> None:
    (tmp_path / "nap.toml").write_text(STUDY)

    def command(out: str) -> list[str]:
        words = ["run", "nap.toml", "-o", out, "--workers", "1", "--block", "1"]
        return [sys.executable, "-m", "mcstudy", *words]

    impatient = {**os.environ, "DASK_DISTRIBUTED__SCHEDULER__WORKER_TTL": GIVEN_UP_AFTER}
    process = subprocess.Popen(command("slept.zarr"), cwd=tmp_path, env=impatient, stderr=subprocess.PIPE)
    while not any((tmp_path / "slept.zarr" / "noisy" / "status").glob("c.*")):
        assert process.poll() is None
        time.sleep(0.01)
    process.send_signal(signal.SIGSTOP)
    time.sleep(NAP_S)
    process.send_signal(signal.SIGCONT)
    try:
        _, errors = process.communicate(timeout=120)
    finally:
        process.kill()
    assert process.returncode == 0, errors
    subprocess.run(command("awake.zarr"), cwd=tmp_path, check=True, capture_output=True)
    assert tree_digest(tmp_path / "slept.zarr") == tree_digest(tmp_path / "awake.zarr")

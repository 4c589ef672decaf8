"""Real processes, really killed: nothing that was done is lost, and the end result is the same bytes."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from mcstudy.study.durable import log_folder, tree_digest

# Some seconds of work in twenty chunks: enough to be killed in the middle of.
STUDY = """
[study]
name = "slow"
seed = 7

[group.noisy]
realizations = 60
starts = 50
fmax = [1.2, 8.0]
amplitude = [5.0]
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("system")
    (path / "slow.toml").write_text(STUDY)
    return path


def command(folder: Path, out: Path, *extra: str) -> list[str]:
    return [sys.executable, "-m", "mcstudy", "run", str(folder / "slow.toml"), "-o", str(out), *extra]


def start(folder: Path, out: Path, *extra: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        command(folder, out, *extra), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )


def wait_for_chunks(process: subprocess.Popen[str], out: Path, n: int) -> None:
    """Until ``n`` chunks are complete; fails if the process ends before."""
    while sum(1 for _ in (out / "noisy" / "status").glob("c.*")) < n:
        assert process.poll() is None, process.communicate()
        time.sleep(0.01)


def finish(folder: Path, out: Path, *extra: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command(folder, out, *extra), capture_output=True, text=True, check=True)


@pytest.fixture(scope="module")
def whole(folder: Path) -> str:
    """Digest of an uninterrupted run."""
    out = folder / "whole.zarr"
    finish(folder, out, "--workers", "1")
    return tree_digest(out)


@pytest.mark.parametrize("chunks", [1, 7])
def test_after_kill_9_a_second_run_completes_the_same_bytes(folder: Path, whole: str, chunks: int) -> None:
    out = folder / f"killed{chunks}.zarr"
    process = start(folder, out, "--workers", "1", "--block", "1")
    wait_for_chunks(process, out, chunks)
    process.kill()
    process.communicate()
    done = finish(folder, out, "--workers", "1")
    assert " 0 were there already" not in done.stdout
    assert tree_digest(out) == whole


@pytest.mark.parametrize("sign", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_drains_says_how_to_resume_and_loses_nothing(folder: Path, whole: str, sign: signal.Signals) -> None:
    out = folder / f"stopped{sign}.zarr"
    process = start(folder, out, "--workers", "1", "--block", "1")
    wait_for_chunks(process, out, 1)
    process.send_signal(sign)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 3, errors
    assert "run the same command again to resume" in errors.splitlines()[-1]
    assert "Traceback" not in errors
    finish(folder, out)
    assert tree_digest(out) == whole


def test_a_second_run_on_a_store_in_use_is_refused(folder: Path) -> None:
    out = folder / "shared.zarr"
    process = start(folder, out, "--workers", "1")
    wait_for_chunks(process, out, 1)
    process.send_signal(signal.SIGSTOP)  # it holds the store for as long as this test needs
    second = subprocess.run(command(folder, out), capture_output=True, text=True, check=False)
    process.kill()
    process.communicate()
    assert second.returncode == 2
    assert "another run is writing" in second.stderr
    assert second.stderr.count("\n") == 1


def test_a_read_only_target_is_one_line_and_exit_2(folder: Path) -> None:
    target = folder / "readonly"
    target.mkdir()
    target.chmod(0o555)
    if os.access(target, os.W_OK):
        pytest.skip("this user can write anywhere")
    done = subprocess.run(command(folder, target / "out.zarr"), capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1


def test_the_log_tells_every_run(folder: Path, whole: str) -> None:
    assert whole
    text = (log_folder(folder / "whole.zarr") / "runs.jsonl").read_text()
    assert text.count('"event": "begin"') == text.count('"event": "end"') == 1

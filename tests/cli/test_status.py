"""``mcstudy status --watch`` follows a run of another process to its end."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from mcstudy.cli import main
from mcstudy.exits import Exit
from mcstudy.study.cube.store import Cube
from mcstudy.study.run import run_study
from mcstudy.study.study_file import read_study

STUDY = """
[study]
name = "watched"
seed = 3

[group.noisy]
realizations = 4
starts = 4
fmax = [1.2]
amplitude = [5.0]
"""


def test_another_shell_sees_the_run_through(tmp_path: Path) -> None:
    file, out = tmp_path / "study.toml", tmp_path / "out.zarr"
    file.write_text(STUDY)
    Cube.create(out, read_study(file))
    words = [sys.executable, "-m", "mcstudy", "status", str(out), "--watch", "--every", "0.1"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as watcher:
        assert watcher.stdout is not None
        assert "study watched" in watcher.stdout.readline()  # it is there before the first fit
        assert "0/16 fits (0 %)" in watcher.stdout.readline()
        run_study(read_study(file), out)
        rest = watcher.stdout.read()
        assert watcher.wait(60) == Exit.DONE
    assert "1/1 chunks  16/16 fits (100 %)" in rest
    assert "0 failed" in rest
    assert "mean |bias|" in rest
    assert "MCSE; 4 realizations" in rest


def test_ctrl_c_ends_only_the_watching(tmp_path: Path) -> None:
    file, out = tmp_path / "study.toml", tmp_path / "out.zarr"
    file.write_text(STUDY)
    Cube.create(out, read_study(file))
    words = [sys.executable, "-m", "mcstudy", "status", str(out), "--watch", "--every", "1000"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as watcher:
        assert watcher.stdout is not None
        assert "study watched" in watcher.stdout.readline()
        watcher.send_signal(signal.SIGINT)
        try:
            _, errors = watcher.communicate(timeout=60)
        finally:
            watcher.kill()  # it would watch for a quarter of an hour
        assert (watcher.returncode, errors) == (Exit.DONE, "")


def test_watching_and_json_exclude_each_other(tmp_path: Path) -> None:
    with pytest.raises(SystemExit) as stopped:
        main(["status", str(tmp_path), "--watch", "--json"])
    assert stopped.value.code == 2

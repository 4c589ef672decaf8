"""Real processes, really killed: nothing that was done is lost, and the end result is the same bytes."""

from __future__ import annotations

import contextlib
import ctypes
import io
import json
import os
import shlex
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from chunks import complete_chunks
from cubes import numbers

from mcstudy.cli import main
from mcstudy.exits import Exit
from mcstudy.files.durable import log_folder, tree_digest

OWN = Path(__file__).parents[2] / "pipelines" / "examples" / "own_model.toml"

# Four chunks of 16 fits.
STUDY = """
[study]
name = "slow"
seed = 7

[group.noisy]
realizations = 8
starts = 4
fmax = [1.2, 8.0]
amplitude = [5.0]
"""

# `mcstudy` that makes new cubes of small chunks (an old one keeps those it has), and whose blocks pause before they
# start and hear no stop request, so that there is a middle to kill it in however fast the machine is.
PAUSES = """
import sys, time
import mcstudy.study.execution.attempt as attempt
from dataclasses import replace
from mcstudy.fitting.solvers import solvers
from mcstudy.study.execution.tasks import run_task
solvers()["lm"] = replace(solvers()["lm"], fits_a_chunk=(16, 16))
ran = []
def pausing(task):
    ran.append(task)
    if len(ran) > {after}:
        time.sleep({pause_s})
    return run_task(task)
attempt.run_task = pausing
from mcstudy.cli import main
sys.exit(main())
"""

FOR_EVER_S = 1000
"""A pause that no test waits for."""

ONE_BY_ONE = ("--workers", "1", "--block", "1")
"""One worker, one block a chunk."""

GIVEN_UP_AFTER = "1s"
"""Silence after which a scheduler that is not told otherwise gives a worker up (its default is five minutes)."""

NAP_S = 8
"""Longer than that, and than ten of the worker's heartbeats."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("system")
    (path / "slow.toml").write_text(STUDY)
    own = OWN.read_text(encoding="utf-8").replace("realizations = 50", "realizations = 4")
    (path / "own.toml").write_text(own.replace("[group.elbow]", "[group.noisy]"))
    return path


def command(folder: Path, out: Path, *extra: str, study: str = "slow") -> list[str]:
    return [sys.executable, "-m", "mcstudy", "run", str(folder / f"{study}.toml"), "-o", str(out), *extra]


def start(
    folder: Path, out: Path, *extra: str, after: int = 1, pause_s: float = 2, study: str = "slow"
) -> subprocess.Popen[str]:
    """A run, block by block, whose blocks pause from the one that follows ``after``."""
    program = PAUSES.format(after=after, pause_s=pause_s)
    words = command(folder, out, *ONE_BY_ONE, *extra, study=study)[3:]
    return subprocess.Popen(
        [sys.executable, "-c", program, *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def wait_for_chunks(process: subprocess.Popen[str], out: Path, n: int) -> None:
    """Until ``n`` chunks are complete; fails if the process ends before."""
    while complete_chunks(out) < n:
        assert process.poll() is None, process.communicate()
        time.sleep(0.01)


def finish(words: list[str]) -> str:
    """Run `mcstudy` with ``words`` to its end, in this process; what it prints."""
    with contextlib.redirect_stdout(io.StringIO()) as said:
        assert main(words) == Exit.DONE
    return said.getvalue()


@pytest.fixture(scope="module")
def whole(folder: Path) -> str:
    """Digest of an uninterrupted run."""
    out = folder / "whole.zarr"
    process = start(folder, out, pause_s=0)
    assert process.communicate(timeout=100)
    assert process.returncode == 0
    assert complete_chunks(out) == 4
    return tree_digest(out)


@pytest.mark.parametrize("chunks", [1, 3])
def test_after_kill_9_a_second_run_completes_the_same_bytes(folder: Path, whole: str, chunks: int) -> None:
    out = folder / f"killed{chunks}.zarr"
    process = start(folder, out, after=chunks, pause_s=FOR_EVER_S)
    wait_for_chunks(process, out, chunks)
    process.kill()
    process.communicate()
    assert " 0 already done" not in finish(command(folder, out, "--workers", "1")[3:])
    assert tree_digest(out) == whole


def test_a_model_of_ones_own_is_killed_resumed_on_two_workers_verified_and_reported_as_any_other(folder: Path) -> None:
    assert len(OWN.read_text(encoding="utf-8").splitlines()) <= 30
    out, whole = folder / "own.zarr", folder / "own_whole.zarr"
    process = start(folder, out, after=2, pause_s=FOR_EVER_S, study="own")
    wait_for_chunks(process, out, 2)
    process.kill()
    process.communicate()
    assert " 0 already done" not in finish(command(folder, out, "--workers", "2", study="own")[3:])
    assert start(folder, whole, pause_s=0, study="own").communicate(timeout=100)
    assert ": 0 damaged" in finish(["verify", str(out)])
    assert numbers(out) == numbers(whole)
    page = folder / "own.html"
    finish(["report", str(out), "-o", str(page)])
    assert "intrinsic stiffness" in page.read_text(encoding="utf-8")


@pytest.mark.parametrize("sign", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_drains_says_how_to_resume_and_loses_nothing(folder: Path, whole: str, sign: signal.Signals) -> None:
    out = folder / f"stopped{sign}.zarr"
    process = start(folder, out)
    wait_for_chunks(process, out, 1)
    process.send_signal(sign)
    _, errors = process.communicate(timeout=100)
    assert process.returncode == 3, errors
    message, again = errors.splitlines()[-1].split("run the same command again to resume: ")
    assert " fits left; " in message
    assert shlex.split(again) == ["mcstudy", *command(folder, out, *ONE_BY_ONE)[3:]]
    assert "Traceback" not in errors
    finish(shlex.split(again)[1:])
    assert tree_digest(out) == whole


@pytest.mark.parametrize("times", [1, 2])
def test_ctrl_c_leaves_a_block_that_hangs_and_twice_does_not_wait_for_it_at_all(
    folder: Path, whole: str, times: int
) -> None:
    out = folder / f"hanging{times}.zarr"
    process = start(folder, out, after=2, pause_s=FOR_EVER_S)
    wait_for_chunks(process, out, 2)
    process.send_signal(signal.SIGINT)
    if times == 2:
        assert process.stderr is not None
        while "Ctrl-C again to quit at once" not in process.stderr.readline():
            assert process.poll() is None
        process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 3, errors
    last = errors.splitlines()[-1]
    # How many fits are left is what a drained run says; one that left at once has not waited to know.
    assert (" fits left; " in last) == (times == 1)
    words = ["mcstudy", *command(folder, out, *ONE_BY_ONE)[3:]]
    assert last.endswith(f"run the same command again to resume: {shlex.join(words)}")
    assert "Traceback" not in errors
    assert " 0 already done" not in finish(command(folder, out)[3:])
    assert tree_digest(out) == whole


def test_a_run_goes_on_after_the_machine_slept(folder: Path, whole: str, monkeypatch: pytest.MonkeyPatch) -> None:
    out = folder / "slept.zarr"
    monkeypatch.setenv("DASK_DISTRIBUTED__SCHEDULER__WORKER_TTL", GIVEN_UP_AFTER)
    process = start(folder, out)
    wait_for_chunks(process, out, 1)
    process.send_signal(signal.SIGSTOP)
    time.sleep(NAP_S)
    process.send_signal(signal.SIGCONT)
    try:
        _, errors = process.communicate(timeout=120)
    finally:
        process.kill()
    assert process.returncode == 0, errors
    assert tree_digest(out) == whole


@pytest.mark.usefixtures("whole")
def test_other_thread_settings_are_warned_of_and_noted_and_a_cube_keeps_those_it_was_made_with(folder: Path) -> None:
    out = folder / "threads.zarr"
    process = start(folder, out, pause_s=FOR_EVER_S)
    wait_for_chunks(process, out, 1)
    process.kill()
    process.communicate()
    other = {**os.environ, "OMP_NUM_THREADS": "2", "NUMBA_NUM_THREADS": "2"}
    done = subprocess.run(command(folder, out), capture_output=True, text=True, check=True, env=other)
    was = os.environ.get("NUMBA_NUM_THREADS", "unset")
    differ = [f"threads.NUMBA_NUM_THREADS: {was} -> 2", "threads.OMP_NUM_THREADS: 1 -> 2"]
    warning = "warning: the cube was created in another environment, so last digits may differ: "
    (told,) = [line for line in done.stderr.splitlines() if line.startswith(warning)]
    assert all(line in told for line in differ)
    events = [json.loads(line) for line in (log_folder(out) / "runs.jsonl").read_text().splitlines()]
    first, last = (e for e in events if e["event"] == "begin")
    assert first["environment"]["threads"]["OMP_NUM_THREADS"] == "1"
    assert last["environment"]["threads"]["OMP_NUM_THREADS"] == "2"
    assert [e for e in events if e["event"] == "block"][-1]["other_environment"] == differ
    assert numbers(out) == numbers(folder / "whole.zarr")  # other files say which chunk was computed where


def without_override() -> None:
    """Take from a child process what lets root write into folders that say nobody may."""
    bounding_set_drop, dac_override = 24, 1  # linux/prctl.h, linux/capability.h
    if os.geteuid() == 0 and ctypes.CDLL(None).prctl(bounding_set_drop, dac_override, 0, 0, 0):
        raise OSError("this root may not drop a capability")


@pytest.mark.parametrize("verb", ["run", "resume", "extend"])
def test_a_read_only_target_is_one_line_and_exit_2(folder: Path, whole: str, verb: str) -> None:
    target = folder / f"readonly-{verb}"
    target.mkdir()
    words = command(folder, target / "out.zarr")
    if verb != "run":
        shutil.copytree(folder / "whole.zarr", target / "out.zarr")
        (target / "out.zarr" / "noisy" / "status" / "c.0.0.1.0").unlink()  # there is something to do
    if verb == "extend":
        words = [*words[:3], "extend", str(target / "out.zarr"), "--realizations", "9"]
    places = [target, *(p for p in target.rglob("*") if p.is_dir())]
    for place in places:
        place.chmod(0o555)
    try:
        writes = "import sys, pathlib; pathlib.Path(sys.argv[1], 'x').touch()"
        probe = subprocess.run(
            [sys.executable, "-c", writes, str(target)], capture_output=True, check=False, preexec_fn=without_override
        )
        if probe.returncode == 0:
            pytest.skip("this user can write anywhere")
        done = subprocess.run(words, capture_output=True, text=True, check=False, preexec_fn=without_override)
    except subprocess.SubprocessError:
        pytest.skip("this user can write anywhere")
    finally:
        for place in places:
            place.chmod(0o755)
    assert done.returncode == 2, done.stderr
    assert done.stderr.count("\n") == 1
    assert "expected a writable folder" in done.stderr
    if verb != "run":
        (target / "out.zarr" / "noisy" / "status" / "c.0.0.1.0").write_bytes(
            (folder / "whole.zarr" / "noisy" / "status" / "c.0.0.1.0").read_bytes()
        )
        assert tree_digest(target / "out.zarr") == whole

"""A scheduler and workers of real processes: same bytes, whoever dies, and nothing done twice or lost."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import dask_processes
import psutil
import pytest
import quick_solver
from certificates import certificates
from chunks import complete_chunks
from dask_processes import Cluster, cluster
from distributed import Client
from distributed.security import Security

from mcstudy.errors import InputError, Interrupted
from mcstudy.files.durable import tree_digest
from mcstudy.scheduler.cluster import ClusterOptions, reach
from mcstudy.scheduler.fan_out import fan_out
from mcstudy.study.cube.store import Cube
from mcstudy.study.execution import submission
from mcstudy.study.run import Outcome, run_study
from mcstudy.study.study_file import parse_study, read_study

STUDY = """
[study]
name = "shared"
seed = 7

[group.noisy]
realizations = 60
starts = 4
fmax = [0.41]
amplitude = [5.0]

[group.odd]
realizations = 4
starts = 2
fmax = [0.41]
amplitude = [5.0]
"""

STUDY_FITS = 60 * 4 + 4 * 2

# Loaded by workers: every block takes a moment, so that there is a middle of the run to kill in; and one group may
# do worse.
PRELOAD = """
import os, time
import mcstudy.study.execution.attempt as attempt
from mcstudy.study.execution.tasks import run_task  # this file may be loaded twice
def slow(task):
    time.sleep(0.05)
    if task.group == "odd":
        {odd}
    return run_task(task)
attempt.run_task = slow
"""

# Loaded by a worker that, after some blocks, waits for another one to join.
WAITS = """
import os, time
import mcstudy.study.execution.attempt as attempt
from mcstudy.study.execution.tasks import run_task
ran = []
def waits(task):
    ran.append(task)
    while len(ran) > 5 and not os.path.exists({joined!r}):
        time.sleep(0.01)
    time.sleep(0.05)
    return run_task(task)
attempt.run_task = waits
"""


@pytest.fixture(autouse=True, scope="module")
def small_chunks() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(*quick_solver.lm(fits_a_chunk=(8, 8)))
        yield


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("cluster")
    (path / "shared.toml").write_text(STUDY)
    for name, odd in (("slow", "pass"), ("kill", "os._exit(1)"), ("hang", "time.sleep(1000)")):
        (path / f"{name}.py").write_text(PRELOAD.format(odd=odd))
    return path


@pytest.fixture(scope="module")
def local(folder: Path, small_chunks: None) -> str:  # noqa: ARG001
    """Digest of a run on threads of one process."""
    run_study(parse_study(STUDY), folder / "local.zarr", ClusterOptions(workers=1))
    return tree_digest(folder / "local.zarr")


@pytest.fixture(scope="module")
def plain(folder: Path) -> Iterator[Cluster]:
    with cluster(folder / "plain") as made:
        for _ in range(2):
            made.add_worker("--preload", str(folder / "slow.py"))
        made.wait_for(2)
        yield made


def run(out: Path, made: Cluster, **options: object) -> Outcome:
    return run_study(
        read_study(out.parent / "shared.toml"), out, ClusterOptions(scheduler=made.address, **options), block=1
    )  # type: ignore[arg-type]


def meanwhile(out: Path, chunks: int, act: Callable[[], None]) -> threading.Thread:
    """Do something as soon as some chunks are on disk, beside a run."""

    def wait() -> None:
        end = time.monotonic() + 100
        while complete_chunks(out) < chunks and time.monotonic() < end:
            time.sleep(0.01)
        act()

    thread = threading.Thread(target=wait)
    thread.start()
    return thread


def test_a_scheduler_ends_with_the_tests_that_started_it_even_if_they_are_killed(tmp_path: Path) -> None:
    """They close nothing then."""
    program = f"import dask_processes, pathlib; c = dask_processes.Cluster(pathlib.Path({str(tmp_path)!r})); "
    helpers = Path(dask_processes.__file__).parent
    tests = subprocess.Popen(
        [sys.executable, "-c", program + "print(c.scheduler.pid, flush=True); input()"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": str(helpers)},
    )
    with tests:
        assert tests.stdout is not None
        scheduler = psutil.Process(int(tests.stdout.readline()))
        tests.kill()
    try:
        scheduler.wait(timeout=60)
    finally:
        with contextlib.suppress(psutil.NoSuchProcess):
            scheduler.kill()


def test_two_worker_processes_write_the_same_bytes_as_local_threads(folder: Path, local: str, plain: Cluster) -> None:
    outcome = run(folder / "tcp.zarr", plain)
    assert (outcome.fits, outcome.failed_blocks) == (STUDY_FITS, [])
    assert tree_digest(folder / "tcp.zarr") == local


def test_a_killed_worker_and_then_all_of_them_replaced_cost_nothing(folder: Path, local: str, plain: Cluster) -> None:
    def kill_all_and_replace() -> None:
        for worker in plain.workers[:2]:
            worker.kill()
        plain.add_worker("--preload", str(folder / "slow.py"))

    out = folder / "killed.zarr"
    threads = [meanwhile(out, 3, plain.workers[0].kill), meanwhile(out, 10, kill_all_and_replace)]
    outcome = run(out, plain)
    for thread in threads:
        thread.join()
    assert outcome.failed_blocks == []
    assert tree_digest(out) == local


def test_a_worker_that_retires_and_one_that_joins_mid_run_leave_no_trace(folder: Path, local: str) -> None:
    out, joined = folder / "handed.zarr", folder / "joined"
    ends: list[int] = []
    chunks: list[int] = []

    with cluster(folder / "handed") as made:
        (folder / "waits.py").write_text(WAITS.format(joined=str(joined)))
        first = made.add_worker("--preload", str(folder / "waits.py"))
        made.wait_for(1)

        def hand_over() -> None:
            with Client(made.address, set_as_default=False) as client:
                old = list(client.nthreads())
                made.add_worker("--preload", str(folder / "slow.py"))
                client.wait_for_workers(2, timeout=60)
                chunks.append(complete_chunks(out))
                joined.touch()
                client.retire_workers(old)
            ends.append(first.wait(timeout=100))

        thread = meanwhile(out, 3, hand_over)
        outcome = run(out, made)
        thread.join()
    assert ends == [0]  # it went by itself
    assert chunks[0] < 30  # the other one came while there was something to do
    assert outcome.failed_blocks == []
    assert tree_digest(out) == local


def test_a_killed_scheduler_ends_the_run_as_resumable(folder: Path, local: str, plain: Cluster) -> None:
    out = folder / "orphaned.zarr"
    study = parse_study(STUDY)
    thread = meanwhile(out, 3, plain.scheduler.kill)
    with pytest.raises(Interrupted, match=r"lost connection to the scheduler with .* run the same command again"):
        run(out, plain)
    thread.join()
    done = run_study(study, out, ClusterOptions(workers=1))
    assert done.skipped > 0
    assert tree_digest(out) == local


def test_a_scheduler_that_is_gone_is_exit_3_and_never_there_exit_2(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with cluster(folder / "short") as made:
        out = folder / "exit.zarr"
        command = [sys.executable, "-m", "mcstudy", "run", str(folder / "shared.toml"), "-o", str(out)]
        process = subprocess.Popen([*command, "--scheduler", made.address], stderr=subprocess.PIPE, text=True)
        assert process.stderr is not None
        while "no workers" not in process.stderr.readline():
            assert process.poll() is None
        made.scheduler.send_signal(signal.SIGKILL)
        _, errors = process.communicate(timeout=100)
        assert process.returncode == 3, errors
        assert "lost connection to the scheduler" in errors.splitlines()[-1]
        assert "Traceback" not in errors
    monkeypatch.setattr("mcstudy.scheduler.cluster.CONNECT_S", 1)
    with pytest.raises(InputError, match="expected a running scheduler"):
        run(folder / "never.zarr", made)


def test_a_challenge_whose_scheduler_or_workers_die_is_resumable(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with cluster(folder / "challenge") as made:
        made.add_worker()
        results = fan_out(time.sleep, [0.01] * 50 + [5.0], ClusterOptions(scheduler=made.address), "data")
        assert next(results) == (0.01, None)
        made.scheduler.send_signal(signal.SIGKILL)
        with pytest.raises(Interrupted, match=r"data: lost connection to the scheduler with \d+ cases left"):
            list(results)
    monkeypatch.setenv("DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES", "0")  # the first death is one too many
    with cluster(folder / "dying") as made:
        made.add_worker()
        with pytest.raises(Interrupted, match=r"data: workers kept dying .* with 1 cases left"):
            list(fan_out(os._exit, [1], ClusterOptions(scheduler=made.address), "data"))


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # the stream of a handshake that failed
def test_tls_with_certificates_gives_the_same_bytes_and_refuses_those_without(folder: Path, local: str) -> None:
    files = certificates(folder / "tls")
    words = ("--tls-ca-file", str(files["ca"]), "--tls-cert", str(files["cert"]), "--tls-key", str(files["key"]))
    security = Security(
        tls_ca_file=str(files["ca"]),
        tls_client_cert=str(files["cert"]),
        tls_client_key=str(files["key"]),
        require_encryption=True,
    )
    with cluster(folder / "tls", "tls", words) as made:
        assert made.address.startswith("tls://")
        made.add_worker()
        made.wait_for(1, security)
        out = folder / "tls.zarr"
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("mcstudy.scheduler.cluster.CONNECT_S", 2)
            stranger = certificates(folder / "stranger")
            with pytest.raises(InputError, match="expected a running scheduler"):
                run(out, made, **{f"tls_{k}": stranger[k] for k in ("ca", "cert", "key")})
            with pytest.raises(InputError, match="expected PEM files for a tls:// scheduler, got none"):
                run(out, made)
            with pytest.raises(InputError, match="expected a running scheduler"):  # unencrypted where TLS is expected
                reach(ClusterOptions(scheduler=made.address.replace("tls:", "tcp:")))
            with cluster(folder / "bare") as bare:
                own = {f"tls_{k}": files[k] for k in ("ca", "cert", "key")}
                with pytest.raises(InputError, match="expected a running scheduler"):  # and the other way round
                    reach(ClusterOptions(scheduler=bare.address.replace("tcp:", "tls:"), **own))
        run(out, made, **{f"tls_{k}": files[k] for k in ("ca", "cert", "key")})
        assert tree_digest(out) == local


def test_a_block_that_kills_every_worker_it_meets_is_reported_and_the_rest_finishes(
    folder: Path, local: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(submission, "STARTS", 2)
    out = folder / "killer.zarr"
    with cluster(folder / "killer") as made:
        made.add_worker("--preload", str(folder / "kill.py"), nanny=True)
        outcome = run(out, made)
    (line,) = outcome.failed_blocks
    assert "group odd" in line
    assert "workers died" in line
    assert outcome.fits == STUDY_FITS - 8
    run_study(parse_study(STUDY), out, ClusterOptions(workers=1))
    assert tree_digest(out) == local


LIES = {
    "no report": ('"nonsense"', "its worker returned no report but Attempt"),
    "nothing that can be sent": ("__import__('threading').Lock()", "Could not serialize object of type Attempt"),
    "work that was not done": ("TaskReport(Counter({1: 8}), True, 0.1)", "reported as done, but not in the cube"),
}


def test_a_worker_that_lies_is_found_out_and_the_next_run_completes_the_cube(folder: Path, local: str) -> None:
    """In one way after the other."""
    values = "".join(f"lambda: {value}, " for value, _ in LIES.values())
    preload = folder / "lies.py"
    preload.write_text(
        "import itertools\nimport mcstudy.study.execution.attempt as attempt\nfrom collections import Counter\n"
        "from mcstudy.study.execution.tasks import TaskReport\n"
        f"lies = itertools.cycle([{values}])\nattempt.run_task = lambda task: next(lies)()\n"
    )
    out = folder / "lies.zarr"
    with cluster(folder / "lies") as made:
        made.add_worker("--preload", str(preload))
        made.wait_for(1)
        outcome = run(out, made)
    chunks = [chunk for group in Cube.open(out).groups.values() for chunk in group.layout.chunks]
    assert len(outcome.failed_blocks) == len(chunks)
    for _, reason in LIES.values():
        assert [line for line in outcome.failed_blocks if reason in line], reason
    assert all(any(r in line for _, r in LIES.values()) and "\n" not in line for line in outcome.failed_blocks)
    assert run_study(parse_study(STUDY), out, ClusterOptions(workers=1)).fits == STUDY_FITS
    assert tree_digest(out) == local


def test_a_block_that_hangs_loses_its_worker_and_the_rest_finishes(
    folder: Path, local: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(submission, "TIMED_OUT", 1)
    out = folder / "hung.zarr"
    with cluster(folder / "hung") as made:
        made.add_worker("--preload", str(folder / "hang.py"), nanny=True)
        outcome = run(out, made, block_timeout=8.0)  # an ordinary block has to stay below on a busy machine
    (line,) = outcome.failed_blocks
    assert "group odd" in line
    assert "ran longer than 8 s" in line
    assert outcome.fits == STUDY_FITS - 8
    run_study(parse_study(STUDY), out, ClusterOptions(workers=1))
    assert tree_digest(out) == local

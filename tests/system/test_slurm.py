"""A real Slurm cluster (controller and two nodes on this machine): same bytes, whatever happens to its jobs.

It takes two minutes, because Slurm's shortest time limit is one; `.ci/run` asks for it.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from chunks import complete_chunks
from slurm_here import Slurm, missing, slurm

from mcstudy.files.durable import tree_digest
from mcstudy.scheduler.cluster import ClusterOptions
from mcstudy.study.run import run_study
from mcstudy.study.study_file import parse_study

STUDY = f"""
[study]
name = "queued"
seed = 7

[group.noisy]
realizations = 8
starts = 4
fmax = [0.41]
amplitude = {[2 + k / 8 for k in range(40)]}
"""  # one chunk each

OPTIONS = """
jobs = 2
cores = 1
memory = "1GB"
time = "{time}"
interface = "lo"
folder = "{folder}"
prologue = ["export DASK_DISTRIBUTED__WORKER__PRELOAD={preload}"]
"""

# Loaded by workers: every block takes a moment; after some blocks all wait for a file.
PRELOAD = """
import os, time
import mcstudy.study.execution.attempt as attempt
from mcstudy.study.execution.tasks import run_task  # this file may be loaded twice
ran = []
def waits(task):
    ran.append(task)
    while len(ran) > 3 and not os.path.exists({go!r}):
        time.sleep(0.05)
    return run_task(task)
attempt.run_task = waits
"""

WAIT_S = 600
"""After which something counts as hung; a busy machine has its time."""

pytestmark = pytest.mark.skipif(
    os.environ.get("MCSTUDY_TEST_SLURM") != "1", reason="two minutes of a real Slurm; MCSTUDY_TEST_SLURM=1 runs it"
)


@pytest.fixture(scope="module")
def cluster() -> Iterator[Slurm]:
    if why := missing():
        pytest.skip(why)
    pytest.importorskip("dask_jobqueue")
    with tempfile.TemporaryDirectory(prefix="slurm") as folder, slurm(Path(folder)) as made:
        yield made


@pytest.fixture(scope="module")
def local(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Digest of a run on threads of one process."""
    out = tmp_path_factory.mktemp("local") / "local.zarr"
    run_study(parse_study(STUDY), out, ClusterOptions(workers=1))
    return tree_digest(out)


class Run:
    """``mcstudy run --slurm`` as a process, in a folder of its own."""

    def __init__(self, folder: Path, made: Slurm, minutes: str) -> None:
        self.out, self.go, self.made = folder / "queued.zarr", folder / "go", made
        self.folder = folder
        (folder / "queued.toml").write_text(STUDY)
        (folder / "waits.py").write_text(PRELOAD.format(go=str(self.go)))
        (folder / "slurm.toml").write_text(
            OPTIONS.format(time=minutes, folder=folder / "jobs", preload=folder / "waits.py")
        )
        self.start()

    def start(self) -> None:
        command = [sys.executable, "-m", "mcstudy", "run", "queued.toml", "-o", str(self.out), "--block", "1"]
        self.process = subprocess.Popen(
            [*command, "--slurm", "slurm.toml"],
            cwd=self.folder,
            env=self.made.environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )

    def until(self, ready: Callable[[], bool]) -> None:
        """Wait while the run goes on."""
        end = time.monotonic() + WAIT_S
        while not ready():
            assert self.process.poll() is None, self.process.communicate()[0]
            assert time.monotonic() < end, self.made.said()
            time.sleep(0.2)

    def end(self) -> str:
        """What it printed, once it has ended by itself."""
        said, _ = self.process.communicate(timeout=WAIT_S)
        return said


def test_jobs_at_their_time_limit_a_drained_node_and_a_restarted_controller_cost_nothing(
    cluster: Slurm, local: str, tmp_path: Path
) -> None:
    run = Run(tmp_path, cluster, "1")
    run.until(lambda: len(cluster.running()) == 2 and complete_chunks(run.out) >= 4)
    first = cluster.running()
    cluster.ask("scontrol", "update", "NodeName=node2", "State=DRAIN", "Reason=test")
    cluster.kill_controller()
    cluster.start_controller()
    run.until(lambda: len(cluster.running() - first) == 2 and not cluster.running() & first)
    assert cluster.ask("squeue", "-h", "-t", "R", "-o", "%N").split() == ["node1", "node1"]
    limits = [file.read_text() for file in (tmp_path / "jobs").glob("*.err")]
    assert sum("DUE TO TIME LIMIT" in text for text in limits) == 2
    run.go.touch()
    said = run.end()
    cluster.ask("scontrol", "update", "NodeName=node2", "State=RESUME")
    assert run.process.returncode == 0, said
    assert "1280 fits" in said
    assert tree_digest(run.out) == local


def test_ctrl_c_cancels_the_jobs_and_the_same_command_resumes(cluster: Slurm, local: str, tmp_path: Path) -> None:
    run = Run(tmp_path, cluster, "10")
    run.until(lambda: complete_chunks(run.out) >= 4)
    jobs = cluster.running()
    assert jobs
    run.process.send_signal(signal.SIGINT)
    said = run.end()
    assert run.process.returncode == 3, said
    assert "Traceback" not in said
    end = time.monotonic() + WAIT_S
    while cluster.jobs() & jobs:
        assert time.monotonic() < end, cluster.ask("squeue")
        time.sleep(0.2)
    assert not list((tmp_path / "jobs").glob("certificate-*"))  # nor the key of the connection
    run.go.touch()
    run.start()
    said = run.end()
    assert run.process.returncode == 0, said
    assert tree_digest(run.out) == local


def test_jobs_that_slurm_refuses_are_one_line(cluster: Slurm, tmp_path: Path) -> None:
    (tmp_path / "queued.toml").write_text(STUDY)
    (tmp_path / "slurm.toml").write_text('cores = 1\npartition = "absent"\n')
    done = subprocess.run(
        [sys.executable, "-m", "mcstudy", "run", "queued.toml", "-o", "queued.zarr", "--slurm", "slurm.toml"],
        cwd=tmp_path,
        env=cluster.environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert "expected jobs that sbatch accepts" in done.stderr
    assert "partition" in done.stderr
    assert len(done.stderr.splitlines()) == 1

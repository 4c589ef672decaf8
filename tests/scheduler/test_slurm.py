"""Options of jobs on a Slurm cluster: what is accepted, and one line for what is not."""

from __future__ import annotations

import signal
import sys
from pathlib import Path

import pytest

from mcstudy.errors import InputError
from mcstudy.scheduler.cluster import ClusterOptions
from mcstudy.scheduler.slurm import SlurmOptions, _cluster, _dask_jobqueue, read_slurm_options, slurm_client

ALL = """
jobs = 8
cores = 16
memory = "16GB"
time = "1-02:00:00"
processes = 4
partition = "normal"
account = "balance"
directives = ["--qos=short"]
prologue = ["module load python"]
folder = "jobs"
"""


def read(folder: Path, text: str) -> SlurmOptions:
    (folder / "slurm.toml").write_text(text)
    return read_slurm_options(folder / "slurm.toml")


def test_every_option_reaches_the_script_that_is_submitted(tmp_path: Path) -> None:
    pytest.importorskip("dask_jobqueue")
    with _cluster(read(tmp_path, ALL), tmp_path) as made:
        script = made.job_script()
        assert made.scheduler_address.startswith("tls://")
    for words in (
        "#SBATCH -p normal", "#SBATCH -A balance", "#SBATCH -t 1-02:00:00", "#SBATCH --cpus-per-task=16",
        "#SBATCH --mem=15G", "#SBATCH --qos=short", "module load python", "OPENBLAS_NUM_THREADS=1", "--nthreads 4",
        "--nworkers 4", f"--tls-key {tmp_path / 'key.pem'}",
    ):  # fmt: skip
        assert words in script


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("cores = 0", r"slurm.toml: cores: expected at least 1, got 0"),
        ("jobs = 2", r"slurm.toml: cores: missing"),
        ("cores = 3\nprocesses = 2", r"slurm.toml: processes: expected a divisor of cores \(3\), got 2"),
        ('cores = 1\ntime = "soon"', r"slurm.toml: time: expected .*, got 'soon'"),
        ('cores = 1\nmemory = "much"', r"slurm.toml: memory: expected .*, got 'much'"),
        ('cores = 1\npartition = "a\\nb"', r"slurm.toml: partition: expected"),
        ("cores = 1\nqueue = 2", r"slurm.toml: queue: unknown key, expected one of jobs, cores"),
        ("cores =", r"slurm.toml: not valid TOML"),
    ],
)
def test_a_mistake_is_one_line(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(InputError, match=said) as caught:
        read(tmp_path, text)
    assert "\n" not in str(caught.value)


def test_a_missing_file_a_missing_sbatch_and_two_schedulers_are_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(InputError, match="expected a readable file of Slurm options"):
        read_slurm_options(tmp_path / "absent.toml")
    options = SlurmOptions(cores=1, folder=str(tmp_path))
    with pytest.raises(InputError, match="expected one of them"):
        ClusterOptions(scheduler="tls://here:1", slurm=options)
    pytest.importorskip("dask_jobqueue")
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(InputError, match="expected the command sbatch"), slurm_client(options):
        pass
    assert not list(tmp_path.iterdir())  # the certificate is gone


def test_a_missing_library_names_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "dask_jobqueue", None)
    with pytest.raises(InputError, match="pip install dask-jobqueue cryptography"):
        _dask_jobqueue()


def test_importing_the_library_leaves_the_handler_of_ctrl_c(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("dask_jobqueue")
    for name in [n for n in sys.modules if n.split(".")[0] == "dask_jobqueue"]:
        monkeypatch.delitem(sys.modules, name)
    before = signal.getsignal(signal.SIGINT)
    _dask_jobqueue()
    assert signal.getsignal(signal.SIGINT) is before

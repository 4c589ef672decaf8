"""Workers as jobs of a Slurm cluster, submitted by dask-jobqueue; scheduler and workers talk over TLS.

The scheduler runs in this process, with a certificate made for this run. dask-jobqueue does not replace a job that has
ended (dask-jobqueue issue 611), so lost jobs are submitted again here.
"""

from __future__ import annotations

import contextlib
import math
import signal
import subprocess
import tempfile
import threading
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import dask
from dask.utils import parse_bytes
from distributed import Client
from distributed.security import Security
from pydantic import Field, StringConstraints

from mcstudy.errors import DesignError, InputError
from mcstudy.files.plain_errors import validated
from mcstudy.files.sections import Section
from mcstudy.files.toml_files import parse_toml, read_text
from mcstudy.files.unfinished import scratch_folder
from mcstudy.scheduler.companion import beside

EXTRA = "pip install dask-jobqueue cryptography"

REPLACE_S = 5.0
"""Seconds between two looks at whether jobs ended and have to be replaced."""

LOST_S = "5 s"
"""Time after which a worker that left is taken for lost, in the form Dask wants it."""

SILENT_S = 60
"""Seconds after which a worker that finds no scheduler ends its job."""

Count = Annotated[int, Field(ge=1)]

Word = Annotated[str, StringConstraints(pattern=r"^[^\s]+$")]

Line = Annotated[str, StringConstraints(pattern=r"^[^\r\n]+$")]


class SlurmOptions(Section):
    """The jobs that compute a study (a file for ``--slurm``).

    Attributes
    ----------
    jobs: number of jobs that run at the same time; a job that ends early is replaced.
    cores, memory, time: of one job, as sbatch reads the last: ``"30"`` (minutes), ``"02:00:00"``, ``"1-12:00:00"``.
    processes: processes of one job; 1 for the solver ``lm``, whose fits run on all cores of a process.
    partition, account: where jobs are submitted, and on whose account; by default those of the cluster.
    directives: further options of sbatch, such as ``--qos=short``.
    prologue: shell lines before a worker starts, such as ``module load python``.
    interface: network interface by which workers reach this machine, such as ``ib0``.
    folder: folder that all nodes share, for the jobs' logs and the certificate.
    """

    jobs: Count = 1
    cores: Count
    memory: Annotated[str, StringConstraints(pattern=r"^[0-9.]+ ?[kMGT]i?B$")] = "4GB"
    time: Annotated[str, StringConstraints(pattern=r"^[0-9]+(-[0-9]+)?(:[0-9]+){0,2}$")] = "01:00:00"
    processes: Count = 1
    partition: Word | None = None
    account: Word | None = None
    directives: tuple[Annotated[str, StringConstraints(pattern=r"^-[^\r\n]+$")], ...] = ()
    prologue: tuple[Line, ...] = ()
    interface: Word | None = None
    folder: Line = "slurm"


def read_slurm_options(path: Path) -> SlurmOptions:
    """The options in a TOML file; raises `InputError` (one line: file, key, what was expected)."""
    try:
        text = read_text(path, "file of Slurm options")
    except DesignError as error:
        raise InputError(str(error)) from None
    try:
        options: SlurmOptions = validated(SlurmOptions, parse_toml(text, "file of Slurm options"))
    except DesignError as error:
        raise InputError(f"{path}: {error}") from None
    if options.cores % options.processes:
        raise InputError(f"{path}: processes: expected a divisor of cores ({options.cores}), got {options.processes}")
    return options


@contextlib.contextmanager
def slurm_client(options: SlurmOptions) -> Iterator[Client]:
    """A client of a scheduler in this process whose workers are jobs; they are cancelled at the end.

    Raises `InputError` when dask-jobqueue is missing or sbatch refuses the jobs.
    """
    # the private key of the certificate lies in a folder that only this user reads
    with (
        scratch_folder("certificate-", _folder(options)) as private,
        dask.config.set(_SETTINGS),
        _cluster(options, private) as cluster,
    ):
        _accepted(cluster.job_script())
        replaced = partial(_replaced, cluster, options.jobs)
        with Client(cluster, set_as_default=False) as client, beside(replaced, "slurm jobs"):
            yield client


_SETTINGS: dict[str, Any] = {
    "distributed.scheduler.allowed-failures": 1_000_000,  # blocks have their own limit of attempts
    "distributed.deploy.lost-worker-timeout": LOST_S,
    "distributed.scheduler.http.routes": [],
}


def _folder(options: SlurmOptions) -> Path:
    folder = Path(options.folder).resolve()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except OSError as error:
        raise InputError(f"--slurm: folder: expected a folder that can be written, got {folder} ({error})") from None


def _cluster(options: SlurmOptions, private: Path) -> Any:
    return _dask_jobqueue().SLURMCluster(
        cores=options.cores,
        processes=options.processes,
        memory=f"{math.ceil(parse_bytes(options.memory) / 2**20)}MiB",
        walltime=options.time,
        queue=options.partition,
        account=options.account,
        job_extra_directives=list(options.directives),
        job_script_prologue=[*_THREADS, *options.prologue],
        interface=options.interface,
        log_directory=str(private.parent),
        local_directory="${TMPDIR:-/tmp}",
        death_timeout=SILENT_S,
        job_name="mcstudy",
        protocol="tls://",
        security=_certificate(private),
        scheduler_options={"dashboard": False, "dashboard_address": ":0"},
        worker_extra_args=["--no-dashboard"],
    )


def _dask_jobqueue() -> Any:
    """The library. Its import replaces the handler of Ctrl-C (version 0.9), which is put back."""
    handler = signal.getsignal(signal.SIGINT)
    try:
        import dask_jobqueue
    except ImportError:
        raise InputError(f"--slurm: expected dask-jobqueue to be installed: {EXTRA}") from None
    except ValueError:  # its import sets a handler
        raise InputError("--slurm: expected a call from the main thread of the process") from None
    signal.signal(signal.SIGINT, handler)
    return dask_jobqueue


def _certificate(private: Path) -> Security:
    """A certificate for scheduler, workers and client, in files that the jobs can read."""
    try:
        made = Security.temporary()
    except ImportError:
        raise InputError(f"--slurm: expected cryptography to be installed: {EXTRA}") from None
    cert, key = private / "cert.pem", private / "key.pem"
    cert.write_text(made.tls_ca_file)
    key.write_text(made.tls_client_key)
    roles = {
        f"tls_{role}_{part}": str(file)
        for role in ("client", "scheduler", "worker")
        for part, file in (("cert", cert), ("key", key))
    }
    return Security(require_encryption=True, tls_ca_file=str(cert), **roles)


_THREADS = tuple(f"export {name}=1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"))


def _accepted(script: str) -> None:
    """Raise `InputError` with what sbatch says when it would not accept a job script."""
    with tempfile.NamedTemporaryFile("w", suffix=".sh") as file:
        file.write(script)
        file.flush()
        try:
            tried = subprocess.run(
                ["sbatch", "--test-only", file.name], capture_output=True, text=True, timeout=60, check=False
            )
        except FileNotFoundError:
            raise InputError("--slurm: expected the command sbatch here (a login node of a Slurm cluster)") from None
        except subprocess.TimeoutExpired:
            raise InputError("--slurm: expected an answer of sbatch within 60 s; is slurmctld running?") from None
    if tried.returncode:
        said = (tried.stderr.strip().splitlines() or ["no reason given"])[-1]
        raise InputError(f"--slurm: expected jobs that sbatch accepts ({said})")


def _replaced(cluster: Any, jobs: int, over: threading.Event) -> None:
    """Submit the jobs, and submit those again that have ended, until the end."""
    while True:
        with contextlib.suppress(Exception):  # the cluster is closing, or sbatch does not answer: next time
            cluster.scale(jobs=jobs)
        if over.wait(REPLACE_S):
            return

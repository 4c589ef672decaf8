"""Where fits are run: the options that all functions share which run them."""

from __future__ import annotations

from pathlib import Path
from typing import TypedDict

from mcstudy.scheduler.cluster import ClusterOptions
from mcstudy.scheduler.slurm import read_slurm_options


class Where(TypedDict, total=False):
    """Where to run, how large a block is and how long it may take.

    Attributes
    ----------
    workers
        Threads of the local scheduler; one per core when None.
    scheduler
        Address of a running Dask scheduler, ``tls://HOST:PORT`` or ``tcp://HOST:PORT``.
    tls_ca, tls_cert, tls_key
        PEM files of a ``tls://`` scheduler: certificate authority, client certificate, its key.
    insecure
        Accept an unencrypted ``tcp://`` scheduler on another machine.
    slurm
        File of options (TOML) of the jobs that compute the study on a Slurm cluster.
    dashboard
        Serve Dask's dashboard on 127.0.0.1:8787.
    block
        Chunks per task; about 0.5 s of work when None.
    block_timeout
        Seconds that a task may take, after which its worker is restarted; no limit when None.
    """

    workers: int | None
    scheduler: str | None
    tls_ca: str | Path | None
    tls_cert: str | Path | None
    tls_key: str | Path | None
    insecure: bool
    slurm: str | Path | None
    dashboard: bool
    block: int | None
    block_timeout: float | None


def cluster_options(where: Where) -> ClusterOptions:
    """The same for the scheduler, which leaves the size of blocks to the study."""
    pem_files = where.get("tls_ca"), where.get("tls_cert"), where.get("tls_key")
    ca, cert, key = (None if pem is None else Path(pem) for pem in pem_files)
    slurm = where.get("slurm")
    return ClusterOptions(
        workers=where.get("workers"),
        scheduler=where.get("scheduler"),
        dashboard=where.get("dashboard", False),
        insecure=where.get("insecure", False),
        tls_ca=ca,
        tls_cert=cert,
        tls_key=key,
        block_timeout=where.get("block_timeout"),
        slurm=None if slurm is None else read_slurm_options(Path(slurm)),
    )

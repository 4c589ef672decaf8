"""Studies: run one and open its results, and their tables."""

from __future__ import annotations

from pathlib import Path

import xarray as xr

from mcstudy.analysis.results import open_results
from mcstudy.analysis.show.tables import report_of, show
from mcstudy.report.summary import StudySummary
from mcstudy.scheduler.cluster import ClusterOptions
from mcstudy.scheduler.slurm import read_slurm_options
from mcstudy.study.design import Study
from mcstudy.study.plan import StudyPlan, plan_study
from mcstudy.study.run import run_study
from mcstudy.study.study_file import read_study

StudyLike = Study | str | Path
"""A `Study`, the path of a study file, or the name of a shipped study."""


def cluster(
    workers: int | None,
    scheduler: str | None,
    tls_ca: str | Path | None,
    tls_cert: str | Path | None,
    tls_key: str | Path | None,
    insecure: bool,
    slurm: str | Path | None,
) -> ClusterOptions:
    """Where a study runs, from the arguments of `run`."""
    ca, cert, key = (None if pem is None else Path(pem) for pem in (tls_ca, tls_cert, tls_key))
    return ClusterOptions(
        workers=workers,
        scheduler=scheduler,
        insecure=insecure,
        tls_ca=ca,
        tls_cert=cert,
        tls_key=key,
        slurm=None if slurm is None else read_slurm_options(Path(slurm)),
    )


def plan(study: StudyLike, *, workers: int | None = None, allow_unstable: bool = False) -> StudyPlan:
    """Predict run time, size and Monte Carlo error of a study from a small pilot.

    Parameters
    ----------
    study
        A `Study`, the path of a study file, or the name of a shipped study.
    workers
        Threads assumed; one per core when None.
    allow_unstable
        Accept true parameters whose closed loop is unstable.

    Returns
    -------
    StudyPlan
        Printed, what ``mcstudy plan`` prints.

    Raises
    ------
    DesignError
        The study has a mistake, or the closed loop of its true parameters is unstable.
    """
    return plan_study(study_of(study), workers=workers, allow_unstable=allow_unstable)


def run(
    study: StudyLike,
    out: str | Path,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    tls_ca: str | Path | None = None,
    tls_cert: str | Path | None = None,
    tls_key: str | Path | None = None,
    insecure: bool = False,
    slurm: str | Path | None = None,
    quarantine: bool = False,
    allow_unstable: bool = False,
) -> xr.DataTree:
    """Run a study into a results cube, or finish what is pending in it, and open it.

    Parameters
    ----------
    study
        A `Study`, the path of a study file, or the name of a shipped study (``goodworth2018``).
    out
        Path of the cube, a ``.zarr`` folder.
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
    quarantine
        Move files in the cube's folder that do not belong to it to ``OUT.aside``; nothing is deleted.
    allow_unstable
        Accept true parameters whose closed loop is unstable.

    Returns
    -------
    xarray.DataTree
        The cube as `open_results` opens it: one node per group, with its statistics as ``.mc``. Fits that failed are
        marked in ``status``; ``mcstudy status OUT`` lists them.

    Raises
    ------
    DesignError
        The study has a mistake.
    StudyChangedError
        The cube belongs to another study.
    StoreError
        The cube cannot be used.
    Interrupted
        The run was stopped; the same call resumes it.
    """
    options = cluster(workers, scheduler, tls_ca, tls_cert, tls_key, insecure, slurm)
    run_study(study_of(study), out, options, quarantine=quarantine, allow_unstable=allow_unstable)
    return open_results(out, lazy=None)


def summary(results: xr.DataTree | str | Path, reference: xr.DataTree | str | Path | None = None) -> StudySummary:
    """The tables of a study: as text, what ``mcstudy show`` prints; in a notebook, HTML tables.

    Parameters
    ----------
    results
        What `run` or `open_results` returned, or the path of a cube, whose statistics are computed once and kept.
    reference
        Another study; groups are compared with its groups of the same name.

    Returns
    -------
    StudySummary
        Print it, or take all its numbers with ``to_dict()``.

    Raises
    ------
    StoreError
        A path is not that of a cube.
    """
    if isinstance(results, xr.DataTree) or isinstance(reference, xr.DataTree):
        tree = _tree(results)
        return StudySummary(report_of(tree, None if reference is None else _tree(reference)), lambda: tree)
    return StudySummary(show(results, reference), lambda: _tree(results))


def _tree(results: xr.DataTree | str | Path) -> xr.DataTree:
    return results if isinstance(results, xr.DataTree) else open_results(results, lazy=None)


def study_of(study: StudyLike) -> Study:
    """The study itself, or the one that a file or a name stands for."""
    return study if isinstance(study, Study) else read_study(study)

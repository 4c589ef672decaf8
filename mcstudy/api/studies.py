"""Studies: run one and open its results, and their tables."""

from __future__ import annotations

from pathlib import Path
from typing import Unpack

import xarray as xr

from mcstudy.analysis.results import open_results
from mcstudy.analysis.show.tables import report_of, show
from mcstudy.api.where import Where, cluster_options
from mcstudy.report.study.summary import StudySummary
from mcstudy.study.design import Study
from mcstudy.study.plan import StudyPlan, plan_study
from mcstudy.study.run import run_study
from mcstudy.study.study_file import read_study

StudyLike = Study | str | Path
"""A `Study`, the path of a study file, or the name of a shipped study."""


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
    quarantine: bool = False,
    allow_unstable: bool = False,
    **where: Unpack[Where],
) -> xr.DataTree:
    """Run a study into a results cube, or finish what is pending in it, and open it.

    Parameters
    ----------
    study
        A `Study`, the path of a study file, or the name of a shipped study (``goodworth2018``).
    out
        Path of the cube, a ``.zarr`` folder.
    quarantine
        Move files in the cube's folder that do not belong to it to ``OUT.aside``; nothing is deleted.
    allow_unstable
        Accept true parameters whose closed loop is unstable.
    where
        Where to run. ``workers``: threads of this process, one per core by default. ``scheduler``: address of a
        running Dask scheduler, ``tls://HOST:PORT`` with ``tls_ca``, ``tls_cert`` and ``tls_key`` (PEM files), or
        ``tcp://HOST:PORT``, on another machine with ``insecure=True``. ``slurm``: file of options (TOML) of the jobs
        that compute the study on a Slurm cluster. ``dashboard``: serve Dask's dashboard on 127.0.0.1:8787. ``block``
        and ``block_timeout``: chunks of a task, and the seconds after which it is given up.

    Returns
    -------
    xarray.DataTree
        The cube as `open_results` opens it: one node per group, with its statistics as ``.mc``. Fits that failed are
        marked in ``status``; `status` lists them.

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
    block = where.get("block")
    run_study(study_of(study), out, cluster_options(where), block, quarantine, allow_unstable=allow_unstable)
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

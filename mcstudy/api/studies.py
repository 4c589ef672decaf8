"""Studies: plan one, run it and open its results, and their tables."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Unpack

import xarray as xr

from mcstudy import adaptive
from mcstudy.analysis.results import open_results
from mcstudy.analysis.show.tables import report_of, show
from mcstudy.api.where import Where, cluster_options
from mcstudy.report.summary import StudySummary
from mcstudy.study.design import Study
from mcstudy.study.plan import StudyPlan, plan_study
from mcstudy.study.run import run_study
from mcstudy.study.study_file import read_study


def plan(study: Study | str | Path, *, workers: int | None = None, allow_unstable: bool = False) -> StudyPlan:
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
    return plan_study(_study(study), workers=workers, allow_unstable=allow_unstable)


def run(
    study: Study | str | Path,
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
    options = cluster_options(where)
    run_study(_study(study), out, options, where.get("block"), quarantine, allow_unstable=allow_unstable)
    return open_results(out, lazy=None)


def run_until(
    study: Study | str | Path,
    out: str | Path,
    until: str,
    budget_fits: int,
    *,
    quarantine: bool = False,
    allow_unstable: bool = False,
    say: Callable[[str], object] = str,
    **where: Unpack[Where],
) -> adaptive.Until:
    """Run a study, and add realizations or starts until its Monte Carlo error is small enough.

    Parameters
    ----------
    study, out
        As for `run`.
    until
        ``"bias=1%"`` or ``"mean_bias=1%"``: the largest Monte Carlo standard error of the bias of a parameter, or of
        the mean of all biases, in percent of the truth.
    budget_fits
        Upper limit on the total number of fits in the cube.
    quarantine, allow_unstable
        As for `run`.
    say
        Called with one line for every extension.
    where
        Where to run, as for `run`.

    Returns
    -------
    Until
        ``reached``, ``statement`` (one line about the final state), ``steps`` (one line per extension), ``outcome``
        (the fits of all rounds). Open the cube with `open_results`.

    Raises
    ------
    InputError
        No group has noise, the target is none, or the study alone exceeds the budget.
    DesignError, StudyChangedError, StoreError, Interrupted
        As for `run`.
    """
    target, block = adaptive.parse_target(until), where.get("block")
    return adaptive.run_until(
        _study(study),
        out,
        target,
        budget_fits,
        cluster_options(where),
        block,
        say,
        quarantine,
        allow_unstable=allow_unstable,
    )


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


def _study(study: Study | str | Path) -> Study:
    return study if isinstance(study, Study) else read_study(study)

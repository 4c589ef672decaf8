"""Studies: run one and open its results, and their tables."""

from __future__ import annotations

from pathlib import Path

import xarray as xr

from mcstudy.analysis.results import open_results
from mcstudy.report.summary import StudySummary
from mcstudy.scheduler.cluster import ClusterOptions
from mcstudy.study.design import Study
from mcstudy.study.run import run_study
from mcstudy.study.study_file import read_study


def run(
    study: Study | str | Path,
    out: str | Path,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    tls_ca: str | Path | None = None,
    tls_cert: str | Path | None = None,
    tls_key: str | Path | None = None,
    insecure: bool = False,
    quarantine: bool = False,
    allow_unstable: bool = False,
) -> xr.DataTree:
    """Run a study into a results cube, or finish what is pending in it, and open it.

    Parameters
    ----------
    study: a `Study`, the path of a study file, or the name of a shipped study (``goodworth2018``).
    out: path of the cube (a ``.zarr`` folder).
    workers: threads of the local scheduler, one per core when None. scheduler: address of a running Dask scheduler,
        with its ``tls_ca``, ``tls_cert`` and ``tls_key`` (PEM files); ``insecure`` accepts tcp:// on another machine.
    quarantine: move files that are no part of the cube to a folder beside it.
    allow_unstable: accept true parameters whose closed loop is unstable.

    Returns the cube as `open_results` does: one node per group, ``.mc`` its statistics. Fits and blocks that failed are
    in the arrays as such (``status``); ``mcstudy status OUT`` lists them.

    Raises `DesignError` for a mistake in the study, `StudyChangedError` when the cube belongs to another study,
    `StoreError` when it cannot be used, and `Interrupted` when stopped; the same call resumes.
    """
    if not isinstance(study, Study):
        study = read_study(study)
    ca, cert, key = (None if pem is None else Path(pem) for pem in (tls_ca, tls_cert, tls_key))
    options = ClusterOptions(
        workers=workers, scheduler=scheduler, insecure=insecure, tls_ca=ca, tls_cert=cert, tls_key=key
    )
    run_study(study, out, options, quarantine=quarantine, allow_unstable=allow_unstable)
    return open_results(out, lazy=None)


def summary(results: xr.DataTree | str | Path, reference: xr.DataTree | str | Path | None = None) -> StudySummary:
    """The tables of a study: printed, what `mcstudy show` prints; in a notebook, tables.

    Parameters
    ----------
    results: what `run` or `open_results` returned, or the path of a cube.
    reference: another study, whose groups are compared with those of the same name.

    ``to_dict()`` gives the numbers, as ``results_schema`` describes (``show.json``).
    """
    return StudySummary(_tree(results), None if reference is None else _tree(reference))


def _tree(results: xr.DataTree | str | Path) -> xr.DataTree:
    return results if isinstance(results, xr.DataTree) else open_results(results, lazy=None)
